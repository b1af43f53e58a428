# SPDX-License-Identifier: BSD-2-Clause
"""`locked=` takes single rates of joints, and messages say which ones to lock."""

import re
from math import prod

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from sst_pin.model.locked_joints import without_locked
from sst_pin.reading import parse_cuts
from tests.support.by_hand import add, at, mark

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
        body = pin.Inertia.Random()
        carrier = add(model, model.njoints - 1, part, name, pin.SE3.Random(), body)
        mark(model, carrier, f"tip_{name}", pin.SE3.Random())
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
    pose, ball = (
        prod((singles[name](positions[name]) for name in names), start=pin.SE3.Identity())
        for names in (order, turns)
    )
    q = pin.neutral(chain.model)
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
    whole = ClosedChain(model, [], [])
    for rate in singles:
        fixed = ClosedChain(model, [], [], locked=[rate])
        q = np.random.default_rng(1).uniform(-1, 1, fixed.model.nq)
        q = pin.normalize(fixed.model, q)
        start = pin.neutral(model)
        start[-1] = q[-1]
        pose = whole.frame_configuration("tip_j", *fixed.frame_placement(q, "tip_j"), start=start)
        model.referenceConfigurations["pose"] = pose
        back = without_locked(model, [rate]).model
        named = back.referenceConfigurations["pose"]
        assert placed(back, named).isApprox(placed(fixed.model, q), 1e-9)


def slider_crank(rod, locked=()) -> ClosedChain:
    """A crank, a slider, and a rod between two balls, along `rod` of the ball in the tree."""
    model, length = pin.Model(), 0.5
    weight = pin.Inertia.FromSphere(1.0, 0.1)
    crank = add(model, 0, pin.JointModelRZ(), "crank", at(), weight)
    place = at(0, 0.2, 0.1, turned=pin.Quaternion.FromTwoVectors(rod, X).matrix())
    body = pin.Inertia(0.3, length / 2 * rod, 1e-2 * (np.eye(3) - np.outer(rod, rod)) + 1e-4)
    ball = add(model, crank, pin.JointModelSpherical(), "ball", place, body)
    mark(model, ball, "tip", at(*length * rod))
    mark(model, add(model, 0, pin.JointModelPX(), "slider", at(), weight), "pin", at())
    return ClosedChain(model, [Closure("tip", "pin", "3d")], ["crank"], locked=locked)


def cure_in(text) -> list[str]:
    """The names in the cure that a message prints."""
    return re.findall(r"'([^']+)'", re.search(r"locked=(\[.*?\])", str(text))[1])


@pytest.mark.filterwarnings("ignore:.*no configuration is named home")
@pytest.mark.parametrize("rod", [X, SKEW], ids=str)
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


@pytest.mark.filterwarnings("ignore:.*no configuration is named home")
@pytest.mark.parametrize("rod", [X, SKEW], ids=str)
def test_the_spin_of_a_rod_between_two_balls_of_the_tree_is_idle(rod):
    """The loop is cut behind the second ball, which turns back what the first one turns."""

    def slider_crank_cut_at_its_slide(locked=()):
        model, length = pin.Model(), 0.5
        weight = pin.Inertia.FromSphere(1.0, 0.1)
        crank = add(model, 0, pin.JointModelRZ(), "crank", at(), weight)
        place = at(0, 0.2, 0.1, turned=pin.Quaternion.FromTwoVectors(rod, X).matrix())
        first = add(model, crank, pin.JointModelSpherical(), "first", place, weight)
        end = at(*length * rod, turned=place.rotation.T)
        second = add(model, first, pin.JointModelSpherical(), "second", end, weight)
        mark(model, second, "slider", at())
        mark(model, 0, "rail", at(turned=pin.Quaternion.FromTwoVectors(np.eye(3)[2], X).matrix()))
        mark(model, second, "along", at(turned=model.frames[-1].placement.rotation))
        closures = [Closure("rail", "along", "prismatic")]
        return ClosedChain(model, closures, ["crank"], locked=locked)

    free = slider_crank_cut_at_its_slide()
    mobility = free.mobility()
    assert (free.degrees_of_freedom, len(mobility.idle_joints)) == (2, 1)
    cured = slider_crank_cut_at_its_slide(cure_in(mobility))
    assert cured.degrees_of_freedom == 1
    assert cured.mobility().sufficient
    assert not cured.mobility().idle_joints


def test_a_body_that_a_cylinder_moves_does_not_rotate_freely():
    """A plate on two rods: to lock its rotation would lock the robot."""
    model = pin.Model()
    plate = add(model, 0, pin.JointModelPlanar(), "plate", at(), pin.Inertia.FromSphere(1.0, 0.1))
    mark(model, 0, "foot", at(-1.0, 0.0))
    for name, x in (("left", 0.0), ("right", 0.7)):
        mark(model, 0, f"{name}_hook", at(x, 1.0))
        mark(model, plate, f"{name}_eye", at(x, 0.2))
    rods = [sst_pin.Distance(f"{name}_hook", f"{name}_eye", 0.8) for name in ("left", "right")]
    cylinder = sst_pin.LineForce("foot", "left_eye", name="cylinder")
    for motors in ([], ["cylinder"]):
        mobility = ClosedChain(model, rods, motors, lines=[cylinder]).mobility()
        assert (mobility.degrees_of_freedom, mobility.held) == (1, len(motors))
        assert mobility.idle_joints == ()


def test_a_door_on_two_balls_that_a_cylinder_moves_does_not_rotate_freely():
    """Without the cylinder, it does: nothing else moves."""
    model = pin.Model()
    door = add(model, 0, pin.JointModelSpherical(), "door", at(), pin.Inertia.FromSphere(1.0, 0.1))
    mark(model, 0, "foot", at(-1.0, 0.5))
    mark(model, 0, "top", at(0.0, 0.0, 1.0))
    mark(model, door, "eye", at(0.0, 0.0, 1.0))
    mark(model, door, "handle", at(0.6, 0.2))
    cylinder = sst_pin.LineForce("foot", "handle", name="cylinder")
    for lines, idle in (([], ("door_wz",)), ([cylinder], ())):
        mobility = ClosedChain(model, [Closure("top", "eye", "3d")], [], lines=lines).mobility()
        assert (mobility.degrees_of_freedom, mobility.idle_joints) == (1, idle)


@pytest.mark.parametrize(
    ("joint", "name", "message"),
    [
        (pin.JointModelRUBX(), "j", "joint j is continuous: a list of names locks it, at zero"),
        (pin.JointModelPlanar(), "j", "joint j has several coordinates; name j_vx, j_vy, j_w"),
    ],
)
def test_a_joint_without_a_single_position_is_not_locked_at_one(joint, name, message):
    model = tree(joint, np.random.default_rng(0))
    with pytest.raises(sst_pin.InputError, match=f"^locked: {message}"):
        without_locked(model, {name: 0.5})
