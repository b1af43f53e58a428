# SPDX-License-Identifier: BSD-2-Clause
"""The content of files that describe a robot."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from copy import deepcopy
from pathlib import Path

from ..errors import DescriptionError

#: Size of a description at most, [byte]; the largest of real robots has half a million.
_LARGEST = 16 * 2**20
#: What an XML says of its own encoding.
_ENCODING = re.compile(rb"""\s*<\?xml[^>]*encoding=["']([\w.:-]+)""")
#: Prefixes that an XML declares.
_DECLARED = re.compile(r"xmlns:([\w.-]+)\s*=")
#: Attributes that are names, blanks included.
_NAMES = {"name", "link", "filename"}
#: Links, joints and others; Pinocchio goes down a tree by recursion, deep enough to crash.
_MOST_ELEMENTS = 10_000


def is_mjcf(path: Path) -> bool:
    """Whether a file is an MJCF, by its ending; else a URDF."""
    return path.suffix.lower() in (".xml", ".mjcf")


def read_text(path: str | Path, what: str) -> str:
    """The content of a description file; one that is too large for a robot is refused."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(_LARGEST + 1)
        said = _ENCODING.match(content)
        wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
        text = content.decode("utf-16" if wide else said[1].decode() if said else "utf-8-sig")
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise DescriptionError(str(path), [f"the {what} cannot be read: {error}"]) from None
    if len(content) > _LARGEST:
        raise DescriptionError(str(path), [f"the {what} has more than {_LARGEST} bytes"])
    return text


def parse_xml(text: str, source: str, what: str = "a URDF") -> ET.Element:
    """The elements of a URDF or an SRDF; errors have line and column."""
    try:
        root = ET.fromstring(_declared(text))
    except ET.ParseError as error:
        raise DescriptionError(source, [f"not {what}: not XML: {error}"]) from None
    if len(root) > _MOST_ELEMENTS:
        text = f"not {what}: {len(root)} elements; at most {_MOST_ELEMENTS} are supported"
        raise DescriptionError(source, [text])
    return root


def _declared(text: str) -> str:
    """The text with prefixes declared that other tools use without: `drake:`, say."""
    prefixes = set(re.findall(r"</?([A-Za-z_][\w.-]*):", text)) - set(_DECLARED.findall(text))
    names = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in sorted(prefixes))
    return re.sub(r"<(robot|sdf)\b", rf"<\1{names}", text, count=1) if names else text


def bare(root: ET.Element, kept: Mapping[str, Collection[str]]) -> ET.Element:
    """Links, joints and others with some of their elements, one blank between numbers."""
    found = ET.Element(root.tag, root.attrib)
    for element in (element for element in root if element.tag in kept):
        copy = ET.SubElement(found, element.tag, element.attrib)
        copy.extend(deepcopy(child) for child in element if child.tag in kept[element.tag])
        for part in (part for child in copy for part in child.iter()):
            for key in part.attrib.keys() - _NAMES:
                part.set(key, " ".join(part.attrib[key].split()))
    return found
