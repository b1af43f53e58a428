# SPDX-License-Identifier: BSD-2-Clause
"""Loops that share no dependent joints are solved apart, and the whole is the same."""

import numpy as np
import pytest

from sst_pin import ClosedChain, Closure
from sst_pin.errors import SingularConfigurationError
from tests.support.link_tables import two_link_angles
from tests.support.planar_bars import planar

CRANK, COUPLER, ROCKER = 0.6, 0.5, 0.6
#: Crank of a loop, its kind, and the length of its fixed bar: loops 0 and 1 have the same crank;
#: hinges between parallel axes have redundant rows.
LOOPS = ((0, "3d", 1.0), (0, "hinge", 1.2), (2, "hinge", 1.0))


def dead_point(ground):
    """Angle of the crank at which coupler and rocker lie in one line."""
    diagonal = COUPLER + ROCKER
    return np.arccos((CRANK**2 + ground**2 - diagonal**2) / (2 * CRANK * ground))


def four_bars():
    """Three four-bars with two cranks."""
    bars, closures = [], []
    for k, (base, kind, ground) in enumerate(LOOPS):
        crank = f"crank_{base}"
        if k == base:
            bars.append((crank, "universe", 0.0, CRANK))
        bars.append((f"coupler_{k}", crank, CRANK, COUPLER))
        bars.append((f"rocker_{k}", "universe", ground, ROCKER))
        closures.append(Closure(f"coupler_{k}_end", f"rocker_{k}_end", kind))
    return ClosedChain(planar(bars), closures, ["crank_0", "crank_2"])


def closed(chain, *angles):
    """The configuration at angles of the cranks, every loop on the same side of its diagonal."""
    q = np.zeros(chain.model.nq)
    of_crank = dict(zip((0, 2), angles, strict=True))
    for k, (base, _, ground) in enumerate(LOOPS):
        angle = of_crank[base]
        rest = ground - CRANK * np.cos(angle), -CRANK * np.sin(angle)
        coupler, knee = two_link_angles(rest, (COUPLER, ROCKER), -1)
        joints = {f"crank_{base}": angle, f"coupler_{k}": coupler - angle}
        for name, x in (joints | {f"rocker_{k}": coupler + knee + np.pi}).items():
            q[chain.model.joints[chain.model.getJointId(name)].idx_q] = x.real
    return q


def test_a_loop_does_not_notice_what_the_others_do():
    """To the last bit: no number of another loop enters its equations."""
    chain, random = four_bars(), np.random.default_rng(2)
    (va, aa), (others_va, others_aa) = random.normal(size=(2, 2))
    here = chain.compute_torques(closed(chain, 0.9, 0.7), [va, 0.3], [aa, -0.2])
    there = chain.compute_torques(closed(chain, 0.9, -0.4), [va, others_va], [aa, others_aa])
    assert here[0] == there[0]
    assert here[1] != there[1]


@pytest.mark.parametrize(
    ("angles", "named"),
    [
        ((0.9, dead_point(1.0)), "coupler_2, rocker_2"),
        ((dead_point(1.2), 0.7), "coupler_1, rocker_1"),
        ((dead_point(1.2), dead_point(1.0)), "coupler_1, rocker_1, coupler_2, rocker_2"),
    ],
)
def test_a_singular_loop_is_named_and_no_other(angles, named):
    """Coupler and rocker in one line: the crank does not say which way they fold."""
    chain = four_bars()
    chain.compute_torques(closed(chain, 0.9, 0.7), np.zeros(2), np.zeros(2))
    with pytest.raises(SingularConfigurationError, match=rf"dependent joints {named};") as caught:
        chain.compute_torques(closed(chain, *angles), np.zeros(2), np.zeros(2))
    assert caught.value.condition_number > 1e7
