# SPDX-License-Identifier: BSD-2-Clause
"""`simulate` by kernels against `simulate` on the reference path."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, Closure, robots
from sst_pin.dynamics import dynamics
from tests.support import any_chain
from tests.support.planar_bars import DRAG_LINK, planar

T = np.linspace(0, 0.1, 6)
#: Torques and loads of each kind, small enough for light bars.
MOTIONS = {
    "torques that are constant": ([0.01, 0.02], {}),
    "a moment that changes": (
        0.1 * np.sin(np.outer(T, (3, 4))),
        {"platform_moment": lambda t, q, va: [t, np.sin(q[1]) / 10, -va[0] / 10]},
    ),
    "a moment and wrenches": (
        lambda t, q, va: (np.cos(q[[1, 3]]) - va) / 100,
        {
            "platform_moment": [0.01, 0.02, -0.03],
            "external_wrenches": lambda t, q, va: np.full((4, 6), -va[1] / 100),
        },
    ),
}


@pytest.fixture(scope="module")
def both():
    """A five-bar with friction and springs, as in test_same_numbers.py: compiled, and not."""
    bars = robots.five_bar()
    weak = dict.fromkeys(("viscous_friction", "coulomb_friction", "stiffness"), np.full(4, 0.005))
    given = bars.model, bars.closures, bars.motor_names
    compiled, reference = (ClosedChain(*given, **weak) for _ in range(2))
    compiled.compile()
    return compiled, reference


@pytest.mark.parametrize("name", MOTIONS)
def test_both_paths_take_the_same_motion_and_kernels_take_it_alone(both, name, monkeypatch):
    (torque, loads), q = MOTIONS[name], both[1].generic_configuration()
    motion = torque, q, [1, -1], T
    b = both[1].simulate(*motion, **loads, sign_width=0.5)

    def forbidden(*_):
        raise AssertionError("the reference path")

    monkeypatch.setattr(dynamics, "direct_dynamics", forbidden)
    a = both[0].simulate(*motion, **loads, sign_width=0.5)
    for part in ("q", "va", "aa", "tau"):
        assert np.abs(getattr(a, part) - getattr(b, part)).max() < 1e-10
    assert max(np.abs(both[0].residual(x)).max() for x in a.q) < 1e-13
    assert np.abs(a.q[-1] - q).max() > 1e-2  # it did move


@pytest.mark.parametrize("gap", [1e-9, 1e-4, 1e-2])
def test_rates_are_those_of_the_closed_loops(both, gap):
    """Where passive joints have drifted, and in a trial step that goes far off."""
    robot, (fast, slow) = both[1], (r._engine.state_space(0.0) for r in both)
    rng, passive = np.random.default_rng(2), [0, 1, 0, 1]
    for q, va, tau in zip(*any_chain.states(robot, 5, 1), strict=True):
        state = np.concatenate([q + gap * rng.choice((-1, 1), 4) * passive, va])
        assert np.abs(fast.closed(state) - q).max() < 1e-14 + gap * 1e-13
        wanted = slow.rate(state, tau, None)
        assert np.abs(fast.rate(state, tau, None) - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_loops_with_unit_vectors_are_closed_to_rounding_after_each_step():
    """Steps of 0.06 rad change the length of cosine-sine pairs by some 1e-10."""
    model = planar(DRAG_LINK, pin.JointModelRUBZ)
    model.referenceConfigurations["home"] = pin.integrate(  # closed to 1e-2
        model, pin.neutral(model), np.array([0.5, 1.9, 1.74])
    )
    chain = ClosedChain(model, [Closure("coupler_end", "rocker_end", "3d")], ["crank"])
    chain.compile()
    motion = chain.rollout(np.zeros((8, 1)), chain.assemble(chain.home), [2.0], 0.03)
    # Lengths are below 1 m, and few turns follow each other: rounding is below 1e-15.
    assert np.abs(chain.residual(motion.q)).max() < 1e-14
    assert np.abs(motion.q[-1] - motion.q[0]).max() > 0.1  # it did move
