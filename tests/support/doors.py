# SPDX-License-Identifier: BSD-2-Clause
"""The ways in which users reach the dynamics: NumPy arrays, kernels, CasADi functions.

Each takes and returns NumPy arrays of one sample, friction smooth within `WIDTH` in derivatives.
"""

import numpy as np

from sst_pin.dynamics.derivatives import AccelerationDerivatives, TorqueDerivatives
from tests.support.derivative_cases import WIDTH


class Arrays:
    """The chain's methods on the reference path."""

    def __init__(self, case):
        self.chain = case.chain

    def forces(self, *state, **loads):
        return self.chain.generalized_forces(*state, **loads)

    def accelerations(self, *state, **loads):
        return self.chain.compute_accelerations(*state, **loads)

    def rates(self, q, va):
        return self.chain.joint_rates(q, va)

    def torque_derivatives(self, *state, **loads):
        return self.chain.torque_derivatives(*state, sign_width=WIDTH, **loads)

    def acceleration_derivatives(self, *state, **loads):
        return self.chain.acceleration_derivatives(*state, sign_width=WIDTH, **loads)

    def step(self, q, va, tau, dt):
        motion = self.chain.rollout([tau], q, va, dt, sign_width=WIDTH)
        return motion.q[1], motion.va[1]


class Kernels(Arrays):
    """A chain computed by compiled kernels."""

    def __init__(self, case):
        super().__init__(case)
        self.chain.compile(case.home, derivatives=True)


class Casadi:
    """CasADi's functions, differentiated by CasADi along their tangent."""

    def __init__(self, case):
        self.chain = case.chain
        self._plain = case.chain.casadi(case.home, sign_width=WIDTH)
        self._loaded = case.chain.casadi(case.home, sign_width=WIDTH, external_wrenches=True)

    def forces(self, *state, external_wrenches=None):
        functions, state = self._taking(state, external_wrenches)
        return functions.generalized_forces(*state).full().ravel()

    def accelerations(self, *state, external_wrenches=None):
        functions, state = self._taking(state, external_wrenches)
        return functions.accelerations(*state).full().ravel()

    def rates(self, *state):
        return self._plain.rates(*state).full().ravel()

    def torque_derivatives(self, *state, external_wrenches=None):
        rows = self._rows("generalized_forces", state, external_wrenches)
        return TorqueDerivatives(*np.hsplit(rows, 3))

    def acceleration_derivatives(self, *state, external_wrenches=None):
        rows = self._rows("accelerations", state, external_wrenches)
        return AccelerationDerivatives(*np.split(rows, (len(rows), 2 * len(rows)), axis=1))

    def _rows(self, name, state, wrenches):
        functions, state = self._taking(state, wrenches)
        by = [x.full() for x in getattr(functions, name).jacobian()(*state, 0)[:3]]
        return np.hstack([by[0] @ functions.tangent(state[0]).full(), *by[1:]])

    def _taking(self, state, wrenches):
        return (self._plain, state) if wrenches is None else (self._loaded, (*state, wrenches))

    def second_derivatives(self, *state):
        """Second derivatives of the torques, shape (n, 3 n, 3 n)."""
        functions, n = self._plain, self._plain.n
        by = functions.torque_derivatives.jacobian()(*state, 0, 0, 0)
        T = functions.tangent(state[0]).full()
        blocks = []  # of dq, dva, daa, each column after column, by q, va, aa
        for k in range(3):
            block = [x.full() for x in by[3 * k : 3 * k + 3]]
            block = np.hstack([block[0] @ T, *block[1:]])
            blocks.append(block.reshape(n, n, 3 * n).swapaxes(0, 1))
        return np.concatenate(blocks, axis=1)

    def step(self, *state_and_dt):
        return [x.full().ravel() for x in self._plain.step(*state_and_dt)]

    def step_derivatives(self, *state_and_dt):
        """Derivatives of both results in a column, by q along the motions, va and tau."""
        by = [x.full() for x in self._plain.step.jacobian()(*state_and_dt, 0, 0)]
        by = [np.vstack([by[k], by[k + 4]]) for k in range(3)]
        return np.hstack([by[0] @ self._plain.tangent(state_and_dt[0]).full(), *by[1:]])


DOORS = {"arrays": Arrays, "kernels": Kernels, "CasADi": Casadi}
