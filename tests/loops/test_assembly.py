# SPDX-License-Identifier: BSD-2-Clause
"""Assembly that scales: loops apart, several starts, any unit of length."""

from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from sst_pin import ClosedChain, Closure
from sst_pin.errors import ClosureError, InputError, UnknownNameError
from sst_pin.robots import delta, five_bar, four_bar, scissor_lift
from tests.support.any_chain import tree
from tests.support.by_hand import in_units
from tests.support.link_tables import ROBOTS
from tests.support.planar_bars import planar


def ladder(rungs, *, broken=None):
    """Four-bars side by side on the ground; the broken one's rocker is too far away."""
    bars = []
    for k in range(rungs):
        bars.append((f"crank_{k}", "universe", float(k), 0.3))
        bars.append((f"coupler_{k}", f"crank_{k}", 0.3, 0.7))
        bars.append((f"rocker_{k}", "universe", k + (5.0 if k == broken else 0.8), 0.6))
    closures = [Closure(f"coupler_{k}_end", f"rocker_{k}_end", "3d") for k in range(rungs)]
    return ClosedChain(planar(bars), closures, [f"crank_{k}" for k in range(rungs)])


def test_a_ladder_closes_when_each_of_its_loops_closes_alone(monkeypatch):
    """12 four-bars from random guesses: the result of each is that of the four-bar alone.

    So is the work: linear systems of one loop, no more of them than the loops alone take.
    """
    lstsq, solved, of_loops = np.linalg.lstsq, [], []

    def counted(A, *others, **options):
        solved.append(A.shape)
        return lstsq(A, *others, **options)

    monkeypatch.setattr(np.linalg, "lstsq", counted)
    random = np.random.default_rng(0)
    alone, together = ladder(1), ladder(12)
    guesses, closed = [], []
    while len(guesses) < 12:
        guess = np.array([1.2, -0.7, 2.0]) + 0.6 * random.normal(size=3)
        solved.clear()
        try:
            closed.append(alone.assemble(guess, ["crank_0"]))
        except ClosureError:
            continue
        guesses.append(guess)
        of_loops += solved
    solved.clear()
    q = together.assemble(np.concatenate(guesses), [f"crank_{k}" for k in range(12)])
    assert_allclose(q, np.concatenate(closed), atol=1e-9)
    assert set(solved) == set(of_loops)
    assert len(solved) <= len(of_loops)


def test_an_open_loop_is_named_and_the_others_close():
    chain = ladder(3, broken=1)
    guess = np.tile([1.2, -0.7, 2.0], 3)
    with pytest.raises(ClosureError) as caught:
        chain.assemble(guess, ())
    assert "coupler_1_end - rocker_1_end" in str(caught.value)
    assert not any(f"coupler_{k}_end" in str(caught.value) for k in (0, 2))


def test_several_starts_close_what_one_start_does_not():
    """One seed gives one configuration; another seed also gives a closed one."""
    chain = ClosedChain(
        tree("", ["RY", "RY", "PX"], ["spherical", "RY", "revolute", "PX"], seed=5),
        [Closure("A", "B", "6d")],
        [],
    )
    random, closed = np.random.default_rng(1), []
    while not closed:
        guess = pin.integrate(chain.model, pin.neutral(chain.model), 2 * random.normal(size=9))
        try:
            chain.assemble(guess, ())
        except ClosureError:
            with suppress(ClosureError):
                closed.append(chain.assemble(guess, (), tries=20, seed=3))
    assert np.array_equal(closed[0], chain.assemble(guess, (), tries=20, seed=3))
    assert np.abs(chain.residual(closed[0])).max() < 1e-9
    for tries in (0, -1, 1.5, None, "3"):
        with pytest.raises(InputError, match="tries: "):
            chain.assemble(guess, (), tries=tries)


def scaled(robot, factor):
    """The robot in another unit of length, and what this makes of its positions."""
    units = np.array([factor if link.prismatic else 1.0 for link in robot.links])
    return ClosedChain(in_units(robot.model(), factor), robot.closures, robot.actuated), units


#: Points, rows of orientation beside points, slides, and rows without lengths.
IN_UNITS = ["planar 3-RRR", "four-bar, coupler aligned and pinned", "6-UPS", "spherical 3-RRR"]


@pytest.mark.parametrize("factor", [1e-6, 1e3])
@pytest.mark.parametrize("name", IN_UNITS)
def test_verdicts_do_not_depend_on_the_unit_of_length(name, factor):
    """Mobility, condition number, closed or open, assembly, generic configuration."""
    robot = ROBOTS[name]
    (one, _), (other, units) = scaled(robot, 1.0), scaled(robot, factor)
    q = robot.joints(robot.x).real
    a, b = one.mobility(q), other.mobility(q * units)
    assert (a.degrees_of_freedom, a.rank, a.held, a.coordinates) == (
        b.degrees_of_freedom,
        b.rank,
        b.held,
        b.coordinates,
    )
    assert_allclose(b.condition_number, a.condition_number, rtol=1e-9)
    assert_allclose(other.condition_number(q * units), one.condition_number(q), rtol=1e-9)
    for size, is_open in ((1e-9, False), (1e-3, True)):
        off = q + size
        va = np.zeros(one.degrees_of_freedom)
        for chain, configuration in ((one, off), (other, off * units)):
            if is_open:
                with pytest.raises(ClosureError, match="the loops are open"):
                    chain.joint_rates(configuration, va)
            else:
                chain.joint_rates(configuration, va)
    guess = q + 0.05 * np.random.default_rng(0).normal(size=len(q))
    assert_allclose(other.assemble(guess * units), one.assemble(guess) * units, rtol=1e-9)
    assert_allclose(other.generic_configuration() / units, one.generic_configuration(), atol=1e-7)


def test_a_scissor_lift_of_twenty_cells_is_judged_at_the_callers_configuration():
    """One freedom where it stands."""
    chain = scissor_lift(20)
    q = chain.home
    report = chain.mobility(q)
    assert (report.degrees_of_freedom, report.held) == (1, 1)
    assert report.where == "the configuration given"
    assert_allclose(report.q, q)
    tau = chain.compute_torques(q, [0.0], [0.0])
    assert chain.compute_accelerations(q, [0.0], tau) == pytest.approx(0, abs=1e-8)


def limited(lower, upper):
    """One four-bar with limits of crank, coupler and rocker."""
    chain = ladder(1)
    chain.model.lowerPositionLimit[:], chain.model.upperPositionLimit[:] = lower, upper
    chain.refresh()
    return chain


def test_assembly_within_limits_holds_them_and_finds_the_other_branch():
    """From any guess, limits of the coupler leave one of the two ways to close the four-bar."""
    guesses = ([1.2, -0.7, 2.0], [1.2, -2.0, -1.5])
    coupler = sorted(ladder(1).assemble(guess, ["crank_0"])[1] for guess in guesses)
    assert coupler[1] - coupler[0] > 0.5
    middle = sum(coupler) / 2
    for lower, upper in ((-4, middle), (middle, 4)):
        chain = limited([-4, lower, -4], [4, upper, 4])
        for seed in range(5):
            guess = 2 * np.random.default_rng(seed).normal(size=3)
            guess[0] = 1.2
            q = chain.assemble(guess, ["crank_0"], limits=True, tries=20)
            assert lower <= q[1] <= upper
            assert np.abs(chain.residual(q)).max() < 1e-11


def test_limits_that_no_configuration_meets_are_named():
    """Which joints are at a limit when the loop stays open; without limits it closes."""
    q = ladder(1).assemble([1.2, -0.7, 2.0], ["crank_0"])
    chain = limited(q - 4, q + np.array([4, 4, -0.2]))
    with pytest.raises(ClosureError, match="rocker_0 at a limit"):
        chain.assemble(q, ["crank_0", "coupler_0"], limits=True)
    assert_allclose(chain.assemble(q, ["crank_0"]), q)
    for lower, upper, held in (
        (q - np.array([-0.1, 4, 4]), q + 4, "crank_0"),
        (q - np.array([4, 4, -0.2]), q + np.array([4, 4, 0.1]), "rocker_0"),
    ):
        with pytest.raises(ClosureError, match=f"empty ranges: {held}"):
            limited(lower, upper).assemble(q, ["crank_0"], limits=True)


def test_positions_are_given_by_name():
    """Coordinates are held; a joint that is none, too, if it is named."""
    chain = four_bar()
    crank, rocker = (chain.position_names.index(name) for name in ("crank", "rocker"))
    by_crank = chain.assemble({"crank": chain.home[crank] + 0.2})
    assert by_crank[crank] == chain.home[crank] + 0.2
    by_rocker = chain.assemble({"rocker": by_crank[rocker]})
    assert np.abs(by_rocker - by_crank).max() < 1e-9
    with pytest.raises(UnknownNameError, match="wheel"):
        chain.assemble({"wheel": 1.0})


def test_a_guess_without_quaternions_is_the_way_from_the_neutral_configuration():
    """A ball counts three angles there, four numbers in q; both lead to the same robot."""
    chain = delta()
    assert (chain.model.nq, chain.model.nv) == (19, 18)
    guess = pin.integrate(chain.model, pin.neutral(chain.model), np.full(18, 0.1))
    q = chain.assemble([0.1] * 18)
    assert np.array_equal(q, chain.assemble(guess))
    assert np.abs(chain.residual(q)).max() < 1e-11
    with pytest.raises(InputError, match=r"expected \(19,\)"):
        chain.assemble([0.1] * 17)
    with pytest.raises(InputError, match=r"quaternion at \d+ is zero"):
        chain.assemble(np.zeros(19))


def test_a_batch_of_guesses_is_assembled_sample_by_sample_and_open_ones_are_named():
    robot, random = five_bar(), np.random.default_rng(0)
    guesses = robot.home + 0.05 * random.normal(size=(2, 3, robot.model.nq))
    result = robot.assemble(guesses)
    assert result.shape == guesses.shape
    assert np.array_equal(result[1, 2], robot.assemble(guesses[1, 2]))
    guesses[0, 1, list(robot.motor_indices)] = np.pi, 0.0  # the elbows are too far apart
    with pytest.raises(ClosureError) as caught:
        robot.assemble(guesses)
    assert caught.value.samples == ((0, 1),)
    with pytest.raises(InputError, match="expected"):
        robot.assemble(guesses[..., :-1])
