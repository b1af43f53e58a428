# SPDX-License-Identifier: BSD-2-Clause
"""The counts of operations are current, and count what computes the right numbers."""

import importlib

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin.verification.sampling import random_parameters, random_states

pytest.importorskip("casadi", reason="operations are counted in CasADi's expressions")
cost = importlib.import_module("count_operations")
counted_methods = importlib.import_module("counted_methods")
counted_chains = importlib.import_module("counted_chains")

METHODS = [
    pytest.param(problem, method, id=f"{problem}-{method.name}")
    for problem, methods in cost.PROBLEMS.items()
    for method in methods
]


def _tallies(formula, *arguments, constants=()):
    """Additions, multiplications, divisions, roots, trig: executed, then generated."""
    found = cost.count(formula, *arguments, constants=constants)
    return tuple(
        [tally[kind] for kind in cost.KINDS] for tally in (found.executed, found.generated)
    )


# --- the page ---


@pytest.mark.slow
def test_the_page_is_current(capsys):
    assert cost.main(["--check"]) == 0, (
        "run scripts/pages/count_operations.py and read docs/cost.md"
    )
    assert "current" in capsys.readouterr().out


def test_the_page_has_the_papers_times():
    times = cost.PAGE.read_text(encoding="utf-8").split(cost.TIMES)[1]
    assert "2.7612 s / 1.7316 s | 1.595" in times


@pytest.mark.slow
def test_a_stale_count_is_found(tmp_path, monkeypatch, capsys):
    page = cost.PAGE.read_text(encoding="utf-8")
    number = str(cost.count_all().of["direct", cost.SHORT].generated.total())
    stale = tmp_path / "cost.md"
    stale.write_text(page.replace(f"| {number} |", f"| {int(number) + 1} |"), encoding="utf-8")
    monkeypatch.setattr(cost, "PAGE", stale)
    assert cost.main(["--check"]) == 1
    assert "stale" in capsys.readouterr().out


@pytest.mark.slow
def test_times_may_differ(tmp_path, monkeypatch):
    counts, _ = cost.PAGE.read_text(encoding="utf-8").split(cost.TIMES)
    page = tmp_path / "cost.md"
    page.write_text(counts + cost.TIMES + "another machine", encoding="utf-8")
    monkeypatch.setattr(cost, "PAGE", page)
    assert cost.main(["--check"]) == 0


# --- the counted formulas ---


@pytest.mark.parametrize(("problem", "method"), METHODS)
def test_counted_formulas_compute_the_right_numbers(problem, method):
    """An SST far from the paper's, by the counted formula and by the counted expression."""
    rng = np.random.default_rng(5)
    parameters = random_parameters(rng, friction=False)
    sst, robot = sst_pin.SST(parameters), cost.Robot.of(parameters)
    instants = cost.Instants.of(sst, *random_states(sst, rng, 20))
    wanted = method.wanted(instants)
    found = [method.formula(robot, *method.given(instants.at(i))) for i in range(20)]
    assert_allclose(found, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    function = cost.count_all().of[problem, method.name].function
    found = function(cost.columns(method, robot, instants)).full().T
    # Its pivots are those of another robot's instant.
    assert_allclose(found, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("t", [0.03, 0.2, 0.37])
@pytest.mark.parametrize("name", [cost.SHORT, cost.MULTIPLIERS])
def test_pivots_hardly_change_the_count(robot, name, t):
    counted = cost.count_all()
    method = next(method for method in cost.PROBLEMS["direct"] if method.name == name)
    instant = cost.Instants.of(robot, *sst_pin.paper_circle(t))
    here, there = cost.count_method(method, counted.robot, instant), counted.of["direct", name]
    assert here.executed == there.executed
    assert here.generated.total() == pytest.approx(there.generated.total(), rel=0.01)


def test_a_formula_that_only_example_1_believes_is_not_counted(monkeypatch):
    """A passive axis that turns the wrong way: in example 1 the torques do not see it."""
    rnea = counted_methods.rnea

    def wrong(robot, tree, q_dot, q_ddot, axes_dot, omega):
        axes_dot = axes_dot.copy()
        axes_dot[1::3] = -axes_dot[1::3]
        return rnea(robot, tree, q_dot, q_ddot, axes_dot, omega)

    monkeypatch.setattr(counted_methods, "rnea", wrong)
    _, short, *_ = cost.PROBLEMS["inverse"]
    monkeypatch.setattr(cost, "PROBLEMS", {"inverse": (short,)})
    with pytest.raises(ArithmeticError, match="short form"):
        cost.count_all.__wrapped__()


# --- any closed chain ---


def _odd_sst():
    parameters = random_parameters(np.random.default_rng(5), friction=False)
    return sst_pin.SST(parameters, kernels=False)


@pytest.mark.parametrize("form", cost.FORMS)
@pytest.mark.parametrize(
    "build",
    [_odd_sst, sst_pin.robots.stewart, *cost.CHAINS.values()],
    ids=["odd SST", "Stewart: slides that turn", *cost.CHAINS],
)
def test_the_long_form_and_the_recursions_give_the_same_torques(build, form):
    """On floats, against the package; rounding is 1e-12, a wrong term 1e-3 and more."""
    robot = build()
    chain = counted_chains.Chain(robot)
    rates = np.random.default_rng(6).normal(size=(2, len(chain.samples), robot.degrees_of_freedom))
    wanted = robot.compute_torques(chain.samples, *rates)
    motions = zip(chain.samples, *rates, strict=True)
    found = [cost.FORMS[form](chain, chain.numbers(*motion)) for motion in motions]
    assert_allclose(np.array(found), wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_a_wrong_recursion_is_not_counted(monkeypatch):
    """Bodies that do not resist turning."""
    backward = counted_chains.Chain._backward

    def wrong(self, n, *rest):
        return backward(self, n._replace(inertia=0.0 * n.inertia), *rest)

    monkeypatch.setattr(counted_chains.Chain, "_backward", wrong)
    monkeypatch.setattr(cost, "CHAINS", {"planar 3-RRR": sst_pin.robots.planar_3rrr})
    with pytest.raises(ArithmeticError, match="recursions, base axes"):
        cost.count_chains.__wrapped__()


def test_a_closure_that_is_not_counted_is_refused():
    with pytest.raises(ValueError, match="not counted"):
        counted_chains.Chain(sst_pin.robots.bennett())


def test_recursions_cost_in_proportion_to_the_bodies():
    """Each cell that a ladder gets, save the first, costs the same."""
    executed = []
    for cells in (2, 3, 4):
        robot = sst_pin.robots.ladder(cells)
        chain = counted_chains.Chain(robot)
        n = chain.numbers(chain.samples[0], *np.ones((2, robot.degrees_of_freedom)))
        formula = cost.partial(cost._of_arrays, cost.FORMS[cost.BODY], chain)
        executed.append(cost.count(formula, *n).executed.total())
    assert executed[2] - executed[1] == pytest.approx(executed[1] - executed[0], rel=0.05)


# --- the counter, against counts known by hand ---


def test_a_matrix_product():
    A, B = np.random.default_rng(0).normal(size=(2, 3, 3))
    assert _tallies(np.matmul, A, B) == ([18, 27, 0, 0, 0],) * 2
    assert_allclose(cost.count(np.matmul, A, B).values, (A @ B).ravel())


def test_structural_zeros_and_ones():
    A = np.random.default_rng(0).normal(size=(3, 3))
    executed, generated = _tallies(lambda unit, A: unit @ A, A, constants=[np.eye(3)])
    assert executed == [18, 27, 0, 0, 0]
    assert generated == [0, 0, 0, 0, 0]


def test_shared_and_unused_subexpressions():
    def formula(x):
        _ = np.cos(x[0])
        return x[0] * x[1] / (x[0] * x[1] + x[2])

    executed, generated = _tallies(formula, np.array([0.3, 0.4, 0.5]))
    assert executed == [1, 2, 1, 0, 1]
    assert generated == [1, 1, 1, 0, 0]


def test_every_operation():
    def formula(x):
        a, b = x[:1], x[1:]
        sums, products = [a + b, a - b, 3.0 - b], [a * b, 2.0 * a, a / b, 1.0 / b, -a]
        others = [np.sqrt(a), np.linalg.norm(x[None], axis=1), np.sin(a), np.cos(b)]
        return np.concatenate([*sums, *products, *others, np.arctan2(a, b)])

    x = np.array([0.3, 0.4])
    found = cost.count(formula, x)
    assert_allclose(found.values, formula(x), rtol=1e-15)
    assert_allclose(found.function(x).full().ravel(), formula(x), rtol=1e-15)
    assert _tallies(formula, x) == ([4, 4, 2, 2, 3],) * 2


@pytest.mark.parametrize("solve", ["solve", "solve_transposed"])
@pytest.mark.parametrize("n", [1, 2, 6])
def test_elimination(n, solve):
    """The textbook's counts: n (n - 1) (2 n - 1) / 6 products to factorise, n (n - 1) to solve."""
    rng = np.random.default_rng(n)
    A, b = rng.normal(size=(n, n)), rng.normal(size=n)
    products = n * (n - 1) * (2 * n - 1) // 6 + n * (n - 1)
    divisions = n * (n - 1) // 2 + n

    def formula(A, b):
        return getattr(counted_methods.LU(A), solve)(b)

    assert _tallies(formula, A, b) == ([products, products, divisions, 0, 0],) * 2
    wanted = np.linalg.solve(A if solve == "solve" else A.T, b)
    assert_allclose(formula(A, b), wanted)
    assert_allclose(cost.count(formula, A, b).values, wanted)


def test_cholesky():
    """The textbook's counts for n = 3: 4 products to factorise, 6 to solve; 3 roots."""
    A, b = np.random.default_rng(0).normal(size=(3, 3)), np.array([1.0, -2.0, 3.0])
    A = A @ A.T
    executed, _ = _tallies(counted_methods.solve_cholesky, A, b)
    assert executed == [10, 10, 9, 3, 0]
    assert_allclose(counted_methods.solve_cholesky(A, b), np.linalg.solve(A, b))
