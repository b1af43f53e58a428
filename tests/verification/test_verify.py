# SPDX-License-Identifier: BSD-2-Clause
"""`sst-pin verify` compares the dynamics of any chain with every referee that takes it."""

import json
import sys

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.cli import main
from sst_pin.errors import install_command
from sst_pin.verification import verify
from sst_pin.verification.mujoco_tree import MujocoTree
from tests.support.files import ROOT

DELTA = ROOT / "examples" / "delta.urdf"
NAMES = {"virtual work", "Lagrange multipliers", "MuJoCo mj_inverse"}


@pytest.mark.parametrize("robot", ["stewart", str(DELTA)])
def test_every_referee_agrees(robot, capsys):
    """One command, one table, exit code 0; JSON for machines."""
    pytest.importorskip("mujoco", reason="MuJoCo is missing (extra 'verify')")
    asked = ["verify", "--quick", "--robot", robot]
    assert (main(asked), main([*asked, "--json"])) == (0, 0)
    out, _, text = capsys.readouterr().out.partition("\n{\n")
    assert out.splitlines()[-1] == "all agree"
    content = json.loads("{" + text)
    assert content["passed"] is True
    assert {row["referee"] for row in content["comparisons"]} == NAMES
    assert {row["compared"] for row in content["comparisons"]} >= {"torques", "accelerations"}
    assert all(row["relative"] <= row["limit"] for row in content["comparisons"])


def test_a_missing_package_costs_one_referee_and_is_named_with_its_remedy(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)  # what Python takes for not installed
    assert main(["verify", "--quick"]) == 0
    out = capsys.readouterr().out
    assert f"skipped: mujoco is not installed; run: {install_command('verify')}" in out
    assert "virtual work" in out


def test_a_robot_that_mujoco_does_not_have_is_left_to_the_others(tmp_path):
    model = pin.Model()
    screw = model.addJoint(0, pin.JointModelHZ(0.1), pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(screw, pin.Inertia.Random(), pin.SE3.Identity())
    chain = sst_pin.ClosedChain(model, [], ["screw"])
    available, (problem,) = verify.referees_of(chain)
    assert {referee.name for referee in available} == NAMES - {"MuJoCo mj_inverse"}
    assert "joint screw: MuJoCo has no joint HZ" in str(problem)
    assert all(row.passed for row in verify.verify_chain(chain, 5))


def test_wrong_weights_end_in_exit_code_1(monkeypatch, capsys):
    """A flipped sign of gravity: every referee says so."""
    for name in ("compute_torques", "generalized_forces"):
        right = getattr(sst_pin.SST, name)

        def wrong(self, q, va, aa, right=right):
            return right(self, q, va, aa) + 2 * self.noc(q, va).gravity

        monkeypatch.setattr(sst_pin.SST, name, wrong)
    assert main(["verify", "--quick", "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    assert content["passed"] is False
    assert not any(row["passed"] for row in content["comparisons"] if row["compared"] == "torques")
    assert main(["verify", "--quick"]) == 1
    assert "disagree" in capsys.readouterr().out.splitlines()[-1]


def test_a_referee_that_answers_nan_disagrees():
    differences = verify.Differences("nobody", "nothing")
    differences.add(lambda: np.array((1.0, np.nan)), np.ones(2))
    row = differences.comparison()
    assert row.passed is False
    assert row.relative == np.inf


def test_mujoco_takes_dense_jacobians_of_large_robots():
    """MuJoCo 4.0.0 factorises sparse ones wrongly; by itself it takes them from 60 rates on."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is missing (extra 'verify')")
    model = pin.Model()
    for k in range(70):
        joint = model.addJoint(k, pin.JointModelRX(), pin.SE3.Identity(), f"joint_{k}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1, 0.1), pin.SE3.Identity())
    tree = MujocoTree(sst_pin.ClosedChain(model, [], ["joint_0"]).mechanism, closed=1e4)
    assert not mujoco.mj_isSparse(tree.mj)
