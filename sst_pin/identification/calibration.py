# SPDX-License-Identifier: BSD-2-Clause
"""Finds the places of joints and closures of a robot from measured poses.

Errors of the geometry are joints of an enlarged robot: three slides, three hinges at each place.
The natural orthogonal complement of this robot has the derivatives of a pose by the errors, with
closed loops.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, for_each_sample, in_order
from ..closed_chain import ClosedChain
from ..errors import (
    ClosureError,
    DescriptionWarning,
    InputError,
    SingularConfigurationError,
    UnknownNameError,
    warn_caller,
)
from ..files import as_path, text_writer, write_files
from ..loops.start import placed
from ..model import geometry
from ..model.named_positions import put
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..progress import counted
from ..reading import Urdf
from ..simulation.coordinate_motions import configurations_of
from ..summaries import Summary, listed
from .base_parameters import independent
from .estimation import solved
from .geometry_measurements import Measurement, Poses, Sight, frames_of, unknown_frames
from .urdf_numbers import carriers_of, with_origins

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
#: Degrees of freedom that must be left to estimate a noise.
_LEAST_FREEDOM = 0.5
#: Probability of a warning where the given noise is true.
_FALSE_ALARM = 1e-6
_TOO_LARGE = "errors too large for Newton's method, or which= leaves out those that matter"


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(Summary):
    """Errors of a geometry.

    Attributes:
        names: The errors found, such as "elbow.x" along x of the link that carries the joint, and
            "elbow.rz" about z of the joint's frame before it moves: [m] and [rad]. An offset of a
            motor is the turn about its axis.
        values: Their values, shape (k,).
        covariance: Their covariance, shape (k, k).
        noise: Standard deviations of the measured positions, [m], and orientations, [rad]; the
            second is missing where only positions were measured. For several measurements, those
            of each in their order.
        hidden: Errors that cannot be told apart from those found, or change nothing; they are zero.
        chain: The robot with the calibrated geometry.
        placements: Of unknown measuring systems, homogeneous matrices: `<name>_base` in the base of
            the robot, `<name>_target` in the frame that was measured.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    noise: Array
    hidden: tuple[str, ...]
    chain: ClosedChain
    placements: Mapping[str, Array] = field(default_factory=dict)

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
        of_robot = {x: e for x, e in errors.items() if x.rpartition(".")[0] not in self.placements}
        for place, displacement in geometry.displacements(mechanism, of_robot).items():
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
            shape (N, 3), [m]. NaN: not measured; see `Poses`.
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
        >>> at = [machine.position_names.index(name) for name in machine.coordinates]
        >>> x = machine.home[at] + np.random.default_rng(0).uniform(-0.3, 0.3, (8, 3))
        >>> q = [machine.assemble(dict(zip(machine.coordinates, each))) for each in x]
        >>> drawn, poses = sst_pin.robots.delta(arm=0.15), machine.platform_pose(q)
        >>> which = ["rod_*.x"]
        >>> result = sst_pin.identification.calibrate(drawn, "platform", x, poses, which=which)
        >>> result.values.round(6)  # of the six rods: where they join the arms
        array([0.001, 0.001, 0.001, 0.001, 0.001, 0.001])
    """
    measured = Poses(frame, x, poses=poses, start=start)
    return calibrate_with(chain, [measured], which=which, urdf=urdf)


def calibrate_with(
    chain: ClosedChain,
    measurements: Sequence[Measurement],
    *,
    which: Sequence[str] | None = None,
    urdf: str | Path | None = None,
) -> Calibration:
    """The geometry of a robot from measurements of several kinds, some perhaps partial.

    Each kind of value has its own noise: the given one, or one that is estimated. What is unknown
    of measuring systems is estimated with the errors of the robot; it comes first, so that errors
    that only move the robot as a whole are `hidden`.

    Args:
        chain: The robot as it is drawn.
        measurements: `Poses`, `Heights` and `Distances`.
        which: As in `calibrate`; frames of measurements may be named too.
        urdf: As in `calibrate`.

    Raises:
        InputError: As `calibrate`; and if the values are too few to estimate a noise.
        ClosureError: If a configuration cannot be assembled.

    Example:
        >>> machine = sst_pin.robots.delta(arm=0.151)  # drawn with 0.15
        >>> at = [machine.position_names.index(name) for name in machine.coordinates]
        >>> x = machine.home[at] + np.random.default_rng(0).uniform(-0.3, 0.3, (12, 3))
        >>> q = [machine.assemble(dict(zip(machine.coordinates, each))) for each in x]
        >>> z = machine.platform_pose(q)[:, 2, 3]
        >>> heights = sst_pin.identification.Heights("platform", x, heights=z)
        >>> motors = {f"rod_{k}{s}.x" for k in "123" for s in "ab"}
        >>> result = sst_pin.identification.calibrate_with(
        ...     sst_pin.robots.delta(arm=0.15), [heights], which=sorted(motors)
        ... )
        >>> len(result.hidden)
        0
    """
    systems = list(in_order("measurements", measurements, "measurements"))
    if not systems or not all(isinstance(each, Measurement) for each in systems):
        raise InputError("measurements", "at least one of Poses, Heights, Distances is needed")
    sizes = [each.count(len(chain.coordinates)) for each in systems]
    drawn = [_configurations(chain, np.asarray(x.x, dtype=float), x.start) for x in systems]
    machine, unknown = _with_systems(chain, systems, drawn)
    errors = [f"{place}.{axis}" for place in unknown for axis in geometry.AXES]
    errors += _considered(machine, list(frames_of(systems)), which, urdf, unknown)
    large, all_drawn = _enlarged(machine, errors), np.concatenate(drawn)
    if alone := _opening(large, errors, _without_errors(large, chain, all_drawn)):
        if which is not None:
            problem = f"{listed(alone)}: each alone opens loops that no joint closes"
            raise InputError("which", f"{problem}, as the robot is overconstrained")
        large = _enlarged(machine, [x for x in errors if x not in alone])
    names = large.coordinates[len(chain.coordinates) :]
    fit = _Fit(large, names, systems, sizes)
    q = _without_errors(large, chain, all_drawn)
    try:
        kinds = fit.linearized(q)
    except SingularConfigurationError:
        problem = "the errors open loops together, as the robot is overconstrained; name fewer"
        raise InputError("which", f'{problem}, such as those of motors, "motor.r*"') from None
    z, A = (np.concatenate(parts) for parts in zip(*(x[:2] for x in kinds), strict=True))
    for tolerance in _TOLERANCES:
        visible = independent(A, tolerance)
        if z.size < visible.size + (None in fit.given_noise(kinds)):
            problem = f"{z.size} equations for {visible.size} errors; give more poses, or which="
            raise InputError("poses", problem)
        try:
            values, root, noise = fit.values(q, visible)
            break
        except InputError:
            if tolerance == _TOLERANCES[-1]:
                raise
    found = {names[k]: float(x) for k, x in zip(visible, values, strict=True)}
    hidden = tuple(name for name in names if name not in found)
    moves = geometry.displacements(machine.mechanism, found)
    placements = _placements(machine, unknown, moves)
    of_robot = {place: move for place, move in moves.items() if place not in unknown}
    robot = chain.with_model(geometry.displaced(chain.mechanism.model, of_robot))
    return Calibration(tuple(found), values, root @ root.T, noise, hidden, robot, placements)


def _with_systems(
    chain: ClosedChain, systems: list[Measurement], drawn: list[Array]
) -> tuple[ClosedChain, dict[str, str]]:
    """The robot with a frame for each unknown base and target, and what these are relative to."""
    model, relative_to = pin.Model(chain.mechanism.model), dict[str, str]()
    for system, q in zip(systems, drawn, strict=True):
        body = model.frames[frame_id(model, system.frame)]
        for name in unknown_frames(system):
            is_base = name == system.reference
            carrier = "universe" if is_base else system.frame
            if relative_to.setdefault(name, carrier) != carrier:
                problem = f"{name} is on {relative_to[name]} and on {carrier}; give name="
                raise InputError("measurements", problem)
            if model.existFrame(name):
                continue
            joint, place = (0, system.placed(chain.engine.loops.placements(q, system.frame)))
            if not is_base:
                joint, place = body.parentJoint, body.placement
            model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return (chain.with_model(model) if relative_to else chain), relative_to


def _placements(
    machine: ClosedChain, unknown: Mapping[str, str], moves: geometry.Displacements
) -> dict[str, Array]:
    """Placements of unknown bases in the base, and of unknown targets on their frames."""
    model = geometry.displaced(machine.mechanism.model, moves)
    result = dict[str, Array]()
    for name, carrier in unknown.items():
        place = geometry.place_of(model, name)[1]
        if carrier != "universe":
            place = geometry.place_of(model, carrier)[1].actInv(place)
        result[name] = place.homogeneous
    return result


class _Fit:
    """Measurements as functions of the errors of an enlarged robot.

    Inside, all is free of units: positions and slides are parts of the robot's length.
    """

    def __init__(
        self,
        large: ClosedChain,
        names: Sequence[str],
        systems: list[Measurement],
        sizes: list[int],
    ) -> None:
        self._large, self._names, self._systems = large, names, systems
        self._ends = np.cumsum(sizes)[:-1]
        self._columns = [large.coordinates.index(name) for name in names]
        #: Units of the errors.
        self._units = large.mechanism.rate_scale[large.mechanism.coordinates[self._columns]]

    def linearized(self, q: Array) -> list[tuple[Array, Array, float]]:
        """For each kind of row: differences (rows,), derivatives by errors (rows, k), the unit."""
        engine, kinds = self._large.engine, list[tuple[Array, Array, float]]()
        length = self._large.mechanism.length
        for system, part in zip(self._systems, np.split(q, self._ends), strict=True):
            frames = system.reference, system.end
            places = [engine.loops.placements(part, name) for name in frames]
            J = [self._large.frame_jacobian(part, name)[..., self._columns] for name in frames]
            for each in system.rows(Sight(*places, *J)):
                unit = 1.0 if each.turns else length
                if not each.turns:
                    _require_near(each.z / unit, length)
                kinds.append((each.z / unit, each.A * self._units / unit, unit))
        return kinds

    def values(self, q: Array, visible: Indices) -> tuple[Array, Array, Array]:
        """Values of errors, the root of their covariance, and the noise, by Newton's method."""
        units, values = self._units[visible], np.zeros(visible.size)
        space, names = self._large.mechanism.space, [self._names[k] for k in visible]
        noise = np.ones(1)
        for step_number in counted(range(_STEPS), "calibrate, steps of Newton's method"):
            errors = dict(zip(names, np.tile(values * units, (len(q), 1)).T, strict=True))
            try:
                q = self._large.assemble(put(space, q, errors))
                kinds = self.linearized(q)
                given = self.given_noise(kinds)
                if not step_number:
                    noise = np.array([1.0 if x is None else x for x in given])
                ends = np.cumsum([len(z) for z, *_ in kinds])[:-1]
                weighted = zip(kinds, noise, strict=True)
                z, A = (
                    np.concatenate(parts)
                    for parts in zip(*((x[0] / s, x[1] / s) for x, s in weighted), strict=True)
                )
                step, root = solved(A[:, visible], z)
            except (ClosureError, SingularConfigurationError, InputError):
                raise InputError("poses", _TOO_LARGE) from None
            values += step
            left = np.split(z - A[:, visible] @ step, ends)
            taken = np.split(np.square(A[:, visible] @ root).sum(axis=1), ends)
            noise = self._updated(noise, given, left, taken)
            if step_number and np.abs(step).max(initial=0.0) < _SETTLED:
                break
        else:
            if (np.abs(step) > _UNSURE * np.linalg.norm(root, axis=1)).any():
                problem = f"the errors do not settle in {_STEPS} steps; give which= or better poses"
                raise InputError("poses", problem)
        self._require_noise(given, left, taken)
        return values * units, root * units[:, None], noise * [unit for *_, unit in kinds]

    def _require_noise(
        self, given: list[float | None], left: Sequence[Array], taken: Sequence[Array]
    ) -> None:
        """Refuse noises that cannot be estimated; warn of given ones that the rows contradict."""
        from scipy.special import chdtri

        for x, rest, used in zip(given, left, taken, strict=True):
            freedom = len(rest) - used.sum()
            if x is None and freedom < _LEAST_FREEDOM:
                problem = f"{len(rest)} values are too few to estimate it with the errors; give it"
                raise InputError("noise", problem)
            freedom = max(float(freedom), _LEAST_FREEDOM)
            if x is not None and rest @ rest > chdtri(freedom, _FALSE_ALARM):
                times = np.sqrt(rest @ rest / freedom)
                warn_caller(
                    f"calibrate: what is left is {times:.3g} times the given noise: the noise is "
                    "larger, or errors that matter are not considered",
                    DescriptionWarning,
                )

    def given_noise(self, kinds: list[tuple[Array, Array, float]]) -> list[float | None]:
        """The noise of each kind of row as given, free of units; None to estimate it."""
        given = [x for system in self._systems for x in system.noises[: system.kinds]]
        pairs = zip(given, kinds, strict=True)
        return [None if x is None else x / unit for x, (*_, unit) in pairs]

    def _updated(
        self,
        noise: Array,
        given: list[float | None],
        left: Sequence[Array],
        taken: Sequence[Array],
    ) -> Array:
        """Noise of each kind, from what is left of its rows and what the errors take of them."""
        kinds = zip(noise, given, left, taken, strict=True)
        result = np.zeros(len(noise))
        for k, (before, fixed, rest, used) in enumerate(kinds):
            freedom = max(len(rest) - float(used.sum()), _LEAST_FREEDOM)
            result[k] = before * np.sqrt(rest @ rest / freedom) if fixed is None else fixed
        return np.maximum(result, max(1e-13, _LEAST_NOISE * result.max()))


def _require_near(away: Array, length: float) -> None:
    """Refuse positions that no errors of a geometry explain, such as those in millimetres."""
    if np.abs(away).max(initial=0.0) > 10:
        k = int(np.abs(away).argmax())
        problem = f"a value is {np.abs(away[k]) * length:.4g} m from the robot as drawn"
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
    chain: ClosedChain,
    frames: Sequence[str],
    which: Sequence[str] | None,
    urdf: str | Path | None,
    unknown: Container[str],
) -> list[str]:
    """Names of the errors that fit patterns; with a URDF, it has to store them."""
    mechanism = chain.mechanism
    for frame in frames:
        frame_id(mechanism.model, frame)
    known = [frame for frame in frames if frame != "universe" and frame not in unknown]
    joints_and_ends = geometry.places_of(mechanism)
    places = list(dict.fromkeys([*joints_and_ends, *known]))
    names = [f"{place}.{axis}" for place in places for axis in geometry.AXES]
    stored = places if urdf is None else carriers_of(Urdf.read(urdf).root, mechanism.model)
    by_default = [f"{x}.*" for x in joints_and_ends if x not in known and x in stored]
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
