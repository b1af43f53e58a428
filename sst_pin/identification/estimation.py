# SPDX-License-Identifier: BSD-2-Clause
"""Estimates base parameters from measured motions and torques, and predicts torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array, whole_number
from ..closed_chain import ClosedChain
from ..errors import InputError
from ..simulation.trajectories import Trajectory, require_motion
from ..summaries import Summary
from .base_parameters import BaseParameters
from .measurements import decimated, noise_correlations

#: Residuals up to this number of standard deviations count in full (P. J. Huber).
_HUBER = 1.345
#: Combinations with a smaller part in the motion are not shown by it.
_UNSHOWN = 1e-9
_ITERATIONS = 10


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
        decimate: One sample of this many was used, after a filter.
    """

    base: BaseParameters
    values: Array
    covariance: Array
    noise: Array
    decimate: int = 1

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, shape (b,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def supported(self) -> Flags:
        """Which values differ from zero by more than three standard deviations, shape (b,)."""
        return np.abs(self.values) > 3 * self.deviations

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        columns = self.base.names, self.values, 3 * self.deviations, self.supported
        rows = [
            (f"{x:.4g} +- {d:.1g}{'' if ok else ', not supported'}", name)
            for name, x, d, ok in zip(*columns, strict=True)
        ]
        return f"{len(self.base)} base parameters, three standard deviations", rows


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
        InputError: For wrong shapes, fewer motors than coordinates, too few samples, or a motion
            that does not show all combinations.

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
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    measured = finite_array("tau", tau, (motors,))
    Y = chain.torque_regressor(q, va, aa)
    _require_enough(Y, measured, n, len(base), whole_number("decimate", decimate, 1))
    if decimate > 1:
        names = chain.dynamic_parameters.names
        dry = [k for k, name in enumerate(names) if name.endswith(".coulomb")]
        Y[..., dry] *= _mean_signs(chain.joint_rates(q, va))[:, None]
    J = chain.actuator_jacobian(q)
    known = np.array(chain.dynamic_parameters)
    known[base.considered] = 0
    right = (measured[:, None, :] @ J)[:, 0] - Y @ known  # J^T tau
    left, right = decimated(Y[..., base.columns], decimate), decimated(right, decimate)
    J, correlations = J if decimate == 1 else J[::decimate][1:-1], noise_correlations(decimate)
    noise, weights = np.ones(motors), np.ones(right.shape)
    for _ in range(_ITERATIONS):
        A, z, errors = _weighted(J, noise, left, right)
        values, inverse = solved(A * weights[..., None], z * weights)
        root, used = _deviations(A * weights[..., None], inverse, correlations)
        z = z - A @ values
        residuals = (errors @ z[..., None])[..., 0]
        if robust:
            scale = np.median(np.abs(residuals), axis=0) / 0.6745
            weights = np.sqrt(np.minimum(1, _HUBER / np.maximum(np.abs(z), 1e-300)))
        else:
            scale = np.sqrt(np.mean(residuals**2, axis=0))
        if motors > n:  # the motion does not show the shares of single motors
            scale = np.full(motors, np.sqrt(np.mean(scale**2)))
        scale *= np.sqrt(motors / n * z.size / (z.size - used))
        settled = np.allclose(scale, noise, rtol=1e-6, atol=0)
        noise = np.maximum(scale, 1e-14 * np.abs(measured).max() + 1e-150)
        if settled:
            break
    if robust:
        root, _ = _deviations(A, solved(A, z)[1], correlations)
        inside = np.abs(z) < _HUBER
        root *= np.sqrt(np.mean(np.clip(z, -_HUBER, _HUBER) ** 2)) / inside.mean()
    return Estimate(base, values, root @ root.T, noise, decimate)


def _require_enough(Y: Array, measured: Array, n: int, b: int, decimate: int) -> None:
    """Check that there are torques for each sample, and more equations than parameters."""
    motors = measured.shape[-1]
    if measured.shape[:-1] != Y.shape[:-2] or Y.ndim != 3:
        raise InputError("tau", f"shape {measured.shape}, expected {(len(Y), motors)}")
    if motors < n:
        raise InputError("chain", f"{motors} motors do not tell the forces of {n} coordinates")
    if (len(Y) // decimate - 2 * (decimate > 1)) * n <= b:
        problem = f"{len(Y)} samples are too few for {b} base parameters"
        raise InputError("q", f"{problem}; measure longer, or consider fewer")


def _mean_signs(v: Array) -> Array:
    """The mean sign of rates, (N, nv), half a sample before and after each, over the sign there.

    A sign changes between samples; filtered friction shows when.
    """
    means = (v[1:] + v[:-1]) / 2
    ends = np.concatenate([v[:1], means]), np.concatenate([means, v[-1:]])
    with np.errstate(divide="ignore", invalid="ignore"):
        halves = [(np.abs(end) - np.abs(v)) / (end - v) * np.sign(v) for end in ends]
    return np.mean([np.where(np.isfinite(half), half, 1.0) for half in halves], axis=0)


def _weighted(J: Array, noise: Array, left: Array, right: Array) -> tuple[Array, Array, Array]:
    """Both sides in units of their noise, and the least torque errors for one unit of each."""
    try:
        weights = np.linalg.inv(np.linalg.cholesky((J.mT * noise**2) @ J))
    except np.linalg.LinAlgError:
        problem = "the motors do not act on all coordinates in all samples"
        raise InputError("q", problem) from None
    z = (weights @ right[..., None])[..., 0]
    return weights @ left, z, noise[:, None] ** 2 * (J @ weights.mT)


def _deviations(A: Array, inverse: Array, correlations: Array) -> tuple[Array, float]:
    """A root of the covariance of the values, and how many degrees of freedom they use.

    `inverse` is R^-1 of A = Q R; the noise of samples j + 1 apart correlates by correlations[j].
    """
    B = A @ inverse
    S = np.eye(B.shape[-1])
    for j, correlation in enumerate(correlations[: len(B) - 1], 1):
        pairs = correlation * np.tensordot(B[:-j], B[j:], axes=((0, 1), (0, 1)))
        S = S + pairs + pairs.T
    sizes, vectors = np.linalg.eigh(S)
    return inverse @ (vectors * np.sqrt(np.maximum(sizes, 0))), float(np.trace(S))


def predicted_torques(chain: ClosedChain, theta: ArrayLike, motion: Trajectory) -> Array:
    """Motor torques of a motion by dynamic parameters, the smallest ones, shape (N, motors).

    Args:
        chain: The robot.
        theta: All dynamic parameters, offsets of motors among them, shape (p,).
        motion: A motion of the robot.
    """
    require_motion(motion, chain.mechanism)
    Y = chain.torque_regressor(motion.q, motion.va, motion.aa)
    forces = Y @ finite_array("theta", theta, (Y.shape[-1],))
    back = np.linalg.pinv(chain.actuator_jacobian(motion.q).mT)
    return np.asarray((back @ forces[..., None])[..., 0])


def report(chain: ClosedChain, found: Estimate, theta: ArrayLike, unseen: Trajectory) -> str:
    """An estimate as Markdown: values with intervals, what is not supported, errors elsewhere.

    Args:
        chain: The robot.
        found: The estimate.
        theta: The dynamic parameters that were chosen, such as `consistent_parameters`.
        unseen: A motion with measured torques that the estimate has not seen.
    """
    errors = decimated(predicted_torques(chain, theta, unseen) - unseen.tau, found.decimate)
    size = np.sqrt(np.mean(np.square(decimated(unseen.tau, found.decimate)), axis=0))
    error = np.sqrt(np.mean(errors**2, axis=0))
    motors = zip(chain.motor_names, chain.motor_units, found.noise, error, size, strict=True)
    lines = [
        f"# Dynamic parameters of {chain.mechanism.model.name}",
        "",
        f"{len(found.base)} combinations of {len(found.base.considered)} parameters, of which "
        f"{int(found.supported.sum())} differ from zero by more than three standard deviations.",
        "",
        "| motor | noise of the estimate | error in the unseen motion | relative |",
        "|---|---|---|---|",
        *(f"| {n} | {s:.3g} {u} | {e:.3g} {u} | {e / a:.3f} |" for n, u, s, e, a in motors),
        "",
        "| combination | value | three standard deviations | |",
        "|---|---|---|---|",
    ]
    rows = zip(found.base.names, found.values, found.deviations, found.supported, strict=True)
    for name, value, deviation, ok in rows:
        remark = "" if ok else "not supported"
        lines.append(f"| {name} | {value:.5g} | {3 * deviation:.2g} | {remark} |")
    if found.base.unseen:
        lines += ["", f"Not identifiable: {', '.join(found.base.unseen)}."]
    if replaced := getattr(unseen, "replaced", {}):
        counts = ", ".join(f"{name} {count}" for name, count in replaced.items())
        lines += ["", f"Outliers of the log that were replaced: {counts}."]
    return "\n".join([*lines, ""])


def solved(A: Array, z: Array) -> tuple[Array, Array]:
    """Least squares by QR, and the inverse of R, a root of the covariance."""
    from scipy.linalg import solve_triangular

    b = A.shape[-1]
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
