# SPDX-License-Identifier: BSD-2-Clause
"""The SST exported as C: what holds for any robot is in tests/compiled/test_export_any.py."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.description import urdf_of
from sst_pin.verification.sampling import random_parameters, random_states

pytest.importorskip("casadi", reason="the generator computes with CasADi's expressions")
compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
with_compiler = pytest.mark.skipif(not compiler, reason="needs a C compiler")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


def build(folder):
    """The example, compiled under all warnings."""
    command = [compiler, *STRICT, "-O2", "-o", "torques", "main.c", "robot.c"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "torques"


@with_compiler
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_exported_c_computes_the_torques_of_python(tmp_path, seed):
    """The paper's robot and odd ones, compiled alone under all warnings: 1e-12 relative."""
    arguments = ["export-c", str(tmp_path / "c")]
    robot = sst_pin.SST()
    if seed is not None:
        parameters = random_parameters(np.random.default_rng(seed))
        (tmp_path / "mine.urdf").write_text(urdf_of(parameters))
        robot = sst_pin.SST.from_urdf(tmp_path / "mine.urdf")
        arguments += ["--robot", str(tmp_path / "mine.urdf")]
    assert main(arguments) == 0
    program = build(tmp_path / "c")
    motion = robot.joint_motion(*random_states(robot, np.random.default_rng(2), 20))
    lines = "\n".join(" ".join(map(repr, row.tolist())) for row in np.hstack(motion))
    result = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    tau = np.array([line.split() for line in result.stdout.splitlines()], dtype=float)
    expected = robot.compute_torques(*motion)
    assert np.abs(tau - expected).max() < 1e-12 * np.abs(expected).max()
    motion[0][0, 1] += 1e-3
    opened = " ".join(map(repr, np.hstack(motion)[0].tolist()))
    result = subprocess.run([program], input=opened, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert "the loops are open" in result.stderr


@with_compiler
def test_the_exported_example_tells_what_it_cannot_compute(tmp_path):
    """Exit code 1, a message and no torques: never nan for nan, never half of the input."""
    assert main(["export-c", str(tmp_path)]) == 0
    program = build(tmp_path)
    good = [*sst_pin.SST().home.tolist(), *[0.0] * 6]

    def run(words):
        return subprocess.run([program], input=words, capture_output=True, text=True, check=False)

    def line(place, word):
        return " ".join([*map(repr, good[:place]), word, *map(repr, good[place + 1 :])])

    assert run("").returncode == 0
    assert len(run(line(14, "0.0")).stdout.split()) == 3
    cases = {
        "not finite": [line(i, w) for i in range(15) for w in ("nan", "-inf", "1e999")]
        + [line(9, "1e300"), line(4, repr(good[4] + 2e6 * np.pi))],
        "not a number": [line(0, "abc"), line(9, "0,3"), "abc", line(14, "0.0") + "\nend"],
        "inside a motion": ["1", line(14, "")],
        "loops are open": [line(1, "0.1")],
    }
    for message, inputs in cases.items():
        for words in inputs:
            result = run(words)
            assert (result.returncode, message in result.stderr) == (1, True), words
            assert "nan" not in result.stdout
            assert "inf" not in result.stdout
    full = Path("/dev/full")
    if full.exists():
        with full.open("w") as stdout:
            words = "\n".join([line(14, "0.0")] * 3)
            ends = {"stdout": stdout, "stderr": subprocess.PIPE}
            result = subprocess.run([program], input=words, text=True, check=False, **ends)
        assert (result.returncode, result.stderr) == (1, "cannot write\n")


def test_export_replaces_nothing_unasked(tmp_path, capsys):
    """Nor does it write some of the files."""
    (tmp_path / "main.c").write_text("mine")
    assert main(["export-c", str(tmp_path)]) == 2
    assert "main.c: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["main.c"]
    assert main(["export-c", str(tmp_path), "--force"]) == 0
