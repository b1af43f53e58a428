# SPDX-License-Identifier: BSD-2-Clause
"""The counts of operations are current, and count what computes the right numbers."""

from functools import cache, partial

import casadi as ca
import numpy as np
import pytest

import sst_pin
from tests.support.files import load
from tests.support.sampling import random_parameters

cost = load("scripts/pages/count_operations.py")

METHODS = [("inverse", name) for name in cost.INVERSE] + [("direct", name) for name in cost.DIRECT]
ODD = random_parameters(np.random.default_rng(5), friction=False)
ODD_ROBOTS = {
    "odd SST": partial(sst_pin.SST, ODD),
    "stewart": sst_pin.robots.stewart,
    "delta": sst_pin.robots.delta,
    "bennett": sst_pin.robots.bennett,
}


@cache
def equations(name):
    """A robot and its equations."""
    robot = ODD_ROBOTS[name]()
    return robot, cost.equations_of(robot)


@pytest.mark.slow
def test_the_page_is_current(capsys):
    assert cost.main(["--check"]) == 0, "run scripts/pages/count_operations.py"
    assert "current" in capsys.readouterr().out


def test_the_page_has_the_papers_times():
    assert f"2.7612 s / 1.7316 s = {2.7612 / 1.7316:.3f}" in cost.PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(("problem", "method"), METHODS)
@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(x, marks=pytest.mark.slow if x in ("delta", "stewart") else ())
        for x in ODD_ROBOTS
    ],
)
def test_counted_expressions_compute_the_right_numbers(robot, problem, method):
    """Robots that the page does not have, all samples, 1e-9 of the largest torque."""
    robot, e = equations(robot)
    cost.require_right(robot, e, problem, method, cost.expression(e, problem, method))


def test_virtual_work_computes_the_right_numbers():
    robot = cost.by_virtual_work(ODD_ROBOTS["odd SST"]())
    e = cost.equations_of(robot)
    for problem in ("inverse", "direct"):
        cost.require_right(robot, e, problem, cost.SHORT, cost.expression(e, problem, cost.SHORT))


@pytest.mark.slow
def test_inverse_dynamics_costs_in_proportion_to_the_bodies():
    """Each cell that a ladder gets, save the first, costs the same."""
    inverse = [operations for operations, _ in cost.count_ladders().values()]
    per_cell = np.diff(inverse) / np.diff(cost.CELLS)
    assert per_cell == pytest.approx(np.full(len(per_cell), per_cell[0]), rel=0.05)


def test_known_counts():
    x, A, B = ca.SX.sym("x", 3), ca.SX.sym("A", 3, 3), ca.SX.sym("B", 3, 3)
    a, b, c = ca.vertsplit(x)

    def counted(*results):
        function = ca.Function("f", [x, A, B], [ca.vertcat(*map(ca.vec, results))], {"cse": True})
        tally = cost.operations(function)
        return [tally[kind] for kind in cost.KINDS]

    assert counted(A @ B) == [18, 27, 0, 0, 0]
    assert counted(ca.SX.eye(3) @ A) == [0] * 5
    assert counted(a * b / (a * b + c)) == [1, 1, 1, 0, 0]  # a b once
    assert counted(a + b, a - b, 3 - b, a * b, 2 * a, a / b, 1 / b, -a) == [3, 2, 2, 0, 0]
    assert counted(ca.sqrt(a), ca.sin(a), ca.cos(b), ca.atan2(a, b)) == [0, 0, 0, 1, 3]
