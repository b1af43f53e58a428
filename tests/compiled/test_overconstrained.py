# SPDX-License-Identifier: BSD-2-Clause
"""Overconstrained loops: each choice of as many rows as rates is singular somewhere on the way."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.dynamics.quantities import Quantity
from tests.gallery import ladder
from tests.support.by_hand import add, at, mark


def loop(seed, lengths, twists, kind="6d", offsets=None):
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
        up = at(0, 0, 0.0 if offsets is None else offsets[k])
        points = 0.1 * random.normal(size=(3, 3)) @ random.normal(size=(3, 3))
        inertia = points @ points.T + 0.01 * np.eye(3)
        inertia = inertia.trace() * np.eye(3) - inertia
        body = pin.Inertia(random.uniform(0.5, 2), 0.2 * random.normal(size=3), inertia)
        joint = add(model, joint, pin.JointModelRZ(), f"joint_{k + 1}", where, body)
        where = up * bar
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


def threefold_bricard(seed, twist):
    """Six equal bars with twists that alternate."""
    return loop(seed, [0.3] * 6, [twist, -twist] * 3)


def line_symmetric_bricard(seed):
    """Six revolutes; each bar equals the one opposite to it."""
    random = np.random.default_rng(seed)
    lengths, twists = random.uniform(0.1, 0.5, 3), random.uniform(0.4, 1.4, 3)
    offsets = random.uniform(-0.1, 0.1, 3)
    return loop(seed, [*lengths] * 2, [*twists] * 2, offsets=[*offsets] * 2)


def trihedral_bricard(seed, lengths):
    """Six right twists that alternate; the squares of every other bar have the same sum."""
    a, b, c, d, e = lengths
    last = np.sqrt(a**2 + c**2 + e**2 - b**2 - d**2)
    return loop(seed, [*lengths, last], [np.pi / 2, -np.pi / 2] * 3)


def sarrus(seed, angle):
    """Three parallel axes and three other ones hold a straight line."""
    return loop(seed, [0.3, 0.3, 0.1, 0.25, 0.25, 0.1], [0, 0, angle, 0, 0, -angle])


ARCS, BARS = [0.4, 1.2, 1.0, 1.3], [0.1, 0.4, 0.3, 0.35]

#: Each has one degree of freedom; axes meet in a point where lengths are 0.
TURNING = {
    "Bennett": lambda: bennett(0, 0.5, 0.6, 1.4, "hinge"),
    "Bennett, welded": lambda: bennett(1, 0.5, 0.6, 1.4, "6d"),
    "Goldberg": lambda: goldberg(6, 1.3, 0.4, 0.5),
    "line-symmetric Bricard": lambda: line_symmetric_bricard(20),
    "spherical": lambda: loop(12, [0.0] * 4, ARCS, "hinge"),
    "planar": lambda: loop(15, BARS, [0.0] * 4, "hinge"),
    "planar drag link": lambda: loop(17, [0.4, 0.35, 0.38, 0.1], [0.0] * 4),
}
#: Their driven hinge turns back at dead points.
TURNING_BACK = {
    "threefold Bricard": lambda: threefold_bricard(8, 1.2),
    "trihedral Bricard": lambda: trihedral_bricard(55, [0.45, 0.2, 0.35, 0.3, 0.4]),
}
#: Singular as mechanisms where they are flat.
STOPPING = {"Sarrus": lambda: sarrus(18, 1.2)}


@cache
def both_paths(name):
    """A robot with kernels and one without."""
    kernels, reference = TURNING[name](), TURNING[name]()
    kernels.compile()
    return kernels, reference


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.slow] * (x != "Bennett")) for x in TURNING]
)
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


@pytest.mark.slow
@pytest.mark.parametrize("name", TURNING_BACK)
def test_loops_go_on_at_dead_points_of_their_hinge(name):
    """The coordinate fails there, the mechanism does not; the energy stays."""
    chain = TURNING_BACK[name]()
    q0 = chain.generic_configuration()
    chain.compile()
    motion = chain.simulate([0.0], q0, [3.0], np.linspace(0, 4, 1001), rtol=1e-10, atol=1e-10)
    assert not motion.stopped
    assert max(map(chain.condition_number, motion.q)) > 100
    # Ten thousand tolerances of the integrator.
    error = np.abs(sst_pin.energy_error(chain, motion)).max()
    assert error < 1e-6 * chain.kinetic_energy(motion.q[0], motion.va[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", STOPPING)
def test_loops_stop_where_they_are_singular(name):
    chain = STOPPING[name]()
    q0 = chain.generic_configuration()
    chain.compile()
    with pytest.warns(match="before a singularity"):
        motion = chain.simulate([0.0], q0, [3.0], np.linspace(0, 4, 20001), rtol=1e-9, atol=1e-9)
    assert chain.condition_number(motion.q[-1]) > 100


GALLERY = {"Bennett": sst_pin.robots.bennett, "Bricard": sst_pin.robots.bricard}
GALLERY |= {"agile wrist": sst_pin.robots.agile_wrist, "ladder": ladder}
GALLERY |= {"SST": sst_pin.SST}


@pytest.mark.parametrize("build", [*{**TURNING, **TURNING_BACK, **STOPPING, **GALLERY}.values()])
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
