# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives by the design are those of robots that are built with other numbers."""

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import robots
from tests.support.derivative_cases import CASES, derivative
from tests.support.rods import rod_delta

AXES = ("x", "y", "z", "rx", "ry", "rz")
QUICK = ("four_bar", "ankle", "two motors on lines")
GALLERY = [name for name in robots.__all__ if name != "GalleryRobot"]
EVERY = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in [*GALLERY, "a motor on a line", "two motors on lines"]
]


def built_with(chain: sst_pin.ClosedChain, changes: dict[str, float]) -> sst_pin.ClosedChain:
    """The robot whose joints and frames are placed elsewhere."""
    model = pin.Model(chain.model)
    for name, change in changes.items():
        place, axis = name.rsplit(".", 1)
        at = [frame.placement for frame in model.frames if frame.name == place]
        if model.existJointName(place):
            at = [model.jointPlacements[model.getJointId(place)]]
        direction = change * np.eye(3)["xyz".index(axis[-1])]
        for placement in at:
            if len(axis) == 1:
                placement.translation = placement.translation + direction
            else:
                placement.rotation = placement.rotation @ pin.exp3(direction)
    other = chain.with_model(model)
    assert other.coordinates == chain.coordinates
    return other


def results(chain, q, va, aa, load, frame, at):
    """Rates from `at`, torques, L and the pose of a frame, the loops closed by assembly."""
    q, n = chain.assemble(q, fixed=chain.coordinates), len(va)
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)
    pose = data.oMf[chain.model.getFrameId(frame)]
    L = np.transpose([chain.joint_rates(q, rate) for rate in np.eye(n)])
    way = pin.log3(pose.rotation @ at[1].rotation.T)
    step = pin.difference(chain.model, at[0], q)
    pose = np.append(pose.translation, way)
    return [step, chain.compute_torques(q, va, aa, external_wrenches=load), L, pose]


def differences(chain, q, va, aa, load, frame, changes, h):
    data = chain.model.createData()
    pin.framesForwardKinematics(chain.model, data, q)
    at = q, data.oMf[chain.model.getFrameId(frame)].copy()

    def flat(s):
        other = built_with(chain, {name: s * size for name, size in changes.items()})
        return np.concatenate([x.ravel() for x in results(other, q, va, aa, load, frame, at)])

    return derivative(flat, h)


def closing_parameters(chain, q, va, aa, random, count, among=None):
    """Some parameters that leave the loops closed, of all displacements or of some names."""
    names = among or [x for x in chain.design_parameters if x.rpartition(".")[2] in AXES]
    result = []
    for name in random.permutation(names):
        try:
            chain.design_derivatives(q, va, aa, [name])
        except sst_pin.InputError:
            continue
        result.append(str(name))
        if len(result) == count:
            break
    return result


@pytest.mark.parametrize("name", EVERY)
def test_derivatives_are_differences_of_robots_built_with_other_placements(name):
    """External wrenches act at their place in the bodies, while the geometry changes."""
    if name in GALLERY:
        chain = getattr(robots, name)()
        q = chain.generic_configuration()
    else:
        make, *arguments = CASES[name]
        case = make(*arguments)
        chain, q = case.twin, case.home
    random, frame, n = np.random.default_rng(1), chain.model.frames[-1].name, len(chain.coordinates)
    va, aa = random.uniform(-1, 1, (2, chain.degrees_of_freedom))
    names = closing_parameters(chain, q, va, aa, random, 3)
    assert names
    together = {names[0]: 1.0, names[-1]: -0.6}
    load = random.normal(size=(chain.model.njoints - 1, 6))
    d = chain.design_derivatives(q, va, aa, [*names, together], frame=frame, external_wrenches=load)
    assert d.L.shape == (chain.model.nv, n, len(names) + 1)
    h = 2e-4 * chain.mechanism.length
    for k, changes in enumerate([*({name: 1.0} for name in names), together]):
        actual = np.concatenate([x[..., k].ravel() for x in (d.q, d.torques, d.L, d.pose)])
        expected = differences(chain, q, va, aa, load, frame, changes, h)
        # Rounding of the differences is 1e-16 / h.
        size = np.abs(expected).max(initial=np.abs(chain.compute_torques(q, va, aa)).max())
        assert_allclose(actual, expected, rtol=0, atol=1e-8 * size, err_msg=str(changes))


@pytest.mark.parametrize("make", [robots.four_bar, robots.ankle])
def test_wrenches_at_frames_stay_there(make):
    """Some parameters move the frames on their bodies, others the bodies."""
    chain = make()
    q = chain.generic_configuration()
    random = np.random.default_rng(2)
    va, aa = random.uniform(-1, 1, (2, chain.degrees_of_freedom))
    names = closing_parameters(chain, q, va, aa, random, 2)
    ends = [frame for closure in chain.closures for frame in (closure.frame_a, closure.frame_b)]
    moved = [x for x in chain.design_parameters if x.rpartition(".")[0] == ends[1]]
    names += closing_parameters(chain, q, va, aa, random, 1, moved)
    load = {ends[1]: random.normal(size=6), ends[-1]: random.normal(size=6)}
    d = chain.design_derivatives(q, va, aa, names, external_wrenches=load)
    h = 2e-4 * chain.mechanism.length
    nv = chain.model.nv
    for k, name in enumerate(names):
        of_all = differences(chain, q, va, aa, load, ends[1], {name: 1.0}, h)
        expected = of_all[nv : nv + len(chain.motor_names)]
        # Rounding of the differences is 1e-16 / h.
        size = np.abs(chain.compute_torques(q, va, aa, external_wrenches=load)).max()
        assert_allclose(d.torques[:, k], expected, rtol=1e-8, atol=1e-8 * size, err_msg=name)


@pytest.mark.filterwarnings("ignore:.*first moment")  # a mass alone
def test_derivatives_by_masses_are_differences_of_robots_of_other_masses():
    chain = robots.ankle()
    q, va, aa = chain.generic_configuration(), [1.0, -2.0], [3.0, 1.0]
    names = ["rod_left.mass", "ankle_roll.mx", {"motor_left.mz": 1.0, "motor_left.iyy": -0.1}]
    d = chain.design_derivatives(q, va, aa, names)
    theta = chain.dynamic_parameters

    def torques(s, changes):
        values = {name: theta[name] + s * size for name, size in changes.items()}
        return chain.with_parameters(values).compute_torques(q, va, aa)

    for k, group in enumerate([{names[0]: 1.0}, {names[1]: 1.0}, names[2]]):
        expected = derivative(partial(torques, changes=group), 1e-3)
        assert_allclose(d.torques[:, k], expected, rtol=1e-9, atol=1e-12)
    assert not d.q.any()
    assert not d.L.any()


@pytest.mark.parametrize(
    ("robot", "length", "places"),
    [
        (robots.four_bar, "coupler.length", {"coupler_pin.x": 1.0}),
        (robots.four_bar, "crank.length", {"coupler.x": 1.0}),
        (robots.delta, "rod_2*.length", {"end_2a.z": -1.0, "end_2b.z": -1.0}),
    ],
)
def test_a_length_moves_the_end_of_its_link_away_from_the_joint(robot, length, places):
    chain = robot()
    n = chain.degrees_of_freedom
    d = chain.design_derivatives(chain.home, np.ones(n), np.ones(n), [length, places])
    for array in d[1:]:
        assert_allclose(array[..., 0], array[..., 1], atol=1e-12)


@pytest.mark.filterwarnings("ignore:.*first moment")  # a mass alone
def test_with_design_is_the_robot_built_with_other_numbers():
    chain = robots.four_bar()
    q, change = chain.home, {"coupler.length": 0.01, "rocker.rz": 0.1, "crank.mass": 0.2}
    other = chain.with_design(change)
    by_hand = built_with(chain, {"coupler_pin.x": 0.01, "rocker.rz": 0.1})
    by_hand = by_hand.with_parameters({"crank.mass": chain.dynamic_parameters["crank.mass"] + 0.2})
    at = by_hand.assemble(q, fixed=["crank"])
    assert_allclose(other.assemble(q, fixed=["crank"]), at, atol=1e-12)
    assert_allclose(other.compute_torques(at, [1], [2]), by_hand.compute_torques(at, [1], [2]))


def test_no_parameters_have_no_derivatives():
    chain = robots.four_bar()
    d = chain.design_derivatives(chain.home, [1], [0], [])
    assert d.names == ()
    assert (d.q.shape, d.torques.shape, d.L.shape) == ((3, 0), (1, 0), (3, 1, 0))


def test_parameters_that_open_the_loops_alone_are_named_and_close_together():
    chain = robots.four_bar()
    names = ["crank.length", "coupler.z", "rocker.y"]  # both across the plane of the bars
    with pytest.raises(sst_pin.InputError, match=r"coupler.z.* rocker.y alone open the loops"):
        chain.design_derivatives(chain.home, [0], [0], names)
    along_y = chain.model.jointPlacements[1].rotation[1, 2]  # of z of the crank
    group = {"coupler.z": 1.0, "rocker.y": along_y}
    together = chain.design_derivatives(chain.home, [0], [0], [group])
    assert_allclose(together.q, 0, atol=1e-12)


@pytest.mark.parametrize(
    "names",
    [
        *("crank.length", ["crank.width"], ["rod*.length"], [["crank"]]),
        *([3], [None], [{"crank.length": "a"}], [{"crank.length": None}]),
    ],
)
def test_names_that_are_none_are_refused(names):
    chain = robots.four_bar()
    with pytest.raises((sst_pin.UnknownNameError, sst_pin.InputError)):
        chain.design_derivatives(chain.home, [0], [0], names)


@pytest.mark.parametrize(
    "changes",
    ["elbow_1.x", ["elbow_1.x"], ("rod*.length",), None, {"elbow_1.x": None}, {"elbow_1.x": "a"}],
)
def test_changes_are_a_mapping_of_names_to_numbers(changes):
    """A name alone once moved the joint by one metre."""
    with pytest.raises(sst_pin.InputError, match="changes"):
        robots.five_bar().with_design(changes)


def test_changes_beyond_all_measures_are_refused():
    with pytest.raises(sst_pin.SSTError, match="too large"):
        robots.five_bar().with_design({"elbow_1.x": 1e200})


def test_derivatives_by_lengths_of_rods_are_differences_of_robots_with_other_rods():
    """Alone, together, and together with a placement and a mass."""
    rods = [f"elbow_{k} - ball_{k}.length" for k in (1, 2, 3)]
    chain = rod_delta([0.36, 0.37, 0.38])
    assert set(rods) < set(chain.design_parameters)
    q = chain.assemble({"motor_1": 0.2, "motor_2": 0.4, "motor_3": 0.1})
    va, aa = np.array([1.0, -2.0, 0.5]), np.array([3.0, 1.0, -2.0])
    mixed = {rods[0]: -1.0, rods[1]: 0.5, "motor_2.x": 0.3, "slides.mass": 2.0}
    d = chain.design_derivatives(q, va, aa, [rods[2], "*ball*.length", mixed], frame="platform")

    def flat(s, changes):
        """Torques and the position of the platform; the rods are given to the constructor."""
        lengths = 0.36 + 0.01 * np.arange(3) + s * np.array([changes.get(rod, 0.0) for rod in rods])
        other = rod_delta(lengths)
        model = pin.Model(other.model)
        place = model.jointPlacements[model.getJointId("motor_2")]
        place.translation = place.translation + s * changes.get("motor_2.x", 0.0) * np.eye(3)[0]
        model.inertias[1].mass += s * changes.get("slides.mass", 0.0)
        other = other.with_model(model)
        position = other.assemble(q, fixed=chain.coordinates)
        tau = other.compute_torques(position, va, aa)
        return np.append(tau, other.frame_placement(position, "platform")[0])

    groups = [{rods[2]: 1.0}, dict.fromkeys(rods, 1.0), mixed]
    for k, changes in enumerate(groups):
        expected = derivative(lambda s, changes=changes: flat(s, changes), 1e-4)
        actual = np.append(d.torques[:, k], d.pose[:3, k])
        # Rounding of the differences is 1e-16 / 1e-4.
        assert_allclose(actual, expected, atol=1e-9 * np.abs(expected).max())


def test_with_design_changes_lengths_of_rods_and_keeps_brakes():
    chain = rod_delta([0.36] * 3).with_brakes(["motor_1"])
    other = chain.with_design({"elbow_2 - ball_2.length": 1e-3})
    assert [x.distance for x in other.closures[:3]] == pytest.approx([0.36, 0.361, 0.36], rel=1e-15)
    assert other.closures[3:] == chain.closures[3:]
    assert other.degrees_of_freedom == 2
    with pytest.raises(sst_pin.DescriptionError, match="positive"):
        chain.with_design({"elbow_2 - ball_2.length": -1.0})


@pytest.mark.filterwarnings("ignore:.*first moment")  # a first moment alone
def test_the_rank_of_the_actuation_is_that_of_the_torques():
    """Two cables at the axis of a wheel, up to the rounding of a file, move its arm only."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    wheel_placement = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    wheel = model.addJoint(arm, pin.JointModelRY(), wheel_placement, "wheel")
    body = pin.Inertia(2.0, np.array([0.5, 0.0, 0.0]), np.eye(3))
    model.appendBodyToJoint(arm, body, pin.SE3.Identity())
    model.appendBodyToJoint(wheel, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    places = {
        "ceiling_1": (0, [0.5, 0.0, 2.0]),
        "ceiling_2": (0, [1.5, 0.0, 1.0]),
        "end_1": (wheel, [1e-11, 0.0, 0.0]),
        "end_2": (wheel, [0.0, 0.0, 1e-11]),
    }
    for name, (joint, origin) in places.items():
        placement = pin.SE3(np.eye(3), np.array(origin))
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))
    lines = [sst_pin.LineForce(f"ceiling_{k}", f"end_{k}", name=f"cable_{k}") for k in (1, 2)]
    chain = sst_pin.ClosedChain(
        model, [], ["cable_1", "cable_2"], lines=lines, coordinates=["arm", "wheel"]
    )
    q, rest = [0.2, 0.3], [0.0, 0.0]
    d = chain.design_derivatives(q, rest, rest, ["arm.mx"])
    mx = chain.dynamic_parameters["arm.mx"]

    def torques(s):
        return chain.with_parameters({"arm.mx": mx + s}).compute_torques(q, rest, rest)

    assert_allclose(d.torques[:, 0], derivative(torques, 0.1), rtol=1e-9)
