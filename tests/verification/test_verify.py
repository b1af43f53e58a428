# SPDX-License-Identifier: BSD-2-Clause
import json
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.verification import referees, verify


@pytest.fixture
def no_engines(monkeypatch):
    """The machine has no extra `verify`."""
    real = referees.import_module

    def import_module(name, package=None):
        if name in ("casadi", "mujoco", "exudyn"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, package)

    monkeypatch.setattr(referees, "import_module", import_module)


@pytest.fixture(scope="module")
def quick():
    """The rows of the quick run."""
    return list(verify.verify_sst(quick=True))


def shown(monkeypatch, rows):
    """Exit code of the command with these rows, as table and as JSON."""
    monkeypatch.setattr(verify, "verify_sst", lambda _: iter(rows))
    return main(["verify", "--quick"]), main(["verify", "--quick", "--json"])


@pytest.mark.slow
def test_every_referee_agrees_in_the_quick_run(quick, monkeypatch, capsys):
    """One command, one table, exit code 0; JSON for machines."""
    assert shown(monkeypatch, quick) == (0, 0)
    out, _, text = capsys.readouterr().out.partition("\n{\n")
    assert out.splitlines()[-1] == "all agree"
    assert "virtual work" in out
    assert "Lagrange multipliers" in out
    assert "DISAGREES" not in out
    content = json.loads("{" + text)
    assert content["passed"] is True
    asked = {comparison["referee"] for comparison in content["comparisons"]}
    assert {"reference path", "virtual work", "Lagrange multipliers", "energy"} <= asked
    assert all(c["relative"] <= c["limit"] for c in content["comparisons"])


@pytest.mark.slow
def test_the_whole_run_includes_those_that_step_in_time():
    """Each shows its order, its stiffness, or comes back to the circle."""
    rows = list(verify.verify_in_time())
    assert rows
    assert all(row.passed for row in rows)
    names = {row.referee for row in rows}
    assert "virtual work" in names
    for package, name in (("exudyn", "Exudyn, time-stepped"), ("mujoco", "MuJoCo, welded")):
        missing = {error.package for error in verify.skipped()}
        assert (name in names) == (package not in missing)


@pytest.mark.slow
def test_referees_that_are_not_installed_are_named_with_their_remedy(no_engines, capsys):
    assert main(["verify", "--quick"]) == 0
    out = capsys.readouterr().out
    for package in ("casadi", "mujoco", "exudyn"):
        assert f"skipped: {package} is not installed; run: pip install 'sst-pin[verify]'" in out
    assert "virtual work" in out


@pytest.mark.slow
def test_a_wrong_torque_ends_in_exit_code_1(monkeypatch, capsys):
    """A flipped sign of the weights: every referee says so."""
    right = sst_pin.SST.compute_torques

    def wrong(self, q, va, aa, **loads):
        states = zip(np.atleast_2d(q), np.atleast_2d(va), strict=True)
        weights = np.array([self.noc(*state).gravity for state in states])
        return right(self, q, va, aa, **loads) + 2 * weights.reshape(np.shape(va))

    monkeypatch.setattr(sst_pin.SST, "compute_torques", wrong)
    assert shown(monkeypatch, list(verify.verify_sst(quick=True))) == (1, 1)
    out, _, text = capsys.readouterr().out.partition("\n{\n")
    assert "disagree" in out.splitlines()[-1]
    content = json.loads("{" + text)
    assert content["passed"] is False
    others = [c for c in content["comparisons"] if c["referee"] != "reference path"]
    torques = [c for c in others if c["compared"].startswith("torques")]
    assert len(torques) >= 4
    assert not any(c["passed"] for c in torques)


def test_a_referee_that_answers_nan_disagrees():
    judge = verify.Judge("nobody", "nothing")
    judge.hold(lambda: np.array((1.0, np.nan)), np.ones(2))
    row = judge.verdict()
    assert row.passed is False
    assert row.relative == np.inf


def test_an_edited_urdf_is_verified_too(tmp_path, capsys):
    path = tmp_path / "mine.urdf"
    path.write_text(Path(sst_pin.URDF_PATH).read_text().replace('"0.3"', '"0.7"'))
    assert main(["verify", "--quick", "--robot", str(path)]) == 0
    assert "torques, sst" in capsys.readouterr().out
