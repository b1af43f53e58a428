# SPDX-License-Identifier: BSD-2-Clause
"""Reactions against Exudyn: rigid joints by its multipliers, soft joints by its springs.

Each body of the tree is a rigid body of Exudyn in redundant coordinates, each joint and closure a
joint or a spring of Exudyn at its place in one configuration.
"""

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import null_space

import sst_pin
from sst_pin import robots
from tests.referees.exudyn_robot import ExudynRobot
from tests.support.by_hand import add, mark

REASON = "exudyn, the referee, is an extra"
exudyn = pytest.importorskip("exudyn", reason=REASON)
items = pytest.importorskip("exudyn.itemInterface", reason=REASON)
utilities = pytest.importorskip("exudyn.utilities", reason=REASON)


class Twin(ExudynRobot):
    """A robot of hinges and welds in Exudyn, in one configuration; motors are locked joints.

    With a stiffness for each joint and closure, [moment; force], joints are springs.
    """

    def __init__(self, chain, q, stiffness=None):
        self.exudyn, self.model = exudyn, chain.model
        self.data = self.model.createData()
        pin.framesForwardKinematics(self.model, self.data, q)
        self._container = exudyn.SystemContainer()
        self.system = self._container.AddSystem()
        self.bodies = [self.system.CreateGround()]
        for body, at in zip(self.model.inertias[1:], self.data.oMi[1:], strict=True):
            inertia = utilities.RigidBodyInertia(
                body.mass, body.inertia, body.lever, inertiaTensorAtCOM=True
            )
            self.bodies.append(
                self.system.CreateRigidBody(
                    referencePosition=at.translation,
                    referenceRotationMatrix=at.rotation,
                    inertia=inertia,
                    gravity=self.model.gravity.linear.tolist(),
                )
            )
        self.joints = []
        for parent, child, at, held in self.connections(chain):
            if stiffness is None:
                joint = self.system.CreateGenericJoint(
                    itemNumbers=[self.bodies[parent], self.bodies[child]],
                    position=at.translation,
                    rotationMatrixAxes=at.rotation,
                    constrainedAxes=held,
                    useGlobalFrame=True,
                )
            else:
                stiff = np.roll(stiffness[len(self.joints)], 3) * held
                joint = self._spring(parent, child, at, np.diag(stiff))
            self.joints.append(joint)
        self.system.Assemble()
        reference = exudyn.ConfigurationType.Reference
        self._reference = self.system.systemData.GetODE2Coordinates(configuration=reference)

    def connections(self, chain):
        """Parent, child, place and held directions, [force; moment], of joints and closures."""
        for j in range(1, self.model.njoints):
            held = [1] * 6
            if self.model.names[j] not in chain.motor_names:
                held[3 + "XYZ".index(self.model.joints[j].shortname()[-1])] = 0
            yield self.model.parents[j], j, self.data.oMi[j], held
        for closure in chain.closures:
            ends = [self.model.getFrameId(name) for name in (closure.frame_a, closure.frame_b)]
            bodies = [self.model.frames[end].parentJoint for end in ends]
            yield *bodies, self.data.oMf[ends[1]], [int(held) for held in closure.held]

    def _spring(self, parent, child, at, stiffness):
        markers = []
        for body in (parent, child):
            own = self.data.oMi[body].actInv(at).homogeneous
            marker = items.MarkerBodyRigid(bodyNumber=self.bodies[body], localHT=own)
            markers.append(self.system.AddMarker(marker))
        return self.system.AddObject(
            items.RigidBodySpringDamper(
                markerNumbers=markers, stiffness=stiffness, damping=np.zeros((6, 6))
            )
        )

    @property
    def wrenches(self):
        """[moment; force] of each joint and closure, as Exudyn tells them."""
        kinds = exudyn.OutputVariableType.TorqueLocal, exudyn.OutputVariableType.ForceLocal
        records = [[self.system.GetObjectOutput(j, kind) for kind in kinds] for j in self.joints]
        return np.array(records).reshape(-1, 6)


def multipliers(chain, q, va, aa):
    """Wrenches [moment; force] of Exudyn's joints along a motion, and which are unique."""
    twin, model = Twin(chain, q), chain.model
    data = model.createData()
    v, v_dot = chain.joint_rates(q, va), chain.joint_accelerations(q, va, aa)
    pin.forwardKinematics(model, data, q, v, v_dot)
    x = np.array(twin._reference).reshape(-1, 7)
    x_dot, x_ddot = np.zeros_like(x), np.zeros_like(x)
    for j, e in enumerate(x[:, 3:]):
        twist = pin.getVelocity(model, data, j + 1, pin.LOCAL_WORLD_ALIGNED)
        rate = pin.getClassicalAcceleration(model, data, j + 1, pin.LOCAL_WORLD_ALIGNED)
        x_dot[j] = *twist.linear, *turned(twist.angular, e)
        x_ddot[j] = *rate.linear, *turned(rate.angular, e)
        x_ddot[j, 3:] -= twist.angular @ twist.angular / 4 * e
    mass, force, Phi, residual = twin.equations(x.ravel(), x_dot.ravel())
    assert np.abs(residual).max() < 1e-9
    right = force - mass @ x_ddot.ravel()
    smallest = np.linalg.lstsq(Phi.T, right, rcond=1e-9)[0]
    assert np.abs(Phi.T @ smallest - right).max() < 1e-9 * (1 + np.abs(right).max())
    both = np.column_stack([smallest, null_space(Phi.T, rcond=1e-9)])
    wrenches = []
    for joint, (_, child, at, _) in zip(twin.joints, twin.connections(chain), strict=True):
        rows, own = twin.system.systemData.GetObjectLTGAE(joint), x[child - 1]
        on_child = -Phi[rows, 7 * child - 7 : 7 * child].T @ both[rows]
        moment = np.array([turned(axis, own[3:]) for axis in np.eye(3)]) @ on_child[3:]
        moment += np.cross(own[:3] - at.translation, on_child[:3], axisb=0, axisc=0)
        wrenches.append(np.vstack([at.rotation.T @ moment, at.rotation.T @ on_child[:3]]))
    result = np.array(wrenches)
    return result[..., 0], np.linalg.norm(result[..., 1:], axis=-1) < 1e-6


def turned(spin, e):
    """Half of the product of quaternions (0, spin) e, scalar first."""
    return np.r_[-spin @ e[1:], spin * e[0] + np.cross(spin, e[1:])] / 2


def whole_star():
    """The SST with its star in one piece on leg 1 and hinges in legs 2 and 3."""
    robot = sst_pin.SST()
    plain, model = robot.model, pin.Model()
    model.gravity = plain.gravity
    star = plain.getJointId("beta_1")
    for j in range(1, plain.njoints):
        if j == star or not plain.names[j].startswith("beta"):
            parent = model.getJointId(plain.names[plain.parents[j]])
            place = plain.jointPlacements[j]
            add(model, parent, plain.joints[j], plain.names[j], place, plain.inertias[j])
    closures = []
    for k, weld in enumerate(robot.closures, 2):
        a, b = (plain.frames[plain.getFrameId(name)] for name in (weld.frame_a, weld.frame_b))
        at, third = a.placement * b.placement.inverse(), b.parentJoint
        own = model.getJointId("beta_1")
        model.appendBodyToJoint(own, plain.inertias[third], at)
        arc, parent = plain.jointPlacements[third], model.getJointId(f"mu_{k}")
        mark(model, parent, f"arc_{k}", arc)
        mark(model, own, f"end_{k}", at)
        closures.append(sst_pin.Closure(f"arc_{k}", f"end_{k}", "hinge"))
    return sst_pin.ClosedChain(model, closures, robot.motor_names)


CHAINS = {
    **{
        name: getattr(robots, name)
        for name in ("bennett", "agile_wrist", "bricard", "four_bar", "planar_3rrr", "five_bar")
    },
    "SST, star cut": sst_pin.SST,
    "SST, hinges cut": whole_star,
}


@pytest.mark.parametrize("name", CHAINS)
def test_unique_wrenches_and_verdicts_are_those_of_exudyn(name):
    chain = CHAINS[name]()
    q, random = chain.generic_configuration(), np.random.default_rng(1)
    va, aa = random.uniform(-1, 1, (2, chain.degrees_of_freedom))
    wanted, unique = multipliers(chain, q, va, aa)
    w = chain.reactions(q, va, aa)
    result = np.concatenate([w.joints, w.closures])
    assert np.array_equal(np.concatenate(w.determined), unique)
    assert result[unique] == pytest.approx(wanted[unique], abs=1e-10 * np.abs(wanted).max())


def sprung(chain, q, stiffness):
    """Wrenches [moment; force] of springs in the pose to which the weight brings the robot."""
    twin = Twin(chain, q, stiffness)
    settings = twin._settings()
    newton = settings.staticSolver.newton
    newton.relativeTolerance, newton.absoluteTolerance = 1e-8, 1e-8
    twin.system.SolveStatic(settings)
    return -twin.wrenches


SPRUNG = [name for name in CHAINS if name not in ("planar_3rrr", "five_bar")]


@pytest.mark.parametrize("name", SPRUNG)
def test_wrenches_of_soft_joints_tend_to_those_of_the_stiffnesses(name):
    """With ten times the stiffness a tenth of the difference: how far the weight bends the robot.

    1e-3 of that are differences of second order and the tolerance of Exudyn's solver.
    """
    chain = CHAINS[name]()
    q, rest = chain.generic_configuration(), np.zeros(chain.degrees_of_freedom)
    names = (*chain.joint_names, *map(str, chain.closures))
    stiffness = np.random.default_rng(1).uniform(1, 2, (len(names), 6))
    w = chain.reactions(q, rest, rest, stiffness=dict(zip(names, stiffness, strict=True)))
    assert (w.elastic.joints & ~w.determined.joints).any()
    wanted = np.concatenate([w.joints, w.closures])
    off = [np.abs(sprung(chain, q, size * stiffness) - wanted).max() for size in (1e6, 1e7)]
    assert off[0] < 1e-3 * np.abs(wanted).max()
    assert off[1] == pytest.approx(off[0] / 10, rel=1e-2)
