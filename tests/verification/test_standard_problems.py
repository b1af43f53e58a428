# SPDX-License-Identifier: BSD-2-Clause
"""Standard problems against published results and equations written by hand, in short form.

docs/standard_problems.md has the whole motions.
"""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.data import PUBLISHED
from tests.gallery import andrews
from tests.gallery import standard_referees as referees
from tests.support.files import load

problems = load("scripts/pages/make_standard_problems.py")
markdown_tables = load("scripts/pages/markdown_tables.py")
read_table = markdown_tables.read_table
table_names = markdown_tables.table_names
every = cache(problems.problems)


@pytest.mark.slow
def test_andrews_mechanism_ends_where_it_is_published():
    """A03: seven angles and rates after 0.03 s, in which the crank turns two and a half times."""
    chain, published = andrews(), PUBLISHED["andrews"]
    start = chain.home, published["start_rates"]
    motion = chain.simulate(published["torques"], *start, np.array([0, 0.03]))
    q = [published["q"][name] for name in chain.joint_names]
    assert_allclose(motion.q[-1], q, rtol=0, atol=5e-9)
    assert_allclose(motion.va[-1], published["v"]["beta"], rtol=1e-9)


def test_andrews_torque_accelerations_and_forces_at_the_published_state():
    """The published accelerations follow from the published angles and rates to 1e-7."""
    chain, published = andrews(), PUBLISHED["andrews"]
    q, v, a = (
        np.array([published[x][name] for name in chain.joint_names]) for x in ("q", "v", "dv")
    )
    assert_allclose(chain.compute_torques(q, v[:1], a[:1]), 0.033, rtol=0, atol=5e-9)
    result = chain.joint_accelerations(q, v[:1], a[:1])
    assert_allclose(result, a, rtol=0, atol=3e-7 * np.abs(a).max())
    assert_allclose(chain.compute_accelerations(q, v[:1], [0.033]), a[:1], rtol=3e-7)
    (*_, forces) = problems.andrews_at_its_end()
    assert float(forces[-1]) < 3e-7


def test_the_home_of_andrews_is_the_published_start():
    start = {
        "beta": -0.0617138900142764496358948458001,
        "theta": 0.0,
        "gamma": 0.455279819163070380255912382449,
        "phi": 0.222668390165885884674473185609,
        "delta": 0.487364979543842550225598953530,
        "omega": -0.222668390165885884674473185609,
        "epsilon": 1.23054744454982119249735015568,
    }
    chain = andrews()
    assert_allclose(chain.home, [start[name] for name in chain.joint_names], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "end"),
    [
        pytest.param("n_four_bar_2", 1.0, marks=pytest.mark.slow),
        pytest.param("slider_crank", 0.5, marks=pytest.mark.slow),
        ("modelica_four_bar", 1.0),
        pytest.param("governor", 0.5, marks=pytest.mark.slow),
    ],
)
def test_motions_are_those_of_equations_written_by_hand(name, end):
    """A02 goes through the horizontal, where both loops are singular at once."""
    problem, t = every()[name], np.linspace(0, end, 6)
    motion = problem.of(problem.chain, problem.simulate(t))
    assert_allclose(motion, problem.independent(t), rtol=0, atol=1e-8)


def test_the_pendulum_is_where_the_library_has_the_row_of_four_bars():
    """Published with six and seven digits."""
    for published in PUBLISHED["n_four_bar"]["B0"]:
        B0 = referees.n_four_bar(published["loops"], np.array([0, published["t"]]))[-1]
        assert_allclose(B0, [published["x"], published["y"]], rtol=0, atol=2e-6)


def test_the_slider_crank_is_the_first_submission():
    """At 5 s the slider is at 0.24072 m, which only one submission has."""
    path = problems.FOLDER / "slider_crank.csv"
    slider = np.genfromtxt(path, delimiter=",", names=True)["slider_m"]
    right, wrong = PUBLISHED["slider_crank"]["slider"]
    assert abs(slider[-1] - right) < 1e-4
    assert abs(slider[-1] - wrong) > 1e-2


def test_the_energy_of_modelicas_four_bar_gives_dymolas_angles():
    """These have Dymola's tolerance of 1e-6."""
    angles = referees.modelica_four_bar(np.array([0, 0.1, 0.25]))
    assert_allclose(angles[1:], [0.573724169, 1.803753622], rtol=5e-6)


def test_the_page_shows_every_problem_with_picture_and_motion():
    """Each motion of the page is near its published end and its independent solution."""
    page = problems.PAGE.read_text(encoding="utf-8")
    assert table_names(page) == {*every()}
    for name, problem in every().items():
        table = read_table(page, name)
        assert table[0] == problems.HEADER
        assert f"standard_problems/{name}.csv" in page
        rows = np.genfromtxt(problems.FOLDER / f"{name}.csv", delimiter=",", names=True)
        assert rows.dtype.names == ("t_s", *problem.columns)
        for quantity, *_, off in table[1:]:
            if "time" not in quantity and off != "-" and "relative" not in quantity:
                # Forty loops are 81 bars of 600 J, fourteen times through a singular configuration.
                most = 1e-5 if name == "n_four_bar_40" else 1e-7
                assert float(off.split()[0]) < most, (name, quantity)
