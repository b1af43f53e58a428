# SPDX-License-Identifier: BSD-2-Clause
"""Closed chains with friction and springs everywhere, and the derivatives of their dynamics."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, robots
from sst_pin.model.closures import Coupling, Distance
from tests.gallery import EVERY_ROBOT
from tests.support import any_chain
from tests.support.any_chain import CONSTRAINTS, TREES, tree
from tests.support.by_hand import add, at
from tests.support.differences import random_q
from tests.support.link_tables import ROBOTS, Z, four_bar

#: Sixth-order central differences: the steps of the values, and their weights.
STEPS = (-3, -2, -1, 1, 2, 3)
WEIGHTS = np.array([-1, 9, -45, 45, -9, 1]) / 60
H = 5e-4
#: Coulomb friction rises within this; some joints of random motions are as slow.
WIDTH = 0.2


def derivative(function, h=H):
    """Derivative at 0: the truncation is h^6 times seventh derivatives, rounding 1e-16 / h."""
    sides = [np.asarray(function(k * h)) for k in STEPS]
    return np.tensordot(WEIGHTS, sides, 1) / h


def close(actual, expected, tolerance, least=1e-3):
    """Equality relative to the largest entry."""
    assert np.shape(actual) == np.shape(expected)
    assert_allclose(actual, expected, rtol=0, atol=tolerance * max(np.abs(expected).max(), least))


@dataclass
class Case:
    """A closed chain, and a twin without Coulomb friction."""

    chain: ClosedChain
    twin: ClosedChain
    coulomb: np.ndarray
    home: np.ndarray

    def L(self, q):
        """Phi L = 0, units at the coordinates."""
        coordinates = self.chain.mechanism.coordinates
        n, nv = len(coordinates), self.chain.model.nv
        system = np.vstack([self.chain.Phi(q), np.eye(nv)[coordinates]])
        right = np.vstack([np.zeros((len(system) - n, n)), np.eye(n)])
        return np.linalg.lstsq(system, right, rcond=None)[0]

    def at(self, q, way, s):
        """q moved by s L way and onto the closures, the coordinates held."""
        step = s * self.L(q) @ way
        return self.chain.assemble(pin.integrate(self.chain.model, q, step))

    def forces(self, q, va, aa, wrenches):
        """f with tanh(v / WIDTH) for the sign, from the dynamics alone."""
        f = self.twin.generalized_forces(q, va, aa, external_wrenches=wrenches)
        return f + self.dry_friction(q, va)

    def accelerations(self, q, va, tau, wrenches):
        """aa likewise."""
        friction = self.dry_friction(q, va)
        aa = self.twin.compute_accelerations(q, va, tau, external_wrenches=wrenches)
        return aa - np.linalg.solve(self.twin.noc(q, va).inertia, friction)

    def dry_friction(self, q, va):
        """What smoothed Coulomb friction of joints and lines needs along the coordinates."""
        L = self.L(q)
        friction = L.T @ (self.coulomb * np.tanh(L @ va / WIDTH))
        for line in self.chain.lines:
            if line.coulomb_friction:
                ends = line.frame_a, line.frame_b
                a, b = (self.twin.frame_placement(q, end)[0] for end in ends)
                J_a, J_b = (self.twin.frame_jacobian(q, end)[:3] for end in ends)
                row = (b - a) / np.linalg.norm(b - a) @ (J_b - J_a)
                friction = friction + line.coulomb_friction * np.tanh(row @ va / WIDTH) * row
        return friction

    def way(self, q, random):
        """Rates of the coordinates at which no joint moves faster than 1."""
        way = random.uniform(-1, 1, self.chain.degrees_of_freedom)
        return way / np.abs(self.L(q) @ way).max()

    def states(self, count):
        """Random motions near home and random wrenches."""
        random, bodies = np.random.default_rng(0), self.chain.model.njoints - 1
        for _ in range(count):
            q = self.at(self.home, self.way(self.home, random), random.uniform(0, 0.05))
            motion = [self.way(q, random), self.way(q, random)]
            yield q, *motion, random.uniform(-5, 5, (bodies, 6))


def case(model, closures, motors, home=None, **options):
    """With friction and springs in all joints that may have them."""
    random = np.random.default_rng(5)
    viscous, coulomb, stiffness = random.uniform(0, 2, (3, model.nv))
    for joint in list(model.joints)[1:]:
        if joint.nv != joint.nq > 2:
            k = slice(joint.idx_v, joint.idx_v + joint.nv)
            stiffness[k] = 1.7 if joint.shortname() == "JointModelSpherical" else 0
    rest = random_q(model, random, 0.3)
    options |= {"viscous_friction": viscous, "stiffness": stiffness, "spring_reference": rest}
    chain = ClosedChain(model, closures, motors, coulomb_friction=coulomb, **options)
    smooth = [replace(line, coulomb_friction=0.0) for line in options.get("lines", ())]
    twin_options = options | {"coulomb_friction": np.zeros(model.nv), "lines": smooth}
    twin = ClosedChain(model, closures, motors, **twin_options)
    if home is None:
        lines = {"lines": options.get("lines", ())}
        home = regular(ClosedChain(model, closures, motors, **lines))
    # Both choose their coordinates at the same place.
    for robot in (chain, twin):
        robot.frame_jacobian(home, "universe")
    assert chain.coordinates == twin.coordinates
    return Case(chain, twin, coulomb, home)


def regular(chain):
    """A random configuration at which no joint moves much faster than the coordinates."""
    for seed in range(50):
        random = np.random.default_rng(seed)
        q = chain.assemble(random_q(chain.model, random), fixed=(), tries=20, seed=seed)
        if np.abs(chain.joint_rates(q, np.eye(chain.degrees_of_freedom))).max() < 4:
            return q
    raise AssertionError("none found")


def of_gallery(name, **options):
    robot = EVERY_ROBOT[name]()
    options = {"lines": robot.lines} | options
    return case(robot.model, robot.closures, robot.motor_names, robot.home, **options)


def without_coulomb(name):
    """A robot of the table, smooth."""
    robot = replace(ROBOTS[name])
    robot.coulomb = np.zeros(len(robot.links))
    return robot


def of_table(name, **options):
    robot = ROBOTS[name]
    q = robot.chain().assemble(robot.joints(robot.x).real)
    return case(robot.model(), robot.closures, robot.actuated, q, **options)


def of_tree(name, kind, **options):
    return case(tree(*TREES[name], seed=1), [CONSTRAINTS[kind]], ["root"], **options)


def geared(**options):
    """A coupling by polynomials beside a rod."""
    model = tree("RY", ["RY", "PX", "RY"], ["revolute", "universal", "PX"], seed=4)
    follow = Coupling("a0_RY", {"b0_revolute": (0.1, -0.8, 0.3, 0.2), "a1_PX": (0, 0.5, -0.4)}, 0.2)
    return case(model, [follow, Distance("A", "B", 0.9)], ["root"], **options)


def carried_four_bar(carrier):
    """A four-bar whose crank stands on a moving base."""
    robot, model = four_bar(), pin.Model()
    model.gravity.linear = -9.81 * Z
    given = robot.model()
    ids = [add(model, 0, carrier, "base", at(), given.inertias[1])]
    for j in range(1, given.njoints):
        place, body = given.jointPlacements[j], given.inertias[j]
        parent = ids[given.parents[j]]
        ids.append(add(model, parent, given.joints[j], given.names[j], place, body))
    for frame in list(given.frames)[1:]:
        frame.parentJoint = ids[frame.parentJoint]
        model.addFrame(frame, False)
    start = pin.neutral(model)
    start[-3:] = robot.joints(robot.x).real
    return model, robot.closures, ["base", *robot.actuated], start


def floating_four_bar(**options):
    return case(*carried_four_bar(pin.JointModelFreeFlyer()), **options)


def with_lines(motors, **options):
    """A four-bar with two lines, one of them a motor, and another motor that pulls both ways."""
    robot = any_chain.lines()
    options = {"lines": robot.lines} | options
    made = any_chain.ON_LINES[:motors]
    return case(robot.model, robot.closures, made, robots.four_bar().home, **options)


def mimicking(**options):
    robot = any_chain.mimicking("hinge")
    return case(robot.model, robot.closures, ["body"], **options)


CASES = {
    **{name: (of_gallery, name) for name in EVERY_ROBOT},
    **{f"{name} (table)": (of_table, name) for name in ROBOTS},
    "floating four-bar": (floating_four_bar,),
    "geared": (geared,),
    "mimicking": (mimicking,),
    "a motor on a line": (with_lines, 1),
    "two motors on lines": (with_lines, 2),
}


def assert_frames_move_as_differences_say(case, q, va, random):
    """The Jacobian, its rate and drift, and the derivatives of the velocity by q and va."""
    chain = case.chain
    frame = chain.model.frames[-1].name
    J, drift = chain.frame_jacobian(q, frame), chain.frame_drift(q, va, frame)

    def derivative_of_J(rates):
        sides = [case.at(q, rates, k * H) for k in STEPS]
        return np.tensordot(WEIGHTS, chain.frame_jacobian(sides, frame), 1) / H

    places = chain.frame_placement([case.at(q, va, k * H) for k in STEPS], frame)
    p_dot, R_dot = (np.tensordot(WEIGHTS, place, 1) / H for place in places)
    close(J[:3] @ va, p_dot, 1e-9)
    # A platform that does not turn has the rounding over the step.
    close(pin.skew(J[3:] @ va), R_dot @ chain.frame_placement(q, frame)[1].T, 1e-9, least=1.0)
    J_dot, way = chain.frame_jacobian_rate(q, va, frame), case.way(q, random)
    close(J_dot, derivative_of_J(va), 1e-8)
    close(J_dot @ va, drift, 1e-12)
    d = chain.frame_velocity_derivatives(q, va, frame)
    close(d.dva, J, 1e-13)
    close(d.dq @ way, derivative_of_J(way) @ va, 1e-9)
    close(d.dq @ va, drift, 1e-12)


def assert_derivatives_are_those_of_differences(case, q, va, aa, wrenches, random):
    """Along a random direction, to 1e-7 of the largest number."""
    chain, way = case.chain, case.way(q, random)
    tau, push = random.uniform(-5, 5, (2, len(chain.motor_names)))
    options = {"external_wrenches": wrenches, "sign_width": WIDTH}
    moved = {k * H: case.at(q, way, k * H) for k in STEPS}

    def f(q, va, aa):
        return case.forces(q, va, aa, wrenches)

    df = chain.torque_derivatives(q, va, aa, **options)
    close(df.dq @ way, derivative(lambda s: f(moved[s], va, aa)), 1e-7)
    close(df.dva @ way, derivative(lambda s: f(q, va + s * way, aa)), 1e-7)
    close(df.daa @ way, derivative(lambda s: f(q, va, aa + s * way)), 1e-7)

    def a(q, va, tau):
        return case.accelerations(q, va, tau, wrenches)

    da = chain.acceleration_derivatives(q, va, tau, **options)
    close(da.dq @ way, derivative(lambda s: a(moved[s], va, tau)), 1e-7)
    close(da.dva @ way, derivative(lambda s: a(q, va + s * way, tau)), 1e-7)
    close(da.dtau @ push, derivative(lambda s: a(q, va, tau + s * push)), 1e-7)


def assert_daa_is_the_inertia_and_dtau_its_inverse(case, q, va, aa, wrenches):
    """Condition numbers of inertia matrices of mixed units are up to 1e4."""
    chain, options = case.chain, {"external_wrenches": wrenches, "sign_width": WIDTH}
    inertia, motors = chain.noc(q, va).inertia, chain.actuator_jacobian(q).T
    daa = chain.torque_derivatives(q, va, aa, **options).daa
    close(daa, inertia, 1e-12)
    tau = np.ones(len(chain.motor_names))
    dtau = chain.acceleration_derivatives(q, va, tau, **options).dtau
    close(daa @ dtau, motors, 1e-10)
    close(dtau, np.linalg.solve(inertia, motors), 1e-10)
