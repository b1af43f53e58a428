# SPDX-License-Identifier: BSD-2-Clause
"""Values that no argument of an annotated type may have, and calls with them."""

import datetime
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from sst_pin import SST, ClosedChain, SSTError, robots

ENDLESS: list[Any] = []
ENDLESS.append(ENDLESS)
#: Values of a function that are never an array of real numbers.
NOT_REAL = (
    "fast", 1j, {1.0}, object(), ENDLESS, b"1", datetime.date(2026, 1, 1),
    [[1.0], [2.0, 3.0]], np.ma.masked_array([1.0], mask=True), np.array("2026", "M8[D]"),
    np.zeros(2, [("x", float)]),
)  # fmt: skip
NOT_NUMBERS = (*NOT_REAL, np.nan, [], [1.0, 2.0])
NOT_COUNTS = (*NOT_REAL, "2", 1.5, np.nan, np.inf, [1], True, -1)
NOT_FLAGS = (None, "no", [], np.zeros(2))
NOT_NAMES = (
    None,
    5,
    True,
    b"raise",
    np.array("nan"),
    ["x"],
    object(),
    "no such name",
    "",
    np.zeros(2),
)
NOT_LISTS_OF_NAMES = ("crank", 5, object(), ["no such name"], [None], [0], [["crank"]], [b"crank"])
NOT_PATHS = (
    None, 5, "", ".", "/dev/null/a.csv", "a\0b.csv", b"a.csv", ["a.csv"],
    "a" * 300 + ".csv", "file/a.csv",
)  # fmt: skip
BY_TYPE = {
    "float": NOT_NUMBERS,
    "int": NOT_COUNTS,
    "bool": NOT_FLAGS,
    "str": NOT_NAMES,
    "Sequence[str]": NOT_LISTS_OF_NAMES,
    "Sequence[str] | Mapping[str, float]": (*NOT_LISTS_OF_NAMES, {"crank": "x"}, {"x": 0.1}),
    "str | Path": NOT_PATHS,
    "Sequence[Motor]": (*NOT_LISTS_OF_NAMES, ["crank", "crank"], ["universe"], [{}]),
    "Sequence[Constraint | tuple[str, str]]": (
        None, "AB", 5, ("A", "B"), [("A",)], [("A", "B", "3d", "x")], [("A", "B", None)], [(1, 2)],
        [None], [object()], [("A", "X")], [("", "")], [("A", "A", "3d")], {"A": "B"},
    ),
    "pin.Model": (None, "model", 5, pin.Model, pin.Model()),
    "ClosedChain": (None, 5, "robot.urdf", pin.Model(), ClosedChain, [ClosedChain], {}),
    "Robot": (None, 5, "robot.urdf", pin.Model(), ClosedChain),
    "SST": (None, 5, "sst", SST, robots.four_bar()),
    "BaseParameters": (None, 5, "x", [], robots.four_bar()),
    "Estimate": (None, 5, "x", [], robots.four_bar()),
    "Trajectory": (5, "m", object(), np.zeros((2, 3))),
    "Sequence[LineForce]": (5, "x", [5], [None]),
    "Sequence[Crossing]": (5, "x", [5], [None]),
    "Callable[[float], None]": (5, "x", []),
    "Mapping[str, ArrayLike]": (5, "x", ["crank"], {"unknown": np.ones(6)}, {"crank": "x"}),
}  # fmt: skip
ARRAYS = ("ArrayLike", "Array", "ForwardRef('Array')", "Sequence[ArrayLike]", "Torque", "Load")
OPTIONS = {"out": "Array | None", "threads": "int", "on_error": "str"}


def bad_arrays(good: Any) -> Iterator[Any]:
    """Values in the place of an array of this shape."""
    good = np.asarray(good, dtype=float)
    yield from NOT_REAL
    yield from (good + 1j, good.astype(str))
    if good.size:
        spoilt = np.array(good)
        spoilt.flat[0] = np.nan
        yield from (spoilt, np.ma.masked_array(good, mask=np.isnan(spoilt)))
    if good.ndim:
        yield from (np.ones((*good.shape[:-1], good.shape[-1] + 1)), np.full(good.shape, None))


def bad_values(annotation: str, good: Any) -> Iterator[Any]:
    """Values that a parameter refuses; an annotation that is not known has none."""
    kind = annotation.removesuffix(" | None").removesuffix(" | Mapping[str, float]")
    if kind in ARRAYS:
        yield from bad_arrays(good) if good is not None else NOT_REAL
    plain = annotation.removesuffix(" | None")
    yield from (x for x in BY_TYPE.get(plain, ()) if x is not None or plain == annotation)


def _words(annotation: Any) -> str:
    """An annotation as it is written."""
    return annotation.__name__ if isinstance(annotation, type) else str(annotation)


def faults(
    call: Callable[..., Any], good: Mapping[str, Any], free: Collection[str] = ()
) -> list[str]:
    """Calls that were not refused by an error of ours, one argument bad, the others good."""
    parameters = inspect.signature(call).parameters
    types = {name: _words(parameter.annotation) for name, parameter in parameters.items()}
    if types.pop("options", ""):  # `Unpack[Options]`
        types |= OPTIONS
    needed = {n: good[n] for n, p in parameters.items() if p.default is p.empty and n in types}
    result = []
    for name in types.keys() - set(free):
        for value in bad_values(types[name], good.get(name)):
            try:
                answer = call(**needed | {name: value})
            except SSTError:
                continue
            except Exception as error:
                answer = error
            result.append(f"{name}={value!r}: {answer!r}")
    return result
