# SPDX-License-Identifier: BSD-2-Clause
"""`torques`, `simulate` and `plot` of any robot; standard input and output."""

import io
import subprocess
import sys

import numpy as np
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.cli.commands import COMMANDS as COMMANDS_OF_THE_HELP
from sst_pin.cli.parser import hint_for_robot
from sst_pin.errors import install_command
from tests.support.command_line import run
from tests.support.files import ROOT

DELTA = ROOT / "examples" / "delta.urdf"
SAMPLE = ROOT / "examples" / "figure_eight.csv"


def test_torques_of_a_delta_lead_back_to_its_motion(here, capsys):
    """URDF and YAML: coordinates to torques, torques to the motion, both to a figure."""
    t = np.linspace(0, 1, 41)
    motors = 20 + 10 * np.sin(6 * t[:, None] + np.arange(3))
    motors[:, 2] = np.radians(motors[:, 2])
    head = "t_s,motor_1_deg,motor_2_deg,motor_3_rad"
    np.savetxt("m.csv", np.column_stack([t, motors]), "%.17g", ",", header=head, comments="")
    robot = ("--robot", DELTA)
    code, out, err = run(capsys, "torques", "m.csv", "-o", "tau.csv", *robot)
    assert code == 0
    assert err == ""
    assert "41 samples, peak torques " in out
    assert "starts at motor_1 " in out
    assert run(capsys, "simulate", "tau.csv", "-o", "back.csv", *robot)[0] == 0
    wanted, motion = (sst_pin.Trajectory.load(name) for name in ("tau.csv", "back.csv"))
    # Torques by splines through samples every 25 ms, over a second.
    assert np.abs(motion.q - wanted.q).max() < 1e-3
    code, out, _ = run(capsys, "plot", "back.csv", "-o", "p.svg", "--what", "torques", *robot)
    assert (code, out) == (0, "torques of 41 samples -> p.svg\n")
    assert b"motor torque (N m)" in (here / "p.svg").read_bytes()


def test_an_mjcf_with_a_motor_that_pushes(here, capsys):
    """Written by `describe`, read by `torques`: millimetres in, newtons out."""
    pytest.importorskip("mujoco")
    assert run(capsys, "describe", "--robot", "scissor_lift", "-o", "lift.xml")[0] == 0
    t = np.linspace(0, 1, 41)
    stroke = np.column_stack([t, 800 + 10 * np.sin(6 * t)])
    np.savetxt("m.csv", stroke, "%.17g", ",", header="t_s,slider_mm", comments="")
    code, out, _ = run(capsys, "torques", "m.csv", "-o", "f.csv", "--robot", "lift.xml")
    assert code == 0
    assert " N -> f.csv" in out
    motion = sst_pin.Trajectory.load("f.csv")
    assert motion.torque_units == ("N",)
    slider = motion.q[:, motion.joint_names.index("slider")]
    assert np.ptp(slider) == pytest.approx(0.02, rel=1e-2)


def test_a_simulation_starts_at_named_joints(here, capsys):
    (here / "tau.csv").write_text("t_s,tau_1_Nm,tau_2_Nm,tau_3_Nm\n0,0,0,0\n0.001,0,0,0\n")
    start = ("--q0", "motor_1=0.3,motor_2=0.4,motor_3=0.3", "--va0", "motor_2=-1")
    arguments = ("tau.csv", "-o", "m.csv", "--robot", DELTA)
    assert run(capsys, "simulate", *arguments, *start)[0] == 0
    motion = sst_pin.Trajectory.load("m.csv")
    assert motion.va[0].tolist() == [0, -1, 0]
    assert motion.q[0][motion.joint_names.index("motor_2")] == 0.4


def through(capsysbinary, monkeypatch, data, *arguments):
    """A command that reads bytes: exit code, bytes, text of errors."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    code = main([str(a) for a in arguments])
    out, err = capsysbinary.readouterr()
    return code, out, err.decode()


def test_a_pipe_of_commands(here, capsysbinary, monkeypatch):
    """`torques - -o -` into `simulate - -o -` into `plot - -o -`."""
    pipe = (capsysbinary, monkeypatch)
    code, torques, err = through(*pipe, SAMPLE.read_bytes(), "torques", "-", "-o", "-")
    assert code == 0
    assert "201 samples, peak torques" in err
    main(["torques", str(SAMPLE), "-o", "file.csv"])
    capsysbinary.readouterr()
    assert torques == (here / "file.csv").read_bytes()
    short = b"\n".join(torques.splitlines()[:30]) + b"\n"
    code, motion, _ = through(*pipe, short, "simulate", "-", "-o", "-")
    assert code == 0
    code, figure, err = through(*pipe, motion, "plot", "-", "-o", "-", "--what", "torques")
    assert (code, err) == (0, "torques of 29 samples -> -\n")
    assert figure[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("command", ["", *(command.name for command in COMMANDS_OF_THE_HELP)])
def test_the_help_of_a_command_fits_on_a_screen(capsys, command):
    code, out, _ = run(capsys, *command.split(), "--help")
    assert code == 0
    assert out.startswith(f"usage: sst-pin {command or 'COMMAND'}")
    assert len(out.splitlines()) <= 24
    assert max(map(len, out.splitlines())) <= 80


def test_the_bare_command_shows_its_help_and_waits_for_no_package():
    """Whoever asks what there is does not wait for Pinocchio."""
    code = "import sys; from sst_pin.cli import main; main([]); "
    code += "print({'pinocchio', 'numpy', 'scipy'} & sys.modules.keys(), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("usage: sst-pin ")
    assert all(word in done.stdout for word in ("torques", "simulate", "plot", "show", "validate"))
    assert done.stderr == "set()\n"


def test_robots_lists_what_robot_takes(capsys):
    code, out, _ = run(capsys, "robots")
    names = [line.split()[0] for line in out.splitlines()]
    assert code == 0
    assert names == ["sst", *(name for name in sst_pin.robots.__all__ if name.islower())]


def test_describe_writes_any_robot_as_a_closed_mjcf(here, capsys):
    """Of an SST with the options; a folder, or options, of another robot are refused."""
    pytest.importorskip("mujoco")
    code, out, _ = run(capsys, "describe", "--robot", DELTA, "-o", "delta.xml")
    assert (code, out) == (0, "delta with closed loops -> delta.xml\n")
    chain = sst_pin.ClosedChain.from_urdf(DELTA)
    again = sst_pin.ClosedChain.from_mjcf("delta.xml")
    assert (again.degrees_of_freedom, again.motor_names) == (3, chain.motor_names)
    assert run(capsys, "describe", "-o", "sst.xml", "--gravity", "0,0,-2")[0] == 0
    assert sst_pin.ClosedChain.from_mjcf("sst.xml").model.gravity.linear[2] == -2
    for arguments, words in (
        ("describe --robot delta -o folder", "-o FILE.xml writes an MJCF"),
        ("describe --robot delta -o other.xml --alpha 90,90,90", "not an SST"),
    ):
        code, _, err = run(capsys, *arguments.split())
        assert (code, words in err) == (2, True)


def test_all_missing_extras_are_named_at_once(here, capsys, monkeypatch):
    """`describe` needs two."""
    for name in ("matplotlib", "trimesh"):
        monkeypatch.setitem(sys.modules, name, None)
    code, _, err = run(capsys, "describe", "-o", "d")
    assert code == 2
    assert f"trimesh, matplotlib are not installed; run: {install_command('mesh,plot')}" in err


LINK = "<link name='{0}'><inertial><mass>1</mass></inertial></link>"
JOINT = (
    "<joint name='{0}_j' type='revolute'><parent>world</parent><child>{0}</child>"
    "<axis><xyz>0 1 0</xyz></axis></joint>"
)


def test_a_model_of_an_sdf_world_is_chosen(here, capsys):
    models = "".join(
        f"<model name='{name}'>{LINK.format(name)}{JOINT.format(name)}</model>" for name in "rs"
    )
    world = f"<sdf version='1.9'><world name='w'>{models}</world></sdf>"
    (here / "w.sdf").write_text(world, encoding="utf-8")
    code, out, _ = run(capsys, "validate", "w.sdf")
    assert code == 1
    assert "--model in the shell" in out
    code, out, _ = run(capsys, "validate", "w.sdf", "--model", "s")
    assert code == 0
    assert "s_j" in out
    assert "r_j" not in out
    for robot in (("--robot", "delta"), ()):
        code, _, err = run(capsys, "verify", *robot, "--model", "s")
        assert code == 2
        assert "--model: only for an SDF" in err


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        ("torques foo.urdf --strict", "; did you mean --robot foo.urdf?"),
        ("torques foo.csv --robot foo.urdf", ""),
        ("torques foo.csv --robot=foo.urdf", ""),
        ("describe -o foo.xml", ""),
    ],
)
def test_the_hint_names_an_argument_not_an_option_or_its_value(words, hint):
    assert hint_for_robot(words.split()) == hint
