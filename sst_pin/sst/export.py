# SPDX-License-Identifier: BSD-2-Clause
"""A robot as C for its own controller: the kernels, its numbers, an example."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from math import prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DescriptionError
from ..files import Writer, as_path, text_writer
from .kernel_path import misfit
from .kernels.packing import FIELDS, pack
from .robot import SST

Array = NDArray[np.float64]

_HEAD = """\
/* The numbers of the robot {name}, by sst-pin export-c; sst_kernels.h says what they are. */
#ifndef SST_ROBOT_H
#define SST_ROBOT_H

#include "sst_kernels.h"

static const sst_parameters sst_robot = {{
"""


def c_files(robot: SST, folder: str | Path) -> dict[Path, Writer]:
    """The files that compute a robot's dynamics without Python.

    Args:
        robot: Whose numbers they hold; Coulomb friction has the sign of the rate, not its tanh.
        folder: Where they go.

    Returns:
        Writers of sst_kernels.h, sst_kernels.c, sst_robot.h and example.c.

    Raises:
        DescriptionError: For a robot that the kernels do not fit, or a number that is not finite.
    """
    if problem := misfit(robot.joint_names, robot.closures):
        raise DescriptionError(f"model {robot.model.name}", [problem])
    source = files("sst_pin.sst") / "kernels"
    names = ("sst_kernels.h", "sst_kernels.c", "example.c")
    texts = {name: (source / name).read_text(encoding="utf-8") for name in names}
    vector = pack(robot.model, robot.geometry, robot.friction)
    numbers = "".join(f"    .{line},\n" for line in _initialisers(vector))
    name = robot.model.name.replace("*/", "* /").replace("/*", "/ *")  # it stands in a comment
    head = _HEAD.format(name=name)
    texts["sst_robot.h"] = f"{head}{numbers}}};\n\n#endif\n"
    return {as_path(folder) / name: text_writer(text) for name, text in texts.items()}


def _initialisers(vector: Array) -> Iterator[str]:
    ends = np.cumsum([prod(field.shape) for field in FIELDS])
    for field, values in zip(FIELDS, np.split(vector, ends[:-1]), strict=True):
        if not np.isfinite(values).all():
            raise DescriptionError("the numbers of the robot", [f"{field.name} is not finite"])
        yield f"{field.name} = {_braces(values.reshape(field.shape))}"


def _braces(values: Array) -> str:
    if values.ndim == 0:
        return repr(float(values))  # the compiler gets every bit back
    separator = ",\n        " if values.ndim > 1 else ", "
    return f"{{{separator.join(_braces(value) for value in values)}}}"
