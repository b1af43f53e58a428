# SPDX-License-Identifier: BSD-2-Clause
"""Cassie squats: optimal control of a floating robot with loops, the contacts given as forces.

Torques of the motors and forces of the ground on toes and heels are the controls of Crocoddyl's
BoxFDDP. The ground only pushes; feet that move cost. The loops stay closed at each node. The
derivatives of the accelerations are those of `acceleration_derivatives`, and of the levers of the
contact forces, which move with the feet.

pip install 'sst-pin[mjcf,optimal]' 'qpsolvers[quadprog]' example-robot-data
python examples/squat_cassie.py
"""

import time
from functools import partial
from timeit import timeit
from typing import Any

import crocoddyl
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from sst_pin import ClosedChain, SSTError
from standing_cassie import CONTACTS, contact_wrenches, robot, stance, standing

Array = NDArray[np.float64]
#: Length of a step and of the motion, [s], and how far the pelvis goes down, [m].
STEP, DURATION, DEPTH = 0.02, 1.0, 0.12
#: Bounds of the contact forces, base axes, [N]; the ground only pushes.
LEAST, MOST = np.array([-60.0, -60.0, 0.0]), np.array([60.0, 60.0, 400.0])
TORQUE = 200.0  # [N m]
#: Weights of squared deviations: feet [1/m^2], height of the pelvis [1/m^2], other coordinates,
#: rates, torques and forces.
OF_FEET, OF_HEIGHT, OF_POSE, OF_RATES, OF_TORQUES, OF_FORCES = 1e4, 1e3, 1.0, 0.1, 1e-3, 1e-4


class FloatingState(crocoddyl.StateAbstract):
    """x = (q, va) with closed loops and a floating base; differences are those of coordinates.

    Args:
        chain: The robot.
        rest: Configuration of the zero state, on the closures, shape (nq,).
    """

    def __init__(self, chain: ClosedChain, rest: Array) -> None:
        self.chain, self.model, self.rest = chain, chain.model, rest
        self.n = chain.degrees_of_freedom
        super().__init__(len(rest) + self.n, 2 * self.n)
        self.nv = self.n
        #: Places of the rates of the coordinates; a free-flyer has six.
        self.rates = [
            k
            for coordinate in chain.coordinates
            for k, name in enumerate(chain.rate_names)
            if name == coordinate or name.startswith(f"{coordinate}_")
        ]

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
        """The way from x0 to x1, along the axes of the pelvis at x0, shape (2 n,)."""
        (q0, va0), (q1, va1) = self.split(x0), self.split(x1)
        return np.append(pin.difference(self.model, q0, q1)[self.rates], va1 - va0)

    def integrate(self, x: Array, dx: Array) -> Array:
        """The state that is off by dx, its passive joints moved onto the closures.

        NaN where the loops cannot be closed: the solver then takes a shorter step.
        """
        q, va = self.split(x)
        guess = pin.integrate(self.model, q, self.chain.joint_rates(q, dx[: self.n]))
        try:
            q = self.chain.assemble(guess, fixed=self.chain.coordinates)
        except SSTError:
            return np.full(self.nx, np.nan)
        return np.append(q, va + dx[self.n :])

    def Jdiff(self, x0: Array, x1: Array, which: Any = crocoddyl.Jcomponent.both) -> Any:
        """Derivatives of diff."""
        q0 = self.split(x0)[0]
        q1 = self.split(x1)[0]
        found = []
        for sign, argument in ((-1, pin.ARG0), (1, pin.ARG1)):
            of_q = pin.dDifference(self.model, q0, q1, argument)[np.ix_(self.rates, self.rates)]
            found.append(self._with_rates(of_q, sign))
        if which == crocoddyl.Jcomponent.both:
            return found
        return found[which != crocoddyl.Jcomponent.first]

    def Jintegrate(self, x: Array, dx: Array, which: Any = crocoddyl.Jcomponent.both) -> Any:
        """Derivatives of integrate."""
        q = self.split(x)[0]
        found = []
        for argument in (pin.ARG0, pin.ARG1):
            found.append(self._with_rates(self._of_step(q, dx, argument), 1))
        if which == crocoddyl.Jcomponent.both:
            return found
        return found[which != crocoddyl.Jcomponent.first]

    def JintegrateTransport(self, x: Array, dx: Array, J: Array, which: Any) -> Array:
        """J times the derivative by a start or a step: rows of the rates stay."""
        argument = pin.ARG0 if which == crocoddyl.Jcomponent.first else pin.ARG1
        J[: self.n] = self._of_step(self.split(x)[0], dx, argument) @ J[: self.n]
        return J

    def _of_step(self, q: Array, dx: Array, argument: Any) -> Array:
        step = self.chain.joint_rates(q, dx[: self.n])
        return pin.dIntegrate(self.model, q, step, argument)[np.ix_(self.rates, self.rates)]

    def _with_rates(self, of_q: Array, sign: int) -> Array:
        J = sign * np.eye(2 * self.n)
        J[: self.n, : self.n] = of_q
        return J


class Squat(crocoddyl.DifferentialActionModelAbstract):
    """Accelerations under torques and contact forces, and the cost of being off a pose.

    Args:
        state: State of the robot.
        goal: The state to be near to, standing.
        height: Height of the pelvis, [m].
        controls: Torques and forces to be near to.
        slopes: The robot that computes the derivatives of accelerations.
    """

    def __init__(
        self, state: FloatingState, goal: Array, height: float, controls: Array, slopes: ClosedChain
    ) -> None:
        super().__init__(state, len(controls), 1)
        self.closed = state
        self.goal = goal
        self.height = height
        self.near = controls
        self.slopes = slopes
        chain = state.chain
        q, _ = state.split(goal)
        self.feet = self.places(q)
        self.motors = len(chain.motor_names)
        sole = len(CONTACTS)
        torques = np.full(self.motors, TORQUE)
        self.u_lb = np.append(-torques, np.tile(LEAST, sole))
        self.u_ub = np.append(torques, np.tile(MOST, sole))
        self.of_controls = np.full(len(controls), OF_FORCES)
        self.of_controls[: self.motors] = OF_TORQUES
        self.of_state = np.full(2 * state.n, OF_POSE)
        self.of_state[state.n :] = OF_RATES
        self.of_state[state.rates.index(chain.rate_names.index("pelvis_vz"))] = 0.0

    def places(self, q: Array) -> Array:
        """Positions of toes and heels."""
        return np.concatenate([self.closed.chain.frame_placement(q, x)[0] for x in CONTACTS])

    def calc(self, data: Any, x: Array, u: Array | None = None) -> None:
        """Acceleration and cost; without controls, the cost of the end."""
        q, va = self.closed.split(x)
        chain = self.closed.chain
        off = self.closed.diff(self.goal, x)
        data.cost = 0.5 * float(off @ (self.of_state * off))
        data.cost += 0.5 * OF_FEET * float(np.sum((self.places(q) - self.feet) ** 2))
        data.cost += 0.5 * OF_HEIGHT * (chain.frame_placement(q, "pelvis")[0][2] - self.height) ** 2
        if u is not None:
            wrenches = contact_wrenches(chain, q, u[self.motors :].reshape(-1, 3))
            tau = u[: self.motors]
            data.xout = chain.compute_accelerations(q, va, tau, external_wrenches=wrenches)
            data.cost += 0.5 * float((u - self.near) @ (self.of_controls * (u - self.near)))

    def calcDiff(self, data: Any, x: Array, u: Array | None = None) -> None:
        """Their derivatives; second ones without the curvature of the deviations."""
        (q, va), chain, n = self.closed.split(x), self.closed.chain, self.closed.n
        J = np.concatenate([chain.frame_jacobian(q, name)[:3] for name in CONTACTS])
        up = chain.frame_jacobian(q, "pelvis")[2]
        height = chain.frame_placement(q, "pelvis")[0][2] - self.height
        Lx = self.of_state * self.closed.diff(self.goal, x)
        Lxx = np.diag(self.of_state)
        Lx[:n] += OF_FEET * J.T @ (self.places(q) - self.feet) + OF_HEIGHT * height * up
        Lxx[:n, :n] += OF_FEET * J.T @ J + OF_HEIGHT * np.outer(up, up)
        data.Lx = Lx
        data.Lxx = Lxx
        if u is not None:
            tau = u[: self.motors]
            forces = u[self.motors :].reshape(-1, 3)
            wrenches = contact_wrenches(chain, q, forces)
            options = {"external_wrenches": wrenches}
            d = self.slopes.acceleration_derivatives(q, va, tau, **options)
            inertia = chain.reduced_terms(q, va).inertia
            by_forces = np.linalg.solve(inertia, np.hstack([J.T, self.levers(q, forces)]))
            contacts = by_forces[:, : len(J)]
            data.Fx = np.hstack([d.dq + by_forces[:, len(J) :], d.dva])
            data.Fu = np.hstack([d.dtau, contacts])
            data.Lu = self.of_controls * (u - self.near)
            data.Luu = np.diag(self.of_controls)

    def levers(self, q: Array, forces: Array) -> Array:
        """Change of the forces along the coordinates as the levers turn with the feet, (n, n)."""
        chain = self.closed.chain
        model = self.closed.model
        data = model.createData()
        change = np.zeros((self.closed.n, self.closed.n))
        pin.framesForwardKinematics(model, data, q)
        for name, force in zip(CONTACTS, forces, strict=True):
            frame = model.getFrameId(name)
            joint = model.frames[frame].parentJoint
            arm = data.oMf[frame].translation - data.oMi[joint].act(model.inertias[joint].lever)
            turn = chain.frame_jacobian(q, name)[3:]
            change += turn.T @ pin.skew(force) @ pin.skew(arm) @ turn
        return change


def squat(
    chain: ClosedChain, slopes: ClosedChain, q: Array, iterations: int = 60
) -> tuple[crocoddyl.SolverBoxFDDP, bool]:
    """Down and up again from a standing pose; whether the solver converged."""
    torques, forces = stance(chain, q)
    state = FloatingState(chain, q)
    controls = np.append(torques, forces)
    goal = state.zero()
    top = chain.frame_placement(q, "pelvis")[0][2]
    times = np.arange(0.0, DURATION + STEP / 2, STEP)
    heights = top - DEPTH * (1 - np.cos(2 * np.pi * times / DURATION)) / 2
    actions = [Squat(state, goal, height, controls, slopes) for height in heights]
    models = [crocoddyl.IntegratedActionModelEuler(action, STEP) for action in actions[:-1]]
    end = crocoddyl.IntegratedActionModelEuler(actions[-1], 0.0)
    solver = crocoddyl.SolverBoxFDDP(crocoddyl.ShootingProblem(goal, models, end))
    nodes = len(models)
    converged = solver.solve([goal] * (nodes + 1), [controls] * nodes, iterations, False)
    return solver, bool(converged)


def main() -> None:
    """Solve with compiled derivatives and with those of the reference path."""
    chain, plain = robot(), robot()
    q = standing(chain)
    chain.compile(derivatives=True)
    squat(chain, chain, q, 1)  # compiles the frames, and derivatives with wrenches
    for label, slopes in (("reference path", plain), ("compiled", chain)):
        start = time.perf_counter()
        solver, converged = squat(chain, slopes, q)
        seconds = time.perf_counter() - start
        print(f"{label}: {seconds:.1f} s, {solver.iter} iterations, converged: {converged}")
        (q_10, va_10), tau_10 = (
            np.split(solver.xs[10], [len(q)]),
            solver.us[10][: len(chain.motor_names)],
        )
        each = timeit(partial(slopes.acceleration_derivatives, q_10, va_10, tau_10), number=100)
        print(f"  derivatives of the accelerations at one node: {1e4 * each:.0f} us")
    action = solver.problem.terminalModel.differential
    heights = [chain.frame_placement(x[: len(q)], "pelvis")[0][2] for x in solver.xs]
    feet = [np.abs(action.places(x[: len(q)]) - action.feet).max() for x in solver.xs]
    print(f"pelvis {min(heights):.3f} to {max(heights):.3f} m, feet move {1e3 * max(feet):.2f} mm")


if __name__ == "__main__":
    main()
