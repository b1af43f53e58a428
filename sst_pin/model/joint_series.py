# SPDX-License-Identifier: BSD-2-Clause
"""Joints in series that replace a joint, for `rebuilt_tree`.

`Series` are any such joints, or none if the joint is fixed. `PartlyLocked` is the series of a joint
with some locked rates.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, in_one_turn
from ..errors import InputError
from .joint_space import kind_of

SLIDES = pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ
TURNS = pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ
#: Single joints that a joint can be replaced by, one for each of its rates.
_SINGLES: dict[str, Sequence[Any]] = {
    "JointModelFreeFlyer": SLIDES + TURNS,
    "JointModelSpherical": TURNS,
    "JointModelTranslation": SLIDES,
    "JointModelPlanar": (*SLIDES[:2], TURNS[2]),
    "JointModelSphericalZYX": TURNS[::-1],
}
#: The rates of the turns about x, y, z for which q has a quaternion.
_BALL_RATES: dict[str, Sequence[int]] = {
    "JointModelFreeFlyer": (3, 4, 5),
    "JointModelSpherical": (0, 1, 2),
}


class Part(NamedTuple):
    """A joint of a series.

    Attributes:
        suffix: Its suffix to the name of the whole joint.
        joint: Its model.
        place: Its pose relative to the joint before it.
        rates: Indices of its rates among the rates of the whole joint.
        entries: Indices of its positions in q of the whole joint; empty if its position is not an
            entry of q, as for a turn of a quaternion.
    """

    suffix: str
    joint: Any
    place: pin.SE3 = pin.SE3.Identity()
    rates: Sequence[int] = ()
    entries: Sequence[int] = ()


class Series:
    """Joints in series that replace a joint.

    Attributes:
        parts: The joints.
        place: Pose of the body relative to the last of them, or to the parent if there are none.
    """

    def __init__(self, parts: Sequence[Part], place: pin.SE3 | None = None) -> None:
        self.parts = tuple(parts)
        self.place = place or pin.SE3.Identity()

    @classmethod
    def named(cls, joints: Mapping[str, Any]) -> Series:
        """A series of new joints, by their suffixes.

        They have no rates and no entries of q of the replaced joint. So `positions` has an empty
        array for each of them, and they are neutral in the stored poses of a rebuilt tree.
        """
        return cls([Part(suffix, joint) for suffix, joint in joints.items()])

    @classmethod
    def whole(cls, joint: Any) -> Series:
        """A series with the joint alone, unchanged."""
        return cls([Part("", joint, rates=range(joint.nv), entries=range(joint.nq))])

    @classmethod
    def fixed(cls, joint: Any, q: Array) -> Series:
        """No joint: the body stays where it is at positions q of the joint."""
        model = pin.Model()
        model.addJoint(0, joint, pin.SE3.Identity(), "")
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        return cls([], data.oMi[1])

    def positions(self, q: Array) -> list[Array]:
        """Positions of each part at positions q of the whole joint."""
        return [q[list(part.entries)] for part in self.parts]


class PartlyLocked(Series):
    """A joint as joints in series, without the rates that are locked.

    There is a joint for each free rate, with the suffix of the rate: first slides along x, y, z,
    then turns. A locked rate remains as a constant pose between its neighbours.

    The three turns of a ball or free-flyer are ordered x, y, z with the locked ones last. For
    instance, a rod along x between two balls has its spin about x locked: the free turns about y
    and z come first and give the rod any direction. If no turn is locked, the three turns stay one
    ball, with the name of the whole joint.

    Args:
        joint: A joint of a model.
        locked: Positions of the locked rates, by their indices in the joint.

    Raises:
        InputError: For a joint that has no such parts.
    """

    def __init__(self, joint: Any, locked: Mapping[int, float]) -> None:
        kind = joint.shortname()
        suffixes = kind_of(joint).v
        models = _single_joints(joint)  # one for each rate, in the order of the rates

        #: The rates about x, y, z of a ball or free-flyer; empty for other joints.
        self._ball_rates = _BALL_RATES.get(kind, ())
        free_turns = [k for k in self._ball_rates if k not in locked]
        locked_turns = [k for k in self._ball_rates if k in locked]
        #: The same rates in the order of their turns in the series.
        self._turns = free_turns + locked_turns
        self._locked = dict(locked)
        stays_ball = bool(self._ball_rates) and not locked_turns

        # The rates in the order of the series, without the rates of a ball that stays one joint.
        order = [k for k in range(len(models)) if k not in self._ball_rates]
        if not stays_ball:
            order += self._turns
        parts = list[Part]()
        place = pin.SE3.Identity()  # of the next part, relative to the part before it
        for k in order:
            if k in locked:
                place = place * Series.fixed(models[k], np.array([locked[k]])).place
                continue
            # A turn of a ball or of a planar joint is no entry of q, see `_angle`.
            is_angle_of_plane = kind == "JointModelPlanar" and k == 2
            entries = [] if k in self._ball_rates or is_angle_of_plane else [k]
            parts.append(Part(f"_{suffixes[k]}", models[k], place, rates=[k], entries=entries))
            place = pin.SE3.Identity()
        if stays_ball:
            first = self._ball_rates[0]
            quaternion = range(first, first + 4)
            ball = pin.JointModelSpherical()
            parts.append(Part("", ball, place, rates=self._ball_rates, entries=quaternion))
            place = pin.SE3.Identity()
        super().__init__(parts, place)

    def positions(self, q: Array) -> list[Array]:
        """Positions of each part at positions q of the whole joint."""
        positions = super().positions(q)
        for k, part in enumerate(self.parts):
            if not part.entries:
                positions[k] = np.array([self._angle(part.rates[0], q)])
        return positions

    def _angle(self, rate: int, q: Array) -> float:
        """The angle of a turn that is no entry of q, [rad]; `rate` is the index of its rate."""
        if self._ball_rates:  # q of a ball or free-flyer ends with the quaternion
            # The rates of a ball are about its axes 0, 1, 2: x, y, z.
            axis_of_rate = {k: axis for axis, k in enumerate(self._ball_rates)}
            order = [axis_of_rate[k] for k in self._turns]
            last = self._locked[self._turns[-1]]  # the last turn is locked at this angle
            return float(_angles(q[-4:], order, last)[axis_of_rate[rate]])
        cosine, sine = q[-2:]  # q of a planar joint ends with them
        return float(np.arctan2(sine, cosine))


def _single_joints(joint: Any) -> list[Any]:
    """New joints of one axis each that together move as a joint does, one for each of its rates."""
    kind = joint.shortname()
    if kind == "JointModelUniversal":
        axes = joint.extract()
        return [pin.JointModelRevoluteUnaligned(axis) for axis in (axes.axis1, axes.axis2)]
    if kind not in _SINGLES:
        problem = "only whole joints of this type can be locked; build it as joints in series"
        raise InputError("locked", f"{kind.removeprefix('JointModel')}: {problem}")
    return [model() for model in _SINGLES[kind]]


def _angles(quaternion: Array, order: Sequence[int], last: float) -> Array:
    """Angles about x, y, z, shape (3,), of a rotation as turns in an order of axes.

    The order [1, 2, 0] is y, z, x. Each turn is about the axis that the turns before it have moved.
    Turns by a, b, c and by a + pi, pi - b, c + pi give the same rotation. The result is the triple
    whose third angle is nearer to `last`.
    """
    from scipy.spatial.transform import Rotation

    angles = np.empty(3)
    axes = "".join("XYZ"[k] for k in order)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in gimbal lock SciPy warns and sets the last angle to 0
        a, b, c = Rotation.from_quat(quaternion).as_euler(axes)
    if np.cos(c - last) < 0:
        a, b, c = in_one_turn([a + np.pi, np.pi - b, c + np.pi])
    angles[list(order)] = [a, b, c]
    return angles
