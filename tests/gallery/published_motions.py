# SPDX-License-Identifier: BSD-2-Clause
"""Mechanisms of the tests of Modelica's standard library and of Chrono, with what these print.

Modelica's numbers are the reference results of the library, with a tolerance of 1e-6 for each step;
Chrono's are tables that ADAMS computed. The joint that is tested is a closure here: a free body
hangs on it.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from pinocchio.rpy import rpyToMatrix

from sst_pin import ClosedChain, Closure, Coupling, Distance, LineForce
from sst_pin.model.closures import Constraint
from sst_pin.robots.building_blocks import Solids, Tree, body, box, rod
from sst_pin.robots.placements import HERE, shift
from tests.data import PUBLISHED

Vector = Sequence[float]
Columns = Callable[[ClosedChain, Any], np.ndarray]

GRAVITY = 9.80665
STEEL = 7700.0  # density of Modelica's bodies


class PublishedMotion(NamedTuple):
    """A mechanism that starts at `home`, and printed values of its motion."""

    chain: ClosedChain
    va: Vector  # at the start
    columns: tuple[str, ...]
    of: Columns  # these columns of a motion, (N, columns)
    times: tuple[float, ...]
    values: np.ndarray  # (times, columns)
    torque: Callable[[float, Any, Any], Any] | None = None

    def simulate(self, end: float = np.inf) -> np.ndarray:
        """The columns at the published times up to an end, (times, columns)."""
        torque = self.torque or np.zeros(len(self.chain.motor_names))
        times = np.array([0, *(t for t in self.times if t <= end)])
        motion = self.chain.simulate(torque, self.chain.home, self.va, times)
        return self.of(self.chain, motion)[1:]


def modelica() -> dict[str, PublishedMotion]:
    """Examples of Modelica.Mechanics.MultiBody, by name."""
    rate = [5.235987755983]
    return {
        **{name: constraint(name) for name in ("Revolute", "Prismatic", "Spherical", "Universal")},
        "Engine1a": _modelica("Engine1a", engine(), [10.0], _first_joint),
        "Fourbar2": _modelica("Fourbar2", fourbar2(), rate, _first_joint),
        "GearConstraint": _modelica("GearConstraint", gear(), [0.0], _second_joint, gear_torque),
    }


def _modelica(
    name: str, chain: ClosedChain, va: Vector, of: Columns, torque: Any = None
) -> PublishedMotion:
    entry = PUBLISHED["modelica"][name]
    columns, times = tuple(entry["columns"]), tuple(entry["times"])
    return PublishedMotion(chain, va, columns, of, times, np.array(entry["values"]), torque)


def _first_joint(chain: ClosedChain, motion: Any) -> np.ndarray:
    return np.stack([motion.q[:, 0], chain.joint_rates(motion.q, motion.va)[:, 0]], axis=1)


def _second_joint(chain: ClosedChain, motion: Any) -> np.ndarray:
    return np.stack([motion.q[:, 1], chain.joint_rates(motion.q, motion.va)[:, 1]], axis=1)


# A free body on a closure ----------------------------------------------------


def free_body(
    solids: Solids,
    home: pin.SE3,
    closure: Callable[[str, str], Constraint],
    on_ground: pin.SE3,
    on_body: pin.SE3,
    gravity: Vector,
    spring: tuple[Vector, Vector] | None = None,
) -> ClosedChain:
    """A free body, at rest at `home`, and a closure between the ground and it.

    The frames of the closure have placements in the base. The spring, 20 N/m without a length at
    rest, pulls a point of the body to a point of the base.
    """
    tree = Tree("free_body")
    tree.model.gravity.linear = np.asarray(gravity, dtype=float)
    tree.add_joint("free", pin.JointModelFreeFlyer(), solids, at=home)
    tree.add_frame("body", "free", HERE)
    tree.add_frame("on_ground", "universe", on_ground)
    tree.add_frame("on_body", "free", home.actInv(on_body))
    lines = []
    if spring:
        foot, eye = spring
        tree.add_frame("spring_foot", "universe", foot)
        tree.add_frame("spring_eye", "free", eye)
        lines.append(LineForce("spring_foot", "spring_eye", stiffness=20.0, rest_length=0.0))
    tree.model.referenceConfigurations["home"] = pin.neutral(tree.model)
    return ClosedChain(tree.model, [closure("on_ground", "on_body")], [], lines=lines)


#: Where the closures of Modelica's examples are: turned about x, then y, then z.
MODELICA_JOINT = pin.SE3(
    rpyToMatrix(np.deg2rad(10), 0.0, 0.0)
    @ rpyToMatrix(0.0, np.deg2rad(55), 0.0)
    @ rpyToMatrix(0.0, 0.0, np.deg2rad(68)),
    np.array([0.2, -0.3, 0.2]),
)


def constraint(name: str) -> PublishedMotion:
    """Constraints.RevoluteConstraint and its three relatives: a body of 1 kg on a spring."""
    z_to_y = pin.SE3(rpyToMatrix(-np.pi / 2, 0.0, 0.0), np.zeros(3))
    z_and_x_to_x_and_y = pin.SE3(np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]]), np.zeros(3))
    slides = (False, False, True, True, True, True)  # along x and y
    kind, axes, eye, of = {
        "Revolute": ("hinge", z_to_y, (0.4, 0, 0), _rate_and_angle),
        "Prismatic": (slides, HERE, (0.4, 0, 0), _place),
        "Spherical": ("3d", HERE, (0.4, 0, 0), _rates),
        "Universal": ("universal", z_and_x_to_x_and_y, (0.5, 0.15, 0.2), _angles),
    }[name]
    solids = body(1.0, (0.2, 0, 0), np.ones(3), [(0, 0, 0), (0.4, 0, 0)], 0.025)
    at = MODELICA_JOINT * axes
    chain = free_body(
        solids, MODELICA_JOINT, lambda a, b: Closure(a, b, kind), at, at, (0, -GRAVITY, 0),
        spring=((0.8, 0, 0.3), eye),
    )  # fmt: skip
    return _modelica(name, chain, np.zeros(chain.degrees_of_freedom), of)


def _place(chain: ClosedChain, motion: Any) -> np.ndarray:
    return chain.frame_placement(motion.q, "body")[0]


def _rates(chain: ClosedChain, motion: Any) -> np.ndarray:
    """Angular velocity about y and z of the body."""
    return chain.joint_rates(motion.q, motion.va)[:, 4:]


def _rate_and_angle(chain: ClosedChain, motion: Any) -> np.ndarray:
    R = MODELICA_JOINT.rotation.T @ chain.frame_placement(motion.q, "body")[1]
    angle = np.arctan2(R[:, 0, 2], R[:, 2, 2])
    return np.stack([chain.joint_rates(motion.q, motion.va)[:, 4], angle], axis=1)


def _angles(chain: ClosedChain, motion: Any) -> np.ndarray:
    """Turns about z and then x."""
    R = MODELICA_JOINT.rotation.T @ chain.frame_placement(motion.q, "body")[1]
    return np.stack(
        [np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.arctan2(R[:, 2, 1], R[:, 2, 2])], axis=1
    )


# Modelica's loops ------------------------------------------------------------


def _moved(solids: Solids, by: Vector) -> Solids:
    return [solid._replace(at=shift(by) * solid.at) for solid in solids]


def _cylinder(end: Vector, diameter: float) -> Solids:
    mass = STEEL * np.pi * diameter**2 / 4 * np.linalg.norm(end)
    return rod(mass, end, diameter / 2)


def _box(size: Vector, centre: Vector) -> Solids:
    return box(STEEL * np.prod(size), size, centre)


def _modelica_tree(name: str) -> Tree:
    tree = Tree(name)
    tree.model.gravity.linear = np.array([0, -GRAVITY, 0])
    return tree


def engine() -> ClosedChain:
    """Loops.Engine1a: a crank with a flywheel of 1 kg m^2, a rod and a piston, hinges about x."""
    tree = _modelica_tree("engine")
    crank = [
        *_cylinder((0.1, 0, 0), 0.05),
        *_box((0.02, 0.1, 0.05), (0.1, 0.05, 0)),
        *_moved(_cylinder((0.1, 0, 0), 0.03), (0.1, 0.1, 0)),
        *_box((0.02, 0.1, 0.05), (0.2, 0.05, 0)),
    ]
    tree.add_joint("bearing", pin.JointModelRX(), crank)
    down = pin.JointModelPrismaticUnaligned(np.array([0, -1.0, 0]))
    tree.add_joint("piston", down, _cylinder((0, -0.1, 0), 0.1), at=shift((0.15, 0.45, 0)))
    rod_body = _box((0.02, 0.2, 0.06), (0, -0.1, 0))
    tree.add_joint("rod", pin.JointModelRX(), rod_body, "piston", shift((0, -0.1, 0)))
    along_x = rpyToMatrix(0.0, np.pi / 2, 0.0)
    tree.add_frame("crank_pin", "bearing", pin.SE3(along_x, np.array([0.15, 0.1, 0])))
    tree.add_frame("rod_end", "rod", pin.SE3(along_x, np.array([0, -0.2, 0])))
    tree.model.armature = np.array([1.0, 0, 0])
    tree.model.referenceConfigurations["home"] = np.array([0, 0.05, 0])
    return ClosedChain(tree.model, [Closure("crank_pin", "rod_end", "hinge")], ["bearing"])


def fourbar2() -> ClosedChain:
    """Loops.Fourbar2: a crank and a slider, a massless rod with a ball and a universal joint."""
    tree = _modelica_tree("fourbar2")
    tree.add_joint("j1", pin.JointModelRX(), _cylinder((0, 0.5, 0.1), 0.05))
    tree.add_joint("j2", pin.JointModelPX(), _cylinder((0, 0.2, 0), 0.05), at=shift((1.2, 0)))
    tree.add_frame("ball", "j1", (0, 0.5, 0.1))
    tree.add_frame("cross", "j2", (0, 0.2, 0))
    tree.model.referenceConfigurations["home"] = np.array([0, -0.2])
    length = float(np.linalg.norm([1.0, -0.3, -0.1]))  # of the rod at the start
    return ClosedChain(tree.model, [Distance("ball", "cross", length)], ["j1"])


def gear() -> ClosedChain:
    """Rotational3DEffects.GearConstraint: two cylinders, the first turns ten times as fast."""
    tree = _modelica_tree("gear")
    tree.add_joint("fast", pin.JointModelRX(), _cylinder((0.4, 0, 0), 0.1))
    tree.add_joint("slow", pin.JointModelRX(), _cylinder((0.4, 0, 0), 0.2), at=shift((0.5, 0)))
    tree.model.referenceConfigurations["home"] = np.zeros(2)
    return ClosedChain(tree.model, [Coupling("fast", {"slow": (0.0, 10.0)})], ["fast"])


def gear_torque(t: float, *_: Any) -> list[float]:
    """On the fast cylinder, [N m]."""
    return [2 * np.sin(2 * np.pi * t)]


def planar_loops() -> ClosedChain:
    """Loops.PlanarLoops_analytic: three four-bars in a row, one driven hinge.

    The bars between two upper hinges carry 1 kg each, the others have no mass: they are distances.
    """
    tree = _modelica_tree("planar_loops")
    upper = [np.array([0, 0.5]), np.array([0.6, 0.5]), np.array([1.1, 0.6]), np.array([1.5, 0.55])]
    tree.add_hinge("rev", [])
    parent, at = "rev", upper[0]
    closures = []
    for k in (1, 2, 3):
        step = upper[k] - upper[k - 1]
        carried = body(1.0, step / 2, [0.001] * 3, [(0, 0, 0), (*step, 0)], 0.01)
        tree.add_hinge(f"bar_{k}", carried, parent, shift(at))
        tree.add_frame(f"top_{k}", f"bar_{k}", step)
        foot = np.array([0.5 * k, 0])
        tree.add_frame(f"foot_{k}", "universe", foot)
        length = float(np.linalg.norm(upper[k] - foot))
        closures.append(Distance(f"foot_{k}", f"top_{k}", length))
        parent, at = f"bar_{k}", step
    tree.model.referenceConfigurations["home"] = np.zeros(4)
    return ClosedChain(tree.model, closures, ["rev"])


# Chrono's pendulums ----------------------------------------------------------

CHRONO_COLUMNS = ("x", "y", "z", "Fx", "Fy", "Fz")
#: A pendulum of 1 kg: its mass centre 2 m from the joint, and its moments of inertia.
SLENDER = (0.04, 0.1, 0.1)


def chrono() -> dict[str, PublishedMotion]:
    """Cases of the unit tests of Chrono's joints, by the name and number of the case."""
    result = {}
    for name, entry in PUBLISHED["chrono"].items():
        chain = chrono_pendulum(name)
        va, times = np.zeros(chain.degrees_of_freedom), tuple(entry["times"])
        values = np.array(entry["values"])
        result[name] = PublishedMotion(chain, va, CHRONO_COLUMNS, _place_and_force, times, values)
    return result


def _place_and_force(chain: ClosedChain, motion: Any) -> np.ndarray:
    """Place of the mass centre and force on the ground."""
    ground = chain.reactions(motion.q, motion.va, motion.aa).ground
    return np.hstack([_place(chain, motion), -ground[:, :3]])


def chrono_pendulum(name: str) -> ClosedChain:
    """A free body on a closure; "Distance 1" is case 1 of the tests of Chrono's distance."""
    kind, case = name.split()
    weight = (0, 0, -GRAVITY)
    if kind == "Distance":
        foot, eye, centre, turn = {
            "1": ((0, 0, 0), (0, 2, 0), (0, 2, 0), 0.0),
            "2": ((1, 2, 3), (1, 4, 3), (-1, 4, 3), 0.0),
            "3": ((0, 0, 0), (0, 2, 0), (0, 4, 0), -np.pi / 2),
        }[case]
        home = pin.SE3(rpyToMatrix(0.0, 0.0, turn), np.array(centre, dtype=float))
        return free_body(
            _centred(SLENDER), home, lambda a, b: Distance(a, b, 2.0), shift(foot), shift(eye),
            weight,
        )  # fmt: skip
    axis, angle, origin = {
        "Universal 1": ((1, 0, 0), np.pi / 2, (0, 0, 0)),
        "Universal 2": ((0, 1, 0), np.pi / 2, (0, 0, 0)),
        "Universal 3": ((0.707107, -0.707107, 0), np.pi / 2, (0, 0, 0)),
        "Spherical 1": ((1, 0, 0), 0.0, (0, 0, 0)),
        "Revolute 1": ((1, 0, 0), -np.pi / 2, (0, 0, 0)),
        "Cylindrical 2": ((1, 0, 0), -np.pi / 2, (0, 0, 0)),
        "Prismatic 3": ((1, 0, 0), -np.pi / 2, (1, 2, 3)),
    }.get(name, ((1, 0, 0), -np.pi / 4, (1, 2, 3)))
    R = pin.AngleAxis(angle, np.array(axis) / np.linalg.norm(axis)).toRotationMatrix()
    at = pin.SE3(R, np.array(origin, dtype=float))
    moments, centre = SLENDER, (2.0, 0, 0)
    if kind == "Universal":
        moments, centre = SLENDER[::-1], (0, 0, -2.0)
    closure = {
        "Universal": "universal", "Spherical": "3d", "Revolute": "hinge",
        "Cylindrical": "cylindrical", "Prismatic": "prismatic",
    }[kind]  # fmt: skip
    home = at * shift(centre)
    return free_body(
        _centred(moments), home, lambda a, b: Closure(a, b, closure), at, at, weight
    )  # fmt: skip


def _centred(moments: Vector) -> Solids:
    """1 kg about its mass centre."""
    return body(1.0, (0, 0, 0), moments, [(0, 0, 0), (0.1, 0, 0)], 0.01)
