# SPDX-License-Identifier: BSD-2-Clause
"""`check_limits` finds what leaves its limits; the limits of files come along."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin

BOOM = """<robot name="r"><link name="base"/><link name="boom"><inertial><origin xyz="0.5 0 0"/>
<mass value="100"/><inertia ixx="1" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="boom"/><axis xyz="0 -1 0"/>
<limit lower="-0.5" upper="1" effort="0" velocity="{velocity}"/></joint>
<joint name="f" type="fixed"><parent link="base"/><child link="foot"/><origin xyz="0.4 0 -0.6"/>
</joint><link name="foot"/>
<joint name="e" type="fixed"><parent link="boom"/><child link="eye"/><origin xyz="0.4 0 0"/></joint>
<link name="eye"/></robot>"""
CUTS = "name_mot: [ram]\nline_force: [{{name: ram, frames: [foot, eye]{}}}]\n"


def boom(folder, limits: str = "", velocity: float = 0.0) -> sst_pin.ClosedChain:
    path = folder / "boom.urdf"
    path.write_text(BOOM.format(velocity=velocity))
    path.with_suffix(".yaml").write_text(CUTS.format(limits))
    return sst_pin.ClosedChain.from_urdf(path)


def motion_of(chain: sst_pin.ClosedChain) -> sst_pin.Trajectory:
    """From level to 0.5 rad at 0.5 rad/s."""
    t = np.linspace(0, 1, 11)
    rates = np.full((11, 1), 0.5)
    return chain.trajectory(t, 0.5 * t[:, None], rates, np.zeros((11, 1)))


def ram_at(angle: float) -> tuple[float, float]:
    """Length of the cylinder and its lever arm about the hinge, by plane geometry."""
    eye, foot = 0.4 * np.array([np.cos(angle), np.sin(angle)]), np.array([0.4, -0.6])
    along = (eye - foot) / np.linalg.norm(eye - foot)
    return float(np.linalg.norm(eye - foot)), float(eye[0] * along[1] - eye[1] * along[0])


@pytest.mark.parametrize(
    ("limits", "velocity", "problem", "value"),
    [
        ("", 0.0, "", 0.0),
        (", upper: 0.7", 0.0, "ram leaves its lengths of 0 to 0.7 m", ram_at(0.5)[0]),
        (", lower: 0.65", 0.0, "ram leaves its lengths of 0.65 to inf m", ram_at(0)[0]),
        (", effort: 1000", 0.0, "ram leaves its efforts of -1000 to 1000 N", 490.5 / ram_at(0)[1]),
        (", velocity: 0.15", 0.0, "ram leaves its velocities", 0.5 * ram_at(0)[1]),
        ("", 0.4, "hinge leaves its velocities of -0.4 to 0.4 rad/s", 0.5),
    ],
)
def test_each_limit_that_a_motion_leaves_is_a_finding(tmp_path, limits, velocity, problem, value):
    """Lengths, forces and rates against those of plane geometry."""
    chain = boom(tmp_path, limits, velocity)
    findings = chain.check_limits(motion_of(chain))
    assert len(findings) == bool(problem)
    for finding in findings:
        assert problem in finding.problem
        low, high = finding.limits
        worst = np.maximum(low - finding.values, finding.values - high).argmax()
        assert finding.values[worst] == pytest.approx(value, rel=1e-9)


def test_forces_of_motors_on_joints_are_judged_with_their_tendons(tmp_path):
    """A motor of 10 N m with a factor of 3 drives a joint that carries 40 N m."""
    path = tmp_path / "boom.urdf"
    path.write_text(BOOM.format(velocity=0).replace('effort="0"', 'effort="40"'))
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=[{"belt": {"hinge": 3.0}}])
    t, zero = np.array([0.0, 1.0]), np.zeros((2, 1))
    for tau, count in ((10.0, 0), (20.0, 1)):
        motion = sst_pin.Trajectory(
            t, zero, zero, zero, np.full((2, 1), tau), ["hinge"], ["belt"], coordinates=["hinge"]
        )
        findings = chain.check_limits(motion)
        assert len(findings) == count
    assert "hinge leaves its efforts of -40 to 40 N m: 60 N m" in str(findings[0])


def test_limits_of_lines_and_motors_come_over_in_an_mjcf(tmp_path):
    chain = boom(tmp_path, ", lower: 0.5, upper: 0.9, effort: 2000")
    sst_pin.write_mjcf(chain, tmp_path / "boom.xml")
    (line,) = sst_pin.ClosedChain.from_mjcf(tmp_path / "boom.xml").lines
    assert (line.lower, line.upper, line.effort) == (0.5, 0.9, 2000.0)
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "boom.xml"))
    assert mj.tendon_range[mj.tendon("ram").id].tolist() == [0.5, 0.9]


MOTORS = """<mujoco><worldbody><body name="a"><joint name="a"{}/><geom size=".1"/></body>
</worldbody><actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("of_joint", "actuators", "effort"),
    [
        ("", '<motor joint="a"/>', np.inf),
        ("", '<motor joint="a" ctrlrange="-2 2" gear="-5"/>', 10.0),
        ("", '<motor joint="a" ctrlrange="-1 2"/>', 2.0),
        ("", '<position joint="a" kp="9" ctrlrange="-1 1"/>', np.inf),
        ("", '<position joint="a" kp="9" ctrlrange="-1 1" forcerange="-7 7" gear="2"/>', 14.0),
        (' actuatorfrcrange="-3 3"', '<motor joint="a" ctrlrange="-5 5"/>', 3.0),
        ("", '<motor joint="a" ctrlrange="-5 5"/><motor joint="a" ctrlrange="-1 1"/>', 6.0),
        ("", '<general joint="a" gainprm="4" ctrlrange="-1 1"/>', 4.0),
    ],
)
@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
def test_the_largest_force_of_a_motor_is_that_of_mujoco(tmp_path, of_joint, actuators, effort):
    """Against MuJoCo's force in the joint for the largest and smallest controls."""
    path = tmp_path / "r.xml"
    path.write_text(MOTORS.format(of_joint, actuators))
    limit = sst_pin.ClosedChain.from_mjcf(path).model.effortLimit[0]
    assert (limit if limit < 1e300 else np.inf) == effort
    mj = mujoco.MjModel.from_xml_path(str(path))
    if np.isfinite(effort):
        data, forces = mujoco.MjData(mj), []
        for control in (-1e6, 1e6):
            for q in (-1e6, 0.0, 1e6):
                data.qpos[:], data.ctrl[:] = q, control
                mujoco.mj_forward(mj, data)
                forces.append(abs(data.qfrc_actuator[0]))
        assert max(forces) == pytest.approx(effort)


@pytest.mark.parametrize(
    ("of_joint", "actuators", "text"),
    [
        ("", '<motor joint="a" ctrlrange="-1 2"/>', "-1 to 2; 2 is used for both directions"),
        (' actuatorfrcrange="-5 3"', "", "-5 to 3; 5 is used for both directions"),
        (' actuatorfrcrange="-5 3"', '<motor joint="a" ctrlrange="-2 2"/>', ""),
    ],
    ids=["of a motor", "of a joint", "of a joint with a motor of a smaller range"],
)
def test_a_range_that_is_used_and_not_symmetric_is_named(tmp_path, of_joint, actuators, text):
    path = tmp_path / "r.xml"
    path.write_text(MOTORS.format(of_joint, actuators))
    notes = [problem.text for problem in sst_pin.validate(path) if "directions" in problem.text]
    assert notes == ([f"joint a: its force is limited to {text}"] if text else [])


def test_a_limit_of_a_fixed_tendon_is_named_once_as_not_used(tmp_path):
    tendon = '<tendon><fixed name="belt"><joint joint="a" coef="1"/></fixed></tendon>'
    path = tmp_path / "r.xml"
    motors = MOTORS.format("", '<motor tendon="belt" ctrlrange="-1 2"/>')
    path.write_text(motors.replace("</mujoco>", f"{tendon}</mujoco>"))
    notes = [problem.text for problem in sst_pin.validate(path) if "belt" in problem.text]
    text = "the limit 2 of its motor is not used: it acts on several joints"
    assert notes == [f"tendon belt: {text}"]


@pytest.mark.parametrize(
    ("limits", "problem"),
    [
        ({"lower": 0.5, "upper": 0.4}, "lower of line a-b: 0.5 is above the upper limit 0.4"),
        ({"effort": np.zeros(2)}, "effort of line a-b: shape"),
        ({"effort": -1}, "effort of line a-b: -1 is negative"),
        ({"velocity": np.nan}, "velocity of line a-b"),
        ({"lower": np.inf}, "lower of line a-b"),
    ],
)
def test_limits_of_a_line_that_cannot_be_meant_are_refused(limits, problem):
    with pytest.raises(sst_pin.InputError, match=problem):
        sst_pin.LineForce("a", "b", **limits)


def test_efforts_of_joints_on_one_belt_come_over_in_an_mjcf(tmp_path):
    path = tmp_path / "boom.urdf"
    path.write_text(BOOM.format(velocity=0).replace('effort="0"', 'effort="40"'))
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["hinge"])
    model = chain.model
    inertia = model.inertias[1]
    arm = model.addJoint(1, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, inertia, pin.SE3.Identity())
    model.effortLimit[:] = [40, 7]
    two = sst_pin.ClosedChain(model, [], [{"belt": {"hinge": 1.0, "arm": -2.0}}, "arm"])
    sst_pin.write_mjcf(two, tmp_path / "two.xml")
    again = sst_pin.ClosedChain.from_mjcf(tmp_path / "two.xml")
    assert again.model.effortLimit.tolist() == [40, 7]
    assert again.motor_names == ("belt", "arm")
