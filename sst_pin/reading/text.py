# SPDX-License-Identifier: BSD-2-Clause
"""The content of files that describe a robot."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from ..errors import DescriptionError

#: Size of a description at most, [byte]; the largest of real robots has half a million.
_LARGEST = 16 * 2**20
#: Links, joints and others; Pinocchio goes down a tree by recursion, deep enough to crash.
_MOST_ELEMENTS = 10_000


def is_mjcf(path: Path) -> bool:
    """Whether a file is an MJCF, by its ending; else a URDF."""
    return path.suffix.lower() in (".xml", ".mjcf")


def read_text(path: str | Path, what: str) -> str:
    """The content of a description file.

    Raises:
        DescriptionError: When it cannot be read, or is too large for a robot.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(_LARGEST + 1)
        text = content.decode("utf-8-sig")
    except (OSError, ValueError, TypeError) as error:
        raise DescriptionError(str(path), [f"the {what} cannot be read: {error}"]) from None
    if len(content) > _LARGEST:
        raise DescriptionError(str(path), [f"the {what} has more than {_LARGEST} bytes"])
    return text


def parse_xml(text: str, source: str, what: str = "a URDF") -> ET.Element:
    """The elements of a URDF or an SRDF.

    Raises:
        DescriptionError: When it is not XML, with line and column, which urdfdom does not say; or
            when it is larger than any robot.
    """
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise DescriptionError(source, [f"not {what}: not XML: {error}"]) from None
    if len(root) > _MOST_ELEMENTS:
        text = f"not {what}: {len(root)} elements; at most {_MOST_ELEMENTS} are supported"
        raise DescriptionError(source, [text])
    return root
