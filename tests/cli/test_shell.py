# SPDX-License-Identifier: BSD-2-Clause
"""The command among other programs: pipes, signals, full discs, files that are there."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.files import text_writer, write_files
from tests.support.command_line import run
from tests.support.files import ROOT

SAMPLE = ROOT / "examples" / "figure_eight.csv"
#: theta 20 deg, phi to 170 deg: beta_1 goes from 30 to -80 deg, off its arc.
OFF_ARC = "t_s,theta_deg,phi_deg\n" + "".join(f"{i / 10},20,{60 + 11 * i}\n" for i in range(11))


def start(*arguments, code="from sst_pin.cli import main; raise SystemExit(main())", **options):
    """The command as a process of its own."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment, **(piped | options))


@pytest.mark.parametrize(
    ("command", "written"),
    [
        (("torques", "off.csv", "-o", "out.csv"), "out.csv"),
        (("plot", "off.csv", "-o", "out.png", "--what", "joints"), "out.png"),
        (("show", "off.csv", "--html", "out.html"), "out.html"),
        (("simulate", "tau.csv", "-o", "out.csv"), "out.csv"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_pose_that_the_machine_cannot_take_is_a_warning_and_with_strict_an_error(
    here, capsys, robot, command, written
):
    """One line for each joint; --strict writes nothing and leaves with exit code 1."""
    (here / "off.csv").write_text(OFF_ARC)
    q = robot.inverse_kinematics(sst_pin.sst.orientation(np.radians(20), np.radians(100)))
    zero = np.zeros((2, 3))
    names = robot.joint_names
    still = sst_pin.Trajectory([0, 0.001], [q, q], zero, zero, zero, names, names[::3])
    still.save(here / "tau.csv")
    before = set(here.iterdir())
    code, _, err = run(capsys, *command, "--strict")
    assert code == 1
    assert "sst-pin: error: beta_1 leaves its arc of 0 to 90 deg: -" in err
    assert set(here.iterdir()) == before
    code, _, err = run(capsys, *command)
    assert code == 0
    lines = err.splitlines()
    assert lines[0].startswith("sst-pin: warning: beta_1 leaves its arc of 0 to 90 deg: -")
    assert all(line.startswith("sst-pin: warning: ") for line in lines)
    assert (here / written).exists()


def test_a_motion_on_its_arcs_is_no_matter_for_strict(here, capsys):
    code, _, err = run(capsys, "torques", SAMPLE, "-o", "out.csv", "--strict")
    assert (code, err) == (0, "")


@pytest.mark.parametrize("arguments", [("--help",), ("validate",)])
def test_a_reader_that_has_enough_ends_the_command_in_silence(arguments):
    """`sst-pin validate | head -0`: no traceback."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as full:
        process = start(*arguments, stdout=full)
        _, err = process.communicate(timeout=60)
    assert err == ""
    assert process.returncode == 128 + signal.SIGPIPE


def test_sigterm_leaves_no_temporary_file(here):
    code = (
        "import sys, time; from sst_pin.cli import main; from sst_pin import Trajectory\n"
        "def write(file):\n"
        "    print('writing', flush=True); time.sleep(60)\n"
        "Trajectory.writer = lambda *_: write\n"
        "raise SystemExit(main())"
    )
    process = start("torques", SAMPLE, "-o", "out.csv", code=code)
    assert process.stdout.readline() == "writing\n"
    assert len(list(here.iterdir())) == 1
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (128 + signal.SIGTERM, "")
    assert list(here.iterdir()) == []


def test_links_lead_to_the_file_that_is_written_and_its_mode_stays(here):
    """A shell writes through a link, also through one to nothing, and so does the package."""
    (here / "far").mkdir()
    far, link, dangling = here / "far" / "data.csv", here / "link.csv", here / "dangling.csv"
    far.write_text("old")
    far.chmod(0o640)
    link.symlink_to(far)
    write_files({link: text_writer("new")}, force=True)
    assert link.is_symlink()
    assert far.read_text() == "new"
    assert stat.S_IMODE(far.stat().st_mode) == 0o640
    dangling.symlink_to(here / "new.csv")
    write_files({dangling: text_writer("first")})
    assert dangling.is_symlink()
    assert (here / "new.csv").read_text() == "first"
    names = ["dangling.csv", "data.csv", "far", "link.csv", "new.csv"]
    assert sorted(path.name for path in here.rglob("*")) == names


def test_a_set_of_files_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    """The second content fails, then the second replacement; old files stay, new ones go.

    The error names the file that could not be replaced.
    """

    def fail(file):
        raise OSError(28, "No space left on device")

    old, new = tmp_path / "robot.h", tmp_path / "robot.c"
    old.write_text("old")
    with pytest.raises(sst_pin.OutputError, match="No space left"):
        write_files({old: text_writer("new"), new: fail}, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["robot.h"]
    assert old.read_text() == "old"
    replace = Path.replace

    def second_fails(self, target):
        if Path(target).name == "robot.c" and self.read_text() == "code":
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", second_fails)
    contents = {old: text_writer("new"), new: text_writer("code")}
    contents[tmp_path / "robot.txt"] = text_writer("third")
    with pytest.raises(sst_pin.OutputError, match=r"robot\.c: .*Input/output error"):
        write_files(contents, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["robot.h"]
    assert old.read_text() == "old"


@pytest.mark.parametrize(
    "command",
    [
        f"torques {SAMPLE} -o - >&-",
        "torques - -o torques.csv <&-",
        "robots >&-",
        "--help >&-",
        "robots --help >&-",
        "compile --list >&-",
        "validate four_bar >&-",
    ],
)
def test_a_closed_stream_is_an_error_in_one_line(command, tmp_path):
    code = "from sst_pin.cli import main; raise SystemExit(main())"
    line = f'exec "$0" -c "{code}" {command}'
    done = subprocess.run(
        ["bash", "-c", line, sys.executable],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "Bad file descriptor" in done.stderr


def test_a_command_that_writes_a_file_needs_no_output(tmp_path):
    code = "from sst_pin.cli import main; raise SystemExit(main())"
    line = f'exec "$0" -c "{code}" torques {SAMPLE} -o torques.csv >&-'
    command = ["bash", "-c", line, sys.executable]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 0
    assert (tmp_path / "torques.csv").stat().st_size > 100


def test_messages_are_not_mixed_with_the_result_if_standard_error_is_closed(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    assert main(["torques", "no_such_file.csv", "-o", "-"]) == 2
    assert capsys.readouterr().out == ""
