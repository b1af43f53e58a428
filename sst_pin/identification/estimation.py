# SPDX-License-Identifier: BSD-2-Clause
"""Estimates base parameters from measured motions and torques, and predicts torques."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array, positive_number, whole_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..simulation.trajectories import Trajectory, require_motion
from ..summaries import Summary
from .base_parameters import BaseParameters, require_base
from .filters import decimated, noise_correlations

#: Residuals up to this number of standard deviations count in full (P. J. Huber).
_HUBER = 1.345
#: Combinations with a smaller part in the motion are not shown by it.
_UNSHOWN = 1e-9
#: Median of the absolute values of normal noise, in standard deviations.
_MEDIAN_OF_NORMAL = 0.6745
#: Most iterations for the noise, and its last relative change.
_ITERATIONS = 100
_CONVERGED = 1e-4
#: Level of the intervals: the probability within three standard deviations.
INTERVAL = 0.9973
#: Fewest degrees of freedom of the residuals of a motor. With fewer, the noise of one motor can
#: vanish, and the intervals hold far less than their level.
_LEAST_FREEDOM = 5.0
#: Squares of larger torques, in units of their rounding, are not finite.
_LARGEST = 1e100


@dataclass(frozen=True, repr=False, eq=False)
class Estimate(Summary):
    """Base parameters as measured.

    Attributes:
        base: The combinations.
        values: Their values, shape (b,).
        covariance: Their covariance, shape (b, b), for torques whose noise is independent from
            sample to sample before the filter of `decimate`.
        noise: Standard deviation of each motor's torque from the model, shape (motors,); the same
            for all where there are more motors than degrees of freedom.
        degrees_of_freedom: Number of independent residuals that show the noise of a motor, for the
            motor with the fewest.
        decimate: One sample of this many was used, after a filter.
    """

    base: BaseParameters
    values: Array
    covariance: Array
    noise: Array
    degrees_of_freedom: float
    decimate: int = 1

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, shape (b,)."""
        return np.sqrt(np.diag(self.covariance))

    def intervals(self, level: float = INTERVAL) -> Array:
        """Half-widths of the confidence intervals of the values, shape (b,), by Student's t.

        Args:
            level: Part of all estimates whose interval contains the true value. The default is that
                of three standard deviations, if these are known.
        """
        from scipy.stats import t

        level = positive_number("level", level)
        if level >= 1:
            raise InputError("level", f"{level:g}, expected a part below 1")
        factors = t.isf((1 - level) / 2, self.degrees_of_freedom)
        return np.asarray(factors * self.deviations)

    @property
    def supported(self) -> Flags:
        """Which values differ from zero by more than `intervals()`, shape (b,)."""
        return np.abs(self.values) > self.intervals()

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = []
        for name, value, interval, supported in zip(
            self.base.names, self.values, self.intervals(), self.supported, strict=True
        ):
            remark = "" if supported else ", not supported"
            rows.append((f"{value:.4g} +- {interval:.1g}{remark}", name))
        return f"{len(self.base)} base parameters, intervals of {INTERVAL:.1%}", rows


def estimate(
    chain: ClosedChain,
    base: BaseParameters,
    q: ArrayLike,
    va: ArrayLike,
    aa: ArrayLike,
    tau: ArrayLike,
    *,
    robust: bool = False,
    decimate: int = 1,
) -> Estimate:
    """Base parameters from measurements by weighted least squares, with their covariance.

    Each motor is weighted by its own noise, which the residuals show; with more motors than degrees
    of freedom all have the same noise. Parameters that `base` does not consider keep the values of
    the chain. With `decimate` both sides of the equations are filtered alike, so friction that
    jumps has no bias (M. Gautier, ICRA 1997); the torques must not be filtered before.

    Args:
        chain: The robot.
        base: The combinations that are estimated.
        q: Configurations on the closures, shape (N, nq).
        va: Rates of the coordinates, shape (N, n).
        aa: Accelerations of the coordinates, shape (N, n).
        tau: Measured torques of the motors, shape (N, motors).
        robust: Whether large residuals count less, by Huber's function.
        decimate: One sample of this many, evenly spaced in time, is used, after a low-pass filter
            forwards and backwards. As in `measured_motion`.

    Raises:
        InputError: For wrong shapes, base parameters of another robot, fewer motors than
            coordinates, too few samples, or a motion that does not show all combinations. Samples
            are too few if their residuals do not show the noise of each motor.

    Example:
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> q, va, aa = sst_pin.identification.random_states(chain, 200)
        >>> tau = chain.compute_torques(q, va, aa)
        >>> tau += 0.01 * np.random.default_rng(1).normal(size=tau.shape)
        >>> result = sst_pin.identification.estimate(chain, base, q, va, aa, tau)
        >>> off = result.values - base.matrix @ chain.dynamic_parameters
        >>> result.noise.round(2), bool((np.abs(off) < 3 * result.deviations).all())
        (array([0.01]), True)
    """
    require_robot("chain", chain)
    n = chain.degrees_of_freedom
    motors = len(chain.motor_names)
    measured = finite_array("tau", tau, (motors,))
    if np.abs(measured).max(initial=0.0) > _LARGEST:
        raise InputError("tau", f"torques up to {np.abs(measured).max():.2g}: squares overflow")
    require_base(chain, base)
    decimate = whole_number("decimate", decimate, 1)
    Y = chain.torque_regressor(q, va, aa)
    _require_enough(Y, measured, n, len(base), decimate)
    J, regressor, forces = _equations(chain, base, Y, measured, q, va, decimate)
    correlations = noise_correlations(decimate)

    # Weighted least squares. The noise of each motor follows from the residuals, and the weights
    # from the noise, until it does not change.
    noise = np.ones(motors)
    weights = np.ones(forces.shape)  # of Huber's function
    for _ in range(_ITERATIONS):
        whitened = _whitened(J, noise, regressor, forces)
        weighted_A = whitened.A * weights[..., None]
        values, inverse = solved(weighted_A, whitened.z * weights)
        spread = _Spread(weighted_A, inverse, whitened.torques / noise[:, None], correlations)
        residuals = whitened.z - whitened.A @ values
        torque_errors = (whitened.torques @ residuals[..., None])[..., 0]
        if robust:
            deviations = np.median(np.abs(torque_errors), axis=0) / _MEDIAN_OF_NORMAL
            squares = len(residuals) * deviations**2
            weights = np.sqrt(np.minimum(1, _HUBER / np.maximum(np.abs(residuals), 1e-300)))
        else:
            squares = np.sum(torque_errors**2, axis=0)
        freedom = spread.freedom
        if motors > n:  # the motion does not show the shares of single motors
            squares = np.full(motors, squares.sum())
            freedom = np.full(motors, freedom.sum())
        fewest = _require_freedom(chain, freedom / spread.repetition, len(Y), len(base))
        updated = np.sqrt(squares / freedom)
        converged = np.allclose(updated, noise, rtol=_CONVERGED, atol=0)
        # Exact torques have no noise; then the rounding of the torques is the noise.
        noise = np.maximum(updated, 1e-14 * np.abs(measured).max() + 1e-150)
        if converged:
            break

    if robust:  # Huber's covariance is a factor times the covariance of least squares
        _, inverse = solved(whitened.A, residuals)
        torques = whitened.torques / noise[:, None]
        spread = _Spread(whitened.A, inverse, torques, correlations)
        covariance = spread.covariance * _huber_factor(residuals, len(base))
    else:
        covariance = spread.covariance
    return Estimate(base, values, covariance, noise, fewest, decimate)


class _Equations(NamedTuple):
    """The equations regressor theta = forces of N samples, with theta of the base parameters."""

    J: Array  #: Actuator Jacobians, shape (N, motors, n).
    regressor: Array  #: Shape (N, n, b).
    forces: Array  #: J^T tau, without the part of known parameters, shape (N, n).


def _equations(
    chain: ClosedChain,
    base: BaseParameters,
    Y: Array,
    measured: Array,
    q: ArrayLike,
    va: ArrayLike,
    decimate: int,
) -> _Equations:
    """The equations Y theta = J^T tau, for measured torques, filtered and decimated.

    Parameters that are not considered go to the right side.
    """
    if decimate > 1:  # friction as the filter sees it
        Y = Y.copy()
        names = chain.dynamic_parameters.names
        dry = [k for k, name in enumerate(names) if name.endswith(".coulomb")]
        v = chain.joint_rates(q, va)
        rates = np.hstack([v, chain.engine.line_rates(q, v)])  # in the order of `dry`
        Y[..., dry] *= _mean_signs(rates)[:, None]
    J = chain.actuator_jacobian(q)
    known = np.array(chain.dynamic_parameters)
    known[base.considered] = 0
    forces = (measured[:, None, :] @ J)[:, 0] - Y @ known
    regressor = decimated(Y[..., base.columns], decimate)
    forces = decimated(forces, decimate)
    if decimate > 1:
        J = J[::decimate][1:-1]  # the samples of `decimated`
    return _Equations(J, regressor, forces)


def _huber_factor(residuals: Array, b: int) -> float:
    """The variance of Huber's estimate of b values, in units of that by least squares.

    The residuals are in units of their noise. See P. J. Huber, Robust Statistics, 1981, Eq. (7.6.8)
    and its correction for many parameters.
    """
    inside = float((np.abs(residuals) < _HUBER).mean())
    correction = 1 + b / residuals.size * (1 - inside) / inside
    mean_square = np.sum(np.clip(residuals, -_HUBER, _HUBER) ** 2) / (residuals.size - b)
    return float(correction**2 * mean_square / inside**2)


class _Whitened(NamedTuple):
    """The equations A theta = z of all samples, in units of their noise.

    Noise of the torques with the covariance N = diag(noise^2) is noise of the forces J^T tau with
    J^T N J = C C^T. So both sides of Y theta = J^T tau are multiplied by C^-1; the noise of z then
    has the covariance 1.
    """

    #: C^-1 Y, shape (N, n, b).
    A: Array
    #: C^-1 J^T tau, shape (N, n).
    z: Array
    #: Torque errors for one unit of an error of z, shape (N, motors, n): N J C^-T. Of the torque
    #: errors that give the same forces, these are the most likely ones.
    torques: Array


def _whitened(J: Array, noise: Array, regressor: Array, forces: Array) -> _Whitened:
    """The equations regressor theta = forces in units of their noise.

    Args:
        J: Actuator Jacobians, shape (N, motors, n).
        noise: Standard deviations of the motors' torques, shape (motors,).
        regressor: Y, shape (N, n, b).
        forces: J^T tau, shape (N, n).
    """
    try:
        C_inverse = np.linalg.inv(np.linalg.cholesky((J.mT * noise**2) @ J))
    except np.linalg.LinAlgError:
        problem = "the motors do not act on all coordinates in all samples"
        raise InputError("q", problem) from None
    z = (C_inverse @ forces[..., None])[..., 0]
    torques = noise[:, None] ** 2 * (J @ C_inverse.mT)
    return _Whitened(C_inverse @ regressor, z, torques)


class _Spread:
    """How the noise of the motors spreads into the values and the residuals, in units of the noise.

    The values are theta = (A^T A)^-1 A^T z with A = Q R, and the residuals (1 - H) z with the hat
    matrix H = Q Q^T. Noise of samples that are k apart has the correlation c_k, together C.

    Args:
        A: The equations in units of the noise, shape (N, n, b).
        inverse: R^-1, shape (b, b).
        torques: Torque errors in units of the noise, for one unit of an error of z, shape (N,
            motors, n).
        correlations: c_1, c_2, ...

    Attributes:
        covariance: Covariance of the values, shape (b, b).
        freedom: Expected sum of the squared residuals of each motor, shape (motors,).
        repetition: Number of samples with the same information as one independent sample.
    """

    def __init__(self, A: Array, inverse: Array, torques: Array, correlations: Array) -> None:
        # Q as torque errors. With it, theta = R^-1 times the sum of Q^T noise over the samples.
        Q = torques @ (A @ inverse)
        motors, b = Q.shape[1:]
        Q_Q = np.empty((motors, b, b))  # Q^T Q of each motor
        Q_C_Q = np.empty((motors, b, b))  # Q^T C Q of each motor
        for k in range(motors):
            rows = Q[:, k]
            Q_Q[k] = rows.T @ rows
            Q_C_Q[k] = Q_Q[k]
            for lag, correlation in enumerate(correlations[: len(rows) - 1], 1):
                pairs = correlation * (rows[:-lag].T @ rows[lag:])
                Q_C_Q[k] += pairs + pairs.T
        total = Q_C_Q.sum(axis=0)
        self.covariance = inverse @ total @ inverse.T
        # The trace of (1 - H) C (1 - H) = C - 2 H C + H C H.
        self.freedom = np.sum(torques**2, axis=(0, 2))
        self.freedom -= 2 * np.trace(Q_C_Q, axis1=1, axis2=2)
        self.freedom += np.einsum("kij,ji->k", Q_Q, total)
        self.repetition = 1 + 2 * float(np.sum(correlations**2))


def _require_freedom(chain: ClosedChain, freedom: Array, samples: int, b: int) -> float:
    """The fewest degrees of freedom; an error if they do not show the noise of a motor."""
    motor = int(np.argmin(freedom))
    if freedom[motor] < _LEAST_FREEDOM:
        problem = (
            f"{samples} samples are too few for {b} base parameters: they leave "
            f"{max(freedom[motor], 0):.2g} degrees of freedom for the noise of motor "
            f"{chain.motor_names[motor]}, needed {_LEAST_FREEDOM:g}"
        )
        raise InputError("q", f"{problem}; measure longer, or consider fewer")
    return float(freedom[motor])


def _require_enough(Y: Array, measured: Array, n: int, b: int, decimate: int) -> None:
    """Check that there are torques for each sample, and more equations than parameters."""
    motors = measured.shape[-1]
    if measured.shape[:-1] != Y.shape[:-2] or Y.ndim != 3:
        raise InputError("tau", f"shape {measured.shape}, expected {(len(Y), motors)}")
    if motors < n:
        raise InputError("chain", f"{motors} motors do not tell the forces of {n} coordinates")
    samples = len(Y)
    if decimate > 1:
        samples = samples // decimate - 2  # the first and the last one are left out
    if samples * n <= b:
        problem = f"{len(Y)} samples are too few for {b} base parameters"
        raise InputError("q", f"{problem}; measure longer, or consider fewer")


def _mean_signs(v: Array) -> Array:
    """The mean of sign(v) about each sample over sign(v) there, for rates v of shape (N, k).

    The mean is over half a sample before and half a sample after, along straight lines between the
    samples. So filtered friction shows when the sign changes between samples.
    """
    means = (v[1:] + v[:-1]) / 2
    halves = []
    for ends in (np.concatenate([v[:1], means]), np.concatenate([means, v[-1:]])):
        # The mean of sign(v) from v to the end of a straight line, times sign(v).
        with np.errstate(divide="ignore", invalid="ignore"):
            half = (np.abs(ends) - np.abs(v)) / (ends - v) * np.sign(v)
        halves.append(np.where(np.isfinite(half), half, 1.0))
    return np.mean(halves, axis=0)


def require_estimate(chain: ClosedChain, found: object) -> None:
    """Raise an `InputError` if `found` is not an estimate for this robot."""
    if not isinstance(found, Estimate):
        raise InputError("found", f"a {type(found).__name__}; give the result of estimate")
    require_base(chain, found.base)


def predicted_torques(chain: ClosedChain, theta: ArrayLike, motion: Trajectory) -> Array:
    """Motor torques of a motion by dynamic parameters, the smallest ones, shape (N, motors).

    Args:
        chain: The robot.
        theta: All dynamic parameters, offsets of motors among them, shape (p,).
        motion: A motion of the robot.
    """
    require_robot("chain", chain)
    require_motion(motion, chain.mechanism)
    Y = chain.torque_regressor(motion.q, motion.va, motion.aa)
    forces = Y @ finite_array("theta", theta, (Y.shape[-1],))
    torques_of_forces = np.linalg.pinv(chain.actuator_jacobian(motion.q).mT)
    return np.asarray((torques_of_forces @ forces[..., None])[..., 0])


def report(chain: ClosedChain, found: Estimate, theta: ArrayLike, unseen: Trajectory) -> str:
    """An estimate as Markdown: values with intervals, what is not supported, errors elsewhere.

    Args:
        chain: The robot.
        found: The estimate.
        theta: The dynamic parameters that were chosen, such as `consistent_parameters`.
        unseen: A motion with measured torques that the estimate has not seen.
    """
    require_robot("chain", chain)
    require_motion(unseen, chain.mechanism, "unseen")
    require_estimate(chain, found)
    errors = decimated(predicted_torques(chain, theta, unseen) - unseen.tau, found.decimate)
    error = np.sqrt(np.mean(errors**2, axis=0))
    size = np.sqrt(np.mean(np.square(decimated(unseen.tau, found.decimate)), axis=0))
    lines = [
        f"# Dynamic parameters of {chain.mechanism.model.name}",
        "",
        f"{len(found.base)} combinations of {len(found.base.considered)} parameters, of which "
        f"{int(found.supported.sum())} differ from zero by more than their intervals of "
        f"{INTERVAL:.1%}.",
        "",
        "| motor | noise of the estimate | error in the unseen motion | relative |",
        "|---|---|---|---|",
    ]
    for k, motor in enumerate(chain.motor_names):
        unit = chain.motor_units[k]
        noise = f"{found.noise[k]:.3g} {unit}"
        lines.append(f"| {motor} | {noise} | {error[k]:.3g} {unit} | {error[k] / size[k]:.3f} |")
    lines += ["", f"| combination | value | interval ({INTERVAL:.1%}) | |", "|---|---|---|---|"]
    intervals = found.intervals()
    supported = found.supported
    for k, name in enumerate(found.base.names):
        remark = "" if supported[k] else "not supported"
        lines.append(f"| {name} | {found.values[k]:.5g} | {intervals[k]:.2g} | {remark} |")
    if found.base.unseen:
        lines += ["", f"Not identifiable: {', '.join(found.base.unseen)}."]
    replaced = getattr(unseen, "replaced", {})  # of a `MeasuredMotion`
    if replaced:
        counts = ", ".join(f"{name} {count}" for name, count in replaced.items())
        lines += ["", f"Outliers of the log that were replaced: {counts}."]
    return "\n".join([*lines, ""])


def solved(A: Array, z: Array) -> tuple[Array, Array]:
    """The least-squares solution of A x = z, and R^-1 of A = Q R, shapes (b,) and (b, b).

    R^-1 R^-T is the covariance of x for noise of z with the covariance 1. Leading axes of A, shape
    (..., b), and z, shape (...), are rows of one system.
    """
    from scipy.linalg import solve_triangular

    b = A.shape[-1]
    # The columns of A and z are triangularised together, in units of their sizes.
    rows = np.concatenate([A, z[..., None]], axis=-1).reshape(-1, b + 1)
    sizes = np.linalg.norm(rows[:, :b], axis=0)
    sizes[sizes == 0] = 1
    rows[:, :b] /= sizes
    R = np.asarray(np.linalg.qr(rows, mode="r"), float)[:b]
    if np.abs(np.diag(R)[:b]).min(initial=1.0) < _UNSHOWN:
        problem = "it does not show all base parameters; base_parameters(motion=) finds those"
        raise InputError("motion", problem)
    inverse = solve_triangular(R[:, :b], np.eye(b)) / sizes[:, None]
    return inverse @ R[:, b], inverse
