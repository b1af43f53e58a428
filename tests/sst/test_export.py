# SPDX-License-Identifier: BSD-2-Clause
import shutil
import subprocess

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
    other.closures = tuple(sst_pin.Closure(c.frame_b, c.frame_a, c.kind) for c in robot.closures)
    with pytest.raises(sst_pin.DescriptionError, match="cuts are others"):
        c_files(other, tmp_path)


def test_export_replaces_nothing_unasked(tmp_path, capsys):
    """Nor does it write some of the files."""
    (tmp_path / "example.c").write_text("mine")
    assert main(["export-c", str(tmp_path)]) == 2
    assert "example.c: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["example.c"]
    assert main(["export-c", str(tmp_path), "--force"]) == 0
