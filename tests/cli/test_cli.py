# SPDX-License-Identifier: BSD-2-Clause
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.sst import paper
from tests.support.command_line import run


@pytest.mark.slow
def test_paper_writes_data_and_figures_and_prints_its_table(here, capsys, robot):
    code, out, _ = run(capsys, "paper", "--samples", 201)
    assert code == 0
    names = {p.name for p in (here / "paper").iterdir()}
    data = {"example_1", "example_2_exact_start", "example_2_printed_start"}
    figures = {"figure_09_path", "figure_10_torques", "figure_11_direct_dynamics"}
    expected = {f"{n}.{e}" for n in data for e in ("csv", "npz")}
    assert names == expected | {f"{n}.{e}" for n in figures for e in ("png", "svg")}
    example = sst_pin.Trajectory.load(here / "paper" / "example_1.csv")
    assert example == sst_pin.Trajectory.load(here / "paper" / "example_1.npz")
    assert example == paper.example_1(robot, np.linspace(0, paper.PERIOD, 201))
    peaks = re.search(r"peak \|tau\| \(N m\) +([\d.]+) +([\d.]+) +([\d.]+)", out).groups()
    assert np.array(peaks, dtype=float) == pytest.approx(np.abs(example.tau).max(axis=0), abs=1e-4)
    exact, printed = (
        float(re.search(rf"^{name} +([\d.e-]+) rad", out, re.MULTILINE)[1])
        for name in ("exact", "printed")
    )
    assert exact < 1e-9
    assert 1e-6 < printed < 5e-5


@pytest.mark.parametrize("kind", ["quaternions", "radians", "degrees", "motors"])
def test_every_way_of_writing_a_motion_gives_the_torques_of_example_1(here, capsys, robot, kind):
    """Quaternions, theta and phi with and without psi, motor angles; signs of q do not matter."""
    from scipy.spatial.transform import Rotation

    t = np.linspace(0, paper.PERIOD, 201)
    example = paper.example_1(robot, t)
    R = sst_pin.paper_circle(t).R
    s = R[:, :, 0]
    angles = np.array((np.unwrap(np.arctan2(s[:, 1], s[:, 0])), np.arccos(s[:, 2])))
    three = [*angles, 0 * t]
    columns, values = {
        "quaternions": (
            ("qw", "qx", "qy", "qz"),
            Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]] * np.resize((1, -1), (201, 1)),
        ),
        "radians": (("theta_rad", "phi_rad"), angles.T),
        "degrees": (("theta_deg", "phi_deg", "psi_deg"), np.degrees(three).T),
        "motors": (("gamma_1_rad", "gamma_2_rad", "gamma_3_rad"), example.q[:, ::3]),
    }[kind]
    time = "time" if kind == "radians" else "t_s"
    head, table = ",".join((time, *columns)), np.column_stack([t, values])
    np.savetxt("m.csv", table, "%.17g", ",", header=head, comments="")
    assert run(capsys, "torques", "m.csv", "-o", "out.csv", "--robot", sst_pin.URDF_PATH)[0] == 0
    motion = sst_pin.Trajectory.load("out.csv")
    assert np.abs(motion.q - example.q).max() < 1e-9
    inner = slice(20, -20)  # a spline knows less at its ends
    assert np.abs(motion.tau - example.tau)[inner].max() < 1e-4


def test_simulate_says_that_it_stopped(here, capsys):
    rows = [(t, 0, 0.88, 1) for t in np.linspace(0, 1, 11)]
    head = "t_s,tau_1_N,slider_m,slider_m_s"
    np.savetxt("tau.csv", rows, "%.17g", ",", header=head, comments="")
    code, out, _ = run(capsys, "simulate", "tau.csv", "-o", "m.csv", "--robot", "scissor_lift")
    assert code == 3
    assert "before a singularity" in out
    assert len(sst_pin.Trajectory.load("m.csv")) < 11


def test_module_and_script_are_the_same_command():
    commands = [sys.executable, "-m", "sst_pin"], [Path(sys.executable).parent / "sst-pin"]
    module, script = (subprocess.check_output([*c, "--version"], text=True) for c in commands)
    assert module == script
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev)?\n", module)
