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


def test_blocks_of_eq_7c_as_printed_do_not_fit_the_robot(case):
    """Six columns for the nine rates of the SST; with Phi_dot^u there are nine."""
    a = list(case.robot.actuated)
    u = [i for i in range(9) if i not in a]
    q = case.motion[0]
    Phi, Phi_dot = case.robot.Phi(q), case.robot.Phi_dot(q, case.rates)
    with pytest.raises(ValueError, match="mismatch"):
        np.hstack([Phi_dot[:, a], Phi[:, a]]) @ case.rates
    assert (np.hstack([Phi_dot[:, a], Phi_dot[:, u]]) @ case.rates).shape == (len(Phi),)


def test_eq_20_gives_accelerations(case):
    """L aa + L_dot va is q_ddot, not q_dot."""
    judge(forms.rate_of_joint_rates(case), ROUNDING)


@pytest.mark.parametrize("case", CASES[:PAPER])
def test_chain_of_eq_54_starts_from_the_base_once(case):
    """With its second factor from {02}, as in (33), it leads to the star's mass centre."""
    judge(forms.center_of_star(case), ROUNDING)


def test_minus_signs_of_eqs_59_to_61_do_not_turn_the_passive_links(case):
    """Their frames turn as plus signs say."""
    judge(forms.spins_of_passive_links(case), DIFFERENCES)


def test_minus_signs_of_eq_62_do_not_move_the_star(case):
    """The lower row: its mass centre moves as plus signs say."""
    judge(forms.velocity_of_star(case), DIFFERENCES)


def test_omega_of_eq_67_is_a_cross_product_matrix(case):
    """Neither diag(omega) nor |omega| 1 gives omega x I omega."""
    judge(forms.gyroscopic_moments(case), DIFFERENCES)


def test_mass_matrix_of_one_body_does_not_take_the_stacked_twist_of_eq_68(case):
    """6 x 6 on 6 r numbers; the stacked M of (69) fits."""
    twist = case.terms.T @ case.motion[1]
    with pytest.raises(ValueError, match="mismatch"):
        case.terms.M[:6, :6] @ twist
    assert (case.terms.M @ twist).shape == twist.shape


def test_powers_of_eqs_74_to_76_need_the_moment_first(case):
    """In the order of (63), not of the words below it, t . w* is the rate of the kinetic energy."""
    judge(forms.power_of_inertia(case), DIFFERENCES)


@pytest.mark.parametrize("case", CASES[PAPER:])
def test_friction_of_eqs_87_to_96_opposes_the_rates(case):
    """A tau^f along the rates, a power "dissipated", breaks (82) and feeds the motors."""
    judge(forms.balance_of_powers(case), ROUNDING)


def test_times_of_section_7_2_contradict_its_words():
    """1.7316 s for the NOC is 37 % less than 2.7612 s for virtual work, as Sect. 6.1 says."""
    noc, virtual_work = 1.7316, 2.7612
    assert not virtual_work < noc
    assert round(100 * (1 - noc / virtual_work)) == 37
