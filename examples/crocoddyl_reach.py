# SPDX-License-Identifier: BSD-2-Clause
"""A closed chain in Crocoddyl: the SST reaches a pose under limited torques, by its BoxFDDP.

Crocoddyl asks for a state and an action. The state is a configuration with its loops closed and the
rates of the coordinates; it moves in as many ways as there are coordinates, and the passive joints
follow. The action gives the accelerations under the torques, with our exact derivatives. Crocoddyl
does the rest: integration, costs over time, the solver.

pip install 'sst-pin[optimal]'
python examples/crocoddyl_reach.py
"""

from typing import Any

import crocoddyl
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

import sst_pin

Array = NDArray[np.float64]
STEP = 0.01  # [s]
LIMIT = 8.0  # of each motor [N m]


class ClosedState(crocoddyl.StateAbstract):
    """x = (q, va) with closed loops; differences are those of the coordinates and their rates.

    Args:
        chain: The robot; its coordinates are joints that turn or slide.
        rest: Configuration of the zero state, on the closures, shape (nq,).
    """

    def __init__(self, chain: sst_pin.ClosedChain, rest: ArrayLike) -> None:
        self.n = chain.degrees_of_freedom
        self.rest = np.asarray(rest, dtype=float)
        super().__init__(len(self.rest) + self.n, 2 * self.n)
        self.nv = self.n
        self.chain = chain
        self.places = [chain.position_names.index(name) for name in chain.coordinates]

    def split(self, x: Array) -> tuple[Array, Array]:
        """Q and va."""
        return x[: len(self.rest)], x[len(self.rest) :]

    def zero(self) -> Array:
        """At rest."""
        return np.append(self.rest, np.zeros(self.n))

    def rand(self) -> Array:
        """A state near rest."""
        return self.integrate(self.zero(), 0.1 * np.random.default_rng().normal(size=2 * self.n))

    def diff(self, x0: Array, x1: Array) -> Array:
        """The way from x0 to x1, shape (2 n,)."""
        (q0, va0), (q1, va1) = self.split(x0), self.split(x1)
        return np.append((q1 - q0)[self.places], va1 - va0)

    def integrate(self, x: Array, dx: Array) -> Array:
        """The state that is off by dx, its passive joints moved onto the closures."""
        q, va = self.split(x)
        guess = q + self.chain.joint_rates(q, dx[: self.n])
        guess[self.places] = q[self.places] + dx[: self.n]
        q = self.chain.assemble(guess, fixed=self.chain.coordinates)
        return np.append(q, va + dx[self.n :])

    def Jdiff(self, x0: Array, x1: Array, which: Any = crocoddyl.Jcomponent.both) -> Any:
        """Derivatives of diff."""
        J = np.eye(2 * self.n)
        if which == crocoddyl.Jcomponent.first:
            return -J
        return J if which == crocoddyl.Jcomponent.second else [-J, J]

    def Jintegrate(self, x: Array, dx: Array, which: Any = crocoddyl.Jcomponent.both) -> Any:
        """Derivatives of integrate."""
        J = np.eye(2 * self.n)
        return [J, J] if which == crocoddyl.Jcomponent.both else J

    def JintegrateTransport(self, x: Array, dx: Array, J: Array, which: Any) -> Array:
        """J, as the derivatives of integrate are the identity."""
        return J


class ClosedAction(crocoddyl.DifferentialActionModelAbstract):
    """Accelerations under torques, and the cost of being off a goal.

    The cost is (x - goal)^T diag(weights) (x - goal) / 2 + effort |tau - hold|^2 / 2, per second.

    Args:
        state: State of the robot.
        goal: A state.
        weights: Shape (2 n,).
        effort: A number.
    """

    def __init__(self, state: ClosedState, goal: Array, weights: ArrayLike, effort: float) -> None:
        motors = len(state.chain.motor_names)
        super().__init__(state, motors, 2 * state.n)
        self.closed = state
        self.goal = goal
        self.effort = effort
        self.weights = np.asarray(weights, dtype=float)
        rest = np.zeros(state.n)
        self.hold = state.chain.compute_torques(state.split(goal)[0], rest, rest)
        self.u_lb = np.full(motors, -LIMIT)
        self.u_ub = np.full(motors, LIMIT)

    def calc(self, data: Any, x: Array, u: Array | None = None) -> None:
        """Acceleration and cost; without torques, the cost of the end."""
        off = self.closed.diff(self.goal, x)
        data.cost = 0.5 * float(off @ (self.weights * off))
        if u is not None:
            data.xout = self.closed.chain.compute_accelerations(*self.closed.split(x), u)
            data.cost += 0.5 * self.effort * float((u - self.hold) @ (u - self.hold))

    def calcDiff(self, data: Any, x: Array, u: Array | None = None) -> None:
        """Their derivatives."""
        data.Lx = self.weights * self.closed.diff(self.goal, x)
        data.Lxx = np.diag(self.weights)
        if u is not None:
            d = self.closed.chain.acceleration_derivatives(*self.closed.split(x), u)
            data.Fx = np.hstack([d.dq, d.dva])
            data.Fu = d.dtau
            data.Lu = self.effort * (u - self.hold)
            data.Luu = self.effort * np.eye(self.nu)


def reach(
    robot: sst_pin.SST, turn: ArrayLike, steps: int, verbose: bool = False
) -> tuple[crocoddyl.SolverBoxFDDP, bool]:
    """From home at rest to the star turned by a rotation vector in {E}, [rad].

    Returns:
        The solver, with `xs` and `us`, and whether it converged.
    """
    R = robot.platform_orientation(robot.home) @ Rotation.from_rotvec(turn).as_matrix()
    state = ClosedState(robot, robot.home)
    goal = np.append(robot.inverse_kinematics(R), np.zeros(3))
    running = ClosedAction(state, goal, [1.0, 1, 1, 0.1, 0.1, 0.1], 1e-2)
    last = ClosedAction(state, goal, [1e4, 1e4, 1e4, 1e3, 1e3, 1e3], 0)
    models = [crocoddyl.IntegratedActionModelEuler(running, STEP)] * steps
    end = crocoddyl.IntegratedActionModelEuler(last, 0.0)
    problem = crocoddyl.ShootingProblem(state.zero(), models, end)
    solver = crocoddyl.SolverBoxFDDP(problem)
    if verbose:
        solver.setCallbacks([crocoddyl.CallbackVerbose()])
    rest = np.zeros(3)
    hold = robot.compute_torques(robot.home, rest, rest)
    converged = solver.solve([state.zero()] * (steps + 1), [hold] * steps, 100, False)
    return solver, bool(converged)


def main() -> None:
    """Solve and print."""
    robot = sst_pin.SST()
    robot.compile()
    solver, converged = reach(robot, (0.3, -0.4, 0.5), 60, verbose=True)
    print("converged" if converged else "not converged", "in", solver.iter, "iterations")
    goal = solver.problem.terminalModel.differential.goal
    print(f"off the pose by {np.abs(solver.xs[-1] - goal)[:9].max():.1e} rad")


if __name__ == "__main__":
    main()
