# SPDX-License-Identifier: BSD-2-Clause
"""The geometry of a robot from measured poses: places of its joints and of its closures.

Errors of the geometry are joints of an enlarged robot, three slides and three hinges at each place.
The natural orthogonal complement of this robot has the derivatives of the measured pose by the
errors, with closed loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Constraint, Coupling, frames_of
from ..chain.named_positions import put
from ..chain.rebuilt_tree import rebuilt
from ..chain.thresholds import RANK_TOLERANCE
from ..chain.tree import frame_id
from ..errors import (
    ClosureError,
    InputError,
    SingularConfigurationError,
    UnknownNameError,
)
from ..files import as_path, text_writer, write_files
from ..motion.coordinate_motions import configurations_of, start_configuration
from ..motion.frame_guide import pose_error
from ..motion.frame_motions import targets_of
from ..summaries import Summary, listed
from .base_parameters import independent
from .estimation import solved
from .urdf_numbers import with_origins

_ERRORS = {
    "x": pin.JointModelPX(),
    "y": pin.JointModelPY(),
    "z": pin.JointModelPZ(),
    "rx": pin.JointModelRX(),
    "ry": pin.JointModelRY(),
    "rz": pin.JointModelRZ(),
}
#: An error whose part that other errors do not explain is smaller depends on them: the first of
#: these with which Newton's method settles.
_DEPENDENT = (1e-6, 1e-5, 1e-4, 1e-3)
#: What the joints do not close of an error, free of units, counts as none below this.
_CLOSED = 1e-6
_STEPS, _SETTLED = 30, 1e-9
#: Least noise of positions as a part of that of orientations, and the reverse: less is rounding.
_LEAST_NOISE = 1e-4
#: After all steps the last one may be so large, in standard deviations of the errors.
_UNSURE = 0.01
_TOO_LARGE = "errors too large for Newton's method, or which= leaves out those that matter"
#: The measured frame of the enlarged robot, and what the names of the others end with.
_FRAME, _MOVED = "measured frame", " moved"


class _UnsettledError(Exception):
    """Newton's method does not settle, and why."""


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(Summary):
    """Errors of a geometry.

    Attributes:
        names: The errors found, such as "elbow.x" along x of the joint's frame before it moves, and
            "elbow.rz" about its z: [m] and [rad]. An offset of a motor is the turn about its axis.
        values: Their values, shape (k,).
        covariance: Their covariance, shape (k, k).
        noise: Standard deviations of the measured positions, [m], and orientations, [rad]; the
            second is missing where only positions were measured.
        hidden: Errors that cannot be told apart from those found, or change nothing; they are zero.
        chain: The robot with the calibrated geometry.

    Example:
        See `calibrate`.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    noise: Array
    hidden: tuple[str, ...]
    chain: ClosedChain

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def write_urdf(self, urdf: str | Path, path: str | Path, force: bool = False) -> None:
        """Write a URDF with the calibrated origins of its joints.

        Args:
            urdf: The URDF that the robot was read from.
            path: The new file.
            force: Whether an existing file may be replaced.

        Raises:
            DescriptionError: If the URDF cannot be read, or has no joint at a calibrated place.
            OutputError: If the file cannot be written, or exists.
        """
        write_files({as_path(path): text_writer(self._urdf(urdf))}, force)

    def _urdf(self, urdf: str | Path) -> str:
        """The URDF that the robot was read from, with calibrated origins."""
        return with_origins(urdf, _placements(self.names, self.values))

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        triples = zip(self.names, self.values, 3 * self.deviations, strict=True)
        rows = [(name, f"{value:.4g} +- {d:.1g}") for name, value, d in triples]
        rows += [("hidden", listed(self.hidden, 12))] if self.hidden else []
        return f"{len(self.names)} errors of the geometry, three standard deviations", rows


def calibrate(
    chain: ClosedChain,
    frame: str,
    x: ArrayLike,
    poses: ArrayLike,
    *,
    which: Sequence[str] | None = None,
    start: ArrayLike | None = None,
) -> Calibration:
    """The geometry of a robot from measured poses of a frame and positions of the motors.

    Args:
        chain: The robot as it is drawn.
        frame: Name of the frame that was measured.
        x: Measured positions of the coordinates, shape (N, n), [rad] or [m].
        poses: Measured poses of the frame in the base, shape (N, 4, 4), or positions of its origin,
            shape (N, 3), [m].
        which: The errors considered: names, or patterns such as "motor_*.r*", of joints that move,
            of frames of closures, and of `frame`; by default those of all joints and closures. An
            error that alone opens loops of an overconstrained robot is left out.
        start: A guess of all joints in the first pose, shape (nq,), as in `coordinate_motion`, from
            which the others are followed; or in each pose, shape (N, nq).

    Returns:
        The errors that the poses show, in the order of the tree, and the calibrated robot.

    Raises:
        UnknownNameError: For an unknown frame, or a pattern that fits no error.
        InputError: For wrong shapes, matrices that are not rotations, fewer equations than errors
            that they could show, errors of `which` that alone open the loops, poses ten lengths of
            the robot away, or poses from which Newton's method does not settle.
        ClosureError: If a pose cannot be assembled.

    Example:
        >>> import pinocchio
        >>> made = sst_pin.robots.delta(arm=0.151)  # drawn with 0.15
        >>> x = made.home[[0, 5, 9]] + np.random.default_rng(0).uniform(-0.3, 0.3, (8, 3))
        >>> data, feet = made.model.createData(), []
        >>> for q in (made.assemble(dict(zip(made.coordinates, each))) for each in x):
        ...     pinocchio.framesForwardKinematics(made.model, data, q)
        ...     feet.append(data.oMf[made.model.getFrameId("platform")].homogeneous)
        >>> drawn = sst_pin.robots.delta(arm=0.15)
        >>> found = sst_pin.identification.calibrate(drawn, "platform", x, feet, which=["rod_*.x"])
        >>> found.values.round(6)  # of the six rods: where they join the arms
        array([0.001, 0.001, 0.001, 0.001, 0.001, 0.001])
    """
    angles = finite_array("x", x, (len(chain.coordinates),))
    if angles.ndim != 2:
        raise InputError("x", f"shape {angles.shape}, expected (N, {len(chain.coordinates)})")
    measured = targets_of(poses, len(angles))
    if any(position is None for position, _ in measured):
        raise InputError("poses", "orientations alone; expected shapes (N, 3) or (N, 4, 4)")
    drawn = _configurations(chain, angles, start)
    large, errors = _enlarged(chain, frame, which)
    every = [x for x in large.mechanism.model.names if not chain.mechanism.model.existJointName(x)]
    if opening := _opening(large, every, drawn):
        if which is not None:
            problem = f"{listed(opening)}: each alone opens loops that no joint closes"
            raise InputError("which", f"{problem}, as the robot is overconstrained")
        large, errors = _enlarged(chain, frame, [x for x in every if x not in opening])
    for tolerance in _DEPENDENT:
        try:
            found, values, root, noise = _found(large, errors, drawn, measured, tolerance)
            break
        except _UnsettledError as error:
            if tolerance == _DEPENDENT[-1]:
                raise InputError("poses", str(error)) from None
    kept = tuple(errors[k] for k in found)
    hidden = tuple(name for name in errors if name not in kept)
    moved = _moved(chain, _placements(kept, values))
    return Calibration(kept, values, root @ root.T, noise, hidden, moved)


def _found(
    large: ClosedChain,
    errors: list[str],
    drawn: list[dict[str, float]],
    measured: list[tuple[Array | None, Array | None]],
    tolerance: float,
) -> tuple[Indices, Array, Array, Array]:
    """Indices of the errors found, their values, the root of their covariance, and the noise.

    By Newton's method; an error whose part that the others do not explain is smaller than the
    tolerance depends on them.
    """
    columns = [large.coordinates.index(name) for name in errors]
    length, model = large.mechanism.length, large.mechanism.model
    units = np.where([".r" in name[-3:] for name in errors], 1.0, length)
    q, data = [_with_errors(large, each) for each in drawn], model.createData()
    size = np.array([length, 1.0])
    values, noise = np.zeros(len(errors)), size
    for step_number in range(_STEPS):
        held, rows, rests = dict(zip(errors, values, strict=True)), [], []
        for k, target in enumerate(measured):
            try:
                q[k] = large.assemble(put(large.mechanism.space, q[k], held))
            except (ClosureError, SingularConfigurationError):
                if step_number == 0:
                    raise
                raise _UnsettledError(_TOO_LARGE) from None
            pin.framesForwardKinematics(model, data, q[k])
            rests.append(pose_error(data.oMf[model.getFrameId(_FRAME)], *target))
            rows.append(large.frame_jacobian(q[k], _FRAME)[: len(rests[k]), columns])
        weights = np.repeat(1 / noise, 3)[: len(rests[0])]
        A = np.array(rows) * weights[:, None] * units
        z = np.array(rests) * weights
        if step_number == 0:
            _require_near(np.array(rests)[:, :3], length)
            found = independent(A.reshape(-1, len(errors)), tolerance)
            if z.size <= found.size:
                problem = f"{z.size} equations for {found.size} errors; give more poses, or which="
                raise InputError("poses", problem)
        try:
            step, root = solved(A[..., found], z)
        except InputError:
            raise _UnsettledError(_TOO_LARGE) from None
        values[found] += step * units[found]
        left = (z - A[..., found] @ step).reshape(len(z), -1, 3)
        scale = np.sqrt(np.mean(left**2, axis=(0, 2)) * left.size / (left.size - found.size))
        noise = noise[: len(scale)] * scale / size[: len(scale)]
        noise = np.maximum(noise, max(1e-13, _LEAST_NOISE * noise.max())) * size[: len(scale)]
        if step_number and np.abs(step).max(initial=0.0) < _SETTLED:
            break
    else:
        if (np.abs(step) > _UNSURE * np.linalg.norm(root, axis=1)).any():
            problem = f"the errors do not settle in {_STEPS} steps; give which= or better poses"
            raise _UnsettledError(problem)
    return found, values[found], root * units[found][:, None], noise


def _require_near(away: Array, length: float) -> None:
    """Refuse positions that no errors of a geometry explain, such as those in millimetres."""
    sizes = np.linalg.norm(away, axis=1)
    if sizes.max(initial=0.0) > 10 * length:
        k = int(sizes.argmax())
        problem = f"pose {k} is {sizes[k]:.4g} m from the frame of the robot as it is drawn"
        raise InputError("poses", f"{problem}, {length:.3g} m long; check units, base and start")


def _enlarged(
    chain: ClosedChain, frame: str, which: Sequence[str] | None
) -> tuple[ClosedChain, list[str]]:
    """The robot whose geometry can err, and the names of the errors that are independent."""
    tree, closures = chain.mechanism.model, chain.closures
    ends = [end for c in closures if not isinstance(c, Coupling) for end in frames_of(c)]
    places = list(dict.fromkeys([*list(tree.names)[1:], *ends, frame]))
    frame_id(tree, frame)
    names = [f"{place}.{axis}" for place in places for axis in _ERRORS]
    patterns = [f"{place}.*" for place in places if place != frame] if which is None else which
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownNameError("error of the geometry", pattern, names)
    errors = [name for name in names if any(fnmatchcase(name, p) for p in patterns)]
    of_place: dict[str, dict[str, object]] = {}
    for name in errors:
        place, _, axis = name.rpartition(".")
        of_place.setdefault(place, {})[f".{axis}"] = _ERRORS[axis]
    joints = {tree.getJointId(place) for place in of_place if tree.existJointName(place)}
    parts = {j: {**of_place[tree.names[j]], "": tree.joints[j]} for j in joints}
    model = rebuilt(tree, parts, pin.neutral(tree))
    for place in dict.fromkeys([*ends, frame]):
        own = model.frames[frame_id(model, place)]
        bearer, at = own.parentJoint, own.placement
        own_errors = {} if tree.existJointName(place) else of_place.get(place, {})
        for suffix, joint in own_errors.items():
            bearer = model.addJoint(bearer, joint, at, place + suffix)
            at = pin.SE3.Identity()
        for new in [place + _MOVED] * (place in ends) + [_FRAME] * (place == frame):
            model.addFrame(pin.Frame(new, bearer, at, pin.FrameType.OP_FRAME))
    for pair in list(model.referenceConfigurations):  # of the tree without errors
        del model.referenceConfigurations[pair.key()]
    new_closures = [c if isinstance(c, Coupling) else _renamed(c, frames_of(c)) for c in closures]
    large = ClosedChain(model, new_closures, [*chain.coordinates, *errors])
    if lost := set(chain.coordinates) - set(large.coordinates):
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large, [name for name in errors if name in large.coordinates]


def _opening(large: ClosedChain, errors: list[str], drawn: list[dict[str, float]]) -> list[str]:
    """The errors that alone open the loops of the robot as it is drawn, in all its poses."""
    model = large.mechanism.model
    columns = [model.joints[model.getJointId(name)].idx_v for name in errors]
    least = np.full(len(errors), np.inf)
    for positions in drawn:
        Phi = large.Phi(_with_errors(large, positions)) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        closing = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        E = Phi[:, columns]
        least = np.minimum(least, np.linalg.norm(E - closing @ (closing.T @ E), axis=0))
    return [name for name, size in zip(errors, least, strict=True) if size > _CLOSED]


def _renamed(closure: Constraint, frames: Sequence[str]) -> Constraint:
    """A closure of the frames that can be moved."""
    keys = [key for key, value in vars(closure).items() if value in frames]
    return replace(closure, **{key: getattr(closure, key) + _MOVED for key in keys})


def _configurations(
    chain: ClosedChain, angles: Array, start: ArrayLike | None
) -> list[dict[str, float]]:
    """Entries of the configurations of the robot as it is drawn, by name."""
    guesses = None if start is None else finite_array("start", start, ())
    size = len(chain.position_names)
    if guesses is not None and guesses.shape not in ((size,), (len(angles), size)):
        raise InputError("start", f"shape {guesses.shape}, expected (nq,) or (N, nq)")
    if guesses is None or guesses.ndim == 1:
        q = configurations_of(chain, angles, guesses)
    else:
        q = guesses.copy()
        for k, x in enumerate(angles):
            try:
                q[k] = start_configuration(
                    chain, dict(zip(chain.coordinates, x, strict=True)), q[k]
                )
            except ClosureError as error:
                error.name_samples([(k,)], len(angles))
                raise
    return [dict(zip(chain.position_names, each, strict=True)) for each in q]


def _with_errors(large: ClosedChain, positions: dict[str, float]) -> Array:
    """A configuration of the enlarged robot, without errors."""
    q = pin.neutral(large.mechanism.model)
    for k, name in enumerate(large.position_names):
        q[k] = positions.get(name, q[k])
    return np.asarray(q, float)


def _placements(names: Sequence[str], values: Array) -> dict[str, pin.SE3]:
    """The errors of each place as one placement: slides first, then hinges, as in _ERRORS."""
    found: dict[str, pin.SE3] = {}
    for name, value in zip(names, values, strict=True):
        place, _, axis = name.rpartition(".")
        unit = np.eye(3)["xyz".index(axis[-1])] * value
        step = pin.SE3(pin.exp3(unit), np.zeros(3)) if len(axis) > 1 else pin.SE3(np.eye(3), unit)
        found[place] = found.get(place, pin.SE3.Identity()) * step
    return found


def _moved(chain: ClosedChain, errors: dict[str, pin.SE3]) -> ClosedChain:
    """The robot with its joints and frames where the errors put them."""
    model = pin.Model(chain.mechanism.model)
    for place, error in errors.items():
        if model.existJointName(place):
            k = model.getJointId(place)
            model.jointPlacements[k] = model.jointPlacements[k] * error
        else:
            at = model.frames[frame_id(model, place)]
            at.placement = at.placement * error
    return chain._remade(model)
