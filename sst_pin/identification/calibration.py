# SPDX-License-Identifier: BSD-2-Clause
"""Finds the placements of joints and closures of a robot from measured poses.

An error of the geometry is a displacement of a joint or of a closure's frame along or about an axis
from where it is drawn, or an error of the length of a rod (a `Distance` closure). The enlarged
robot has a joint for each error: three slides and three hinges at each place, and a slide for each
rod. So the Jacobian of a frame of this robot, along motions that keep the loops closed, has the
derivatives of a pose by the errors. Newton's method finds the errors that fit the poses.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, for_each_sample, in_order
from ..closed_chain import ClosedChain
from ..engine import require_robot
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
from ..model.closures import Constraint, Distance
from ..model.named_positions import with_positions
from ..model.thresholds import RANK_TOLERANCE
from ..model.tree import frame_id
from ..progress import counted
from ..reading import Urdf
from ..simulation.coordinate_motions import configurations_of
from ..summaries import Summary, listed
from .base_parameters import independent
from .estimation import solved
from .geometry_measurements import FramePair, Measurement, Poses, frames_of, unknown_frames
from .urdf_numbers import carriers_of, with_origins

#: An error opens the loops if the joints leave a larger gap, free of units.
_CLOSED = 1e-6
#: An error is hidden if the part of it that errors before it do not explain is smaller. The first
#: tolerance with which Newton's method converges is used.
_TOLERANCES = (1e-6, 1e-5, 1e-4, 1e-3)
#: Most steps of Newton's method, and the largest change of an error in the last one, free of units.
_STEPS = 30
_CONVERGED = 1e-9
#: Least ratio of the noises of positions and orientations, and of its reverse: less is rounding.
_LEAST_NOISE = 1e-4
#: Without convergence: the largest last step of Newton's method that is accepted, in standard
#: deviations of the errors.
_UNSURE = 0.01
#: Degrees of freedom that must be left to estimate a noise.
_LEAST_FREEDOM = 0.5
#: Probability of a warning although the noise that the caller states is true.
_FALSE_ALARM = 1e-6
#: Farther from the robot as drawn, in its lengths, a value has another unit or another base.
_FAR = 10.0
_TOO_LARGE = "errors too large for Newton's method, or which= leaves out those that matter"


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(Summary):
    """Errors of a geometry.

    Attributes:
        names: The errors found, such as "elbow.x" along x of the link that carries the joint, and
            "elbow.rz" about z of the joint's frame before it moves: [m] and [rad]. An offset of a
            motor is the turn about its axis. "a - b.length" is the length of the `Distance` closure
            of the frames a and b. `with_design` has the same names.
        values: Their values, shape (k,).
        covariance: Their covariance, shape (k, k).
        noise: Standard deviations of the measured positions, [m], and orientations, [rad]; the
            second is missing where only positions were measured. For several measurements, those
            of each in their order.
        hidden: Errors that cannot be distinguished from those found, or change nothing; they are
            zero.
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

        Lengths of rods are in the YAML beside it: a `DescriptionWarning` says what to write there.

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
        mechanism = self.chain.mechanism
        errors_of_robot = dict[str, float]()
        for name, value in zip(self.names, self.values, strict=True):
            place = name.rpartition(".")[0]
            if place not in self.placements:
                errors_of_robot[name] = value
        rods = geometry.extensions(mechanism.closures, errors_of_robot)
        if rods:
            warn_caller(_lengths_in_yaml(mechanism.closures, rods), DescriptionWarning)
        changes = dict[str, pin.SE3]()
        for place, displacement in geometry.displacements(mechanism, errors_of_robot).items():
            # A displacement is along the axes of the place as drawn: before its rotation.
            rotation = geometry.relative(pin.SE3.Identity(), displacement).rotation
            calibrated = geometry.place_of(mechanism.model, place)[1].rotation
            drawn = pin.SE3(calibrated @ rotation.T, np.zeros(3))
            changes[place] = geometry.relative(drawn, displacement)
        return with_origins(urdf, mechanism.model, changes, folder)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = []
        for name, value, deviation in zip(self.names, self.values, self.deviations, strict=True):
            rows.append((name, f"{value:.4g} +- {3 * deviation:.1g}"))
        if self.hidden:
            rows.append(("hidden", listed(self.hidden, 12)))
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

    Only errors that the poses show are estimated. Lengths of rods (`Distance` closures) come first,
    the others are in the order of the tree.

    Args:
        chain: The robot as it is drawn.
        frame: Name of the frame that was measured.
        x: Measured positions of the coordinates, shape (N, n), [rad] or [m].
        poses: Measured poses of the frame in the base, shape (N, 4, 4), or positions of its origin,
            shape (N, 3), [m]. NaN: not measured; see `Poses`.
        which: The errors considered: names, or patterns such as "motor_*.r*", of joints that move,
            of frames of closures, and of `frame`, and lengths of rods; by default of all joints and
            closures. An error that alone opens loops of an overconstrained robot is left out.
        urdf: The URDF that `write_urdf` of the result takes: by default only errors that it, or the
            YAML beside it, can store are considered.
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
    require_robot("chain", chain)
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
    require_robot("chain", chain)
    systems = list(in_order("measurements", measurements, "measurements"))
    if not systems or not all(isinstance(each, Measurement) for each in systems):
        raise InputError("measurements", "at least one of Poses, Heights, Distances is needed")
    sizes = [system.count(len(chain.coordinates)) for system in systems]

    # The robot as drawn in the measured configurations, with a frame for what is unknown of each
    # measuring system.
    q_of_systems = [_configurations(chain, np.asarray(s.x, dtype=float), s.start) for s in systems]
    machine, unknown = _with_systems(chain, systems, q_of_systems)
    q_of_all = np.concatenate(q_of_systems)

    # The enlarged robot has a joint for each error.
    errors = _errors_at(unknown)
    errors += _considered(machine, list(frames_of(systems)), which, urdf, unknown)
    large = _enlarged(machine, errors)
    opening = _opening(large, errors, _without_errors(large, chain, q_of_all))
    if opening:
        if which is not None:
            problem = f"{listed(opening)}: each alone opens loops that no joint closes"
            raise InputError("which", f"{problem}, as the robot is overconstrained")
        large = _enlarged(machine, [name for name in errors if name not in opening])
    names = large.coordinates[len(chain.coordinates) :]

    # The errors that the measurements show, and their values.
    fit = _Fit(large, names, systems, sizes)
    q = _without_errors(large, chain, q_of_all)
    try:
        kinds = fit.linearized(q)
    except SingularConfigurationError:
        problem = "the errors open loops together, as the robot is overconstrained; name fewer"
        raise InputError("which", f'{problem}, such as those of motors, "motor.r*"') from None
    A = np.concatenate([kind.A for kind in kinds])
    noises_to_estimate = any(kind.stated_noise is None for kind in kinds)
    for tolerance in _TOLERANCES:
        visible = independent(A, tolerance)
        if len(A) < visible.size + noises_to_estimate:
            problem = f"{len(A)} equations for {visible.size} errors; give more poses, or which="
            raise InputError("poses", problem)
        try:
            solution = fit.solution(q, visible)
            break
        except InputError:
            if tolerance == _TOLERANCES[-1]:
                raise

    # The robot with these errors.
    value_of = {names[k]: float(x) for k, x in zip(visible, solution.values, strict=True)}
    hidden = tuple(name for name in names if name not in value_of)
    moves = geometry.displacements(machine.mechanism, value_of)
    placements = _placements(machine, unknown, moves)
    moves_of_robot = {place: move for place, move in moves.items() if place not in unknown}
    robot = chain.with_model(geometry.displaced(chain.mechanism.model, moves_of_robot))
    lengths = geometry.length_names(chain.closures)
    changes_of_lengths = {name: value for name, value in value_of.items() if name in lengths}
    if changes_of_lengths:
        robot = robot.with_design(changes_of_lengths)
    return Calibration(
        names=tuple(value_of),
        values=solution.values,
        covariance=solution.root @ solution.root.T,
        noise=solution.noise,
        hidden=hidden,
        chain=robot,
        placements=placements,
    )


def _with_systems(
    chain: ClosedChain, systems: list[Measurement], q_of_systems: list[Array]
) -> tuple[ClosedChain, dict[str, str]]:
    """The robot with a frame for each unknown base and target of a measuring system.

    The second result has the names of these frames, and for each the frame that carries it.
    """
    model = pin.Model(chain.mechanism.model)
    carriers = dict[str, str]()
    for system, q in zip(systems, q_of_systems, strict=True):
        for name in unknown_frames(system):
            is_base = name == system.reference
            carrier = "universe" if is_base else system.frame
            if carriers.setdefault(name, carrier) != carrier:
                problem = f"{name} is on {carriers[name]} and on {carrier}; give name="
                raise InputError("measurements", problem)
            if model.existFrame(name):  # of a measurement with the same system
                continue
            if is_base:
                joint = 0
                place = system.guess_of_base(chain.engine.loops.placements(q, system.frame))
            else:
                measured = model.frames[frame_id(model, system.frame)]
                joint = measured.parentJoint
                place = measured.placement
            model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    if not carriers:
        return chain, carriers
    return chain.with_model(model), carriers


def _placements(
    machine: ClosedChain, unknown: Mapping[str, str], moves: geometry.Displacements
) -> dict[str, Array]:
    """Placements of unknown bases in the base, and of unknown targets on their frames."""
    model = geometry.displaced(machine.mechanism.model, moves)
    result = dict[str, Array]()
    for name, carrier in unknown.items():
        _, place = geometry.place_of(model, name)
        if carrier != "universe":
            _, place_of_carrier = geometry.place_of(model, carrier)
            place = place_of_carrier.actInv(place)
        result[name] = place.homogeneous
    return result


class _Kind(NamedTuple):
    """The equations of one kind of measured values: A times the errors is z, but for noise.

    Attributes:
        z: Measured less computed values, in the unit, shape (rows,).
        A: Derivatives of the computed values by the errors, free of units, shape (rows, k).
        unit: The unit of the values, [m] or [rad].
        stated_noise: Standard deviation that the caller states, in the unit; None to estimate it.
    """

    z: Array
    A: Array
    unit: float
    stated_noise: float | None


class _Solution(NamedTuple):
    """Errors that fit the measurements."""

    #: Shape (k,), [m] or [rad].
    values: Array
    #: A root of their covariance root root^T, shape (k, k).
    root: Array
    #: Standard deviation of each kind of measured values, [m] or [rad].
    noise: Array


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
        self._large = large
        self._names = names
        self._systems = systems
        #: Where the samples of each system but the first begin.
        self._starts = np.cumsum(sizes)[:-1]
        self._columns = [large.coordinates.index(name) for name in names]
        #: Units of the errors.
        self._units = large.mechanism.rate_scale[large.mechanism.coordinates[self._columns]]

    def linearized(self, q: Array) -> list[_Kind]:
        """The equations of each kind of values at configurations q, shape (N, nq)."""
        kinds = list[_Kind]()
        length = self._large.mechanism.length
        for system, q_of_system in zip(self._systems, np.split(q, self._starts), strict=True):
            place_a, J_a = self._frame(q_of_system, system.reference)
            place_b, J_b = self._frame(q_of_system, system.end)
            rows_of_kinds = system.rows(FramePair(a=place_a, b=place_b, J_a=J_a, J_b=J_b))
            noises = system.noises[: system.kinds]
            for rows, noise in zip(rows_of_kinds, noises, strict=True):
                unit = 1.0 if rows.turns else length
                if not rows.turns:
                    _require_near(rows.z, length)
                kinds.append(
                    _Kind(
                        z=rows.z / unit,
                        A=rows.A * self._units / unit,
                        unit=unit,
                        stated_noise=None if noise is None else noise / unit,
                    )
                )
        return kinds

    def _frame(self, q: Array, name: str) -> tuple[Array, Array]:
        """Placements of a frame, (N, 4, 4), and their derivatives by the errors, (N, 6, k)."""
        placements = self._large.engine.loops.placements(q, name)
        return placements, self._large.frame_jacobian(q, name)[..., self._columns]

    def solution(self, q: Array, visible: Indices) -> _Solution:
        """The errors of these indices by Newton's method, from configurations q without errors.

        Each step solves the equations, weighted by the noise of their kind, by least squares; the
        noise that is not stated is estimated from the residuals of the step before.
        """
        units = self._units[visible]
        names = [self._names[k] for k in visible]
        values = np.zeros(visible.size)  # in their units
        noise = np.empty(0)
        for step_number in counted(range(_STEPS), "calibrate, steps of Newton's method"):
            try:
                q = self._with_errors(q, names, values * units)
                kinds = self.linearized(q)
                if step_number == 0:
                    stated = [kind.stated_noise for kind in kinds]
                    noise = np.array([1.0 if x is None else x for x in stated])
                z = np.concatenate([k.z / s for k, s in zip(kinds, noise, strict=True)])
                A = np.concatenate([k.A / s for k, s in zip(kinds, noise, strict=True)])
                A = A[:, visible]
                step, root = solved(A, z)
            except (ClosureError, SingularConfigurationError, InputError):
                raise InputError("poses", _TOO_LARGE) from None
            values += step
            starts = np.cumsum([len(kind.z) for kind in kinds])[:-1]
            residuals = np.split(z - A @ step, starts)
            # The diagonal of the hat matrix: the part of each equation that fits the errors.
            leverages = np.split(np.square(A @ root).sum(axis=1), starts)
            noise = _updated_noise(noise, kinds, residuals, leverages)
            if step_number > 0 and np.abs(step).max(initial=0.0) < _CONVERGED:
                break
        else:  # no convergence
            if (np.abs(step) > _UNSURE * np.linalg.norm(root, axis=1)).any():
                problem = f"the errors do not settle in {_STEPS} steps; give which= or better poses"
                raise InputError("poses", problem)
        for kind, residual, leverage in zip(kinds, residuals, leverages, strict=True):
            _check_noise(kind, residual, leverage)
        return _Solution(
            values=values * units,
            root=root * units[:, None],
            noise=noise * [kind.unit for kind in kinds],
        )

    def _with_errors(self, q: Array, names: Sequence[str], values: Array) -> Array:
        """Closed configurations with these errors, near q."""
        errors = {name: np.full(len(q), x) for name, x in zip(names, values, strict=True)}
        return self._large.assemble(with_positions(self._large.mechanism.space, q, errors))


def _updated_noise(
    noise: Array, kinds: Sequence[_Kind], residuals: Sequence[Array], leverages: Sequence[Array]
) -> Array:
    """Noise of each kind, stated or from its residuals, which are in units of the last noise."""
    result = np.zeros(len(noise))
    for k, kind in enumerate(kinds):
        if kind.stated_noise is None:
            freedom = _degrees_of_freedom(leverages[k])
            result[k] = noise[k] * np.sqrt(residuals[k] @ residuals[k] / freedom)
        else:
            result[k] = kind.stated_noise
    # Without a floor, exact values of one kind would have infinite weight.
    return np.maximum(result, max(1e-13, _LEAST_NOISE * result.max()))


def _degrees_of_freedom(leverage: Array) -> float:
    """Degrees of freedom of residuals, at least `_LEAST_FREEDOM`."""
    return max(len(leverage) - float(leverage.sum()), _LEAST_FREEDOM)


def _check_noise(kind: _Kind, residual: Array, leverage: Array) -> None:
    """Refuse a noise that cannot be estimated; warn of a stated one that is too small.

    Residuals are in units of the noise.
    """
    from scipy.special import chdtri

    if kind.stated_noise is None:
        if len(residual) - leverage.sum() < _LEAST_FREEDOM:
            problem = f"{len(residual)} values are too few to estimate it with the errors; give it"
            raise InputError("noise", problem)
        return
    freedom = _degrees_of_freedom(leverage)
    if residual @ residual > chdtri(freedom, _FALSE_ALARM):
        times = np.sqrt(residual @ residual / freedom)
        warn_caller(
            f"calibrate: the residuals are {times:.3g} times the given noise: the noise is larger, "
            "or errors that matter are not considered",
            DescriptionWarning,
        )


def _require_near(differences: Array, length: float) -> None:
    """Refuse positions that no errors of a geometry explain, such as those in millimetres."""
    if np.abs(differences).max(initial=0.0) > _FAR * length:
        problem = f"a value is {np.abs(differences).max():.4g} m from the robot as drawn"
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


def _lengths_in_yaml(closures: Iterable[Constraint], rods: Container[str]) -> str:
    """What to write into a YAML for the lengths of rods."""
    entries = []
    for closure in closures:
        if isinstance(closure, Distance) and str(closure) in rods:
            entries.append(f"distance {closure.distance!r} for {closure}")
    return f"a URDF has no lengths of rods; in its YAML write the type {', '.join(entries)}"


def _errors_at(places: Iterable[str]) -> list[str]:
    """Names of the six errors of each place."""
    errors = []
    for place in places:
        errors += [f"{place}.{axis}" for axis in geometry.AXES]
    return errors


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
    lengths = geometry.length_names(mechanism.closures)
    names = [*lengths, *_errors_at(places)]
    if urdf is None:
        storable = set(places)
    else:
        storable = set(carriers_of(Urdf.read(urdf).root, mechanism.model))
    if which is None:
        patterns = [f"{x}.*" for x in joints_and_ends if x not in known and x in storable]
        patterns += lengths
    else:
        patterns = list(which)
    errors = set[str]()
    for pattern in patterns:
        matches = [name for name in names if fnmatchcase(name, pattern)]
        if not matches:
            raise UnknownNameError("error of the geometry", pattern, names)
        errors.update(matches)
    considered = [name for name in names if name in errors]
    displaced = [name for name in considered if name not in lengths]
    others = [name for name in displaced if name.rpartition(".")[0] not in storable]
    if others:
        problem = f"{urdf} cannot store {listed(others)}: no joint of it is there; leave them out"
        raise InputError("which", problem)
    return considered


def _enlarged(chain: ClosedChain, errors: Sequence[str]) -> ClosedChain:
    """The robot with a joint for each error of the geometry.

    Its coordinates are the chain's, and the errors that the loops allow independently.
    """
    mechanism = chain.mechanism
    joints = []
    rods_of_joints = dict[str, str]()
    for name in errors:
        for place, displacement in geometry.displacements(mechanism, {name: 1.0}).items():
            joints.append((name, place, displacement))
        for rod in geometry.extensions(mechanism.closures, {name: 1.0}):
            rods_of_joints[name] = rod
    model = geometry.enlarged(mechanism.model, joints, slides=rods_of_joints)
    closures = geometry.extended(chain.closures, rods_of_joints)
    large = ClosedChain(model, closures, [*chain.coordinates, *errors])
    lost = set(chain.coordinates) - set(large.coordinates)
    if lost:
        raise InputError("which", f"the errors leave no choice of {listed(sorted(lost))}")
    return large


def _without_errors(large: ClosedChain, chain: ClosedChain, q: Array) -> Array:
    """Configurations of the enlarged robot for configurations q of the chain, shape (N, nq)."""
    result = np.tile(pin.neutral(large.mechanism.model), (len(q), 1))
    result[:, [large.position_names.index(name) for name in chain.position_names]] = q
    return result


def _opening(large: ClosedChain, errors: Sequence[str], q: Array) -> list[str]:
    """The errors that alone open the loops in all configurations of the enlarged robot.

    The other joints can close the loops if the column of an error in Phi is a combination of
    theirs. What is left of the column, after its projection onto theirs, is the gap.
    """
    columns = large.mechanism.space.rates_of(errors)
    least_gaps = np.full(len(errors), np.inf)
    for configuration in q:
        Phi = large.Phi(configuration) * large.mechanism.rate_scale
        Phi *= large.mechanism.row_scale[:, None]
        U, s, _ = np.linalg.svd(np.delete(Phi, columns, axis=1), full_matrices=False)
        span = U[:, s > RANK_TOLERANCE * s.max(initial=0.0)]
        by_errors = Phi[:, columns]
        gaps = np.linalg.norm(by_errors - span @ (span.T @ by_errors), axis=0)
        least_gaps = np.minimum(least_gaps, gaps)
    return [name for name, gap in zip(errors, least_gaps, strict=True) if gap > _CLOSED]
