# SPDX-License-Identifier: BSD-2-Clause
"""`locked=` takes single rates of joints, and messages say which ones to lock."""

import re

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from sst_pin.model.checks import without_locked
from sst_pin.reading import parse_cuts

X, Y, Z = np.eye(3)
SKEW = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])


def slide(axis):
    return lambda x: pin.SE3(np.eye(3), x * axis)


def turn(axis):
    return lambda x: pin.SE3(pin.exp3(x * axis), np.zeros(3))


SLIDES = {f"j_v{name}": slide(axis) for name, axis in zip("xyz", np.eye(3), strict=True)}
TURNS = {f"j_w{name}": turn(axis) for name, axis in zip("xyz", np.eye(3), strict=True)}
#: For each kind of joint its model, and its single rates in series.
KINDS = {
    "ball": (pin.JointModelSpherical(), TURNS),
    "free-flyer": (pin.JointModelFreeFlyer(), SLIDES | TURNS),
    "translation": (pin.JointModelTranslation(), SLIDES),
    "planar": (
        pin.JointModelPlanar(),
        {"j_vx": slide(X), "j_vy": slide(Y), "j_w": turn(Z)},
    ),
    "universal": (pin.JointModelUniversal(X, SKEW), {"j_1": turn(X), "j_2": turn(SKEW)}),
    "Euler": (
        pin.JointModelSphericalZYX(),
        {"j_rz": turn(Z), "j_ry": turn(Y), "j_rx": turn(X)},
    ),
}


def tree(joint, random) -> pin.Model:
    """A body on the joint, and one on a hinge of it."""
    model = pin.Model()
    for name, part in (("j", joint), ("hinge", pin.JointModelRY())):
        bearer = model.addJoint(model.njoints - 1, part, pin.SE3.Random(), name)
        model.appendBodyToJoint(bearer, pin.Inertia.Random(), pin.SE3.Random())
        model.addFrame(pin.Frame("tip", bearer, pin.SE3.Random(), pin.FrameType.OP_FRAME))
        model.frames[model.nframes - 1].name = f"tip_{name}"
    model.damping = random.uniform(1, 2, model.nv)
    return model


def placed(model: pin.Model, q) -> pin.SE3:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("tip_hinge")]


@pytest.mark.parametrize(
    ("kind", "rate"), [(kind, rate) for kind, (_, rates) in KINDS.items() for rate in rates]
)
def test_a_single_rate_of_any_joint_is_locked_at_a_position(kind, rate):
    """The others stay, with their names and friction, as joints in series."""
    joint, singles = KINDS[kind]
    pin.seed(0)
    random = np.random.default_rng(0)
    model = tree(joint, random)
    chain = ClosedChain(model, [], ["hinge"], locked={rate: 0.7})
    left = [name for name in singles if name != rate]
    assert sorted(chain.rate_names) == sorted([*left, "hinge"])
    whole = dict(zip(ClosedChain(model, [], ["hinge"]).rate_names, model.damping, strict=True))
    damping = zip(chain.rate_names, chain.friction.viscous, strict=True)
    assert all(whole[name] == x for name, x in damping)

    positions = {name: 0.7 if name == rate else random.uniform(-1, 1) for name in singles}
    turns = [name for name in singles if "_w" in name]
    order = sorted(singles, key=lambda name: name == rate in turns)  # a locked turn is the last
    pose = pin.SE3.Identity()
    for name in order:
        pose = pose * singles[name](positions[name])
    q = pin.neutral(chain.model)
    ball = pin.SE3.Identity()
    for name in turns:
        ball = ball * singles[name](positions[name])
    for k, entry in enumerate(chain.position_names):
        q[k] = positions.get(entry, q[k])
    if "j_qw" in chain.position_names:
        first = chain.position_names.index("j_qx")
        q[first : first + 4] = pin.Quaternion(ball.rotation).coeffs()
    hinge = model.jointPlacements[2] * turn(Y)(q[-1])
    tip = model.frames[model.getFrameId("tip_hinge")].placement
    expected = model.jointPlacements[1] * pose * hinge * tip
    assert placed(chain.model, q).isApprox(expected, 1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_named_poses_stay_where_a_locked_rate_is_at_zero(kind):
    joint, singles = KINDS[kind]
    pin.seed(0)
    model = tree(joint, np.random.default_rng(0))
    for rate in singles:
        reduced = without_locked(model, [rate])
        q = np.random.default_rng(1).uniform(-1, 1, reduced.nq)
        q = pin.normalize(reduced, q)
        place = reduced.createData()
        pin.forwardKinematics(reduced, place, q)
        pin.framesForwardKinematics(reduced, place, q)
        expected = placed(reduced, q)
        body = model.jointPlacements[1].actInv(
            place.oMf[reduced.getFrameId("tip_j")]
            * model.frames[model.getFrameId("tip_j")].placement.inverse()
        )
        model.referenceConfigurations["pose"] = np.append(_position(kind, body), q[-1])
        back = without_locked(model, [rate])
        assert placed(back, back.referenceConfigurations["pose"]).isApprox(expected, 1e-9)


def _position(kind: str, body: pin.SE3) -> np.ndarray:
    """Entries of q of a joint whose body is at a placement."""
    R, p = body.rotation, body.translation
    if kind == "universal":
        axis = X.copy()  # the first turn moves the second axis
        second = R @ SKEW
        plane = np.array([SKEW - (SKEW @ X) * X, np.cross(X, SKEW)])
        first = np.arctan2(plane[1] @ second, plane[0] @ second)
        rest = pin.exp3(-first * axis) @ R
        return np.array([first, pin.log3(rest) @ SKEW])
    if kind == "Euler":
        return pin.rpy.matrixToRpy(R)[::-1]
    if kind == "planar":
        return np.array([*p[:2], R[0, 0], R[1, 0]])
    quaternion = pin.Quaternion(R).coeffs()
    return {"ball": quaternion, "translation": p, "free-flyer": np.append(p, quaternion)}[kind]


def slider_crank(rod, locked=()) -> ClosedChain:
    """A crank, a slider, and a rod between two balls, along `rod` of the ball in the tree."""
    model, length = pin.Model(), 0.5
    crank = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "crank")
    model.appendBodyToJoint(crank, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    end = pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.1]))
    place = end * pin.SE3(pin.Quaternion.FromTwoVectors(rod, X).matrix(), np.zeros(3))
    ball = model.addJoint(crank, pin.JointModelSpherical(), place, "ball")
    body = pin.Inertia(0.3, length / 2 * rod, 1e-2 * (np.eye(3) - np.outer(rod, rod)) + 1e-4)
    model.appendBodyToJoint(ball, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), length * rod)
    model.addFrame(pin.Frame("tip", ball, tip, pin.FrameType.OP_FRAME))
    slider = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slider")
    model.appendBodyToJoint(slider, pin.Inertia.FromSphere(0.5, 0.1), pin.SE3.Identity())
    model.addFrame(pin.Frame("pin", slider, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return ClosedChain(model, [Closure("tip", "pin", "3d")], ["crank"], locked=locked)


def cure_in(text) -> list[str]:
    """The names in the cure that a message prints."""
    return re.findall(r"'([^']+)'", re.search(r"locked=(\[.*?\])", str(text))[1])


@pytest.mark.parametrize("rod", [X, Y, Z, SKEW], ids=str)
def test_the_cure_that_messages_print_removes_the_spin_alone(rod):
    """The rod can still have any direction, and the motor moves it with the same torques."""
    free = slider_crank(rod)
    assert free.degrees_of_freedom == 2
    q = free.assemble({"crank": 0.3})
    with pytest.raises(sst_pin.ActuationError) as refusal:
        free.compute_torques(q, [1, 2], [3, 4])
    for message in (free.mobility(), refusal.value):
        locked = cure_in(message)
        assert len(locked) == 1
        in_yaml = re.search("`(locked: .*?)`", str(message))[1]
        assert parse_cuts(f"name_mot: []\n{in_yaml}", "cuts").locked == tuple(locked)
        assert locked[0].startswith("ball_w")
        cured = slider_crank(rod, locked)
        assert cured.degrees_of_freedom == 1
        assert cured.mobility().sufficient
        assert not cured.mobility().idle_joints
    t = np.linspace(0, 1, 21)
    motion = sst_pin.coordinate_motion(cured, t, np.sin(2 * np.pi * t)[:, None])
    assert np.abs(motion.q).max() < 10
