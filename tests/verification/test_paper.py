# SPDX-License-Identifier: BSD-2-Clause
"""The paper's equations hold, and where its print is wrong ours holds, by outside witnesses.

`paper_equations` measures what docs/paper.md lists; the misprints stand in `printed_forms`.
"""

import numpy as np
import pytest

from sst_pin.sst import kinematics
from tests.support.files import load

paper_equations = load("scripts/pages/paper_equations.py")
EQUATIONS = paper_equations.EQUATIONS
MISPRINTS = paper_equations.MISPRINTS
SEED = paper_equations.SEED
forms = load("scripts/pages/printed_forms.py")

#: Sums and products of a dozen numbers, times condition numbers up to 30 squared.
ROUNDING = 1e-11
#: Witnesses that are differences in time: rounding over the step of 1e-4 s, and the same again.
DIFFERENCES = 1e-8
BY_DIFFERENCES = ("(7c)", "(59)-(61)", "(62), lower row", "(67)", "(63), (74)-(76)")
#: Equations whose witness is not exact: differences, an integrator, four printed decimals.
INEXACT = {"(4), (5)": 1e-9, "(63)-(71)": 1e-9, "(94)": 1e-8}
INEXACT |= {"Sect. 7.3": 5e-5, "Sects. 6.2, 7.3": 1e-9}
#: What counts as wrong: a slip that would be seen in a plot.
WRONG = 0.05


@pytest.fixture(scope="module")
def cases():
    """Motions of the paper's robot, then one of each of as many others, with friction."""
    return forms.cases(SEED, 6, 6)


@pytest.mark.parametrize("numbers", EQUATIONS)
def test_the_equations_of_the_paper_hold(cases, numbers):
    assert EQUATIONS[numbers](cases) < INEXACT.get(numbers, ROUNDING)


@pytest.mark.parametrize("where", MISPRINTS)
def test_the_printed_form_fails_and_ours_holds(cases, where):
    printed, ours = zip(*MISPRINTS[where](cases), strict=True)
    assert min(printed) > WRONG
    assert max(ours) < (DIFFERENCES if where in BY_DIFFERENCES else ROUNDING)


def test_printed_minus_signs_do_not_give_the_twist_of_the_star(cases):
    """Eq. (62) as printed: gamma_dot e_1 - mu_dot e_4 - beta_dot e_7 is not omega_7."""
    for case in cases:
        legs = kinematics.legs_of_joints(case.robot.geometry, case.motion[0])
        axes = np.array((case.robot.geometry.e[0], legs.u[0], legs.n[0]))
        assert np.abs(case.rates[:3] @ axes - case.omega).max() < 1e-12
        assert np.abs(case.rates[:3] * (1, -1, -1) @ axes - case.omega).max() > 0.1


def test_the_axes_of_eq_1_are_judged_where_beta_is_between_0_and_pi():
    """All along the circle: there e_{k+6} is e_{k+3} x s, as the angle beta_k of (29) wants it."""
    for case in forms.circle(12):
        assert (np.sin(case.motion[0][2::3]) > 0.2).all()
