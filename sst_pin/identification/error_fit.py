# SPDX-License-Identifier: BSD-2-Clause
"""Errors of a geometry that fit measurements: weighted least squares by Newton's method.

Let y be the measured values and h(e) the values that the robot with the errors e would give. A step
of Newton's method changes the errors by the de for which A de = z in the sense of least squares,

    z = y - h(e),    A = dh / de.

Each equation is divided by the noise of its kind of values. The noise of a kind is the number that
the caller states, or it is estimated from the residuals of the step before. In this module errors,
values and noises are free of units: lengths are parts of the robot's length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Indices
from ..errors import (
    ClosureError,
    DescriptionWarning,
    InputError,
    SingularConfigurationError,
    warn_caller,
)
from ..model.named_positions import with_positions
from ..progress import counted
from .enlarged_robot import EnlargedRobot
from .geometry_measurements import MeasuredFrames, Measurement
from .least_squares import solved

#: Most steps of Newton's method.
_STEPS = 30
#: The method has converged if a step changes no error by more than this.
_CONVERGED = 1e-9
#: If the method has not converged, its result is still accepted if the last step is at most this
#: part of the standard deviation of each error: then the noise limits the accuracy.
_UNSURE = 0.01
#: Least ratio of the noises of two kinds: a smaller one is rounding.
_LEAST_NOISE = 1e-4
#: Least noise: the rounding of exact values.
_EXACT = 1e-13
#: Degrees of freedom that must be left to estimate a noise.
_LEAST_FREEDOM = 0.5
#: Probability of a warning although the noise that the caller states is true.
_FALSE_ALARM = 1e-6
#: A value that is farther from the robot as drawn, in lengths of the robot, has another unit or is
#: measured from another base.
_FAR = 10.0
_TOO_LARGE = "errors too large for Newton's method, or which= leaves out those that matter"


class ConvergenceError(InputError):
    """Newton's method does not find errors that fit the measurements."""


class KindEquations(NamedTuple):
    """The equations A de = z of one kind of measured values, free of units.

    Attributes:
        z: Measured minus computed values, shape (rows,).
        A: Derivatives of the computed values by the errors, shape (rows, k).
        unit: The unit by which values were divided: the robot's length, [m], or 1 rad.
        stated_noise: Standard deviation that the caller states; None to estimate it.
    """

    z: Array
    A: Array
    unit: float
    stated_noise: float | None


class ErrorEstimate(NamedTuple):
    """Errors that fit the measurements, in SI units."""

    #: Shape (k,), [m] or [rad].
    values: Array
    #: Shape (k, k): the covariance of the values is root root^T.
    root: Array
    #: Standard deviation of each kind of measured values, [m] or [rad].
    noise: Array


class _Step(NamedTuple):
    """One step of Newton's method, from equations divided by the noise of their kind."""

    #: Changes of the errors, shape (k,).
    change: Array
    #: Shape (k, k): the covariance of the errors is root root^T.
    root: Array
    #: Residuals of each kind, in units of its noise.
    residuals: list[Array]
    #: Diagonal of the hat matrix H, for each kind. The residuals are (1 - H) z, so the variance of
    #: residual i is 1 - H_ii in units of the noise.
    leverages: list[Array]


class ErrorFit:
    """Measurements as functions of the errors of an enlarged robot.

    Args:
        enlarged: The enlarged robot.
        measurements: The measurements.
        counts: Number of configurations of each measurement. Where all measurements are meant, the
            configurations of the first one come first, then those of the second one, and so on.
    """

    def __init__(
        self, enlarged: EnlargedRobot, measurements: Sequence[Measurement], counts: Sequence[int]
    ) -> None:
        self._enlarged = enlarged
        self._measurements = measurements
        self._starts = np.cumsum(counts)[:-1]
        mechanism = enlarged.chain.mechanism
        # The errors are positions of joints at rest of the enlarged robot. These joints are some of
        # its coordinates.
        #: Units of the errors, shape (k,).
        self._units = mechanism.rate_scale[mechanism.coordinates[enlarged.columns]]

    def equations(self, q: Array) -> list[KindEquations]:
        """The equations of each kind of values, at configurations q of all measurements."""
        equations = list[KindEquations]()
        length = self._enlarged.chain.mechanism.length
        q_of_measurements = np.split(q, self._starts)
        for measurement, configurations in zip(self._measurements, q_of_measurements, strict=True):
            a, J_a = self._frame(configurations, measurement.reference)
            b, J_b = self._frame(configurations, measurement.end)
            rows_of_kinds = measurement.rows(MeasuredFrames(a=a, b=b, J_a=J_a, J_b=J_b))
            for rows, noise in zip(rows_of_kinds, measurement.noise_of_kinds, strict=True):
                if rows.are_angles:
                    unit = 1.0
                else:
                    unit = length
                    _require_near(rows.z, length)
                kind = KindEquations(
                    z=rows.z / unit,
                    A=rows.A * self._units / unit,
                    unit=unit,
                    stated_noise=None if noise is None else noise / unit,
                )
                equations.append(kind)
        return equations

    def _frame(self, q: Array, name: str) -> tuple[Array, Array]:
        """Placements of a frame, (N, 4, 4), and its Jacobians by the errors, (N, 6, k)."""
        chain = self._enlarged.chain
        J = chain.frame_jacobian(q, name)
        return chain.engine.loops.placements(q, name), J[..., self._enlarged.columns]

    def estimate(self, q: Array, visible: Indices, noise: Array) -> ErrorEstimate:
        """The errors with the numbers `visible`, by Newton's method; all others are zero.

        Args:
            q: Configurations of all measurements without errors, shape (N, nq).
            visible: Numbers of the errors to estimate, shape (k,). The columns of their
                derivatives are independent, so that the measurements determine them.
            noise: A guess of the noise of each kind of values.

        Raises:
            ConvergenceError: If Newton's method does not converge.
            InputError: If the values are too few to estimate their noise.
        """
        units = self._units[visible]
        names = [self._enlarged.errors[k] for k in visible]
        errors = np.zeros(visible.size)
        converged = False
        for step_number in counted(range(_STEPS), "calibrate, steps of Newton's method"):
            try:
                q = self._with_errors(q, names, errors * units)
                equations = self.equations(q)
                step = _newton_step(equations, visible, noise)
            except (ClosureError, SingularConfigurationError, InputError):
                raise ConvergenceError("poses", _TOO_LARGE) from None
            errors += step.change
            noise = _updated_noise(noise, equations, step)
            # The first step is weighted by a guess of the noise: it is never the last one.
            if step_number > 0 and np.abs(step.change).max(initial=0.0) < _CONVERGED:
                converged = True
                break
        deviations = np.linalg.norm(step.root, axis=1)
        if not converged and (np.abs(step.change) > _UNSURE * deviations).any():
            problem = f"the errors do not settle in {_STEPS} steps; give which= or better poses"
            raise ConvergenceError("poses", problem)
        for kind, residuals, leverages in zip(
            equations, step.residuals, step.leverages, strict=True
        ):
            _check_noise(kind, residuals, leverages)
        return ErrorEstimate(
            values=errors * units,
            root=step.root * units[:, None],
            noise=noise * [kind.unit for kind in equations],
        )

    def _with_errors(self, q: Array, names: Sequence[str], values: Array) -> Array:
        """Closed configurations near q with values of errors, [m] or [rad]."""
        chain = self._enlarged.chain
        positions = {name: np.full(len(q), x) for name, x in zip(names, values, strict=True)}
        return chain.assemble(with_positions(chain.mechanism.space, q, positions))


def _newton_step(equations: Sequence[KindEquations], visible: Indices, noise: Array) -> _Step:
    """The step that solves the equations, each divided by the noise of its kind."""
    z = np.concatenate([kind.z / s for kind, s in zip(equations, noise, strict=True)])
    A = np.concatenate([kind.A / s for kind, s in zip(equations, noise, strict=True)])
    A = A[:, visible]
    change, root = solved(A, z)
    starts = np.cumsum([len(kind.z) for kind in equations])[:-1]
    return _Step(
        change=change,
        root=root,
        residuals=np.split(z - A @ change, starts),
        # The hat matrix is A (A^T A)^-1 A^T = (A root) (A root)^T.
        leverages=np.split(np.square(A @ root).sum(axis=1), starts),
    )


def first_noise(equations: Sequence[KindEquations]) -> Array:
    """A first guess of the noise of each kind: the stated one, or the same for all others."""
    noise = [1.0 if kind.stated_noise is None else kind.stated_noise for kind in equations]
    return np.array(noise)


def _updated_noise(noise: Array, equations: Sequence[KindEquations], step: _Step) -> Array:
    """The noise of each kind: the stated one, or an estimate from the residuals of a step.

    `noise` is the noise that weighted the equations of the step.
    """
    updated = np.zeros(len(noise))
    for k, kind in enumerate(equations):
        if kind.stated_noise is None:
            freedom = _degrees_of_freedom(step.leverages[k])
            residuals = step.residuals[k]
            updated[k] = noise[k] * np.sqrt(residuals @ residuals / freedom)
        else:
            updated[k] = kind.stated_noise
    # Without a floor, exact values of one kind would have infinite weight.
    return np.maximum(updated, max(_EXACT, _LEAST_NOISE * updated.max()))


def _degrees_of_freedom(leverages: Array) -> float:
    """Degrees of freedom of residuals, at least `_LEAST_FREEDOM`."""
    return max(len(leverages) - float(leverages.sum()), _LEAST_FREEDOM)


def _check_noise(kind: KindEquations, residuals: Array, leverages: Array) -> None:
    """Refuse a noise that cannot be estimated; warn of a stated one that is too small.

    Residuals are in units of the noise.
    """
    from scipy.special import chdtri

    if kind.stated_noise is None:
        if len(residuals) - leverages.sum() < _LEAST_FREEDOM:
            problem = f"{len(residuals)} values are too few to estimate it with the errors; give it"
            raise InputError("noise", problem)
        return
    freedom = _degrees_of_freedom(leverages)
    # With the true noise, the sum of the squares has a chi-squared distribution.
    if residuals @ residuals > chdtri(freedom, _FALSE_ALARM):
        times = np.sqrt(residuals @ residuals / freedom)
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
