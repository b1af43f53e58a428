# SPDX-License-Identifier: BSD-2-Clause
"""A command that cannot do what it is asked says why in one line, and writes nothing."""

import signal

import numpy as np
import pytest

import sst_pin
from tests.support.command_line import run
from tests.support.files import ROOT

SAMPLE, DELTA = ROOT / "examples" / "figure_eight.csv", ROOT / "examples" / "delta.urdf"
LONG = 300 * "x"

#: By what the error says. Words of a command that hold blanks stand behind a bar.
COMMANDS = [
    ("dance", "no command 'dance'; the commands are paper, torques,"),
    ("torque", "did you mean sst-pin torques?"),
    ("mobility", "did you mean sst-pin validate?"),
    ("run", "did you mean sst-pin simulate?"),
    ("export-c folder", "did you mean sst-pin compile --export-c FOLDER?"),
    (f"{DELTA}", f"did you mean sst-pin validate {DELTA}?"),
    # arguments that are missing, or no numbers
    (f"torques {SAMPLE}", "required: -o/--output"),
    (f"plot {SAMPLE}", "required: -o/--output"),
    ("paper --samples 3", "3 is not from 10 to 10 million"),
    ("show --port 99999", "port 99999: ports end at 65535"),
    (f"plot {SAMPLE} -o a.png --what torques,dance", "'dance'], expected some of path, torques,"),
    (f"plot {SAMPLE} -o a.png --what|", "[''], expected some of"),
    # starts of simulations
    (f"simulate {SAMPLE} -o x.csv", "missing columns tau_gamma_1_Nm"),
    ("simulate tau.csv -o x.csv", "give --va0 gamma_1=.."),
    ("simulate row.csv -o x.csv --q0 gamma_1=0,gamma_2=0,gamma_3=0", "one row; a simulation"),
    (f"simulate tau.csv -o x.csv --robot {DELTA} --q0 motor_1", "the form crank=0.1"),
    (f"simulate tau.csv -o x.csv --robot {DELTA} --q0 wheel=1 --va0 motor_1=0", "motor_1"),
    # files to be read
    ("torques nowhere.csv -o x.csv", "cannot be read: No such file"),
    ("plot one.csv -o a.png", "has one sample; a curve needs at least two"),
    ("plot other.npz -o a.png", "belongs to another robot, with joints crank"),
    (f"plot tau.csv -o x.png --what path --robot {DELTA}", "no column of"),
    (f"torques {SAMPLE} -o x.csv --robot {DELTA}", "no column of motor_1, motor_2, motor_3"),
    (f"torques {LONG}.csv -o x.csv", "File name too long"),
    # robots
    (f"torques {SAMPLE} -o x.csv --robot nowhere.urdf", "the URDF cannot be read"),
    (f"torques {SAMPLE} -o x.csv --robot text.csv", "not a URDF"),
    ("compile --robot nowhere.xml", "nowhere.xml"),
    ("compile --robot delta --precision single", "--precision: only of exported C"),
    ("compile --robot delat", "did you mean delta?"),
    ("compile --robot DELTA", "did you mean delta?"),
    ("paper --robot delta", "delta is not an SST"),
    (f"verify {DELTA}", f"did you mean --robot {DELTA}?"),
    (f"show --robot {DELTA} --ghost {SAMPLE}", "--ghost: only beside a motion"),
    ("torques delta -o m.csv", "did you mean --robot delta?"),
    (f"validate {DELTA} --robot {DELTA}", "give one robot"),
    ("describe -o d --alpha 110,120", "arc_angles: shape (2,), expected (3,)"),
    ("describe -o d --base-directions|1,0,0 0,1,0 a,0,1", "1,0,0 0,1,0 a,0,1'"),
    ("describe -o d --star-mass 0", "star.mass"),
    ("describe -o d --base-radius 1e308", "base_radius: 1e+308 m is outside"),
    ("describe -o d --link-mass 1e308", "not finite"),
    # files to be written
    (f"torques {SAMPLE} -o x.xlsx", "known: .csv, .npz"),
    (f"plot {SAMPLE} -o a.gif", "ending '.gif' unknown; known: .png, .svg, .pdf"),
    (f"torques {SAMPLE} -o there.csv", "use force (--force)"),
    (f"torques {SAMPLE} -o there.csv/out.csv", "cannot be written"),
    (f"torques {SAMPLE} -o folder.csv", "is a folder"),
    (f"torques {SAMPLE} -o {LONG}.csv", "File name too long"),
    (f"compile --export-c {LONG}", "File name too long"),
    (f"torques {SAMPLE} -o device.csv --force", "is a device, not a file"),
]
#: Motion files, line by line, and what the error says.
MOTIONS = [
    (["t_s,qw,qx,qy", "0,1,0,0", "1,1,0,0", "2,1,0,0"], "missing column qz"),
    (["t_s,x", "0,1"], "line 1: the columns do not describe a motion"),
    (["t_s,theta_rad,phi_rad,qw", "0,1,1,1"], "line 1: the columns do not describe a motion"),
    (["t_s,theta_rad,phi_rad", "0,1,1", "1,1,1"], "2 rows; rates need at least three"),
    (
        ["t_s,qw,qx,qy,qz", "0,1,0,0,0", "1,1,1,0,0", "2,1,0,0,0"],
        "line 3: quaternion of length 1.41421",
    ),
    (
        ["t_s,theta_rad,phi_rad,psi_rad", *(f"{t},0,{np.pi / 2},{np.pi / 2}" for t in range(3))],
        "is in the plane of its arc",
    ),
]


@pytest.fixture
def folder(here, robot):
    """Files in the way, and files that are not what they should be."""
    (here / "folder.csv").mkdir()
    (here / "there.csv").write_text("in the way")
    head = "t_s,tau_1_Nm,tau_2_Nm,tau_3_Nm\n0,0,0,0\n"
    (here / "text.csv").write_text("t_s,x\n0,1\n")
    (here / "tau.csv").write_text(f"{head}0.001,0,0,0\n")
    (here / "row.csv").write_text(head)
    (here / "device.csv").symlink_to("/dev/null")
    sst_pin.Trajectory([0, 1], *[np.zeros((2, 1))] * 4, ["crank"], ["crank"]).save("other.npz")
    zero = np.zeros((1, 3))
    robot.trajectory([0], [robot.home], zero, zero, zero).save("one.csv")
    return here


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def require_told(folder, capsys, command, word):
    """One line, and every file as it was; exit code 2, or 1 where `validate` lists errors."""
    before = files(folder)
    words, bar, last = command.partition("|")
    arguments = words.split(" ")
    if bar:
        arguments.append(last)
    code, out, err = run(capsys, *arguments)
    said = err.rpartition("\r")[2]  # after a bar of progress
    if code == 1 and command.startswith("validate"):
        assert (said, "error(s)" in out) == ("", True)
    else:
        assert (code, out) == (2, "")
        assert said.count("\n") == 1
        assert said.startswith("sst-pin")
        assert "error: " in said
        assert word in said
    assert files(folder) == before


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of packages of others
@pytest.mark.parametrize(("command", "word"), COMMANDS)
def test_a_command_says_in_one_line_why_it_does_nothing(folder, capsys, command, word):
    signal.alarm(60)  # one that does not end would end the process
    require_told(folder, capsys, command, word)
    signal.alarm(0)


@pytest.mark.parametrize(("lines", "word"), MOTIONS)
def test_a_bad_motion_gives_one_clear_line(here, capsys, lines, word):
    (here / "bad.csv").write_text("\n".join([*lines, ""]))
    require_told(here, capsys, "torques bad.csv -o out.csv", word)
