# SPDX-License-Identifier: BSD-2-Clause
"""Keys and values of a YAML; scalars are unchanged strings.

`YamlContent` is the mapping of the whole file. Functions such as `name_in` and `number_in` read one
value; they raise a ValueError for a wrong one.
"""

import reprlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from difflib import get_close_matches
from itertools import accumulate
from typing import Any, TypeVar

import yaml

from ..errors import DescriptionError
from .problems import collecting_problems, numbers

#: Largest number of characters; the YAML of a robot with 400 joints has a tenth of it.
_MAX_LENGTH = 200_000
#: Largest depth of nested brackets; two are needed, and PyYAML is slow for many.
_MAX_DEPTH = 50
#: How much a bracket changes the depth of what follows it.
_DEPTH_CHANGE = {"[": 1, "{": 1, "]": -1, "}": -1}

#: Known keys, by unknown keys that mean the same. An error about the unknown key proposes the known
#: one. Some of the unknown keys are arguments of `ClosedChain`.
_SAME_MEANING = {
    "closures": "closed_loop",
    "lines": "line_force",
    "forces": "line_force",
    "ropes": "contacts",
    "actuated": "name_mot",
    "motors": "name_mot",
    "springs": "joint_spring",
    "stiffness": "joint_spring",
    "damping": "viscous_friction",
    "limits": "joint_limit",
}
#: The same for unknown keys in one entry of the file, such as one contact. A key can be known in
#: one kind of entry and unknown in another: a line has `frames`, but the frames of a rope are
#: called `rope`. So a known key is proposed only if the entry can have it.
_SAME_MEANING_IN_ENTRY = {
    "frame_a": "frames",
    "frame_b": "frames",
    "sites": "frames",
    "site": "frame",
    "mu": "friction",
    "k": "stiffness",
    "d": "damping",
    "length": "rest_length",
    "max_length": "length",
    "frames": "rope",
    "min": "lower",
    "max": "upper",
    "force": "effort",
    "q0": "reference",
    "rest": "reference",
    "inertia": "rotor_inertia",
    "ratio": "gear_ratio",
}
#: Examples, for messages, of the lists that users type by hand.
_EXAMPLES = {
    "contacts": "[{frame: sole, friction: 0.8}]",
    "brakes": "[axis_1]",
    "line_force": "[{frames: [a, b], stiffness: 900}]",
    "locked": "[axis_1]",
    "name_mot": "[axis_1, axis_2]",
}
#: Keys of lists whose entries are mappings.
_LISTS_OF_MAPPINGS = ("contacts", "line_force")

_T = TypeVar("_T")


class YamlContent(dict[str, Any]):
    """The content of a YAML, with the problems that its readers find."""

    def __init__(self, text: str, source: str) -> None:
        super().__init__(_content(text, source))
        self._source = source
        self.problems = list[str]()

    def require_known(self, keys: Collection[str]) -> None:
        """Report each key that is not known, and propose a known one."""
        known = ", ".join(keys)
        for key in self:
            if key not in keys:
                guess = _guess(key, keys, _SAME_MEANING)
                self.problems.append(f"{key}: unknown{guess}; known: {known}")

    def entries(self, key: str, parse: Callable[[Any], _T]) -> list[_T]:
        """The entries of a list, each parsed; entries with a problem are left out.

        Without the key the list is empty.
        """
        value = self.get(key, [])
        results = list[_T]()
        example = f", such as {key}: {_EXAMPLES[key]}" if key in _EXAMPLES else ""
        if not isinstance(value, list):
            self.problems.append(f"{key}: a list is needed{example}")
            return results
        for entry in value:
            if key in _LISTS_OF_MAPPINGS and not isinstance(entry, dict):
                self.problems.append(f"{key}: {shown(entry)} is not a mapping{example}")
                continue
            with collecting_problems(self.problems, f"{key}: "):
                results.append(parse(entry))
        return results

    def table(self, key: str, parse: Callable[[str, Any], _T]) -> dict[str, _T]:
        """A mapping from names, each value parsed with its name.

        Entries with a problem are left out. Without the key the mapping is empty.
        """
        value = self.get(key, {})
        results = dict[str, _T]()
        if not isinstance(value, dict):
            self.problems.append(f"{key}: a mapping from names is needed")
            return results
        for name, entry in value.items():
            with collecting_problems(self.problems, f"{key}: "):
                results[name] = parse(name, entry)
        return results

    def require_same_length(self, first: str, second: str) -> None:
        """Report two lists of the file if they do not have the same number of entries."""
        first_list = self.get(first, [])
        second_list = self.get(second, [])
        if not isinstance(first_list, list) or not isinstance(second_list, list):
            return  # `entries` reports it
        if len(first_list) != len(second_list):
            text = f"{first} has {len(first_list)} entries, {second} has {len(second_list)}"
            self.problems.append(text)

    def raise_problems(self) -> None:
        """Raise an error that lists all problems, if there are any."""
        if self.problems:
            raise DescriptionError(self._source, self.problems)


def repeated(names: Iterable[str]) -> list[str]:
    """Names that appear more than once."""
    return [name for name, count in Counter(names).items() if count > 1]


def name_in(value: Any) -> str:
    """A text that is not empty; a ValueError for anything else."""
    if not isinstance(value, str) or not value:
        raise ValueError(f"{shown(value)} is not a name")
    return value


def number_in(value: Any, key: str = "") -> float:
    """A finite number; a ValueError for anything else, which names the key."""
    one_number = None  # shape (1,)
    if isinstance(value, str):
        one_number = numbers(value, count=1)
    if one_number is None:
        raise ValueError(f"{key} {shown(value)} is not a number".lstrip())
    return float(one_number[0])


def pair_in(value: Any) -> tuple[str, str]:
    """Two names; a ValueError for anything else."""
    is_pair = isinstance(value, list) and len(value) == 2
    if not is_pair or not all(isinstance(name, str) and name for name in value):
        raise ValueError(f"{shown(value)} is not a pair of frame names")
    return value[0], value[1]


def mapping_in(value: Any, keys: Collection[str] = ()) -> dict[str, Any]:
    """A mapping; a ValueError for anything else, and for keys that are not in `keys`.

    If `keys` is empty, all keys are allowed.
    """
    if not isinstance(value, dict):
        of_keys = f" of {', '.join(keys)}" if keys else ""
        raise ValueError(f"{shown(value)} is not a mapping{of_keys}")
    unknown = [key for key in value if key not in keys]
    if unknown and keys:
        guess = _guess(unknown[0], keys, _SAME_MEANING_IN_ENTRY)
        raise ValueError(f"{', '.join(unknown)} unknown{guess}; known: {', '.join(keys)}")
    return value


def _guess(key: str, keys: Collection[str], same_meaning: Mapping[str, str]) -> str:
    """A question for the known key that an unknown one may mean; empty if there is none."""
    meant = same_meaning.get(str(key), "")
    if meant not in keys:
        similar = get_close_matches(str(key), keys, n=1)
        meant = similar[0] if similar else ""
    return f"; do you mean {meant}" if meant else ""


def numbers_in(
    value: Any, required: Sequence[str], defaults: Mapping[str, float]
) -> dict[str, float]:
    """Numbers of a mapping, by key.

    A ValueError for a missing key of `required`, and for keys that are neither in `required` nor in
    `defaults`.
    """
    fields = mapping_in(value, (*required, *defaults))
    for key in required:
        if key not in fields:
            raise ValueError(f"{shown(value)} has no {key}")
    numbers_by_key = dict(defaults)
    for key, number in fields.items():
        numbers_by_key[key] = number_in(number, key)
    return numbers_by_key


def shown(value: Any) -> str:
    """A short text of a value for messages.

    With aliases a few lines of YAML can be a list of lists whose full text fills the memory.
    """
    representation = reprlib.Repr()
    representation.maxlevel = 2
    return representation.repr(value)


class _Loader(yaml.BaseLoader):
    """Scalars are strings; a key that appears twice in a mapping is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        for key in repeated(key for key in keys if isinstance(key, str)):
            raise ValueError(f"{key}: appears twice")
        return super().construct_mapping(node, deep)


def _content(text: str, source: str) -> dict[str, Any]:
    """The mapping that is the content of a YAML; a DescriptionError for anything else."""
    if len(text) > _MAX_LENGTH:
        raise DescriptionError(source, [f"more than {_MAX_LENGTH} characters"])
    if _depth(text) > _MAX_DEPTH:
        raise DescriptionError(source, ["lists are nested too deeply"])
    try:
        content = yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        one_line = " ".join(str(error).split())
        problem = "not YAML: " + one_line.replace('in "<unicode string>", ', "at ")
        raise DescriptionError(source, [problem]) from None
    except ValueError as error:  # of `_Loader`
        raise DescriptionError(source, [str(error)]) from None
    except RecursionError:  # nesting by indentation
        raise DescriptionError(source, ["lists are nested too deeply"]) from None
    if not isinstance(content, dict) or not content:
        raise DescriptionError(source, ["no keys; name_mot is needed"])
    return content


def _depth(text: str) -> int:
    """Largest depth of nested brackets."""
    changes = (_DEPTH_CHANGE.get(character, 0) for character in text)
    depths = accumulate(changes)  # the depth after each character
    return max(depths, default=0)
