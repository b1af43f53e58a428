# SPDX-License-Identifier: BSD-2-Clause
"""Texts with a few things changed, for hypothesis."""

import re
import xml.etree.ElementTree as ET
from typing import Any

import yaml
from hypothesis import strategies as st

#: Words in the place of a number, and numbers at the edge.
NUMBERS = (
    "", " ", "0", "-0", "1", "-1", "0.3", "1e-9", "1e9", "+.5", "5.", "nan", "-inf", "1e999",
    "1e-999", "0,3", "0.3kg", "0.3 kg", "${m}", "$(arg m)", "1_0", "0x1p3", "0x10", "\u0663", "1d3",
    "1e", "--1",
    "1 2", "1 2 3", "0 0 0", "0 0 1", "1 2 3 4", "1\n2\t3", " 0.5 ", "0.5\t", "1;2;3", "[1, 2, 3]",
    "true", "None", "9" * 400, "0." + "0" * 400 + "1", "pi", "1/2", "1e308", "4.9e-324", "\u22121",
)  # fmt: skip
_CHARACTERS = "<>\"'=/&;[]{}:,.-#!*|\n\t 09aeEnN\0\u00e9\ufeff"
_WORDS = ("", "x", "crank", "rocker", "end", "pivot", "revolute", "prismatic", "fixed", "0")


@st.composite
def broken_text(draw: st.DrawFn, text: str) -> str:
    """A character put in, left out or exchanged, a piece doubled, or the end cut off."""
    i = draw(st.integers(0, len(text) - 1))
    j = min(len(text), i + draw(st.integers(1, 60)))
    character = draw(st.sampled_from(_CHARACTERS))
    ways = (
        text[:i] + character + text[i:],
        text[:i] + text[i + 1 :],
        text[:i] + character + text[i + 1 :],
        text[:i] + text[i:j] * 2 + text[j:],
        text[:i] + text[j:],
        text[:i],
    )
    return draw(st.sampled_from(ways))


@st.composite
def changed_xml(draw: st.DrawFn, text: str) -> str:
    """One to three changes of elements or attributes, or of the text itself."""
    if draw(st.integers(0, 9)) == 0:
        return draw(broken_text(text))
    root = ET.fromstring(text)
    for _ in range(draw(st.integers(1, 3))):
        _change(draw, root)
    return ET.tostring(root, encoding="unicode")


def _change(draw: st.DrawFn, root: ET.Element) -> None:
    elements = list(root.iter())
    element = draw(st.sampled_from(elements))
    ways = ["number", "number", "number", "word", "remove", "double", "move", "rename", "key"]
    way = draw(st.sampled_from(ways))
    numeric = [
        (e, key)
        for e in elements
        for key, value in e.attrib.items()
        if re.fullmatch(r"[-+0-9.e ]+", value)
    ]
    parents = {child: parent for parent in elements for child in parent}
    if way == "number" and numeric:
        e, key = draw(st.sampled_from(numeric))
        e.set(key, draw(st.sampled_from(NUMBERS) | st.floats(-5, 5).map(repr)))
    elif element.attrib and way in ("word", "key"):
        key = draw(st.sampled_from(sorted(element.attrib)))
        if way == "word":
            element.set(key, draw(st.sampled_from(_WORDS)))
        else:
            element.set(key + draw(st.sampled_from("sX")), element.attrib.pop(key))
    elif element in parents and way in ("remove", "double", "move"):
        parent = parents[element]
        if way == "double":
            parent.append(element)
        else:
            parent.remove(element)
            if way == "move":
                others = [e for e in elements if e not in list(element.iter())]
                draw(st.sampled_from(others)).append(element)
    elif way == "rename":
        element.tag = draw(st.sampled_from(sorted({e.tag for e in elements} | {"x"})))


_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1e9, float("nan"), float("inf"), 10**400, "", "x", "crank", "end", "3d",
    "6d", "9,81",
    [], [[]], {}, {"x": 1}, ["end", "pivot"], [["end", "pivot"]], [0, 0, -9.81], ["crank"],
)  # fmt: skip


@st.composite
def changed_yaml(draw: st.DrawFn, text: str) -> str:
    """One or two values changed, added or left out, or the text broken."""
    if draw(st.integers(0, 4)) == 0:
        return draw(broken_text(text))
    content = yaml.safe_load(text)
    for _ in range(draw(st.integers(1, 2))):
        if not content:
            break
        key = draw(st.sampled_from(sorted(content)))
        ways = ("value", "entry", "entry", "remove", "rename", "add", "double")
        way = draw(st.sampled_from(ways))
        if way == "value":
            content[key] = draw(st.sampled_from(_VALUES) | st.floats(-9, 9))
        elif way == "remove":
            del content[key]
        elif way == "rename":
            content[draw(st.sampled_from((key.upper(), key + "s", " " + key)))] = content.pop(key)
        elif way == "add":
            key = draw(st.sampled_from(("gravitiy", "x", "joint_name")))
            content[key] = draw(st.sampled_from(_VALUES))
        elif isinstance(content[key], list) and content[key]:
            i = draw(st.integers(0, len(content[key]) - 1))
            if way == "double":
                content[key].append(content[key][i])
            else:
                content[key][i] = draw(st.sampled_from(_VALUES) | st.floats(-9, 9))
    return yaml.safe_dump(content)
