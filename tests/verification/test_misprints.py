# SPDX-License-Identifier: BSD-2-Clause
"""Where the paper's print is wrong: the printed form fails, ours holds, each by an outside witness.

The forms stand in `printed_forms`; the minus signs in the upper row of (62) are refuted in
`test_noc.test_printed_minus_signs_do_not_give_the_twist_of_the_star` too.
"""

import numpy as np
import pytest

import printed_forms as forms

SEED = 2012
#: Motions of the paper's robot, then one of each of as many others, with friction.
PAPER, OTHERS = 6, 6
CASES = forms.cases(SEED, PAPER, OTHERS)

#: Sums and products of a dozen numbers, times condition numbers up to 30 squared.
ROUNDING = 1e-11
#: Witnesses that are differences in time: rounding over the step of 1e-4 s, and the same again.
DIFFERENCES = 1e-8
#: What counts as wrong: a slip that would be seen in a plot.
WRONG = 0.05


def judge(found, tolerance):
    """The printed form fails and ours holds."""
    assert found.printed > WRONG
    assert found.ours < tolerance


@pytest.fixture(params=CASES, ids=range(PAPER + OTHERS))
def case(request):
    return request.param


@pytest.mark.parametrize("case", forms.circle(12))
def test_cross_product_of_eq_1_points_against_the_axis_of_eq_44(case):
    """All along the circle: e_{k+6} is e_{k+3} x s, as the angle beta_k of (29) wants it."""
    assert (np.sin(case.motion[0][2::3]) > 0.2).all()
    judge(forms.arc_normal(case), ROUNDING)


@pytest.mark.parametrize("seed", range(12))
def test_second_block_of_eq_7c_is_the_rate_of_phi_u(seed):
    """On a five-bar, which has the block sizes that the print needs."""
    judge(forms.passive_accelerations(np.random.default_rng(SEED + seed)), DIFFERENCES)


def test_eq_20_gives_accelerations(case):
    judge(forms.rate_of_joint_rates(case), ROUNDING)


@pytest.mark.parametrize("case", CASES[:PAPER])
def test_chain_of_eq_54_starts_from_the_base_once(case):
    """With its second factor from {02}, as in (33), it leads to the star's mass centre."""
    judge(forms.center_of_star(case), ROUNDING)


def test_minus_signs_of_eqs_59_to_61_do_not_turn_the_passive_links(case):
    judge(forms.spins_of_passive_links(case), DIFFERENCES)


def test_minus_signs_of_eq_62_do_not_move_the_star(case):
    """The lower row: its mass centre moves as plus signs say."""
    judge(forms.velocity_of_star(case), DIFFERENCES)


def test_omega_of_eq_67_is_a_cross_product_matrix(case):
    """Neither diag(omega) nor |omega| 1 gives omega x I omega."""
    judge(forms.gyroscopic_moments(case), DIFFERENCES)


def test_powers_of_eqs_74_to_76_need_the_moment_first(case):
    """In the order of (63), not of the words below it, t . w* is the rate of the kinetic energy."""
    judge(forms.power_of_inertia(case), DIFFERENCES)


@pytest.mark.parametrize("case", CASES[PAPER:])
def test_friction_of_eqs_87_to_96_opposes_the_rates(case):
    """A tau^f along the rates, a power "dissipated", breaks (82) and feeds the motors."""
    judge(forms.balance_of_powers(case), ROUNDING)
