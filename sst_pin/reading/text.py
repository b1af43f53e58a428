# SPDX-License-Identifier: BSD-2-Clause
"""The texts of files that describe a robot, and their elements if they are XML."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from copy import deepcopy
from pathlib import Path
from xml.parsers import expat

from ..errors import DescriptionError
from .problems import Problem, warning

#: Largest size of a description, [byte]; the largest one of a real robot has half a million.
_LARGEST = 16 * 2**20
#: The encoding that an XML declares.
_ENCODING = re.compile(rb"""\s*<\?xml[^>]*encoding=["']([\w.:-]+)""")
_COMMENT = re.compile("<!--.*?-->", re.S)
#: Attributes that are names, blanks included.
_NAMES = {"name", "link", "filename"}
#: Largest number of links, joints and other elements: Pinocchio crashes in the recursion of deep
#: trees.
_MOST_ELEMENTS = 10_000


def is_mjcf(path: Path) -> bool:
    """Whether a file is an MJCF, by its ending; else a URDF."""
    return path.suffix.lower() in (".xml", ".mjcf")


def read_text(path: str | Path, what: str) -> str:
    """The content of a description file; one that is too large for a robot is refused."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(_LARGEST + 1)
        text = content.decode(_encoding_of(content))
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise DescriptionError(str(path), [f"the {what} cannot be read: {error}"]) from None
    if len(content) > _LARGEST:
        raise DescriptionError(str(path), [f"the {what} has more than {_LARGEST} bytes"])
    return text


def _encoding_of(content: bytes) -> str:
    """The encoding of a file, by its first bytes or as its XML declares it."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    declared = _ENCODING.match(content)
    if declared is not None:
        return declared[1].decode()
    return "utf-8-sig"


def parse_xml(text: str, source: str, what: str = "a URDF") -> ET.Element:
    """The elements of a URDF or an SRDF; errors have line and column.

    Prefixes such as `drake:` stay in the tags, whether or not the file declares them.
    """
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise DescriptionError(source, [f"not {what}: not XML: {error}"]) from None
    root: ET.Element = builder.close()
    if len(root) > _MOST_ELEMENTS:
        text = f"not {what}: {len(root)} elements; at most {_MOST_ELEMENTS} are supported"
        raise DescriptionError(source, [text])
    return root


def parse_almost_xml(text: str, source: str, what: str) -> tuple[ET.Element, list[Problem]]:
    """The elements of a file, also of one that is not XML and that other tools read nevertheless.

    Such files have `--` in comments, or white space before `<?xml`. A warning names this fault.
    """
    try:
        return parse_xml(text, source, what), []
    except DescriptionError as caught:
        # Comments become empty lines, so that the numbers of the other lines stay.
        plain = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text.lstrip())
        try:
            root = parse_xml(plain, source, what)
        except DescriptionError:
            raise caught from None
        fault = caught.problems[0].partition("not XML: ")[2]
        return root, [warning("file", f"not XML: {fault}; read as if it were")]


def with_elements(root: ET.Element, tags: Mapping[str, Collection[str]]) -> ET.Element:
    """A copy of a robot with some of its elements, such as links and joints.

    `tags` has the tags of the elements that are copied and, for each, the tags of the parts that
    are copied with it. White space between the numbers of an attribute becomes one blank, which is
    what urdfdom needs.
    """
    root_copy = ET.Element(root.tag, root.attrib)
    for element in root:
        if element.tag not in tags:
            continue
        copy = ET.SubElement(root_copy, element.tag, element.attrib)
        for child in element:
            if child.tag in tags[element.tag]:
                copy.append(deepcopy(child))
        for child in copy:
            for part in child.iter():
                for key in part.attrib.keys() - _NAMES:
                    part.set(key, " ".join(part.attrib[key].split()))
    return root_copy
