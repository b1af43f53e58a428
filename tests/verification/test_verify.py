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
from tests.gallery.cylinder_boom import cylinder_boom
from tests.support.files import ROOT

DELTA = ROOT / "examples" / "delta.urdf"
NAMES = {"Lagrange multipliers", "MuJoCo mj_inverse"}


@pytest.mark.parametrize("robot", [pytest.param("stewart", marks=pytest.mark.slow), str(DELTA)])
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
    assert "Lagrange multipliers" in out


def test_a_robot_that_mujoco_does_not_have_is_left_to_the_others(tmp_path):
    model = pin.Model()
    screw = model.addJoint(0, pin.JointModelHZ(0.1), pin.SE3.Identity(), "screw")
    model.appendBodyToJoint(screw, pin.Inertia.Random(), pin.SE3.Identity())
    chain = sst_pin.ClosedChain(model, [], ["screw"])
    available, (problem,) = verify.referees_of(chain)
    assert {referee.name for referee in available} == NAMES - {"MuJoCo mj_inverse"}
    assert "joint screw: MuJoCo has no joint HZ" in str(problem)
    assert all(row.passed for row in verify.verify_chain(chain, 5))


def test_a_free_joint_on_a_body_is_not_for_mujoco_and_the_error_says_why(tmp_path):
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "base")
    free = model.addJoint(base, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    for joint in (base, free):
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    chain = sst_pin.ClosedChain(model, [], ["base"])
    with pytest.raises(sst_pin.DescriptionError, match="free joints on the world only"):
        sst_pin.write_mjcf(chain, tmp_path / "free.xml")


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


@pytest.mark.parametrize("away", [0.5, 1e-2, pytest.param(1e-4, marks=pytest.mark.slow)])
def test_a_right_robot_agrees_near_a_singular_configuration(away):
    """Condition numbers up to 5e4; differences of 1e-6 there are rounding."""
    rows = list(verify.verify_chain(cylinder_boom(-np.pi / 2 + away), 20))
    assert {row.verdict for row in rows} == {"ok"}


def test_the_limit_stays_small_for_usual_robots():
    """A slip of 1e-6 in a well-conditioned robot is seen."""
    assert max(row.limit for row in verify.verify_chain(sst_pin.robots.stewart(), 5)) < 1e-7


def _fails():
    raise np.linalg.LinAlgError("singular")


@pytest.mark.parametrize("answer", [lambda: np.array((1.0, np.nan)), _fails])
def test_a_referee_without_an_answer_cannot_say(answer):
    differences = verify.Differences("nobody", "nothing")
    differences.add(answer, verify.Expected(np.ones(2), size=1.0, limit=1e-9))
    row = differences.comparison()
    assert (row.verdict, row.cases, row.unclear) == ("cannot say", 0, 1)


def test_a_wrong_answer_beside_one_that_is_missing_disagrees():
    differences = verify.Differences("nobody", "nothing")
    expected = verify.Expected(np.ones(2), size=1.0, limit=1e-9)
    differences.add(lambda: np.full(2, np.nan), expected)
    differences.add(lambda: np.full(2, 1.001), expected)
    assert differences.comparison().verdict == "DISAGREES"


def test_a_quantity_that_no_referee_can_judge_ends_in_exit_code_1(monkeypatch, capsys):
    """Rounding as large as the results: nothing is shown, and nothing is called wrong."""
    monkeypatch.setattr(verify, "_UNCLEAR", 0.0)
    assert main(["verify", "--quick"]) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "no referee can judge: accelerations, forces along the coordinates, torques"


def test_mujoco_takes_dense_jacobians_of_large_robots():
    """MuJoCo 4.0.0 factorises sparse ones wrongly; by itself it takes them from 60 rates on."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is missing (extra 'verify')")
    model = pin.Model()
    for k in range(70):
        joint = model.addJoint(k, pin.JointModelRX(), pin.SE3.Identity(), f"joint_{k}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1, 0.1), pin.SE3.Identity())
    tree = MujocoTree(sst_pin.ClosedChain(model, [], ["joint_0"]).mechanism, closure_stiffness=1e4)
    assert not mujoco.mj_isSparse(tree.mj)
