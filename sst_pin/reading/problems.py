# SPDX-License-Identifier: BSD-2-Clause
"""Problems of files, and functions that read numbers and attributes from the texts of files.

Functions that read a text return None for a text that is wrong, or raise a ValueError, which
`collecting_problems` adds to a list of problems.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..summaries import listed

#: Texts that urdfdom and MuJoCo read as the same number.
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: An unknown name counts as a misspelling of a known name if their similarity, from 0 to 1, is at
#: least this one: four of five letters are the same.
ALIKE = 0.8
#: A shorter axis counts as zero: below 1e-154 the square of its length underflows.
SHORTEST_AXIS = 1e-100


@dataclass(frozen=True)
class Problem:
    """A problem of a robot's files.

    Attributes:
        severity: "error" if the robot cannot be computed or drawn, "warning" if it is probably not
            what was meant, "note" for what other tools read otherwise.
        where: The element with the problem: "link foot", "joint knee", "closure A - B".
        text: The problem in one sentence.

    Example:
        >>> urdf = '<robot name="r"><link name="a"/><link name="b"/></robot>'
        >>> with open("two.urdf", "w") as file:
        ...     _ = file.write(urdf)
        >>> for problem in sst_pin.validate("two.urdf"):
        ...     print(problem)
        error: tree: 2 links without a parent: a, b; only the base may have none
    """

    severity: str
    where: str
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.text}"


#: From the worst on.
SEVERITIES = ("error", "warning", "note")
#: Constructors for each severity, with the arguments `where` and `text`.
error = partial(Problem, "error")
warning = partial(Problem, "warning")
note = partial(Problem, "note")


def merged(problems: Iterable[Problem]) -> Iterator[Problem]:
    """The problems, where notes of several links or joints with the same text are one note."""
    names_by_note = dict[tuple[str, str], list[str]]()  # the note: its kind of element and its text
    for problem in problems:
        if problem.severity == "note":
            kind, _, name = problem.where.partition(" ")  # "link foot"
            names_by_note.setdefault((kind, problem.text), []).append(name)
        else:
            yield problem
    for (kind, text), names in names_by_note.items():
        if len(names) > 1:
            yield note(f"{kind}s {listed(names)}", text)
        else:
            yield note(f"{kind} {names[0]}".strip(), text)


@contextmanager
def collecting_problems(problems: list[str], where: str = "") -> Iterator[None]:
    """Add the ValueError of a block to problems, and continue after the block.

    The texts of problems start with `where`.
    """
    try:
        yield
    except DescriptionError as caught:
        problems.extend(f"{where}{text}" for text in caught.problems)
    except ValueError as caught:
        problems.append(f"{where}{caught}")


def numbers(text: str, count: int) -> Array | None:
    """The numbers in a text, shape (count,); None if they are not finite or not as many."""
    words = text.split()
    if len(words) != count or not all(map(_NUMBER.fullmatch, words)):
        return None
    values = np.array(words, dtype=float)
    return values if np.isfinite(values).all() else None


def is_true(text: str | None) -> bool:
    """Whether a text is one of the words of XML for true."""
    return (text or "").strip().lower() in ("true", "1")


def stands_for(text: str, value: float) -> bool:
    """Whether all numbers in a text have this value, as in "0 0 0"; true and false are 1 and 0."""
    words = {"true": "1", "false": "0"}.get(text.strip().lower(), text)
    values = numbers(words, len(words.split()))
    return values is not None and bool((values == value).all())


def unknown_parts(
    element: ET.Element,
    *,
    tags: Collection[str] = (),
    attributes: Collection[str] = (),
    several: Collection[str] = (),
    others: bool = False,
) -> Iterator[str]:
    """Faults of an element that changes the motion: parts that are unknown or repeated.

    Its parts are its attributes and the elements in it. An unknown one could change the motion too.

    Args:
        element: The element.
        tags: Tags of known elements in it, each at most once.
        attributes: Names of its known attributes.
        several: Tags of known elements of which there may be several.
        others: Whether other tools may add parts. If so, an unknown part is a fault only if its
            name looks like the misspelling of a known one.
    """
    for tag, count in Counter(child.tag for child in element).items():
        if count > 1 and tag in tags:
            yield f"{count} <{tag}>; only one is allowed"
    for tag in dict.fromkeys(child.tag for child in element):
        if tag in tags or tag in several:
            continue
        similar = get_close_matches(tag.lower(), [*tags, *several], 1, ALIKE)
        if similar:
            yield f"<{tag}> is unknown; did you mean {similar[0]}?"
        elif not others:
            yield f"<{tag}> in <{element.tag}> is not supported"
    for key in element.attrib:
        if key in attributes or key.startswith("xmlns"):
            continue
        similar = get_close_matches(key.lower(), attributes, 1, ALIKE)
        if similar:
            yield f"<{element.tag} {key}=...> is unknown; did you mean {similar[0]}?"
        elif not others:
            known = f"; it has {', '.join(attributes)}" if attributes else ""
            yield f"<{element.tag}> has no {key}{known}"


def vector(value: object) -> Array | None:
    """Three numbers in a list of a YAML, shape (3,); None for anything else.

    The scalars of the YAML are texts.
    """
    if not isinstance(value, list):
        return None
    for word in value:
        if not isinstance(word, str) or numbers(word, 1) is None:
            return None
    return numbers(" ".join(value), 3)


def number(element: ET.Element | None, key: str) -> float | None:
    """An attribute that is one finite number, or None."""
    value = None if element is None else numbers(element.get(key, ""), 1)
    return None if value is None else float(value[0])


def attribute(element: ET.Element, path: str) -> str:
    """An attribute of an element, or of one in it as `tag/attribute`; empty without it."""
    tag, _, key = path.rpartition("/")
    holder = element.find(tag) if tag else element
    return "" if holder is None else holder.get(key, "")


def direction(text: str) -> Array:
    """The unit vector with the direction of three numbers, shape (3,); a ValueError without one."""
    axis = numbers(text, 3)
    if axis is None or not np.linalg.norm(axis) > SHORTEST_AXIS:
        raise ValueError(f"axis {text!r} is not a direction")
    return axis / np.linalg.norm(axis)


def placement(xyz: Array, rpy: Array) -> pin.SE3:
    """The placement of a frame, by its origin [m] and its roll, pitch and yaw [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
