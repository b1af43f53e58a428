# SPDX-License-Identifier: BSD-2-Clause
"""The public names and parameters that code outside the package depends on."""

import inspect
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import robots

DATA = Path(__file__).with_name("data")
REFERENCE = json.loads((DATA / "reference.json").read_text(encoding="utf-8"))

CLASSES = {
    sst_pin.ClosedChain: {
        "__init__": "model closures actuated coordinates lines",
        "from_urdf": "",
        "from_mjcf": "",
        "assemble": "fixed",
        "mobility": "",
        "compute_torques": "q va aa weights preload limits out",
        "compute_accelerations": "q va tau out",
        "generalized_forces": "q va aa",
        "noc": "q va",
        "reduced_terms": "q va",
        "frame_placement": "q frame",
        "frame_configuration": "frame position rotation start",
        "frame_jacobian": "q frame",
        "actuator_jacobian": "q",
        "torque_derivatives": "q va aa",
        "acceleration_derivatives": "q va tau",
        "linearize": "q va tau",
        "reactions": "q va aa tau",
        "preload_directions": "q",
        "torque_regressor": "q va aa",
        "with_parameters": "theta",
        "assembly_modes": "positions frame",
        "design_derivatives": "q va aa names frame",
        "simulate": "torque q0 va0 t through_singularities",
        "rollout": "tau q0 va0 dt",
        "check_limits": "motion",
        "compile": "",
        "casadi": "",
        "show": "live",
    },
    sst_pin.SST: {
        "__init__": "parameters",
        "from_urdf": "",
        "inverse_kinematics": "pose branch",
        "forward_kinematics": "gamma",
        "joint_motion": "R omega alpha",
        "platform_orientation": "q",
    },
    sst_pin.LineForce: {"__init__": "frame_a frame_b stiffness rest_length damping preload"},
    sst_pin.Closure: {"__init__": "frame_a frame_b kind"},
}
PROPERTIES = [
    "model",
    "joint_names",
    "motor_indices",
    "motor_names",
    "position_units",
    "lines",
    "home",
    "design_parameters",
    "coordinates",
    "degrees_of_freedom",
    "backend",
]
PROPERTIES += ["dynamic_parameters"]


@pytest.mark.parametrize(
    ("owner", "name", "parameters"),
    [(owner, name, names) for owner, table in CLASSES.items() for name, names in table.items()],
    ids=lambda x: getattr(x, "__name__", str(x)),
)
def test_public_functions_take_the_parameters_of_the_contract(
    owner: type, name: str, parameters: str
) -> None:
    taken = inspect.signature(getattr(owner, name)).parameters
    assert set(parameters.split()) <= taken.keys()


@pytest.mark.parametrize("make", [sst_pin.SST, sst_pin.robots.stewart], ids=["sst", "stewart"])
def test_every_robot_has_the_properties_of_the_contract(make) -> None:
    robot = make()
    assert [name for name in PROPERTIES if not hasattr(robot, name)] == []


FORMER_NAMES = {
    "actuated": "motor_indices",
    "joint_units": "position_units",
    "path": "backend",
    "forces": "lines",
    "check": "check_limits",
}


@pytest.mark.parametrize(("former", "name"), FORMER_NAMES.items())
def test_former_names_of_attributes_work_with_a_warning(former: str, name: str) -> None:
    robot = sst_pin.robots.five_bar()
    with pytest.warns(DeprecationWarning, match=f"^GalleryRobot.{former} is now {name}$") as told:
        value = getattr(robot, former)
    assert np.array_equal(value, getattr(robot, name))
    assert told[0].filename == __file__


def test_former_names_of_arguments_and_results_work_with_a_warning() -> None:
    bar = sst_pin.robots.four_bar()
    spring = sst_pin.LineForce("universe", "platform", stiffness=1.0)
    with pytest.warns(DeprecationWarning, match="^forces= is now lines=$") as told:
        chain = sst_pin.ClosedChain(bar.model, bar.closures, ["crank"], forces=[spring])
    assert told[0].filename == __file__
    assert chain.lines == (spring,)
    with pytest.raises(sst_pin.errors.InputError, match="use lines= alone"):
        sst_pin.ClosedChain(bar.model, bar.closures, ["crank"], forces=[], lines=[spring])
    with pytest.warns(DeprecationWarning, match="Mobility.actuated is now motor_names"):
        assert chain.mobility().actuated == ("crank",)
    arrays = [[0.0, 1.0], [[0.0], [1.0]], [[1.0], [1.0]], [[0.0], [0.0]], [[0.0], [0.0]]]
    with pytest.warns(DeprecationWarning, match="actuated= is now motor_names="):
        motion = sst_pin.Trajectory(*arrays, joint_names=["crank"], actuated=["crank"])
    with pytest.warns(DeprecationWarning, match="Trajectory.actuated is now motor_names"):
        assert motion.actuated == motion.motor_names == ("crank",)


def test_the_inverse_kinematics_of_all_robots_takes_poses() -> None:
    star, delta = sst_pin.SST(), sst_pin.robots.delta()
    position, R = star.frame_placement(star.home, "E")
    poses = [pin.SE3(R, position), pin.SE3(R, position).homogeneous, R]
    for pose in poses:
        assert star.inverse_kinematics(pose=pose) == pytest.approx(star.home, abs=1e-12)
    with pytest.raises(sst_pin.WorkspaceError, match=r"E is 0\.1 m away"):
        star.inverse_kinematics(pin.SE3(R, position + np.array([0.0, 0.0, 0.1])))
    home = delta.platform_pose(delta.home)
    assert delta.inverse_kinematics(pose=home) == pytest.approx(delta.home, abs=1e-12)
    with pytest.warns(DeprecationWarning, match="^R= is now pose=$"):
        star.inverse_kinematics(R=R)


OF_SST = """BRANCHES MJCF_PATH PACKAGE_PATH REPOSITORY_PATH SRDF_PATH YAML_PATH
PlatformMotion RigidBody interpolate_orientations orientation orientation_motion orientation_path"""


@pytest.mark.parametrize("name", OF_SST.split())
def test_names_of_the_sst_work_at_the_top_with_a_warning(name: str) -> None:
    with pytest.warns(
        DeprecationWarning, match=f"^sst_pin.{name} is now sst_pin.sst.{name}$"
    ) as told:
        value = getattr(sst_pin, name)
    assert value is getattr(sst_pin.sst, name)
    assert told[0].filename == __file__


def test_results_of_derivatives_and_reactions_have_the_fields_of_the_contract() -> None:
    robot = sst_pin.robots.five_bar()
    q, rest = robot.home, np.zeros(robot.degrees_of_freedom)
    assert robot.torque_derivatives(q, rest, rest)._fields == ("dq", "dva", "daa")
    assert robot.acceleration_derivatives(q, rest, rest)._fields == ("dq", "dva", "dtau")
    assert hasattr(robot.reactions(q, rest, rest), "determined")
    A, B = robot.linearize(q, rest, rest)
    assert (A.shape, B.shape) == ((4, 4), (4, 2))


def test_the_motion_of_the_paper_and_the_plots_are_public() -> None:
    R, omega, alpha = sst_pin.paper_circle(np.zeros(2))
    assert (R.shape, omega.shape, alpha.shape) == ((2, 3, 3), (2, 3), (2, 3))
    assert "crossings" in inspect.getsource(sst_pin.Trajectory)
    assert set(inspect.signature(sst_pin.plots.motion_page).parameters) >= {"motion"}


def test_assemble_takes_positions_by_name() -> None:
    chain = sst_pin.robots.four_bar()
    (crank,) = chain.coordinates
    q = chain.assemble({crank: 0.3})
    assert q[chain.joint_names.index(crank)] == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize("path", ["reference", "compiled"])
@pytest.mark.parametrize("name", ["sst", "five_bar", "stewart"])
def test_both_paths_give_the_torques_and_accelerations_of_the_reference_data(
    name: str, path: str
) -> None:
    robot = sst_pin.SST() if name == "sst" else getattr(robots, name)()
    if path == "compiled":
        robot.compile()
    joints = [robot.model.joints[robot.model.getJointId(j)] for j in robot.coordinates]
    rates = [joint.idx_v for joint in joints]
    for state in REFERENCE[name]["states"]:
        x = {key: np.array(value, float) for key, value in state.items()}
        va, aa = x["v"][rates], x["dv"][rates]
        # The data have forty digits; rounding of the equations leaves 1e-12 of the largest number.
        tau = robot.compute_torques(x["q"], va, aa)
        assert np.abs(tau - x["torques"]).max() < 1e-12 * np.abs(tau).max()
        aa = robot.compute_accelerations(x["q"], va, x["given_torques"])
        assert np.abs(aa - x["accelerations"]).max() < 1e-11 * np.abs(aa).max()
