# SPDX-License-Identifier: BSD-2-Clause
"""Trees with every joint of Pinocchio, and derivatives by differences."""

import numpy as np
import pinocchio as pin

from sst_pin import Closure
from sst_pin.model.closures import Distance, Rolling
from tests.support.by_hand import mark

GRAVITY = np.array([0.6, -1.3, -9.4])


def _composite(*parts):
    joint = pin.JointModelComposite()
    for part in parts:
        joint.addJoint(part, pin.SE3.Random())
    return joint


def unbounded(axis):
    """A joint that turns about an axis without end."""
    joint = pin.JointModelRevoluteUnboundedUnaligned()
    joint.axis = axis
    return joint


def _unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


#: Every type of joint, by a name.
JOINTS = {
    "RX": pin.JointModelRX,
    "RZ": pin.JointModelRZ,
    "PX": pin.JointModelPX,
    "PZ": pin.JointModelPZ,
    "revolute": lambda: pin.JointModelRevoluteUnaligned(_unit(0.3, -1, 0.5)),
    "prismatic": lambda: pin.JointModelPrismaticUnaligned(_unit(-0.4, 0.2, 1)),
    "RUBY": pin.JointModelRUBY,
    "unbounded": lambda: unbounded(_unit(1, 2, -1)),
    "HY": lambda: pin.JointModelHY(0.2),
    "helical": lambda: pin.JointModelHelicalUnaligned(_unit(0.5, 0.5, 1), -0.3),
    "universal": lambda: pin.JointModelUniversal(np.array([1.0, 0, 0]), np.array([0, 0.6, 0.8])),
    "ball": pin.JointModelSpherical,
    "ZYX": pin.JointModelSphericalZYX,
    "plane": pin.JointModelPlanar,
    "translation": pin.JointModelTranslation,
    "free": pin.JointModelFreeFlyer,
    "composite": lambda: _composite(
        pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPZ(), pin.JointModelRUBZ()
    ),
}


def add_joint(model, parent, name, joint, random, mass=True):
    """A joint at a random place with a random body; its index."""
    pose = pin.SE3(pin.exp3(random.normal(size=3)), 0.4 * random.normal(size=3))
    index = model.addJoint(parent, joint, pose, name)
    if mass:
        points = 0.2 * random.normal(size=(3, 3))
        second = points @ points.T
        inertia = np.trace(second) * np.eye(3) - second
        body = pin.Inertia(random.uniform(0.5, 2), 0.1 * random.normal(size=3), inertia)
        model.appendBodyToJoint(index, body, pin.SE3.Identity())
    return index


def add_frame(model, name, joint, random):
    """A frame at a random place of a joint's body."""
    pose = pin.SE3(pin.exp3(random.normal(size=3)), 0.3 * random.normal(size=3))
    mark(model, joint, name, pose)


def tree(root, first, second, seed=0):
    """Two branches on one root, joints by their names of `JOINTS`, frames "A" and "B" at the ends.

    The joints are added breadth-first, so that they are not in Pinocchio's usual order. The frames
    coincide at the reference configuration "closed".
    """
    pin.seed(seed)
    random = np.random.default_rng(seed)
    model = pin.Model()
    model.gravity.linear = GRAVITY
    base = add_joint(model, 0, "root", JOINTS[root](), random) if root else 0
    ends = [base, base]
    for level in range(max(len(first), len(second))):
        for side, branch in enumerate((first, second)):
            if level < len(branch):
                name = f"{'ab'[side]}{level}_{branch[level]}"
                ends[side] = add_joint(model, ends[side], name, JOINTS[branch[level]](), random)
    add_frame(model, "A", ends[0], random)
    q = random_q(model, random, 0.5)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    pose = data.oMi[ends[1]].actInv(data.oMf[model.getFrameId("A")])
    mark(model, ends[1], "B", pose)
    model.referenceConfigurations["closed"] = q
    model.armature = random.uniform(0, 0.1, model.nv)
    return model


def random_q(model, random, size=1.0):
    """A configuration around the neutral one."""
    return pin.integrate(model, pin.neutral(model), size * random.normal(size=model.nv))


def derivative(function, h=0.01):
    """Derivative at 0 by central differences of eighth order: h^8 and rounding / h."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (function(k * h) - function(-k * h)) for k, w in weights.items()) / h


def gradient(function, model, q, h=0.01):
    """Derivative of a function of q along each rate, columns."""
    units = np.eye(model.nv)
    return np.stack(
        [derivative(lambda s, e=e: function(pin.integrate(model, q, s * e)), h) for e in units],
        axis=-1,
    )


#: Names of joints: root, branch of frame A, branch of frame B. Every type is in one of them.
TREES = {
    "floating": ("free", ["ball", "RX", "PZ"], ["revolute", "ZYX", "translation"]),
    "planar": ("plane", ["universal", "prismatic", "RUBY", "PX"], ["ball", "helical", "free"]),
    "composite": ("composite", ["unbounded", "HY", "ball"], ["RZ", "composite", "plane"]),
}
CONSTRAINTS = {
    **{kind: Closure("A", "B", kind) for kind in Closure.KINDS},
    "mask": Closure("A", "B", (False, True, False, True, False, False)),
    "all turns": Closure("A", "B", (True, False, False, True, True, True)),
    "rod": Distance("A", "B", 0.7),
    "disc": Rolling("A", "B", 0.25),
    "ball": Rolling("A", "B", 0.25, ball=True),
}
