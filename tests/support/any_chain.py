# SPDX-License-Identifier: BSD-2-Clause
"""Closed chains with every kind of joint and of closure, of random dimensions."""

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, ClosureError, LineForce, robots
from sst_pin.model.closures import Closure, Constraint, Coupling, Distance, Rolling
from tests.support.by_hand import add, at, mark
from tests.support.trees import unbounded

AXIS = np.array([2.0, -1.0, 2.0]) / 3
OTHER = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)


def _unit(random: np.random.Generator, size: int) -> np.ndarray:
    x = random.normal(size=size)
    return x / np.linalg.norm(x)


def _placement(random: np.random.Generator, reach: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(_unit(random, 4)), reach * _unit(random, 3))


def _parts() -> list[tuple[pin.JointModel, pin.SE3]]:
    random = np.random.default_rng(4)
    kinds = pin.JointModelRX(), pin.JointModelPrismaticUnaligned(AXIS), pin.JointModelRZ()
    return [(kind, _placement(random, 0.5)) for kind in kinds]


def _composite() -> pin.JointModelComposite:
    joint = pin.JointModelComposite()
    for kind, placement in _parts():
        joint.addJoint(kind, placement)
    return joint


JOINTS: dict[str, Callable[[], pin.JointModel]] = {
    "RY": pin.JointModelRY,
    "revolute": lambda: pin.JointModelRevoluteUnaligned(AXIS),
    "PX": pin.JointModelPX,
    "prismatic": lambda: pin.JointModelPrismaticUnaligned(AXIS),
    "HZ": lambda: pin.JointModelHZ(0.3),
    "helical": lambda: pin.JointModelHelicalUnaligned(AXIS, 0.2),
    "RUBX": pin.JointModelRUBX,
    "continuous": lambda: unbounded(AXIS),
    "spherical": pin.JointModelSpherical,
    "translation": pin.JointModelTranslation,
    "planar": pin.JointModelPlanar,
    "free-flyer": pin.JointModelFreeFlyer,
}
#: Joints that are the same as several in a row.
IN_A_ROW: dict[str, tuple[Callable[[], pin.JointModel], list[tuple[pin.JointModel, pin.SE3]]]] = {
    "universal": (
        lambda: pin.JointModelUniversal(AXIS, OTHER),
        [(pin.JointModelRevoluteUnaligned(a), pin.SE3.Identity()) for a in (AXIS, OTHER)],
    ),
    "ZYX": (
        pin.JointModelSphericalZYX,
        [
            (kind(), pin.SE3.Identity())
            for kind in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
        ],
    ),
    "composite": (_composite, _parts()),
}
CLOSURES = [*Closure.KINDS, (True, False, True, False, True, False)]


def chain(
    joints: Sequence[tuple[pin.JointModel, pin.SE3]] = (),
    kind: str | tuple[bool, ...] = "6d",
    more: Sequence[Constraint] = (),
    **options,
) -> ClosedChain:
    """A body on a joint from the base, held by an arm of six revolutes."""
    random = np.random.default_rng(0)
    model = pin.Model()
    model.gravity.linear = np.array([0.7, -1.1, -9.6])

    def load(index: int, name: str) -> int:
        points = 0.2 * random.normal(size=(3, 3))
        moments = points @ points.T
        inertia = moments.trace() * np.eye(3) - moments
        body = pin.Inertia(random.uniform(0.5, 2), 0.2 * random.normal(size=3), inertia)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
        mark(model, index, f"point_{name}", _placement(random, 0.3))
        return index

    joints = list(joints) or [(pin.JointModelRY(), pin.SE3.Identity())]
    index, names = 0, [f"body_{k}" for k in range(len(joints) - 1)] + ["body"]
    where = _placement(random, 0.3)
    for name, (joint, placement) in zip(names, joints, strict=True):
        index = model.addJoint(index, joint, where * placement, name)
        where = pin.SE3.Identity()
    body, hand = load(index, "body"), 0
    for k in range(6):
        axis = pin.JointModelRevoluteUnaligned(_unit(random, 3))
        name = f"arm_{k + 1}"
        hand = load(model.addJoint(hand, axis, _placement(random, 0.5), name), name)
    data, q = model.createData(), pin.integrate(model, pin.neutral(model), 0.3 * np.ones(model.nv))
    pin.framesForwardKinematics(model, data, q)
    end = _placement(random, 0.2)
    reached = data.oMi[body].actInv(data.oMi[hand] * end)
    mark(model, body, "A", reached)
    mark(model, hand, "B", end)
    model.armature = random.uniform(0, 0.1, model.nv)
    model.damping, model.friction = random.uniform(0, 2, (2, model.nv))
    closures = [Closure("A", "B", kind)] if kind else []
    return ClosedChain(model, [*closures, *more], options.pop("actuated", names), **options)


def with_joint(name: str, **options) -> ClosedChain:
    """The body on a joint of one kind."""
    make = JOINTS[name] if name in JOINTS else IN_A_ROW[name][0]
    return chain([(make(), pin.SE3.Identity())], **options)


def rods() -> ClosedChain:
    """The arm ends in a ball; a rod between two of its links."""
    plain = chain(kind="3d")
    data = plain.model.createData()
    pin.framesForwardKinematics(plain.model, data, plain.generic_configuration())
    a, b = (data.oMf[plain.model.getFrameId(f"point_arm_{k}")].translation for k in (2, 5))
    rod = Distance("point_arm_2", "point_arm_5", float(np.linalg.norm(a - b)))
    return chain(kind="3d", more=[rod])


def coupled() -> ClosedChain:
    """A joint of the arm follows polynomials of two others."""
    following = Coupling("arm_2", {"arm_1": (0.1, -0.5, 0.2), "body": (0.0, 0.3)}, 0.05)
    return chain(kind="3d", more=[following])


def rolling(ball: bool) -> ClosedChain:
    """A wheel or a ball on the arm, on a plane that moves in its plane."""
    plane = [(pin.JointModelPlanar(), pin.SE3.Identity())]
    return chain(plane, "", [Rolling("A", "B", 0.2, ball)])


def mimicking(kind: str) -> ClosedChain:
    """Two joints of the arm follow others: the first of the arm, and one behind it."""
    plain = with_joint("free-flyer", kind=kind)
    model = plain.model
    for leader, follower, factor, offset in ((1, 5, 1.4, -0.2), (2, 4, -0.7, 0.3)):
        ids = (model.getJointId(f"arm_{k}") for k in (leader, follower))
        model = pin.transformJointIntoMimic(model, *ids, factor, offset)
    return ClosedChain(model, plain.closures, ["body"])


def sprung(name: str) -> ClosedChain:
    """Springs in the joint of the body and in the arm, drawn far enough to matter."""
    model = with_joint(name).model
    stiffness = np.linspace(1, 5, model.nv)
    body = model.joints[1]
    stiffness[: body.nv] = 3.0
    rest = pin.integrate(model, pin.neutral(model), np.linspace(-1.5, 1.5, model.nv))
    return with_joint(name, stiffness=stiffness, spring_reference=rest)


def cart() -> ClosedChain:
    """On two wheels, with a sprung ball and a gripper of two fingers: few joints, of all kinds.

    One finger mimics the other; a third joint hangs behind both by a coupling.
    """
    model = pin.Model()
    model.gravity.linear = np.array([0.7, -1.1, -9.6])
    points = np.array([[0.1, 0.2, 0.0], [-0.1, 0.1, 0.1], [0.05, 0.0, -0.2]])
    moments = points @ points.T
    body = pin.Inertia(1.5, points[0], moments.trace() * np.eye(3) - moments)

    axle = at(turned=pin.exp3(np.array([np.pi / 2, 0, 0])))
    base = add(model, 0, pin.JointModelPlanar(), "base", at(), body)
    for side, y in (("left", 0.3), ("right", -0.3)):
        wheel = add(model, base, pin.JointModelRUBY(), side, at(0, y, 0.25), body)
        mark(model, wheel, f"{side}_hub", axle)
    add(model, base, pin.JointModelSpherical(), "ball", at(0.1, 0, 0.4), body)
    joint = pin.JointModelRevoluteUnaligned(AXIS)
    finger = add(model, base, joint, "finger", at(0.2, 0.1, 0.3), body)
    follower = add(model, finger, pin.JointModelPX(), "follower", at(0, 0.2, 0.1), body)
    add(model, follower, pin.JointModelRZ(), "tip", at(0.1), body)
    model.damping, model.friction = np.linspace(0.1, 1, (2 * model.nv)).reshape(2, -1)
    model = pin.transformJointIntoMimic(model, finger, follower, -0.7, 0.3)
    ball, left = (model.joints[model.getJointId(name)].idx_v for name in ("ball", "left"))
    stiffness = np.zeros(model.nv)
    stiffness[ball : ball + 3], stiffness[left] = 20.0, 5.0
    wheels = [Rolling("universe", f"{side}_hub", 0.25) for side in ("left", "right")]
    closures = [*wheels, Coupling("tip", {"finger": (0.1, -0.5, 0.2)})]
    rest = pin.integrate(model, pin.neutral(model), np.linspace(-1, 1, model.nv))
    motors = ["left", "right", "ball", "finger"]
    return ClosedChain(model, closures, motors, stiffness=stiffness, spring_reference=rest)


GAS = LineForce("wall", "platform", name="gas", stiffness=60, rest_length=0.4, damping=5)
SPRING = LineForce("rocker_pin", "wall", stiffness=300, rest_length=0.1, preload=-9)
#: Of a four-bar, two of them on one degree of freedom.
ON_LINES = ["gas", {"rocker": 0.3, SPRING.name: 2.0}]


def lines(
    where: Sequence[float] = (-0.3, 0.1, 0.3), forces: Sequence[LineForce] = (GAS, SPRING)
) -> ClosedChain:
    """A four-bar with lines from a point on the wall, one of them a motor."""
    bars = robots.four_bar()
    model = pin.Model(bars.model)
    mark(model, 0, "wall", at(*where))
    return ClosedChain(model, bars.closures, ON_LINES, forces=forces)


def states(chain: ClosedChain, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, va, aa of random motions around a generic configuration, the worst ones left out."""
    random = np.random.default_rng(seed)
    generic, found = chain.generic_configuration(), []
    while len(found) < count:
        moved = pin.integrate(chain.model, generic, 0.2 * random.normal(size=chain.model.nv))
        try:
            q = chain.assemble(moved, fixed=())
        except ClosureError:
            continue
        if chain.condition_number(q) < 1e2:
            found.append(q)
    va, aa = random.normal(size=(2, count, chain.degrees_of_freedom))
    return np.array(found), va, aa
