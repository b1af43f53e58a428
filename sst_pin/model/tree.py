# SPDX-License-Identifier: BSD-2-Clause
"""Joints and frames of a tree by name, and the columns of Pinocchio's joint Jacobian J.

J in world axes, reduced at the world's origin, holds the unit twist of every rate. The twist of a
frame is J with the columns left out that do not move it. A mimic joint has a column of its own in
J, scaled already; it is added to that of the joint that it follows at the end.
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pinocchio as pin

from ..arrays import Array, Indices
from ..errors import DescriptionError, UnknownNameError
from .vectors import brackets


def frame_id(model: pin.Model, name: str | None) -> int:
    """Index of a frame; a joint and a link of one name are one frame where they coincide."""
    if not (isinstance(name, str) and model.existFrame(name)):
        raise UnknownNameError("frame", str(name), [f.name for f in model.frames])
    with suppress(ValueError):  # several frames of the name
        return int(model.getFrameId(name))
    found = [i for i, frame in enumerate(model.frames) if frame.name == name]
    first = model.frames[found[0]]
    for i in found[1:]:
        other = model.frames[i]
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise DescriptionError(
                f"frame {name}", ["several frames have this name, at different places; rename one"]
            )
    return found[0]


def body_of(model: pin.Model, frame: str) -> int | None:
    """Which body, counted from 0, has a frame; None without this frame, or where it is fixed."""
    joint = model.frames[frame_id(model, frame)].parentJoint if model.existFrame(frame) else 0
    return joint - 1 if joint else None


def frame_named(model: pin.Model, name: str) -> pin.Frame:
    """A frame by its name; errors as `frame_id`."""
    return model.frames[frame_id(model, name)]


def joint_id(model: pin.Model, name: str) -> int:
    """Index of a joint of the tree."""
    names = list(model.names)[1:]
    if name not in names:
        raise UnknownNameError("joint", name, names)
    return names.index(name) + 1


def support(model: pin.Model, joint: int) -> Array:
    """1 for the columns of J that move a joint's body, 0 for the others, shape (nvExtended,)."""
    support = np.zeros(model.nvExtended)
    for j in model.supports[joint]:
        if j > 0:
            support[columns(model, j)] = 1
    return support


def columns(model: pin.Model, joint: int) -> slice:
    """Columns of a joint in J."""
    first = model.joints[joint].idx_vExtended
    return slice(first, first + model.joints[joint].nvExtended)


def rates_of_columns(model: pin.Model) -> Indices:
    """For each column of J its rate in v: for a mimic joint that of the joint that it follows."""
    rates = np.empty(model.nvExtended, dtype=np.intp)
    for j in range(1, model.njoints):
        at = columns(model, j)
        rates[at] = np.arange(at.stop - at.start) + model.joints[j].idx_v
    return rates


def summed(model: pin.Model, X: Array) -> Array:
    """From columns of J, shape (..., nvExtended), to rates, shape (..., nv)."""
    if model.nvExtended == model.nv:
        return X
    return X.dot(np.eye(model.nv)[rates_of_columns(model)])


def memory_of(element: Any, attribute: str) -> Array:
    """An array on Pinocchio's own memory, such as `translation` of a placement in `data.oMf`.

    It follows what Pinocchio computes; the data must stay.
    """
    part = getattr(element, attribute)
    if part.__array_interface__["data"] != getattr(element, attribute).__array_interface__["data"]:
        raise RuntimeError(f"this version of Pinocchio hands out copies of {attribute}")
    return part


def of_rates(matrix: Array) -> Array:
    """Pinocchio's matrix with a column for each rate, shape (6, nv), also of a single rate."""
    return matrix.reshape(6, -1)


def depth_first(model: pin.Model) -> bool:
    """Whether each joint stands before its subtree and that in one piece, as `pin.crba` wants."""
    return all(
        list(subtree) == list(range(subtree[0], subtree[0] + len(subtree)))
        for subtree in list(model.subtrees)[1:]
    )


def series_of(joint: Any) -> list[tuple[Any, pin.SE3]]:
    """The joints of one axis, or of fixed axes, that a joint consists of, with placements."""
    short, here = joint.shortname(), pin.SE3.Identity()
    if short == "JointModelSphericalZYX":
        axes = (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        return [(axis(), here) for axis in axes]
    if short not in ("JointModelUniversal", "JointModelComposite"):
        return [(joint, here)]
    joint = joint.extract() if hasattr(joint, "extract") else joint
    if short == "JointModelUniversal":
        both = (joint.axis1, joint.axis2)
        return [(pin.JointModelRevoluteUnaligned(np.array(axis)), here) for axis in both]
    found: list[tuple[Any, pin.SE3]] = []
    for part, placement in zip(joint.joints, joint.jointPlacements, strict=True):
        first, *rest = series_of(part)
        found += [(first[0], placement * first[1]), *rest]
    return found


class JacobianRates:
    """The rate of J for joints of all types.

    Pinocchio leaves out that axes move in a joint that is several in series. There the rate of a
    column is its bracket with the twist of what bears and moves its axis.
    """

    def __init__(self, model: pin.Model) -> None:
        self._model, self._rates = model, rates_of_columns(model)
        moved_by = list(_moving_axes(model))
        self._columns = np.array([k for k, _ in moved_by], dtype=np.intp)
        self._moved_by = np.array([by for _, by in moved_by]).reshape(-1, model.nvExtended).T

    def update(self, data: pin.Data, q: Array, v: Array) -> None:
        """Compute J and its rate at q and v into `data`."""
        pin.computeJointJacobiansTimeVariation(self._model, data, q, v)
        if len(self._columns):
            J, J_dot = of_rates(data.J), of_rates(data.dJ)
            twists = (J * v[self._rates]).dot(self._moved_by)
            J_dot[:, self._columns] = brackets(twists, J[:, self._columns])


def _moving_axes(model: pin.Model) -> Iterator[tuple[int, Array]]:
    """Each column of a joint in series, and 1 for the columns that move its axis."""
    for j in range(1, model.njoints):
        parts = [part for part, _ in series_of(model.joints[j])]
        if len(parts) == 1:
            continue
        moved_by, first = support(model, model.parents[j]), columns(model, j).start
        for part in parts:
            moved_by[first : first + part.nv] = 1
            for column in range(first, first + part.nv):
                yield column, moved_by.copy()
            first += part.nv
