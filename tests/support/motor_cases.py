# SPDX-License-Identifier: BSD-2-Clause
"""Robots whose motors are many, too few, or hold them nearly not."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from sst_pin import ClosedChain, Closure, ClosureError, robots
from tests.support import by_hand
from tests.support.by_hand import at, mark

UP = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0, 0), np.zeros(3))


def add(model: pin.Model, parent: int, joint, name: str, place: pin.SE3, mass: float) -> int:
    """The number of a new joint with its frame and its body."""
    inertia = mass * np.diag([0.011, 0.013, 0.017])
    body = pin.Inertia(mass, np.array([0.1, 0.02, 0.01]), inertia)
    index = by_hand.add(model, parent, joint, name, place, body)
    model.addJointFrame(index)
    return index


def four_bar(model: pin.Model, base: int, mass: float) -> Closure:
    """Crank, coupler and rocker on a base."""
    crank = add(model, base, pin.JointModelRZ(), "crank", UP, mass)
    coupler = add(model, crank, pin.JointModelRZ(), "coupler", at(0.2, 0, 0), mass)
    rocker = add(model, base, pin.JointModelRZ(), "rocker", UP * at(0.47, 0, 0), mass)
    mark(model, coupler, "a", at(0.53, 0, 0))
    mark(model, rocker, "b", at(0.41, 0, 0))
    return Closure("a", "b", "hinge")


def lift(
    mass: float, of_bars: float, motors: Sequence | None = None, joint: pin.JointModel | None = None
) -> ClosedChain:
    """A four-bar linkage on a lift or a cart; by default five motors, one pulls at both."""
    model = pin.Model()
    base = add(model, 0, joint or pin.JointModelPZ(), "lift", pin.SE3.Identity(), mass)
    closure = four_bar(model, base, of_bars)
    both = {"lift": 1.7, "crank": 0.3}
    chosen = ["lift", both, "crank", "coupler", "rocker"] if motors is None else list(motors)
    return ClosedChain(model, [closure], chosen, coordinates=["lift", "rocker"])


def telescope(light: float, heavy: float, loop: bool) -> ClosedChain:
    """Two stages on two ropes that pull at both alike, so that none moves the lower one alone."""
    model = pin.Model()
    lower = add(model, 0, pin.JointModelPZ(), "lower", pin.SE3.Identity(), light)
    upper = add(model, lower, pin.JointModelPZ(), "upper", at(0, 0, 0.7), heavy)
    ropes = [{"lower": k, "upper": k} for k in (1.0, 2.0)]
    if not loop:
        return ClosedChain(model, [], ropes)
    return ClosedChain(model, [four_bar(model, upper, 1.0)], [*ropes, "crank", "rocker"])


def five_bar(motors: Sequence, **options) -> ClosedChain:
    model = pin.Model()
    left = add(model, 0, pin.JointModelRZ(), "a1", UP, 1.1)
    a2 = add(model, left, pin.JointModelRZ(), "a2", at(0.31, 0, 0), 0.7)
    right = add(model, 0, pin.JointModelRZ(), "b1", UP * at(0.29, 0, 0), 0.9)
    b2 = add(model, right, pin.JointModelRZ(), "b2", at(0.33, 0, 0), 0.8)
    mark(model, a2, "fa", at(0.47, 0, 0))
    mark(model, b2, "fb", at(0.44, 0, 0))
    mark(model, a2, "platform", at(0.2, 0.1, 0))
    coordinates = options.pop("coordinates", ["a1", "b1"])
    closures = [Closure("fa", "fb", "hinge")]
    return ClosedChain(model, closures, list(motors), coordinates=coordinates, **options)


def elbows() -> ClosedChain:
    """A five-bar with motors at its elbows, which hold it nowhere on a surface of poses."""
    return five_bar(["a2", "b2"])


def held_not(chain: ClosedChain) -> tuple[np.ndarray, np.ndarray]:
    """A pose that the motors of `elbows` do not hold, and one beside it."""

    def pose(turn: float, start: np.ndarray) -> np.ndarray:
        guess = start.copy()
        guess[0] = first[0] + turn
        return chain.assemble(guess)

    def held(q: np.ndarray) -> float:
        return float(np.linalg.det(chain.actuator_jacobian(q)))

    random, generic = np.random.default_rng(0), chain.generic_configuration()
    while True:
        with suppress(ClosureError):
            first = q = chain.assemble(generic + 0.8 * random.normal(size=4))
            for turn in np.linspace(0, 2, 60):
                before, q = q, pose(turn, q)
                regular = chain.condition_number(q) < 10 and np.abs(q - before).max() < 0.3
                if regular and held(before) * held(q) < 0:
                    root = brentq(lambda x, q=q: held(pose(x, q)), turn - 2 / 59, turn, xtol=1e-15)
                    return pose(root, q), pose(root + 0.1, q)


def motors_everywhere() -> ClosedChain:
    """A planar 3-RRR with a motor in each joint of its legs: three more than freedoms."""
    plain = robots.planar_3rrr()
    names = [name for name in plain.joint_names if not name.startswith("wrist")][:6]
    return ClosedChain(plain.model, plain.closures, names, coordinates=plain.coordinates)


def two_modes() -> ClosedChain:
    """A parallelogram with a disc on its coupler, which turns in the other assembly mode only."""
    model, length, ground = pin.Model(), 0.2, 0.47
    add(model, 0, pin.JointModelPX(), "slide", at(0, 0, 1), 2.0)
    crank = add(model, 0, pin.JointModelRZ(), "crank", UP, 1.0)
    coupler = add(model, crank, pin.JointModelRZ(), "coupler", at(length, 0, 0), 1.0)
    rocker = add(model, 0, pin.JointModelRZ(), "rocker", UP * at(ground, 0, 0), 1.0)
    mark(model, coupler, "fa", at(ground, 0, 0))
    mark(model, rocker, "fb", at(length, 0, 0))
    x = add(model, 0, pin.JointModelPX(), "x", UP, 0.1)
    y = add(model, x, pin.JointModelPY(), "y", pin.SE3.Identity(), 0.1)
    turn = add(model, y, pin.JointModelRZ(), "turn", pin.SE3.Identity(), 0.3)
    mark(model, coupler, "wa", at(0.1, 0, 0))
    mark(model, turn, "wb", pin.SE3.Identity())
    model.referenceConfigurations["home"] = in_mode(0.8, crossed=False)
    closures = [Closure("fa", "fb", "hinge"), Closure("wa", "wb", "6d")]
    motors = [{"slide": 1.0, "turn": 0.5}, "crank"]
    return ClosedChain(model, closures, motors, coordinates=["slide", "crank"])


def in_mode(crank: float, *, crossed: bool) -> np.ndarray:
    """A closed configuration of `two_modes`, by the law of cosines."""
    length, ground = 0.2, 0.47
    pin_a = length * np.array([np.cos(crank), np.sin(crank)])
    pin_b = np.array([ground, 0.0])
    end = pin_a + pin_b
    if crossed:  # the mirror image of the other end in the line between the two pins
        line = (pin_a - pin_b) / np.linalg.norm(pin_a - pin_b)
        end = pin_b + 2 * line * line.dot(pin_a) - pin_a
    turned = np.arctan2(*(end - pin_a)[::-1])
    disc = pin_a + 0.1 * np.array([np.cos(turned), np.sin(turned)])
    rocker = np.arctan2(*(end - pin_b)[::-1])
    return np.array([0.1, crank, turned - crank, rocker, *disc, turned])


def slider_crank() -> ClosedChain:
    """Crank and rod without mass: at its dead points the crank moves no mass."""
    model = pin.Model()
    crank = model.addJoint(0, pin.JointModelRZ(), UP, "crank")
    rod = model.addJoint(crank, pin.JointModelRZ(), at(0.2), "rod")
    slide = add(model, 0, pin.JointModelPX(), "slide", UP, 1.0)
    mark(model, rod, "fa", at(0.5, 0, 0))
    mark(model, slide, "fb", pin.SE3.Identity())
    model.referenceConfigurations["home"] = at_angle(0.7)
    return ClosedChain(model, [Closure("fa", "fb", "hinge")], ["crank"])


def at_angle(crank: float) -> np.ndarray:
    """A closed configuration of `slider_crank`."""
    rod = -np.arcsin(0.2 * np.sin(crank) / 0.5)
    return np.array([crank, rod - crank, 0.2 * np.cos(crank) + 0.5 * np.cos(rod)])
