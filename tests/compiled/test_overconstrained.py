# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained loops: each choice of as many rows as rates is singular somewhere on the way."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.dynamics.quantities import Quantity
from tests.gallery import ladder
from tests.support.by_hand import add, mark


def loop(seed, lengths, twists, kind="6d"):
    """Revolute joints by Denavit and Hartenberg, the end welded to the base or the last a hinge."""
    random, n = np.random.default_rng(seed), len(lengths)
    model = pin.Model()
    model.name = f"loop_{n}"
    model.gravity.linear = 0.1 * random.normal(size=3)  # weak, so that all loops turn on
    where = pin.SE3(pin.Quaternion(random.normal(size=4)).normalized(), random.normal(size=3))
    bars = [
        pin.SE3(pin.rpy.rpyToMatrix(twist, 0, 0), np.array([a, 0, 0]))
        for a, twist in zip(lengths, twists, strict=True)
    ]
    joint, ground = 0, where.copy()
    for k, bar in enumerate(bars if kind == "6d" else bars[:-1]):
        points = 0.1 * random.normal(size=(3, 3)) @ random.normal(size=(3, 3))
        inertia = points @ points.T + 0.01 * np.eye(3)
        inertia = inertia.trace() * np.eye(3) - inertia
        body = pin.Inertia(random.uniform(0.5, 2), 0.2 * random.normal(size=3), inertia)
        joint = add(model, joint, pin.JointModelRZ(), f"joint_{k + 1}", where, body)
        where = bar.copy()
    if kind != "6d":
        ground = ground * bars[-1].inverse()
    mark(model, joint, "end", where)
    mark(model, 0, "ground", ground)
    return sst_pin.ClosedChain(model, [sst_pin.Closure("ground", "end", kind)], ["joint_1"])


def bennett(seed, ratio, twist, other, kind):
    """Opposite bars are equal, their lengths in proportion to the sines of their twists."""
    return loop(seed, [*ratio * np.sin([twist, other])] * 2, [twist, other] * 2, kind)


def goldberg(seed, a, b, c):
    """Five revolutes: two linkages of Bennett with a common bar removed."""
    lengths = [0.5 * np.sin(x) for x in (a, b, a, c)]
    return loop(seed, [*lengths, lengths[1] + lengths[3]], [a, b, a, c, b + c])


#: Each has one degree of freedom.
TURNING = {
    "Bennett": lambda: bennett(0, 0.5, 0.6, 1.4, "hinge"),
    "Bennett, welded": lambda: bennett(1, 0.5, 0.6, 1.4, "6d"),
    "Goldberg": lambda: goldberg(6, 1.3, 0.4, 0.5),
}


@cache
def both_paths(name):
    """A robot with kernels and one without."""
    kernels, reference = TURNING[name](), TURNING[name]()
    kernels.compile()
    return kernels, reference


@pytest.mark.slow
@pytest.mark.parametrize("name", TURNING)
def test_loops_turn_fully_by_kernels_and_follow_the_reference_path(name):
    """No kernel leaves a sample of a full turn to the reference path, where all is regular."""
    kernels, reference = both_paths(name)
    q0 = kernels.generic_configuration()
    motion = kernels.simulate([0.0], q0, [3.0], np.linspace(0, 8, 101), rtol=1e-9, atol=1e-9)
    assert not motion.stopped
    assert np.ptp(motion.q[:, 0]) > 2 * np.pi
    q, va = motion.q, motion.va
    aa = np.random.default_rng(0).normal(size=va.shape)
    for ours, theirs in (
        (kernels.compute_torques, reference.compute_torques),
        (kernels.compute_accelerations, reference.compute_accelerations),
    ):
        expected = theirs(q, va, aa)
        key, result = Quantity(ours.__name__.removeprefix("compute_")), np.empty_like(expected)
        assert not len(kernels.engine.kernel(key).many((q, va, aa), result))
        # Condition numbers are below 1e3.
        assert np.allclose(result, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


GALLERY = {"Bennett": sst_pin.robots.bennett, "Bricard": sst_pin.robots.bricard}
GALLERY |= {"agile wrist": sst_pin.robots.agile_wrist, "ladder": ladder}
GALLERY |= {"SST": sst_pin.SST}


@pytest.mark.parametrize("build", [*{**TURNING, **GALLERY}.values()])
def test_redundant_rows_hold_where_loops_are_open_by_the_tolerance(build):
    """Loops as open as they may be break their redundant rows; this is no refusal."""
    chain, random = build(), np.random.default_rng(0)
    mechanism, q = chain.mechanism, chain.generic_configuration()
    model, va = mechanism.model, np.ones(chain.degrees_of_freedom)
    closed = chain.joint_rates(q, va)
    for _ in range(20):
        way = random.normal(size=model.nv) * mechanism.rate_scale
        gap = np.abs(chain.residual(pin.integrate(model, q, 1e-6 * way)) * mechanism.row_scale)
        aside = pin.integrate(model, q, 0.99e-12 / gap.max() * way)
        assert np.allclose(chain.joint_rates(aside, va), closed, rtol=1e-3, atol=1e-3)


def test_an_open_loop_is_refused_whichever_row_is_open():
    chain = TURNING["Bennett"]()
    q = chain.generic_configuration()
    chain.compile()
    random, zero = np.random.default_rng(1), np.zeros(1)
    for _ in range(20):
        aside = q + 1e-5 * random.normal(size=3)
        assert chain.engine.torques(aside, zero, zero, None, None, 1) is None
