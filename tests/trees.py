# SPDX-License-Identifier: BSD-2-Clause
"""Trees with every joint of Pinocchio, and a referee for closed chains that shares nothing.

The referee takes the equations of motion of the tree, RNEA column by column, and the constraint
forces as Lagrange multipliers of a Jacobian that the caller gives.
"""

import numpy as np
import pinocchio as pin

GRAVITY = np.array([0.6, -1.3, -9.4])


def _composite(*parts):
    joint = pin.JointModelComposite()
    for part in parts:
        joint.addJoint(part, pin.SE3.Random())
    return joint


def _unbounded(axis):
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
    "unbounded": lambda: _unbounded(_unit(1, 2, -1)),
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
    model.addFrame(pin.Frame(name, joint, pose, pin.FrameType.OP_FRAME))


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
    model.addFrame(pin.Frame("B", ends[1], pose, pin.FrameType.OP_FRAME))
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


class Lagrange:
    """M v_dot + h = B tau + Phi^T lambda + applied, Phi v_dot = -gamma, solved as one system.

    Args:
        model: The tree.
        B: Of the motors, shape (nv, motors).
        jacobian: q -> Phi, shape (rows, nv), from elsewhere than the code under test.
        drift: (q, v) -> Phi_dot v, shape (rows,); differences of the Jacobian by default.
    """

    def __init__(self, model, B, jacobian, drift=None):
        self.model, self.B, self.jacobian = model, B, jacobian
        self.drift = drift or self._difference
        self.data = model.createData()

    def mass_matrix(self, q):
        """RNEA's columns."""
        zero, model = np.zeros(self.model.nv), self.model
        rest = pin.rnea(model, self.data, q, zero, zero)
        return np.array([pin.rnea(model, self.data, q, zero, e) - rest for e in np.eye(model.nv)]).T

    def forces(self, q, v, v_dot, applied=0):
        """What the motors and closures must give, shape (nv,)."""
        return pin.rnea(self.model, self.data, q, v, v_dot) - applied

    def torques(self, q, v, v_dot, applied=0):
        """Least-squares tau of B tau + Phi^T lambda, and what is left over."""
        A = np.hstack([self.B, self.jacobian(q).T])
        force = self.forces(q, v, v_dot, applied)
        x = np.linalg.lstsq(A, force, rcond=1e-9)[0]
        return x[: self.B.shape[1]], force - A @ x

    def _difference(self, q, v):
        return derivative(lambda s: self.jacobian(pin.integrate(self.model, q, s * v)) @ v, 0.003)

    def accelerations(self, q, v, tau, applied=0):
        """v_dot of the whole tree."""
        model, Phi = self.model, self.jacobian(q)
        M = self.mass_matrix(q)
        bias = pin.rnea(model, self.data, q, v, np.zeros(model.nv))
        rows = len(Phi)
        A = np.block([[M, -Phi.T], [Phi, np.zeros((rows, rows))]])
        right = np.concatenate([self.B @ tau + applied - bias, -self.drift(q, v)])
        return np.linalg.lstsq(A, right, rcond=1e-11)[0][: model.nv]


class TwistRows:
    """Rows that hold the twist of frame "B" relative to "A" in the axes of "A", by Pinocchio.

    Where the loop is closed these are the closure's own rows up to their order and axes, and so is
    what their rate makes of rates that keep the loop closed.
    """

    def __init__(self, model, kind):
        self._model, self._data = model, model.createData()
        self._ids = [model.getFrameId(name) for name in "AB"]
        self._held = {"6d": slice(6), "3d": slice(3), "hinge": slice(5)}[kind]

    def __call__(self, q):
        """Phi, shape (rows, nv)."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        where = pin.LOCAL_WORLD_ALIGNED
        J_a, J_b = (pin.getFrameJacobian(model, data, f, where) for f in self._ids)
        return (self._axes() @ (J_b - J_a))[self._held]

    def drift(self, q, v):
        """Phi_dot v, shape (rows,)."""
        model, data, where = self._model, self._data, pin.LOCAL_WORLD_ALIGNED
        pin.forwardKinematics(model, data, q, v, 0 * v)
        pin.updateFramePlacements(model, data)
        twists = [pin.getFrameVelocity(model, data, f, where) for f in self._ids]
        rates = [pin.getFrameClassicalAcceleration(model, data, f, where) for f in self._ids]
        relative, omega = twists[1] - twists[0], twists[0].angular
        turned = [np.cross(omega, relative.linear), np.cross(omega, relative.angular)]
        rate = (rates[1] - rates[0]).vector - np.concatenate(turned)
        return (self._axes() @ rate)[self._held]

    def _axes(self):
        return np.kron(np.eye(2), self._data.oMf[self._ids[0]].rotation.T)
