# SPDX-License-Identifier: BSD-2-Clause
"""Any robot as C99, compiled strictly by two compilers, gives what the package gives."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import any_chain
from sst_pin import ClosedChain
from sst_pin.cli import main
from sst_pin.compiled import build
from sst_pin.compiled.export import c_files
from sst_pin.files import write_files

DELTA = Path(__file__).parents[2] / "examples" / "delta.urdf"
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1"]
ZIG = [sys.executable, "-m", "ziglang", "cc"]
IN_A_WHEEL = build.find_spec("ziglang") is not None
COMPILERS = [["cc"], *([pytest.param(ZIG, marks=pytest.mark.slow)] if IN_A_WHEEL else [])]


@pytest.mark.parametrize("compiler", COMPILERS, ids=lambda command: command[-1])
def test_the_exported_delta_computes_the_torques_that_hold_it(compiler, tmp_path):
    chain = ClosedChain.from_urdf(DELTA)
    assert main(["export-c", str(DELTA), str(tmp_path)]) == 0
    program = tmp_path / "hold"
    sources = [str(tmp_path / name) for name in ("main.c", "robot.c")]
    subprocess.run([*compiler, *STRICT, *sources, "-o", str(program), "-lm"], check=True)
    output = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout
    q = chain.generic_configuration()
    expected = chain.compute_torques(q, np.zeros(3), np.zeros(3))
    assert np.allclose(np.array(output.split(), dtype=float), expected, rtol=1e-11)


@pytest.mark.slow
@pytest.mark.skipif(not IN_A_WHEEL, reason="needs ziglang")
@pytest.mark.parametrize("target", ["aarch64-linux-musl", "arm-linux-musleabihf"])
def test_the_exported_source_compiles_for_controllers(target, tmp_path):
    chain = any_chain.with_joint("spherical")
    write_files(c_files(chain, tmp_path))
    source, made = str(tmp_path / "robot.c"), str(tmp_path / "robot.o")
    subprocess.run([*ZIG, "-target", target, *STRICT, "-c", source, "-o", made], check=True)


def test_names_cannot_break_out_of_the_comments(tmp_path):
    chain = any_chain.chain()
    model = chain.model
    model.name = "*/ int evil; /*"
    files = c_files(ClosedChain(model, chain.closures, ["body"]), tmp_path)
    write_files(files)
    assert "*/ int evil" not in (tmp_path / "robot.h").read_text()
