# SPDX-License-Identifier: BSD-2-Clause
"""From the log of a motion to the dynamic parameters."""

import re

import numpy as np
import pytest

import sst_pin
from tests.support.command_line import run
from tests.support.files import ROOT

DELTA = ROOT / "examples" / "delta.urdf"


@pytest.fixture(scope="module")
def five_bar():
    """A robot with a spring, whose stiffness is among the parameters."""
    plain, rest = sst_pin.robots.five_bar(), {"stiffness": 5.0, "rest_length": 0.1}
    spring = sst_pin.LineForce("universe", "platform", name="spring", **rest)
    return sst_pin.ClosedChain(plain.model, plain.closures, plain.motor_names, lines=[spring])


@pytest.fixture(scope="module")
def measured(five_bar):
    """Times, positions and noisy torques: friction in the left motor, a stiffer spring."""
    true = five_bar.with_parameters({"shoulder_1.viscous": 0.2, "spring.stiffness": 6.0})
    t = np.linspace(0, 4, 201)
    phase = np.outer(t, [3, 4]) + np.sin(np.outer(t, [1, 2]))
    home = five_bar.generic_configuration()
    x = home[[0, 2]] + np.array([0.3, 0.2]) * np.sin(phase)
    tau = np.array(sst_pin.coordinate_motion(true, t, x, home).tau)
    tau += 0.001 * np.random.default_rng(0).normal(size=tau.shape)
    return np.column_stack([t, x, tau])


@pytest.fixture
def log(here, measured):
    head = "t_s,shoulder_1_rad,shoulder_2_rad,tau_shoulder_1_Nm,tau_shoulder_2_Nm"
    np.savetxt(here / "log.csv", measured, "%.9g", ",", header=head, comments="")
    return here / "log.csv"


def test_a_report_has_the_parameters_of_the_robot_and_the_errors_of_unseen_samples(
    five_bar, log, capsys
):
    sst_pin.write_mjcf(five_bar, "robot.xml")
    options = "--robot", "robot.xml", "--cutoff", 10
    code, out, _ = run(capsys, "identify", log, "-o", "report.md", *options)
    assert code == 0
    assert "report.md" in out
    lines = (log.parent / "report.md").read_text().splitlines()
    for name, value in (("shoulder_1.viscous", 0.2), ("spring.stiffness", 6.0)):
        (row,) = [line.split("|") for line in lines if line.startswith(f"| {name} |")]
        assert float(row[2]) == pytest.approx(value, abs=float(row[3]))
        assert not row[4].strip()
    (motor,) = [line.split("|") for line in lines if line.startswith("| shoulder_1 |")]
    assert float(motor[4]) < 0.03  # of the torque, in the third that was kept apart
    assert lines[-1].endswith("(<report_torques.png>)")
    assert (log.parent / "report_torques.png").read_bytes().startswith(b"\x89PNG")
    options = "--robot", "five_bar", "--cutoff", 10, "--robust", "--decimate", 2
    code, out, _ = run(capsys, "identify", log, "-o", "-", *options)
    assert code == 0
    assert out.startswith("# Dynamic parameters of five_bar")


def test_it_says_which_parameters_are_supported_and_takes_known_masses(log, capsys):
    """The names of its advice, as it gives them, are the parameters of the next estimate."""
    call = "identify", log, "-o", "-", "--robot", "five_bar", "--cutoff", 10
    code, out, error = run(capsys, *call, "--masses", "elbow_1=0.3")
    assert code == 0, error
    assert "elbow_1.mass" not in out
    (advice,) = [line for line in error.splitlines() if "--which" in line]
    names = advice.split()[-1]
    code, out, error = run(capsys, *call, "--masses", "elbow_1=0.3", "--which", names)
    assert code == 0, error
    assert len(names.split(",")) < 10
    assert f"{len(names.split(','))} combinations of {len(names.split(','))} parameters" in out
    code, _, error = run(capsys, *call, "--masses", "elbow=0.3")
    assert code == 2
    assert "elbow_1.mass" in error


def test_with_known_masses_which_takes_brackets_and_refuses_unknown_names(log, capsys):
    five_bar = sst_pin.robots.five_bar()
    model = five_bar.model
    model.names[model.getJointId("elbow_1")] = "elbow[1]"
    named = sst_pin.ClosedChain(model, five_bar.closures, five_bar.motor_names)
    sst_pin.write_mjcf(named, "robot.xml")
    call = "identify", log, "-o", "-", "--robot", "robot.xml", "--cutoff", 10
    call = *call, "--masses", "elbow_2=0.3", "--which"
    code, out, error = run(capsys, *call, "elbow[1].mx,shoulder_1.viscous")
    assert code == 0, error
    assert "elbow[1].mx" in out
    code, _, error = run(capsys, *call, "shoulder_1.viscous,elbow_1.mx")
    assert code == 2
    assert "elbow_1.mx" in error


def test_where_no_combination_is_supported_fewer_parameters_may_be(measured, log, capsys):
    noisy = measured.copy()
    noisy[:, 3:] += np.random.default_rng(1).normal(scale=100, size=(len(noisy), 2))
    head = log.read_text().splitlines()[0]
    np.savetxt(log, noisy, "%.9g", ",", header=head, comments="")
    call = "identify", log, "-o", "-", "--robot", "five_bar", "--cutoff", 10
    code, _, error = run(capsys, *call, "--which", "*.viscous")
    assert code == 0, error
    assert re.search("no combination is supported.* or fewer parameters by --which", error)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
def test_the_urdf_gets_the_parameters_found(here, capsys):
    delta = sst_pin.ClosedChain.from_urdf(DELTA)
    true = delta.with_parameters({"motor_1.viscous": 0.2, "motor_3.viscous": 0.1})
    t = np.linspace(0, 4, 401)
    x = 0.2 + np.array([0.3, 0.2, 0.1]) * np.sin(np.outer(t, [3, 4, 5]))
    tau = np.array(sst_pin.coordinate_motion(true, t, x).tau)
    head = [f"{name}_rad" for name in delta.coordinates]
    head += [f"tau_{name}_Nm" for name in delta.coordinates]
    table = np.column_stack([t, x, tau])
    np.savetxt(here / "log.csv", table, "%.9g", ",", header=",".join(["t_s", *head]), comments="")
    options = "--cutoff", 20, "--which", "motor_*.viscous", "--urdf", "found.urdf"
    options += ("--robot",)
    code, _, error = run(capsys, "identify", "log.csv", "-o", "report.md", *options, DELTA)
    assert code == 0, error
    result = sst_pin.ClosedChain.from_urdf(here / "found.urdf").dynamic_parameters
    assert result["motor_1.viscous"] == pytest.approx(0.2, abs=0.01)
    assert result["motor_3.viscous"] == pytest.approx(0.1, abs=0.01)
    assert result["motor_2.mx"] == pytest.approx(delta.dynamic_parameters["motor_2.mx"], rel=1e-12)
    code, _, error = run(capsys, "identify", "log.csv", "-o", "r.md", *options, "delta")
    assert code == 2
    assert "needed: a URDF" in error
    # Closures and named configurations go with the URDF from wherever they are read.
    folder = here / "package" / "urdf"
    folder.mkdir(parents=True)
    (folder / "delta.urdf").write_text(DELTA.read_text())
    text = DELTA.with_suffix(".yaml").read_text()
    (folder.parent / "loop_closures.yaml").write_text(text)
    group = '<group_state name="home" group="all"><joint name="motor_1" value="0.3"/></group_state>'
    (folder / "delta.srdf").write_text(f'<robot name="delta">{group}</robot>')
    robot = folder / "delta.urdf"
    code, _, error = run(
        capsys, "identify", "log.csv", "-o", "report.md", "--force", *options, robot
    )
    assert code == 0, error
    again = sst_pin.ClosedChain.from_urdf(here / "found.urdf")
    assert again.closures == delta.closures
    assert 0.3 in again.model.referenceConfigurations["home"]


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("identify log.csv -o log.csv --force", "log.csv: ending '.csv' unknown; known: .md"),
        ("identify log.csv -o r.md --urdf r.md", "r.md: ending '.md' unknown; known: .urdf"),
    ],
)
def test_no_output_takes_the_name_of_another_kind_of_file(log, capsys, command, told):
    before = {path: path.read_bytes() for path in log.parent.iterdir()}
    code, _, error = run(capsys, *command.split(), "--robot", DELTA, "--cutoff", 10)
    assert code == 2
    assert told in error
    assert {path: path.read_bytes() for path in log.parent.iterdir()} == before


@pytest.mark.parametrize(
    ("change", "columns", "told"),
    [
        ("--cutoff 30", 5, "cutoff"),
        ("--cutoff 0", 5, "cutoff"),
        ("--cutoff 10 --which none", 5, "none"),
        ("--cutoff 10", 3, "tau"),  # the log holds no torques
    ],
)
def test_what_cannot_be_identified_is_told_in_one_line(log, capsys, change, columns, told):
    rows = log.read_text().splitlines()
    log.write_text("\n".join(",".join(row.split(",")[:columns]) for row in rows))
    options = "-o", "r.md", "--robot", "five_bar", *change.split()
    code, _, error = run(capsys, "identify", log, *options)
    assert code == 2
    assert told in error
    assert error.count("\n") == 1
