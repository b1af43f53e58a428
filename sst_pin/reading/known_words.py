# SPDX-License-Identifier: BSD-2-Clause
"""Known words of an element of an XML file; unknown words are reported: they may matter.

A table has a row of words for a tag, or for `tag/tag` inside another: elements, and attributes as
`@name`. `word+` may stand several times, `word=0` with this value only; `*=0` is any other word
with this value, and `...` any other word that is no misspelling. Elements without a row are not
looked into.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping
from difflib import get_close_matches

from .problems import numbers

#: Similarity of words above which one is taken for a misspelling of the other.
_ALIKE = 0.8


def is_true(text: str | None) -> bool:
    """Whether a text is XML's true."""
    return (text or "").strip().lower() in ("true", "1")


def unknown(element: ET.Element, table: Mapping[str, str], row: str = "") -> Iterator[str]:
    """Words of an element and of its descendants that are not in the table."""
    tag = element.tag
    words = {w.partition("=")[0].rstrip("+"): w for w in table[row or tag].split()}
    content = [(f"@{key}", text) for key, text in element.items() if not key.startswith("xmlns")]
    content += [(child.tag, child.text or "") for child in element]
    for name, count in Counter(name for name, _ in content).items():
        if count > 1 and name in words and not words[name].endswith("+"):
            yield f"{count} <{name}>; only one is allowed"
    for name, text in content:
        mark, key = name[: name.startswith("@")], name.lstrip("@")
        word = words.get(name, words.get("*", ""))
        value = word.partition("=")[2]
        if name not in words:
            known = [w.lstrip("@") for w in words if w.startswith("@") == bool(mark)]
            shown = f"<{tag} {key}=...>" if mark else f"<{key}>"
            if near := get_close_matches(key.lower(), known, 1, _ALIKE):
                yield f"{shown} is unknown; did you mean {near[0]}?"
                continue
            if not word and "..." not in words:
                has = f"<{tag}> has no {key}{'; it has ' * bool(known)}{', '.join(known)}"
                yield has if mark else f"{shown} in <{tag}> is not supported"
        if value and not means(text, value):
            yield f"<{tag}> with {key} {text.strip()!r} is not supported"
    for child in element:
        inside = f"{tag}/{child.tag}"
        row = inside if inside in table else child.tag
        if child.tag in words and row in table:
            named = f"{child.tag} {child.get('name')}: " if "name" in child.attrib else ""
            yield from (named + text for text in unknown(child, table, row))


def means(text: str, value: str) -> bool:
    """Whether a text has a value: a number, perhaps repeated, or true or false for 1 or 0."""
    text = {"true": "1", "false": "0"}.get(text.strip().lower(), text)
    values = numbers(text, len(text.split()))
    return values is not None and bool((values == float(value)).all())
