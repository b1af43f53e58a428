# SPDX-License-Identifier: BSD-2-Clause
"""From the log of a motion to the dynamic parameters."""

from pathlib import Path

import numpy as np
import pytest

import sst_pin
from tests.support.command_line import run

DELTA = Path(__file__).parents[2] / "examples" / "delta.urdf"
CHAIN = sst_pin.robots.five_bar()


@pytest.fixture(scope="module")
def measured():
    """Times, positions and noisy torques of a robot with friction in its left motor."""
    true = CHAIN.with_parameters({"shoulder_1.viscous": 0.2})
    t = np.linspace(0, 6, 301)
    phase = np.outer(t, [3, 4]) + np.sin(np.outer(t, [1, 2]))
    x = np.array(CHAIN.home)[[0, 2]] + np.array([0.3, 0.2]) * np.sin(phase)
    tau = np.array(sst_pin.coordinate_motion(true, t, x).tau)
    tau += 0.002 * np.random.default_rng(0).normal(size=tau.shape)
    return np.column_stack([t, x, tau])


@pytest.fixture
def log(here, measured):
    head = "t_s,shoulder_1_rad,shoulder_2_rad,tau_shoulder_1_Nm,tau_shoulder_2_Nm"
    np.savetxt(here / "log.csv", measured, "%.9g", ",", header=head, comments="")
    return here / "log.csv"


def test_a_report_has_the_friction_of_the_robot_and_the_errors_of_unseen_samples(log, capsys):
    arguments = "--robot", "five_bar", "--cutoff", 10
    code, out, _ = run(capsys, "identify", log, "-o", "report.md", *arguments)
    assert code == 0
    assert "report.md" in out
    lines = (log.parent / "report.md").read_text().splitlines()
    (row,) = [line.split("|") for line in lines if line.startswith("| shoulder_1.viscous |")]
    assert float(row[2]) == pytest.approx(0.2, abs=float(row[3]))
    assert not row[4].strip()
    (motor,) = [line.split("|") for line in lines if line.startswith("| shoulder_1 |")]
    assert float(motor[4]) < 0.03  # of the torque, in the third that was kept apart
    assert lines[-1].endswith("(<report_torques.png>)")
    assert (log.parent / "report_torques.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = run(capsys, "identify", log, "-o", "-", "--robust", "--decimate", 2, *arguments)
    assert code == 0
    assert out.startswith("# Dynamic parameters of five_bar")


@pytest.mark.slow
def test_intervals_have_the_dry_friction_of_the_robot(here, capsys):
    """Torques and regressor pass the same filter; lines are among the parameters."""
    spring = sst_pin.LineForce(
        "universe", "platform", stiffness=5.0, rest_length=0.1, name="spring"
    )
    model = CHAIN.model
    drawn = sst_pin.ClosedChain(model, CHAIN.closures, CHAIN.motor_names, forces=[spring])
    words = {"viscous": 0.05, "coulomb": 0.1}
    real = {f"{m}.{word}": x for m in CHAIN.motor_names for word, x in words.items()}
    true = drawn.with_parameters(real | {"spring.stiffness": 6.0, "spring.damping": 0.2})
    t = np.arange(0, 6, 0.01)
    phase = np.outer(t, [3, 4]) + np.sin(np.outer(t, [1, 2]))
    x = np.array(CHAIN.home)[[0, 2]] + np.array([0.3, 0.2]) * np.sin(phase)
    motion = sst_pin.coordinate_motion(true, t, x, CHAIN.home)
    tau = motion.tau + 0.01 * np.random.default_rng(0).normal(size=motion.tau.shape)
    head = ["t_s", *(f"{m}_rad" for m in CHAIN.motor_names)]
    head += [f"tau_{m}_Nm" for m in CHAIN.motor_names]
    table = np.column_stack([t, x, tau])
    np.savetxt(here / "log.csv", table, "%.9g", ",", header=",".join(head), comments="")
    sst_pin.write_mjcf(drawn, here / "robot.xml")
    options = "--robot", "robot.xml", "--cutoff", 8, "-o", "-"
    code, out, error = run(capsys, "identify", "log.csv", *options)
    assert code == 0, error
    base = sst_pin.identification.base_parameters(
        drawn, ["*.m*", "*.i*", "*.viscous", "*.coulomb", "spring.*"]
    )
    values = dict(zip(base.names, base.matrix @ true.dynamic_parameters, strict=True))
    rows = [line.split("|") for line in out.splitlines() if line.count("|") == 5]
    shown = {row[1].strip(): row for row in rows if row[1].strip() in values}
    assert {"spring.stiffness", "spring.damping", "shoulder_1.coulomb"} <= shown.keys()
    away = [abs(float(row[2]) - values[name]) / float(row[3]) for name, row in shown.items()]
    assert len(away) >= 12
    assert max(away) < 1.2  # of three standard deviations, of which so many values may use more


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
