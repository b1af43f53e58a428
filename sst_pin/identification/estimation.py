# SPDX-License-Identifier: BSD-2-Clause
"""Estimates base parameters from measured motions and torques.

`estimate` is the main function. It makes the equations Y theta = J^T tau of all samples
(`_equations`), and solves them by weighted least squares (`_fit`) until the weights, which follow
from the residuals, do not change. `torque_noise` has the formulas for the noise of the motors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array, positive_number, require_flags, whole_number
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..summaries import Summary
from .base_parameters import BaseParameters, require_base
from .filters import decimated, noise_correlations
from .least_squares import solved
from .torque_noise import (
    NoiseSpread,
    Whitened,
    noise_spread,
    samples_per_independent_sample,
    whitened,
)

#: With `robust`, residuals above this number of standard deviations count less (P. J. Huber). With
#: this number and normal noise, the variance of the estimate is 5 % larger than without `robust`.
_HUBER = 1.345
#: Median of the absolute values of normal noise, in standard deviations.
_MEDIAN_OF_NORMAL = 0.6745
#: Most iterations for the noise. It has converged if its relative change is at most `_CONVERGED`.
_ITERATIONS = 100
_CONVERGED = 1e-4
#: Level of the intervals: the probability within three standard deviations.
INTERVAL = 0.9973
#: Fewest degrees of freedom of the residuals of a motor. With fewer, the noise of one motor can
#: vanish, and the intervals hold far less than their level.
_LEAST_FREEDOM = 5.0
#: Largest torque that is accepted: squares of larger ones, divided by their rounding, overflow.
_LARGEST = 1e100


@dataclass(frozen=True, repr=False, eq=False)
class Estimate(Summary):
    """Base parameters as measured.

    Attributes:
        base: The combinations.
        values: Their values, shape (b,).
        covariance: Their covariance, shape (b, b). The noise of the measured torques is taken as
            independent from sample to sample, before the filter of `decimate`.
        noise: Standard deviation of each motor's torque from the model, shape (motors,). If there
            are more motors than degrees of freedom, all have the same.
        degrees_of_freedom: Number of independent residuals that show the noise of a motor, for the
            motor with the fewest.
        decimate: One sample of this many was used, after a low-pass filter.
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
            level: Probability that an interval contains the true value. By default the probability
                that a normal variable is within three standard deviations.
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
    the chain. With `decimate` the regressor and the torques pass the same filter. So Coulomb
    friction, which jumps, is estimated without bias (M. Gautier, ICRA 1997). The torques must not
    be filtered before.

    Args:
        chain: The robot.
        base: The combinations that are estimated.
        q: Configurations on the closures, shape (N, nq).
        va: Rates of the coordinates, shape (N, n).
        aa: Accelerations of the coordinates, shape (N, n).
        tau: Measured torques of the motors, shape (N, motors).
        robust: Whether large residuals count less, by Huber's function. Deviations are approximate
            then: with 3 % outliers in 800 samples, intervals of 95 % held the true values in 93 %
            (decimate=10) to 98 % (decimate=2) of the logs of a five-bar.
        decimate: One sample of this many, evenly spaced in time, is used, after a low-pass filter
            forwards and backwards. Give the same number as to `measured_motion`.

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
    require_flags(robust=robust)
    decimate = whole_number("decimate", decimate, 1)
    Y = chain.torque_regressor(q, va, aa)
    _require_enough(Y, measured, n, len(base), decimate)
    equations = _equations(chain, base, Y, measured, q, va, decimate)
    correlations = noise_correlations(decimate)

    # Weighted least squares. The weights follow from the noise of each motor, and the noise from
    # the residuals: sqrt(sum of squared torque errors / degrees of freedom).
    noise = np.ones(motors)
    huber_weights = np.ones(equations.forces.shape)
    for _ in range(_ITERATIONS):
        fit = _fit(equations, noise, huber_weights, correlations)
        squares = _squared_torque_errors(fit, noise, robust)
        freedom = fit.spread.freedom
        if motors > n:  # single motors cannot be distinguished: one noise for all
            squares = np.full(motors, squares.sum())
            freedom = np.full(motors, freedom.sum())
        # Residuals of filtered samples are correlated, so fewer of them are independent.
        independent_freedom = freedom / samples_per_independent_sample(correlations)
        _require_freedom(chain, independent_freedom, len(Y), len(base))
        if robust:
            huber_weights = _huber_weights(fit.residuals)
        updated = np.sqrt(squares / freedom)
        converged = np.allclose(updated, noise, rtol=_CONVERGED, atol=0)
        # Exact torques have no noise; then their rounding is the noise. It must not be zero.
        rounding = 1e-14 * np.abs(measured).max() + 1e-150
        noise = np.maximum(updated, rounding)
        if converged:
            break

    if robust:
        covariance = _huber_covariance(fit, correlations)
    else:
        covariance = fit.spread.covariance
    return Estimate(
        base=base,
        values=fit.values,
        covariance=covariance,
        noise=noise,
        degrees_of_freedom=float(independent_freedom.min()),
        decimate=decimate,
    )


class _Equations(NamedTuple):
    """The equations Y theta = forces of N samples, with the base parameters theta."""

    #: Actuator Jacobians, shape (N, motors, n).
    J: Array
    #: Regressors of the base parameters, shape (N, n, b).
    Y: Array
    #: J^T tau minus the forces due to known parameters, shape (N, n).
    forces: Array


def _equations(
    chain: ClosedChain,
    base: BaseParameters,
    Y: Array,
    measured: Array,
    q: ArrayLike,
    va: ArrayLike,
    decimate: int,
) -> _Equations:
    """The equations for measured torques, shape (N, motors), filtered and decimated.

    The forces due to parameters that are not considered go to the right side. Y has the regressors
    of all parameters, shape (N, n, p).
    """
    if decimate > 1:
        Y = _with_mean_friction(chain, Y, q, va)
    J = chain.actuator_jacobian(q)
    known = np.array(chain.dynamic_parameters)
    known[base.considered] = 0
    J_T_tau = (measured[:, None, :] @ J)[:, 0]
    forces = J_T_tau - Y @ known
    if decimate > 1:
        # J changes slowly and is not filtered. These are the samples that `decimated` takes.
        J = J[::decimate][1:-1]
    return _Equations(
        J=J, Y=decimated(Y[..., base.columns], decimate), forces=decimated(forces, decimate)
    )


def _with_mean_friction(chain: ClosedChain, Y: Array, q: ArrayLike, va: ArrayLike) -> Array:
    """Regressors whose columns of Coulomb friction are means over the time about each sample.

    Filtered torques depend on the time at which a rate changes its sign, also between two samples.
    The column of a sample, sign(v), has only the sign at the sample. The mean of sign(v) over the
    time about the sample has this information.
    """
    names = chain.dynamic_parameters.names
    # Columns for Coulomb friction of joints, then of lines, in the order of `rates`.
    columns = [k for k, name in enumerate(names) if name.endswith(".coulomb")]
    v = chain.joint_rates(q, va)
    rates = np.hstack([v, chain.engine.line_rates(q, v)])
    Y = Y.copy()
    Y[..., columns] *= _mean_signs_by_signs(rates)[:, None]
    return Y


def _mean_signs_by_signs(v: Array) -> Array:
    """The mean of sign(v) about each sample, divided by sign(v) at the sample; v has shape (N, k).

    The mean is over the time from half a sample before to half a sample after, where v is linear
    between the samples.
    """
    middles = (v[1:] + v[:-1]) / 2
    before = _mean_sign_by_sign(v, np.concatenate([v[:1], middles]))
    after = _mean_sign_by_sign(v, np.concatenate([middles, v[-1:]]))
    return np.mean([before, after], axis=0)


def _mean_sign_by_sign(v: Array, end: Array) -> Array:
    """The mean of sign(x), where x changes linearly from v to an end e, divided by sign(v).

    The mean is (|e| - |v|) / (e - v), because d|x|/dx = sign(x). Where v does not change, the
    result is 1. Where v is zero, so is the column of the regressor, and any factor serves.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (np.abs(end) - np.abs(v)) / (end - v) * np.sign(v)
    return np.where(np.isfinite(mean), mean, 1.0)


class _Fit(NamedTuple):
    """The solution of the equations by least squares for one guess of the noise."""

    #: The equations in units of the noise.
    whitened: Whitened
    #: The base parameters theta, shape (b,).
    values: Array
    #: z - A theta, in units of the noise, shape (N, n).
    residuals: Array
    spread: NoiseSpread


def _fit(equations: _Equations, noise: Array, weights: Array, correlations: Array) -> _Fit:
    """The solution for a noise of each motor, shape (motors,).

    `weights`, shape (N, n), are factors of the equations, beside those by the noise.
    """
    whitened_equations = whitened(equations.J, noise, equations.Y, equations.forces)
    A = whitened_equations.A
    z = whitened_equations.z
    weighted_A = A * weights[..., None]
    values, R_inverse = solved(weighted_A, z * weights)
    return _Fit(
        whitened=whitened_equations,
        values=values,
        residuals=z - A @ values,
        spread=noise_spread(weighted_A, R_inverse, whitened_equations.P, correlations),
    )


def _squared_torque_errors(fit: _Fit, noise: Array, robust: bool) -> Array:
    """Sum of the squared torque errors of each motor, shape (motors,).

    `noise` is the noise of the fit. If `robust`, the sum is estimated from the median of the sizes
    of the errors, on which outliers have little effect.
    """
    # P maps whitened residuals to torques in units of their noise; see `torque_noise`.
    torque_errors = noise * (fit.whitened.P @ fit.residuals[..., None])[..., 0]
    if robust:
        deviations = np.median(np.abs(torque_errors), axis=0) / _MEDIAN_OF_NORMAL
        return np.asarray(len(torque_errors) * deviations**2)
    return np.asarray(np.sum(torque_errors**2, axis=0))


# --- Huber's function for k = _HUBER: r^2 for a residual |r| <= k, and else 2 k |r| - k^2 ---------


def _huber_weights(residuals: Array) -> Array:
    """Factors of the equations with which least squares minimises the sum of Huber's function.

    A factor squared is the derivative of Huber's function divided by 2 r: 1 or k / |r|.
    """
    return np.sqrt(np.minimum(1, _HUBER / np.maximum(np.abs(residuals), 1e-300)))


def _huber_covariance(fit: _Fit, correlations: Array) -> Array:
    """Covariance of the values: the covariance of ordinary least squares, times a factor.

    The factor is the ratio of the variances of both estimates: P. J. Huber, Robust Statistics,
    1981, Eq. (7.6.8) with its correction for many parameters.
    """
    A = fit.whitened.A
    residuals = fit.residuals
    _, R_inverse = solved(A, residuals)
    spread = noise_spread(A, R_inverse, fit.whitened.P, correlations)

    b = fit.values.size
    inside = float((np.abs(residuals) < _HUBER).mean())
    correction = 1 + b / residuals.size * (1 - inside) / inside
    mean_square = np.sum(np.clip(residuals, -_HUBER, _HUBER) ** 2) / (residuals.size - b)
    return np.asarray(spread.covariance * float(correction**2 * mean_square / inside**2))


# --- checks ---------------------------------------------------------------------------------------


def _require_freedom(chain: ClosedChain, freedom: Array, samples: int, b: int) -> None:
    """Refuse degrees of freedom, shape (motors,), too few to show the noise of a motor."""
    motor = int(np.argmin(freedom))
    if freedom[motor] < _LEAST_FREEDOM:
        problem = (
            f"{samples} samples are too few for {b} base parameters: they leave "
            f"{max(freedom[motor], 0):.2g} degrees of freedom for the noise of motor "
            f"{chain.motor_names[motor]}, needed {_LEAST_FREEDOM:g}"
        )
        raise InputError("q", f"{problem}; measure longer, or consider fewer")


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


def require_estimate(chain: ClosedChain, found: object) -> None:
    """Raise an `InputError` if `found` is not an estimate for this robot."""
    if not isinstance(found, Estimate):
        raise InputError("found", f"a {type(found).__name__}; give the result of estimate")
    require_base(chain, found.base)
