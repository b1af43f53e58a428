# SPDX-License-Identifier: BSD-2-Clause
"""Forces from outside, observed from motions and motor torques without a force sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, names, one_or_each, single_array
from ..closed_chain import ClosedChain
from ..engine import require_robot
from ..errors import InputError
from ..model.thresholds import RANK_TOLERANCE
from ..simulation.samples import rows_of_samples
from ..summaries import listed

#: Components of a wrench, in order.
_COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


class _Sample(NamedTuple):
    """A sample of the motion.

    Attributes:
        t: Time, [s].
        momentum: M va, shape (n,).
        known_forces: Rate of the momentum by the model, without the motors and f, shape (n,).
        J: Actuator Jacobian, shape (motors, n).
    """

    t: float
    momentum: Array
    known_forces: Array
    J: Array


class ForceObserver:
    """The momentum observer: forces along the coordinates that motors and model do not explain.

    The momentum p = M va changes by motors, weights, friction, springs and Coriolis forces, which
    the model knows, and by other forces f. The change of p between two samples, minus the effect of
    the known forces, gives the mean of f. The estimate r is f after a low-pass filter, r' = gain (f
    - r), so it follows a step of f with the time constant 1 / gain. It needs no accelerations (De
    Luca and Mattone 2003). Errors of the model, above all of friction, appear in r as forces.

    Between two samples, r follows the exact solution for a constant f, so any period is stable.

    Args:
        chain: The model of the robot.
        gain: Bandwidth of each coordinate, () or shape (n,), positive, [1/s]. The noise of va
            enters r times the mass matrix and the gain.

    Example:
        >>> observer = sst_pin.control.ForceObserver(chain, gain=50.0)
        >>> motion = chain.simulate([0.1], chain.home, [0.0], np.linspace(0, 0.2, 201))
        >>> f = observer.forces(motion.t, motion.q, motion.va, motion.tau)
        >>> bool(np.abs(f).max() < 1e-4)
        True
    """

    def __init__(self, chain: ClosedChain, gain: ArrayLike) -> None:
        require_robot("chain", chain)
        chain.mechanism.require_freedom()
        self.chain = chain
        self.gain = one_or_each("gain", gain, chain.degrees_of_freedom)
        self.reset()

    def reset(self) -> None:
        """Forget all samples; the estimate of the next one is zero."""
        self._estimate = np.zeros(self.chain.degrees_of_freedom)
        self._last: _Sample | None = None

    def update(self, t: float, q: ArrayLike, va: ArrayLike, tau: ArrayLike) -> Array:
        """The estimate r at a new sample, shape (n,), [N m] or [N].

        The first sample after the start or `reset` gives zero.

        Args:
            t: Time, later than at the sample before, [s].
            q: Configuration, with closed loops, shape (nq,).
            va: Rates of the coordinates, shape (n,).
            tau: Motor torques that acted since the sample before, shape (motors,): the command that
                was held, or the mean of two measurements.

        Raises:
            InputError: If t is not later than before.
        """
        chain = self.chain
        time = float(single_array("t", t, ()))
        rates = single_array("va", va, (chain.degrees_of_freedom,))
        torques = single_array("tau", tau, (len(chain.motor_names),))
        last = self._last
        if last is not None and not time > last.t:
            raise InputError("t", f"{time:g} s is not later than the sample before, {last.t:g} s")
        configuration = single_array("q", q, (chain.mechanism.model.nq,))
        sample = self._sample(time, configuration, rates)
        if last is not None:
            # The mean of f in the period is the mean rate of the momentum minus the known rates.
            dt = time - last.t
            known_forces = (last.known_forces + sample.known_forces) / 2
            motor_forces = (last.J + sample.J).T @ torques / 2
            f = (sample.momentum - last.momentum) / dt - (known_forces + motor_forces)
            # The solution of r' = gain (f - r) at the end of the period, for a constant f.
            decay = np.exp(-self.gain * dt)
            self._estimate = decay * self._estimate + (1 - decay) * f
        self._last = sample
        return self._estimate.copy()

    def _sample(self, t: float, q: Array, va: Array) -> _Sample:
        """The sample of a time and a state.

        The equations of motion are M aa + C va = gravity + friction + J^T tau + f. With M_dot = C +
        C^T, the momentum p = M va has the rate

            p_dot = M aa + M_dot va = C^T va + gravity + friction + J^T tau + f.
        """
        terms = self.chain.reduced_terms(q, va)
        return _Sample(
            t=t,
            momentum=terms.inertia @ va,
            known_forces=terms.coriolis.T @ va + terms.gravity + terms.friction,
            J=self.chain.actuator_jacobian(q),
        )

    def forces(self, t: ArrayLike, q: ArrayLike, va: ArrayLike, tau: ArrayLike) -> Array:
        """The estimates of a log, shape (N, n), from zero at its first sample; `reset`s first.

        Args:
            t: Times, increasing, shape (N,), [s].
            q: Configurations, shape (N, nq).
            va: Rates of the coordinates, shape (N, n).
            tau: Motor torques, measured at the samples, shape (N, motors).
        """
        chain = self.chain
        times = finite_array("t", t, ())
        if times.ndim != 1:
            raise InputError("t", f"shape {times.shape}: times of samples are needed, shape (N,)")
        size = len(times)
        configurations = rows_of_samples("q", q, (size, chain.mechanism.model.nq))
        rates = rows_of_samples("va", va, (size, chain.degrees_of_freedom))
        torques = rows_of_samples("tau", tau, (size, len(chain.motor_names)))
        means = torques.copy()
        means[1:] = (torques[1:] + torques[:-1]) / 2
        self.reset()
        estimates = np.empty((size, chain.degrees_of_freedom))
        for k in range(size):
            estimates[k] = self.update(float(times[k]), configurations[k], rates[k], means[k])
        return estimates

    def wrench(
        self,
        q: ArrayLike,
        forces: ArrayLike,
        frame: str,
        components: Sequence[str] = _COMPONENTS,
    ) -> Array:
        """The wrench [force; moment] on a frame that causes forces along the coordinates.

        It acts at the origin of the frame, in base axes, shape (6,). With fewer components than
        degrees of freedom it fits the forces with least squares.

        Args:
            q: Configuration, shape (nq,).
            forces: Forces along the coordinates, such as an estimate, shape (n,).
            frame: Name of the frame that is touched.
            components: The components that may act, of fx, fy, fz, mx, my, mz; others are zero.

        Raises:
            InputError: If the coordinates cannot distinguish these components.

        Example:
            >>> delta = sst_pin.robots.delta()
            >>> observer = sst_pin.control.ForceObserver(delta, gain=50.0)
            >>> f = delta.frame_jacobian(delta.home, "platform").T @ [0, 0, -3, 0, 0, 0]
            >>> w = observer.wrench(delta.home, f, "platform", ["fx", "fy", "fz"])
            >>> w.round(6) + 0.0
            array([ 0.,  0., -3.,  0.,  0.,  0.])
        """
        chain = self.chain
        words = names("components", components)
        unknown = [word for word in words if word not in _COMPONENTS]
        if unknown:
            raise InputError("components", f"{listed(unknown)}: known are {listed(_COMPONENTS)}")
        f = single_array("forces", forces, (chain.degrees_of_freedom,))
        chosen = [_COMPONENTS.index(word) for word in dict.fromkeys(words)]
        mechanism = chain.mechanism
        J = np.asarray(chain.frame_jacobian(single_array("q", q, (mechanism.model.nq,)), frame))
        # The equations J^T w = f, free of units: A x = unit f with x = size w. The size of a force
        # is the length of the robot, so that all entries of x are like moments.
        size = np.repeat([mechanism.length, 1.0], 3)[chosen]
        unit = mechanism.rate_scale[mechanism.coordinates]
        A = (J[chosen] / size[:, None] * unit).T
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        if np.count_nonzero(s > RANK_TOLERANCE * s.max(initial=0.0)) < len(chosen):
            raise InputError(
                "components",
                f"{chain.degrees_of_freedom} coordinates cannot distinguish {listed(words)} of "
                f"{frame} here; name only those that can act",
            )
        result = np.zeros(6)
        result[chosen] = (Vt.T @ (U.T @ (unit * f) / s)) / size
        return result
