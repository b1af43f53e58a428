# SPDX-License-Identifier: BSD-2-Clause
"""Finds the placements of joints and closures of a robot from measured poses.

An error of the geometry is a displacement of a joint or of a closure's frame along or about an axis
from where it is drawn, or an error of the length of a rod (a `Distance` closure). The robot of
`enlarged_robot` has a joint for each error, so that Jacobians of its frames are derivatives by the
errors. `error_fit` finds the errors that fit the measurements.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, for_each_sample, in_order
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import (
    DescriptionWarning,
    InputError,
    SingularConfigurationError,
    warn_caller,
)
from ..files import as_path, text_writer, write_files
from ..loops.start import placed
from ..model import geometry
from ..model.closures import Constraint, Distance
from ..simulation.coordinate_motions import configurations_of
from ..summaries import Summary, listed
from .base_parameters import independent
from .enlarged_robot import EnlargedRobot, considered_errors, error_names
from .error_fit import ConvergenceError, ErrorEstimate, ErrorFit, KindEquations, first_noise
from .geometry_measurements import Measurement, Poses, frames_of
from .measuring_systems import with_systems
from .urdf_origins import with_origins

#: Tolerances of linear dependence. Each error has a column of derivatives of the measured values,
#: which is projected on the columns before it. If the remainder is shorter than the tolerance times
#: the column, the error is hidden. The tolerances are tried in this order, until Newton's method
#: converges. The first one is above the rounding of the derivatives. With each larger one, fewer
#: errors are left to estimate. There is no larger one than 1e-3: it would hide errors that the
#: measurements do show.
_TOLERANCES = (1e-6, 1e-5, 1e-4, 1e-3)


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
        placements: Homogeneous matrices of the unknown bases and targets of measuring systems,
            such as trackers, by name: `<name>_base` in the base of the robot, `<name>_target` in
            the frame that was measured.
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
        errors_of_robot = dict[str, float]()  # without those of measuring systems
        for name, value in zip(self.names, self.values, strict=True):
            place = name.rpartition(".")[0]
            if place not in self.placements:
                errors_of_robot[name] = value
        rods = geometry.extensions(mechanism.closures, errors_of_robot)
        if rods:
            warn_caller(_lengths_in_yaml(mechanism.closures, rods), DescriptionWarning)
        changes = dict[str, pin.SE3]()
        for place, displacement in geometry.displacements(mechanism, errors_of_robot).items():
            # The URDF has the drawn placement P, the mechanism the calibrated placement P D. With
            # the displacement (t, angles), t in the axes of the body that carries the place,
            # D = relative(P, displacement) has the rotation R_D of the angles alone, and the
            # translation R_P^T t. So R_P is needed: R_PD = R_P R_D gives R_P = R_PD R_D^T.
            R_D = geometry.relative(pin.SE3.Identity(), displacement).rotation
            _, PD = geometry.place_of(mechanism.model, place)
            R_P = PD.rotation @ R_D.T
            P = pin.SE3(R_P, np.zeros(3))  # D does not depend on the translation of P
            changes[place] = geometry.relative(P, displacement)
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
            which the others are followed; or in each pose, shape (N, nq). A robot with brakes needs
            it: it has the positions at which they hold.

    Raises:
        InputError: For fewer equations than errors that they could show, errors of `which` that
            open the loops or that the URDF cannot store, poses ten lengths of the robot away, poses
            from which Newton's method does not converge, or a robot with brakes and no `start`.
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

    Each kind of value has its own noise: the given one, or one that is estimated. A measuring
    system, such as a tracker, may have an unknown base, or an unknown target on the measured frame.
    Their placements are estimated with the errors of the robot. They come first, so that errors
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
        >>> rods = {f"rod_{k}{s}.x" for k in "123" for s in "ab"}
        >>> result = sst_pin.identification.calibrate_with(
        ...     sst_pin.robots.delta(arm=0.15), [heights], which=sorted(rods)
        ... )
        >>> len(result.hidden)
        0
    """
    require_robot("chain", chain)
    measurements = list(in_order("measurements", measurements, "measurements"))
    if not measurements or not all(isinstance(each, Measurement) for each in measurements):
        raise InputError("measurements", "at least one of Poses, Heights, Distances is needed")
    counts = []
    for measurement in measurements:
        counts.append(measurement.count(len(chain.coordinates)))
        measurement.check_noise()

    # The measured configurations of the robot as drawn.
    q_of_measurements = []
    for measurement in measurements:
        x = np.asarray(measurement.x, dtype=float)
        q_of_measurements.append(_configurations(chain, x, measurement.start))
    q = np.concatenate(q_of_measurements)

    # The robot as drawn, with a frame for each unknown base and target of a measuring system.
    with_frames = with_systems(chain, measurements, q_of_measurements)
    unknown_frames = list(with_frames.carriers)

    # The same robot with a joint for each error. Errors of the unknown frames come first. A
    # measurement compares two frames; each of them may be known or unknown.
    compared_frames = list(frames_of(measurements))
    errors_of_systems = error_names(unknown_frames)
    errors_of_robot = considered_errors(
        with_frames.chain, compared_frames, which, urdf, unknown_frames
    )
    enlarged = _enlarged(with_frames.chain, [*errors_of_systems, *errors_of_robot], q, which)

    # The errors that the measurements show, and their values.
    fit = ErrorFit(enlarged, measurements, counts)
    visible, estimate = _visible_errors(fit, enlarged.without_errors(q))

    # The result: the robot with these errors, without the frames of measuring systems.
    names = [enlarged.errors[k] for k in visible]
    values = dict(zip(names, estimate.values.tolist(), strict=True))
    displacements = geometry.displacements(with_frames.chain.mechanism, values)
    return Calibration(
        names=tuple(names),
        values=estimate.values,
        covariance=estimate.root @ estimate.root.T,
        noise=estimate.noise,
        hidden=tuple(name for name in enlarged.errors if name not in values),
        chain=_calibrated(chain, displacements, values, unknown_frames),
        placements=with_frames.placements(displacements),
    )


def _calibrated(
    chain: ClosedChain,
    displacements: geometry.Displacements,
    values: Mapping[str, float],
    unknown_frames: Container[str],
) -> ClosedChain:
    """The robot with displaced places and changed lengths of rods.

    `unknown_frames` belong to measuring systems: they are not in `chain`, and are left out.
    """
    displacements_of_robot = {}
    for place, displacement in displacements.items():
        if place not in unknown_frames:
            displacements_of_robot[place] = displacement
    model = geometry.displaced(chain.mechanism.model, displacements_of_robot)
    calibrated = chain.with_model(model)
    lengths = geometry.length_names(chain.closures)
    changes_of_lengths = {name: value for name, value in values.items() if name in lengths}
    if changes_of_lengths:
        calibrated = calibrated.with_design(changes_of_lengths)
    return calibrated


def _configurations(chain: ClosedChain, x: Array, start: ArrayLike | None) -> Array:
    """Configurations of the robot as drawn for positions x of the coordinates, shape (N, nq)."""
    guesses = None if start is None else finite_array("start", start, ())
    size = len(chain.position_names)
    if guesses is not None and guesses.shape not in ((size,), (len(x), size)):
        raise InputError("start", f"shape {guesses.shape}, expected (nq,) or (N, nq)")
    if guesses is None or guesses.ndim == 1:
        return configurations_of(chain.engine, x, guesses)

    def assembled(positions: Array, guess: Array) -> Array:
        """The configuration with these positions, from a guess of all joints."""
        return placed(chain.engine, dict(zip(chain.coordinates, positions, strict=True)), guess)

    return for_each_sample(assembled, [x, guesses], (1, 1), (size,))


def _enlarged(
    chain: ClosedChain, errors: Sequence[str], q: Array, which: Sequence[str] | None
) -> EnlargedRobot:
    """The robot with a joint for each error that does not open the loops alone.

    For instance, a tilt of one axis of a planar four-bar opens its loop. If the caller names errors
    by `which`, one that opens the loops is refused.
    """
    enlarged = EnlargedRobot(chain, errors)
    opening = enlarged.opening_errors(enlarged.without_errors(q))
    if not opening:
        return enlarged
    if which is not None:
        problem = f"{listed(opening)}: each alone opens loops that no joint closes"
        raise InputError("which", f"{problem}, as the robot is overconstrained")
    return EnlargedRobot(chain, [name for name in errors if name not in opening])


def _visible_errors(fit: ErrorFit, q: Array) -> tuple[Indices, ErrorEstimate]:
    """Indices of the errors that the measurements show, and their values.

    Errors are visible if the columns of their derivatives at the configurations q, without errors,
    are independent. A column that is nearly dependent can keep Newton's method from converging.
    Then the next larger tolerance leaves it out.
    """
    try:
        equations = fit.equations(q)
    except SingularConfigurationError:
        problem = "the errors open loops together, as the robot is overconstrained; name fewer"
        raise InputError("which", f'{problem}, such as those of motors, "motor.r*"') from None
    noise = first_noise(equations)
    A = np.concatenate([kind.A for kind in equations])

    def estimate(tolerance: float) -> tuple[Indices, ErrorEstimate]:
        visible = independent(A, tolerance)
        _require_enough(equations, visible.size)
        return visible, fit.estimate(q, visible, noise)

    *smaller_tolerances, largest_tolerance = _TOLERANCES
    for tolerance in smaller_tolerances:
        with suppress(ConvergenceError):
            return estimate(tolerance)
    return estimate(largest_tolerance)


def _require_enough(equations: Sequence[KindEquations], errors: int) -> None:
    """Refuse too few equations: at least one for each error, and one more to estimate a noise.

    With several unknown noises this is a lower bound. `ErrorFit.estimate` checks for each kind of
    values whether they suffice to estimate its noise.
    """
    count = sum(len(kind.z) for kind in equations)
    needed = errors
    if any(kind.stated_noise is None for kind in equations):
        needed += 1
    if count < needed:
        problem = f"{count} equations for {errors} errors; give more poses, or which="
        raise InputError("poses", problem)


def _lengths_in_yaml(closures: Iterable[Constraint], rods: Container[str]) -> str:
    """A sentence that says what to write into a YAML for the lengths of rods."""
    entries = []
    for closure in closures:
        if isinstance(closure, Distance) and str(closure) in rods:
            entries.append(f"distance {closure.distance!r} for {closure}")
    return f"a URDF has no lengths of rods; in its YAML write the type {', '.join(entries)}"
