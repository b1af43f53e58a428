# SPDX-License-Identifier: BSD-2-Clause
"""Closed chains with every kind of joint and of closure, of random dimensions."""

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, ClosureError, LineForce, robots
from sst_pin.model.closures import Closure, Constraint, Coupling, Distance, Rolling
from tests.support.by_hand import add, at, mark
from tests.support.differences import random_q

GRAVITY = np.array([0.7, -1.1, -9.6])
AXIS = np.array([2.0, -1.0, 2.0]) / 3
OTHER = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
#: Joints by their placements in the one before.
Parts = Sequence[tuple[pin.JointModel, pin.SE3]]


def _unit(random: np.random.Generator, size: int) -> np.ndarray:
    x = random.normal(size=size)
    return x / np.linalg.norm(x)


def _placement(random: np.random.Generator, reach: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(_unit(random, 4)), reach * _unit(random, 3))


def _parts(*kinds: pin.JointModel) -> Parts:
    random = np.random.default_rng(4)
    return [(kind, _placement(random, 0.5)) for kind in kinds]


def _composite(parts: Parts) -> pin.JointModelComposite:
    joint = pin.JointModelComposite()
    for kind, placement in parts:
        joint.addJoint(kind, placement)
    return joint


def unbounded() -> pin.JointModel:
    """A joint that turns about an axis without end."""
    joint = pin.JointModelRevoluteUnboundedUnaligned()
    joint.axis = AXIS
    return joint


JOINTS: dict[str, Callable[[], pin.JointModel]] = {
    "RY": pin.JointModelRY,
    "revolute": lambda: pin.JointModelRevoluteUnaligned(AXIS),
    "PX": pin.JointModelPX,
    "prismatic": lambda: pin.JointModelPrismaticUnaligned(AXIS),
    "HZ": lambda: pin.JointModelHZ(0.3),
    "helical": lambda: pin.JointModelHelicalUnaligned(AXIS, 0.2),
    "RUBX": pin.JointModelRUBX,
    "continuous": unbounded,
    "spherical": pin.JointModelSpherical,
    "translation": pin.JointModelTranslation,
    "planar": pin.JointModelPlanar,
    "free-flyer": pin.JointModelFreeFlyer,
}
#: Joints that are the same as several in a row.
IN_A_ROW: dict[str, tuple[Callable[[], pin.JointModel], Parts]] = {
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
    "composite": (
        lambda: _composite(_parts(pin.JointModelRX(), JOINTS["prismatic"](), pin.JointModelRZ())),
        _parts(pin.JointModelRX(), JOINTS["prismatic"](), pin.JointModelRZ()),
    ),
}
#: Every type of joint. "mixed" is a composite joint with a ball and an angle without end.
ALL_JOINTS = JOINTS | {name: make for name, (make, _) in IN_A_ROW.items()}
ALL_JOINTS["mixed"] = lambda: _composite(
    _parts(pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPZ(), pin.JointModelRUBZ())
)
CLOSURES = [*Closure.KINDS, (True, False, True, False, True, False)]
#: Every type of closure between the frames A and B.
CONSTRAINTS = {
    **{kind: Closure("A", "B", kind) for kind in Closure.KINDS},
    "mask": Closure("A", "B", (False, True, False, True, False, False)),
    "all turns": Closure("A", "B", (True, False, False, True, True, True)),
    "rod": Distance("A", "B", 0.7),
    "disc": Rolling("A", "B", 0.25),
    "ball": Rolling("A", "B", 0.25, ball=True),
}
#: Arguments of `tree`. Every type of joint is in one of them.
TREES = {
    "floating": ("free-flyer", ["spherical", "RY", "PX"], ["revolute", "ZYX", "translation"]),
    "planar": (
        "planar",
        ["universal", "prismatic", "RUBX", "PX"],
        ["spherical", "helical", "free-flyer"],
    ),
    "composite": ("mixed", ["continuous", "HZ", "spherical"], ["RY", "composite", "planar"]),
}


def add_joint(
    model: pin.Model,
    parent: int,
    name: str,
    joint: pin.JointModel,
    random: np.random.Generator,
    placement: pin.SE3 | None = None,
) -> int:
    """The number of a new joint with a random body, at a random place by default."""
    points = 0.2 * random.normal(size=(3, 3))
    moments = points @ points.T
    inertia = moments.trace() * np.eye(3) - moments
    body = pin.Inertia(random.uniform(0.5, 2), 0.2 * random.normal(size=3), inertia)
    return add(model, parent, joint, name, placement or _placement(random, 0.5), body)


def add_frame(model: pin.Model, name: str, joint: int, random: np.random.Generator) -> None:
    """A frame at a random place of a joint's body."""
    mark(model, joint, name, _placement(random, 0.3))


def close(
    model: pin.Model, first: int, second: int, q: np.ndarray, random: np.random.Generator
) -> None:
    """Frames A and B on two bodies that meet at q, which becomes the configuration "closed"."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    add_frame(model, "A", first, random)
    mark(model, second, "B", data.oMi[second].actInv(data.oMi[first] * model.frames[-1].placement))
    model.referenceConfigurations["closed"] = q
    model.armature = random.uniform(0, 0.1, model.nv)


def tree(root: str, first: Sequence[str], second: Sequence[str], seed: int = 0) -> pin.Model:
    """Two branches on one root, joints by their names, frames A and B at the ends.

    The joints are added breadth-first, so that they are not in Pinocchio's usual order.
    """
    random, model = np.random.default_rng(seed), pin.Model()
    model.gravity.linear = GRAVITY
    base = add_joint(model, 0, "root", ALL_JOINTS[root](), random) if root else 0
    ends = [base, base]
    for level in range(max(len(first), len(second))):
        for side, branch in enumerate((first, second)):
            if level < len(branch):
                name, joint = f"{'ab'[side]}{level}_{branch[level]}", ALL_JOINTS[branch[level]]()
                ends[side] = add_joint(model, ends[side], name, joint, random)
    close(model, *ends, random_q(model, random, 0.5), random)
    return model


def chain(
    joints: Parts = (),
    kind: str | tuple[bool, ...] = "6d",
    more: Sequence[Constraint] = (),
    **options,
) -> ClosedChain:
    """A body on a joint from the base, held by an arm of six revolutes."""
    random, model = np.random.default_rng(0), pin.Model()
    model.gravity.linear = GRAVITY
    *light, (last, step) = joints or [(pin.JointModelRY(), pin.SE3.Identity())]
    names = [*(f"body_{k}" for k in range(len(light))), "body"]
    index, where = 0, _placement(random, 0.3)
    for name, (joint, placement) in zip(names[:-1], light, strict=True):
        index = model.addJoint(index, joint, where * placement, name)
        where = pin.SE3.Identity()
    body, hand = add_joint(model, index, "body", last, random, where * step), 0
    add_frame(model, "point_body", body, random)
    for k in range(1, 7):
        axis = pin.JointModelRevoluteUnaligned(_unit(random, 3))
        hand = add_joint(model, hand, f"arm_{k}", axis, random)
        add_frame(model, f"point_arm_{k}", hand, random)
    close(
        model, body, hand, pin.integrate(model, pin.neutral(model), 0.3 * np.ones(model.nv)), random
    )
    model.damping, model.friction = random.uniform(0, 2, (2, model.nv))
    closures = [Closure("A", "B", kind)] if kind else []
    return ClosedChain(model, [*closures, *more], options.pop("actuated", names), **options)


def with_joint(name: str, **options) -> ClosedChain:
    """The body on a joint of one kind."""
    return chain([(ALL_JOINTS[name](), pin.SE3.Identity())], **options)


def welded_in_a_row() -> ClosedChain:
    """Three floating bodies: the second one is welded to the first, the third to the second."""
    random, model = np.random.default_rng(6), pin.Model()
    model.gravity.linear = GRAVITY
    for k in range(3):
        body = add_joint(model, 0, f"body_{k}", pin.JointModelFreeFlyer(), random)
        add_frame(model, f"back_{k}", body, random)
        add_frame(model, f"front_{k}", body, random)
    closures = [Closure("back_1", "front_0"), Closure("back_2", "front_1")]
    return ClosedChain(model, closures, [], coordinates=["body_0"])


def rods() -> ClosedChain:
    """The arm ends in a ball; a rod between two of its links."""
    plain = chain(kind="3d")
    q = plain.generic_configuration()
    a, b = (plain.frame_placement(q, f"point_arm_{k}")[0] for k in (2, 5))
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
    model.gravity.linear = GRAVITY
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


GAS = LineForce(
    "wall",
    "platform",
    name="gas",
    stiffness=60,
    rest_length=0.4,
    damping=5,
    mass=1.5,
    coulomb_friction=2,
)
SPRING = LineForce("rocker_pin", "wall", stiffness=300, rest_length=0.1, preload=-9)
#: Of a four-bar, two of them on one degree of freedom.
ON_LINES = ["gas", {"rocker": 0.3, SPRING.name: 2.0}]


def lines(
    where: Sequence[float] = (-0.3, 0.1, 0.3), lines: Sequence[LineForce] = (GAS, SPRING)
) -> ClosedChain:
    """A four-bar with lines from a point on the wall, one of them a motor."""
    bars = robots.four_bar()
    model = pin.Model(bars.model)
    mark(model, 0, "wall", at(*where))
    return ClosedChain(model, bars.closures, ON_LINES, lines=lines)


def states(chain: ClosedChain, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, va, aa of random motions around a generic configuration, the worst ones left out."""
    random = np.random.default_rng(seed)
    generic, result = chain.generic_configuration(), []
    while len(result) < count:
        moved = pin.integrate(chain.model, generic, 0.2 * random.normal(size=chain.model.nv))
        try:
            q = chain.assemble(moved, fixed=())
        except ClosureError:
            continue
        if chain.condition_number(q) < 1e2:
            result.append(q)
    va, aa = random.normal(size=(2, count, chain.degrees_of_freedom))
    return np.array(result), va, aa
