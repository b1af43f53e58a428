# SPDX-License-Identifier: BSD-2-Clause
"""Keys and values of a YAML; scalars are unchanged strings."""

import reprlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import accumulate
from typing import Any, TypeVar

import yaml

from ..errors import DescriptionError
from .problems import numbers, telling

#: The most characters of a YAML; that of a robot with 400 joints has a tenth of it.
_LONGEST = 200_000
#: Depth of brackets in brackets; two are needed.
_DEEPEST = 50
_BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}

_T = TypeVar("_T")


class YamlContent(dict[str, Any]):
    """The content of a YAML, with the problems that its readers find."""

    def __init__(self, text: str, source: str) -> None:
        super().__init__(_content(text, source))
        self._source, self.problems = source, list[str]()

    def require_known(self, keys: Collection[str]) -> None:
        """Report the keys that are not known."""
        known = ", ".join(keys)
        self.problems += [f"{key}: unknown; known: {known}" for key in self if key not in keys]

    def entries(self, key: str, parse: Callable[..., _T], kind: type[Any] = list) -> list[_T]:
        """The entries of a list, or the names and values of a mapping, each parsed."""
        value, results = self.get(key, kind()), list[_T]()
        if not isinstance(value, kind):
            what = "list" if kind is list else "mapping from names"
            self.problems.append(f"{key}: a {what} is needed")
            return results
        for entry in value:
            with telling(self.problems, f"{key}: "):
                results.append(parse(entry, value[entry]) if kind is dict else parse(entry))
        return results

    def zipped(self, lists: Mapping[str, list[Any]], first: str, second: str) -> list[Any]:
        """Pairs of the entries of two lists; reports lists of different length."""
        if (m := len(self.get(first, ()))) != (n := len(self.get(second, ()))):
            self.problems.append(f"{first} has {m} entries, {second} has {n}")
        return list(zip(lists[first], lists[second], strict=False))

    def raise_problems(self) -> None:
        """Raise an error that lists all problems, if there are any."""
        if self.problems:
            raise DescriptionError(self._source, self.problems)


def repeated(names: Iterable[str]) -> list[str]:
    """Names that appear more than once."""
    return [name for name, count in Counter(names).items() if count > 1]


def name_in(value: Any) -> str:
    """A name; a ValueError for anything else."""
    if not isinstance(value, str) or not value:
        raise ValueError(f"{shown(value)} is not a name")
    return value


def number_in(value: Any, key: str = "") -> float:
    """A number; a ValueError for anything else, with the key of it."""
    number = numbers(value, 1) if isinstance(value, str) else None
    if number is None:
        raise ValueError(f"{key} {shown(value)} is not a number".lstrip())
    return float(number[0])


def pair_in(value: Any) -> tuple[str, str]:
    """Two names; a ValueError for anything else."""
    names = value if isinstance(value, list) else []
    if len(names) != 2 or not all(isinstance(name, str) and name for name in names):
        raise ValueError(f"{shown(value)} is not a pair of frame names")
    return names[0], names[1]


def mapping_in(value: Any, keys: Collection[str] = ()) -> dict[str, Any]:
    """A mapping, with no keys but these; a ValueError for anything else."""
    if not isinstance(value, dict):
        raise ValueError(f"{shown(value)} is not a mapping")
    if unknown := [key for key in value if keys and key not in keys]:
        raise ValueError(f"{', '.join(unknown)} unknown; known: {', '.join(keys)}")
    return value


def numbers_in(value: Any, **defaults: str | None) -> list[float]:
    """Numbers of a mapping by their keys; a ValueError for others, or if one is missing."""
    fields = {**defaults, **mapping_in(value, defaults)}
    if missing := [key for key, number in fields.items() if number is None]:
        raise ValueError(f"{shown(value)} has no {missing[0]}")
    return [number_in(number, key) for key, number in fields.items()]


def shown(value: Any) -> str:
    """A short form of a value; aliases can make a few lines of YAML a list of lists of lists."""
    short = reprlib.Repr()
    short.maxlevel = 2
    return short.repr(value)


class _Loader(yaml.BaseLoader):
    """Scalars are strings; a key that appears twice in a mapping is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        for key in repeated(key for key in keys if isinstance(key, str)):
            raise ValueError(f"{key}: appears twice")
        return super().construct_mapping(node, deep)


def _content(text: str, source: str) -> dict[str, Any]:
    problem, content = "no keys; name_mot is needed", None
    if len(text) > _LONGEST:
        problem = f"more than {_LONGEST} characters"
    elif max(accumulate(_BRACKETS.get(c, 0) for c in text), default=0) > _DEEPEST:  # slow to scan
        problem = "lists are nested too deeply"
    else:
        try:
            content = yaml.load(text, _Loader)
        except yaml.YAMLError as error:
            text = " ".join(str(error).split())
            problem = "not YAML: " + text.replace('in "<unicode string>", ', "at ")
        except ValueError as error:
            problem = str(error)
        except RecursionError:
            problem = "lists are nested too deeply"
    if not isinstance(content, dict) or not content:
        raise DescriptionError(source, [problem])
    return content
