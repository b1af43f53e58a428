# SPDX-License-Identifier: BSD-2-Clause
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.description import urdf_of
from sst_pin.sst.export import c_files
from sst_pin.verification.sampling import random_parameters, random_states

compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
with_compiler = pytest.mark.skipif(not compiler, reason="needs a C compiler")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


@with_compiler
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_exported_c_computes_the_torques_of_python(tmp_path, capsys, seed):
    """The paper's robot and odd ones, compiled alone under all warnings: 1e-12 relative."""
    arguments = ["export-c", str(tmp_path / "c")]
    robot = sst_pin.SST()
    if seed is not None:
        parameters = random_parameters(np.random.default_rng(seed))
        (tmp_path / "mine.urdf").write_text(urdf_of(parameters))
        robot = sst_pin.SST.from_urdf(tmp_path / "mine.urdf")
        arguments += ["--urdf", str(tmp_path / "mine.urdf")]
    assert main(arguments) == 0
    assert "sst_robot.h" in capsys.readouterr().out
    build = [compiler, *STRICT, "-O2", "-o", "torques", "example.c", "sst_kernels.c"]
    subprocess.run(build, cwd=tmp_path / "c", check=True)
    motion = robot.joint_motion(*random_states(robot, np.random.default_rng(2), 20))
    lines = "\n".join(" ".join(map(repr, row.tolist())) for row in np.hstack(motion))
    result = subprocess.run(
        [tmp_path / "c" / "torques"], input=lines, capture_output=True, text=True, check=True
    )
    tau = np.array([line.split() for line in result.stdout.splitlines()], dtype=float)
    expected = robot.compute_torques(*motion)
    assert np.abs(tau - expected).max() < 1e-12 * np.abs(expected).max()
    motion[0][0, 1] += 1e-3
    result = subprocess.run(
        [tmp_path / "c" / "torques"],
        input=" ".join(map(repr, np.hstack(motion)[0].tolist())),
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "the loops are open" in result.stderr


@with_compiler
def test_the_exported_example_tells_what_it_cannot_compute(tmp_path):
    """Exit code 1, a message and no torques: never nan for nan, never half of the input."""
    assert main(["export-c", str(tmp_path)]) == 0
    build = [compiler, *STRICT, "-O2", "-o", "torques", "example.c", "sst_kernels.c"]
    subprocess.run(build, cwd=tmp_path, check=True)
    good = [*sst_pin.SST().home.tolist(), *[0.0] * 6]

    def run(words):
        return subprocess.run(
            [tmp_path / "torques"], input=words, capture_output=True, text=True, check=False
        )

    def line(place, word):
        return " ".join([*map(repr, good[:place]), word, *map(repr, good[place + 1 :])])

    assert run("").returncode == 0
    assert len(run(line(14, "0.0")).stdout.split()) == 3
    cases = {
        "not a finite number": [line(i, w) for i in range(15) for w in ("nan", "-inf", "1e999")],
        "not a number": [line(0, "abc"), line(9, "0,3"), "abc", line(14, "0.0") + "\nend"],
        "inside a motion": ["1", line(14, "")],
        "beyond 1e6 rad": [line(4, repr(good[4] + 2e6 * np.pi))],
        "not finite": [line(9, "1e300")],
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
            command = [tmp_path / "torques"]
            words = "\n".join([line(14, "0.0")] * 3)
            result = subprocess.run(
                command, input=words, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False
            )
        assert (result.returncode, result.stderr) == (1, "cannot write\n")


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_export_refuses_numbers_that_no_compiler_reads(tmp_path):
    """A gravity of nan would be written as `nan`."""
    robot = sst_pin.SST()
    robot.model.gravity.linear = np.array((0, np.nan, 0))
    with pytest.raises(sst_pin.DescriptionError, match="gravity is not finite"):
        c_files(robot, tmp_path)


@with_compiler
@pytest.mark.parametrize("name", ["a */ b", "/* a", "*/*/", "line\nbreak", "trigraph ??/", "\\"])
def test_the_name_of_a_robot_stays_in_its_comment(tmp_path, name):
    """Whatever it is, the header compiles under all warnings."""
    robot = sst_pin.SST()
    robot.model.name = name
    for path, write in c_files(robot, tmp_path).items():
        with path.open("wb") as file:
            write(file)
    build = [compiler, *STRICT, "-o", "torques", "example.c", "sst_kernels.c"]
    subprocess.run(build, cwd=tmp_path, check=True)


@with_compiler
def test_exported_c_needs_no_library(tmp_path):
    """The object file calls nothing, not even the mathematical library."""
    main(["export-c", str(tmp_path)])
    build = [compiler, *STRICT, "-O2", "-c", "sst_kernels.c"]
    subprocess.run(build, cwd=tmp_path, check=True)
    nm = shutil.which("nm")
    if nm:
        symbols = subprocess.run(
            [nm, "-u", tmp_path / "sst_kernels.o"], capture_output=True, text=True, check=True
        ).stdout
        assert not [word for word in symbols.split() if word not in ("U", "_GLOBAL_OFFSET_TABLE_")]


def test_export_refuses_a_robot_that_is_cut_elsewhere(robot, tmp_path):
    """The kernels would compute another robot."""
    other = sst_pin.SST()
    other._current.closures = tuple(
        sst_pin.Closure(c.frame_b, c.frame_a, c.kind) for c in robot.closures
    )
    with pytest.raises(sst_pin.DescriptionError, match="cuts are others"):
        c_files(other, tmp_path)


def test_export_replaces_nothing_unasked(tmp_path, capsys):
    """Nor does it write some of the files."""
    (tmp_path / "example.c").write_text("mine")
    assert main(["export-c", str(tmp_path)]) == 2
    assert "example.c: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["example.c"]
    assert main(["export-c", str(tmp_path), "--force"]) == 0
