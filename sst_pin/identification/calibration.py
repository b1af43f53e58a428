# SPDX-License-Identifier: BSD-2-Clause
"""Finds the places of joints and closures of a robot from measured poses.

Errors of the geometry are joints of an enlarged robot: three slides, three hinges at each place.
The natural orthogonal complement of this robot has the derivatives of a pose by the errors, with
closed loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, for_each_sample
from ..closed_chain import ClosedChain
from ..errors import ClosureError, InputError, SingularConfigurationError, UnknownNameError
from ..files import as_path, text_writer, write_files
from ..loops.frame_guide import pose_error
from ..loops.start import placed
from ..model import geometry
from ..model.named_positions import put
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..progress import counted
from ..reading import Urdf
from ..simulation.coordinate_motions import configurations_of
from ..simulation.frame_motions import targets_of
from ..summaries import Summary, listed
from .base_parameters import independent
from .estimation import solved
from .urdf_numbers import bearers_of, with_origins

#: An error opens the loops if the joints leave a larger gap, free of units.
_CLOSED = 1e-6
#: An error is hidden if the part of it that errors before it do not explain is smaller. The first
#: tolerance with which Newton's method settles is used.
_TOLERANCES = (1e-6, 1e-5, 1e-4, 1e-3)
_STEPS, _SETTLED = 30, 1e-9
#: Least noise of positions as a part of that of orientations, and the reverse: less is rounding.
_LEAST_NOISE = 1e-4
#: Largest last step of Newton's method, in standard deviations of the errors.
_UNSURE = 0.01
_TOO_LARGE = "errors too large for Newton's method, or which= leaves out those that matter"


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(Summary):
    """Errors of a geometry.

    Attributes:
        names: The errors found, such as "elbow.x" along x of the link that bears the joint, and
            "elbow.rz" about z of the joint's frame before it moves: [m] and [rad]. An offset of a
            motor is the turn about its axis.
        values: Their values, shape (k,).
        covariance: Their covariance, shape (k, k).
        noise: Standard deviations of the measured positions, [m], and orientations, [rad]; the
            second is missing where only positions were measured.
        hidden: Errors that cannot be told apart from those found, or change nothing; they are zero.
        chain: The robot with the calibrated geometry.
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
        folder = as_path(path).parent
        write_files({as_path(path): text_writer(self._urdf(urdf, folder))}, force)

    def _urdf(self, urdf: str | Path, folder: Path) -> str:
        """The URDF that the robot was read from, for a folder, with calibrated origins."""
        mechanism, places = self.chain.mechanism, dict[str, pin.SE3]()
        errors = dict(zip(self.names, self.values, strict=True))
        for place, displacement in geometry.displacements(mechanism, errors).items():
            turn = geometry.relative(pin.SE3.Identity(), displacement).rotation
            calibrated = geometry.place_of(mechanism.model, place)[1].rotation
            drawn = pin.SE3(calibrated @ turn.T, np.zeros(3))
            places[place] = geometry.relative(drawn, displacement)
        return with_origins(urdf, mechanism.model, places, folder)

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
    urdf: str | Path | None = None,
    start: ArrayLike | None = None,
) -> Calibration:
    """The geometry of a robot from measured poses of a frame and positions of the coordinates.

    The errors are those that the poses show, in the order of the tree.

    Args:
        chain: The robot as it is drawn.
        frame: Name of the frame that was measured.
        x: Measured positions of the coordinates, shape (N, n), [rad] or [m].
        poses: Measured poses of the frame in the base, shape (N, 4, 4), or positions of its origin,
            shape (N, 3), [m].
        which: The errors considered: names, or patterns such as "motor_*.r*", of joints that move,
            of frames of closures, and of `frame`; by default those of all joints and closures. An
            error that alone opens loops of an overconstrained robot is left out.
        urdf: The URDF that `write_urdf` of the result takes: by default only errors that it can
            store are considered.
        start: A guess of all joints in the first pose, shape (nq,), as in `coordinate_motion`, from
            which the others are followed; or in each pose, shape (N, nq).

    Raises:
        InputError: For fewer equations than errors that they could show, errors of `which` that
            open the loops or that the URDF cannot store, poses ten lengths of the robot away, or
            poses from which Newton's method does not settle.
        ClosureError: If a pose cannot be assembled.

    Example:
        >>> machine = sst_pin.robots.delta(arm=0.151)  # drawn with 0.15
        >>> x = machine.home[[0, 5, 9]] + np.random.default_rng(0).uniform(-0.3, 0.3, (8, 3))
        >>> q = [machine.assemble(dict(zip(machine.coordinates, each))) for each in x]
        >>> drawn, poses = sst_pin.robots.delta(arm=0.15), machine.platform_pose(q)
        >>> which = ["rod_*.x"]
        >>> result = sst_pin.identification.calibrate(drawn, "platform", x, poses, which=which)
        >>> result.values.round(6)  # of the six rods: where they join the arms
        array([0.001, 0.001, 0.001, 0.001, 0.001, 0.001])
    """
    angles = finite_array("x", x, (len(chain.coordinates),))
    if angles.ndim != 2:
        raise InputError("x", f"shape {angles.shape}, expected (N, {len(chain.coordinates)})")
    targets = targets_of(poses, len(angles))
    if any(position is None for position, _ in targets):
        raise InputError("poses", "orientations alone; expected shapes (N, 3) or (N, 4, 4)")
    errors = _considered(chain, frame, which, urdf)
    drawn, large = _configurations(chain, angles, start), _enlarged(chain, errors)
    if alone := _opening(large, errors, _without_errors(large, chain, drawn)):
        if which is not None:
            problem = f"{listed(alone)}: each alone opens loops that no joint closes"
            raise InputError("which", f"{problem}, as the robot is overconstrained")
        large = _enlarged(chain, [x for x in errors if x not in alone])
    names = large.coordinates[len(chain.coordinates) :]
    poses_of_errors = _Poses(large, frame, names, targets)
    q = _without_errors(large, chain, drawn)
    try:
        z, A = poses_of_errors.linearized(q)
    except SingularConfigurationError:
        problem = "the errors open loops together, as the robot is overconstrained; name fewer"
        raise InputError("which", f'{problem}, such as those of motors, "motor.r*"') from None
    _require_near(z[:, :3], large.mechanism.length)
    for tolerance in _TOLERANCES:
        visible = independent(A.reshape(-1, len(names)), tolerance)
        if z.size <= visible.size:
            problem = f"{z.size} equations for {visible.size} errors; give more poses, or which="
            raise InputError("poses", problem)
        try:
            values, root, noise = poses_of_errors.fitted(q, visible)
            break
        except InputError:
            if tolerance == _TOLERANCES[-1]:
                raise
    sizes = {names[k]: float(x) for k, x in zip(visible, values, strict=True)}
    hidden = tuple(name for name in names if name not in sizes)
    displacements = geometry.displacements(chain.mechanism, sizes)
    robot = chain.with_model(geometry.displaced(chain.mechanism.model, displacements))
    return Calibration(tuple(sizes), values, root @ root.T, noise, hidden, robot)


class _Poses:
    """Poses of a frame as functions of the errors of an enlarged robot, and the measured poses.

    Inside, all is free of units: positions and slides are parts of the robot's length.
    """

    def __init__(
        self,
        large: ClosedChain,
        frame: str,
        names: Sequence[str],
        targets: list[tuple[Array | None, Array | None]],
    ) -> None:
        self._large, self._frame, self._names, self._targets = large, frame, names, targets
        self._columns = [large.coordinates.index(name) for name in names]
        #: Units of the errors, and of positions and orientations.
        self._units = large.mechanism.rate_scale[large.mechanism.coordinates[self._columns]]
        self._sizes = np.array([large.mechanism.length, 1.0])

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """Differences from the targets, shape (N, m), and derivatives by errors, (N, m, k)."""
        places = map(pin.SE3, self._large.engine.placements(q, self._frame))
        pairs = zip(places, self._targets, strict=True)
        z = np.array([pose_error(place, *target) for place, target in pairs])
        sizes = np.repeat(self._sizes, 3)[: z.shape[1]]
        J = self._large.frame_jacobian(q, self._frame)[:, : z.shape[1], self._columns]
        return z / sizes, J / sizes[:, None] * self._units

    def fitted(self, q: Array, visible: Indices) -> tuple[Array, Array, Array]:
        """Values of errors, the root of their covariance, and the noise, by Newton's method."""
        units, values, noise = self._units[visible], np.zeros(visible.size), np.ones(1)
        space, names = self._large.mechanism.space, [self._names[k] for k in visible]
        for step_number in counted(range(_STEPS), "calibrate, steps of Newton's method"):
            errors = dict(zip(names, np.tile(values * units, (len(q), 1)).T, strict=True))
            try:
                q = self._large.assemble(put(space, q, errors))
                z, A = self.linearized(q)
                weights = np.repeat(1 / np.resize(noise, z.shape[1] // 3), 3)
                z, A = z * weights, A[..., visible] * weights[:, None]
                step, root = solved(A, z)
            except (ClosureError, SingularConfigurationError, InputError):
                raise InputError("poses", _TOO_LARGE) from None
            values += step
            left = (z - A @ step).reshape(len(z), -1, 3)
            scale = np.sqrt(np.mean(left**2, axis=(0, 2)) * left.size / (left.size - visible.size))
            noise = noise * scale
            noise = np.maximum(noise, max(1e-13, _LEAST_NOISE * noise.max()))
            if step_number and np.abs(step).max(initial=0.0) < _SETTLED:
                break
        else:
            if (np.abs(step) > _UNSURE * np.linalg.norm(root, axis=1)).any():
                problem = f"the errors do not settle in {_STEPS} steps; give which= or better poses"
                raise InputError("poses", problem)
        return values * units, root * units[:, None], noise * self._sizes[: noise.size]


def _require_near(away: Array, length: float) -> None:
    """Refuse positions that no errors of a geometry explain, such as those in millimetres."""
    sizes = np.linalg.norm(away, axis=1)
    if sizes.max(initial=0.0) > 10:
        k = int(sizes.argmax())
        problem = f"pose {k} is {sizes[k] * length:.4g} m from the frame of the robot as drawn"
        raise InputError("poses", f"{problem}, {length:.3g} m long; check units, base and start")


def _configurations(chain: ClosedChain, angles: Array, start: ArrayLike | None) -> Array:
    """Configurations of the robot as it is drawn, shape (N, nq)."""
    guesses = None if start is None else finite_array("start", start, ())
    size = len(chain.position_names)
    if guesses is not None and guesses.shape not in ((size,), (len(angles), size)):
        raise InputError("start", f"shape {guesses.shape}, expected (nq,) or (N, nq)")
    if guesses is None or guesses.ndim == 1:
        return configurations_of(chain.engine, angles, guesses)

    def assembled(x: Array, guess: Array) -> Array:
        return placed(chain.engine, dict(zip(chain.coordinates, x, strict=True)), guess)

    return for_each_sample(assembled, [angles, guesses], (1, 1), (size,))


def _considered(
    chain: ClosedChain, frame: str, which: Sequence[str] | None, urdf: str | Path | None
) -> list[str]:
    """Names of the errors that fit patterns; with a URDF, it has to store them."""
    mechanism = chain.mechanism
    frame_id(mechanism.model, frame)
    places = list(dict.fromkeys([*geometry.places_of(mechanism), frame]))
    names = [f"{place}.{axis}" for place in places for axis in geometry.AXES]
    stored = places if urdf is None else bearers_of(Urdf.read(urdf).root, mechanism.model)
    by_default = [f"{place}.*" for place in places if place != frame and place in stored]
    patterns = by_default if which is None else which
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownNameError("error of the geometry", pattern, names)
    errors = [name for name in names if any(fnmatchcase(name, p) for p in patterns)]
    if others := [name for name in errors if name.rpartition(".")[0] not in stored]:
        problem = f"{urdf} cannot store {listed(others)}: no joint of it is there; leave them out"
        raise InputError("which", problem)
    return errors


def _enlarged(chain: ClosedChain, errors: Sequence[str]) -> ClosedChain:
    """The robot whose geometry can err; its coordinates are the chain's and independent errors."""
    mechanism = chain.mechanism
    moves = [geometry.displacements(mechanism, {name: 1.0}) for name in errors]
    pairs = zip(errors, moves, strict=True)
    joints = [(name, *place_and_move) for name, move in pairs for place_and_move in move.items()]
    model = geometry.enlarged(mechanism.model, joints)
    large = ClosedChain(model, chain.closures, [*chain.coordinates, *errors])
    if lost := set(chain.coordinates) - set(large.coordinates):
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large


def _without_errors(large: ClosedChain, chain: ClosedChain, q: Array) -> Array:
    """Configurations of the enlarged robot for those of the chain, shape (N, nq)."""
    result = np.tile(pin.neutral(large.mechanism.model), (len(q), 1))
    result[:, [large.position_names.index(name) for name in chain.position_names]] = q
    return result


def _opening(large: ClosedChain, errors: Sequence[str], q: Array) -> list[str]:
    """The errors that alone open the loops in all configurations of the enlarged robot."""
    columns = large.mechanism.space.rates_of(errors)
    least = np.full(len(errors), np.inf)
    for configuration in q:
        Phi = large.Phi(configuration) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        closing = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        E = Phi[:, columns]
        least = np.minimum(least, np.linalg.norm(E - closing @ (closing.T @ E), axis=0))
    return [name for name, size in zip(errors, least, strict=True) if size > _CLOSED]
