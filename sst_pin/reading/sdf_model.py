# SPDX-License-Identifier: BSD-2-Clause
"""One model of an SDF: its elements and frames, with the problems and notes of its readers."""

import xml.etree.ElementTree as ET

from .problems import Problem, numbers
from .sdf_frames import SdfFrames
from .sdf_nesting import without_nested_models


class SdfModel:
    """A model of an SDF without inner models.

    Attributes:
        element: The `<model>`.
        name: Its name.
        links: Its links, by name.
        frames: Its frames.
        problems: What cannot be read. The readers of the model add to them.
        notes: Warnings of content that is not read, or that is missing and has a default. The
            readers add to them too.
    """

    def __init__(self, element: ET.Element, is_in_world: bool) -> None:
        self.element, self.problems = without_nested_models(element)
        self.name = self.element.get("name", "")
        self.notes = list[Problem]()
        self.links = {link.get("name", ""): link for link in self.element.findall("link")}
        self.frames = SdfFrames(self.element, is_in_world, self.problems)

    def refuse(self, element: ET.Element, text: str) -> None:
        """Add a problem with an element of the model."""
        self.problems.append(f"{element.tag} {element.get('name')}: {text}")

    def number(
        self, element: ET.Element, path: str, default: float, *, part: ET.Element | None = None
    ) -> float:
        """The number at a path in an element, or the default without a text there.

        The path starts at `part`, a part of the element, if there is one. A text that is no number
        adds a problem of the element.
        """
        start = element if part is None else part
        text = start.findtext(path, "").strip() or repr(default)
        if text.lstrip("+-").lower() in ("inf", "infinity"):
            return float(text)
        value = numbers(text, 1)
        if value is None:
            self.refuse(element, f"{path} {text!r} is not a number")
            return default
        return float(value[0])
