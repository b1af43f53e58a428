# SPDX-License-Identifier: BSD-2-Clause
"""Loops that share no dependent joints are solved apart, and the whole is the same."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.sparse.csgraph import connected_components

import sst_pin
from sst_pin import ClosedChain, Closure, Coupling
from sst_pin.dynamics.dynamics import Memory
from sst_pin.errors import SingularConfigurationError
from sst_pin.loops.loops import connected
from sst_pin.model.mechanism import Friction, Mechanism, Springs
from tests.gallery import ladder
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
        bars += [(crank, "universe", 0.0, CRANK)] * (k == base)
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


def whole(chain, Phi, right):
    """Least squares over all loops at once: Phi x = right, coordinates at rest."""
    mechanism = chain.mechanism
    system = np.concatenate((Phi, mechanism.selection))
    zeros = np.zeros((len(mechanism.selection), right.shape[1]))
    return np.linalg.lstsq(system, np.concatenate((right, zeros)), rcond=None)[0]


ROBOTS = {
    "four-bars": (four_bars, 3),
    "ladder": (lambda: ladder(7), 7),
    "stewart": (sst_pin.robots.stewart, 1),
    "SST": (sst_pin.SST, 1),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_blocks_solve_what_all_loops_at_once_do(name):
    """L, and what closures need, against least squares over all rows; by how many blocks."""
    build, count = ROBOTS[name]
    chain, random = build(), np.random.default_rng(1)
    q = closed(chain, 0.9, 0.7) if name == "four-bars" else chain.generic_configuration()
    memory = Memory(chain.mechanism)
    memory.evaluate(q)
    Phi = memory.loops.Phi
    memory.complement.factorise(Phi)
    assert len(memory.complement.blocks) == count
    L, coordinates = memory.complement.L, memory.mechanism.coordinates
    assert np.array_equal(L[coordinates], np.eye(len(coordinates)))
    moved = -Phi[:, coordinates]
    expected = whole(chain, Phi, moved)
    expected[coordinates] += np.eye(len(coordinates))
    # Two ways with rounding of 1e-16 times condition numbers below 1e2.
    assert_allclose(L, expected, rtol=0, atol=1e-13 * np.abs(L).max())
    right = Phi @ random.normal(size=(chain.model.nv, 3))
    X = memory.complement.inverse @ right
    assert_allclose(X, whole(chain, Phi, right), rtol=0, atol=1e-13 * np.abs(X).max())
    assert not X[coordinates].any()
    va = random.normal(size=len(coordinates))
    x = memory.complement.accelerations(va, right[:, 0])
    assert_allclose(x, L @ va - X[:, 0], rtol=0, atol=1e-13 * np.abs(x).max())


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


def test_connected_parts_are_those_of_the_graph():
    """Random rows, also empty ones, and rates that are in no row."""
    random = np.random.default_rng(3)
    for _ in range(50):
        touched = random.random(size=random.integers(0, 12, size=2)) < 0.15
        n, m = touched.shape
        graph = np.block([[np.zeros((n, n)), touched], [touched.T, np.zeros((m, m))]])
        _, label = connected_components(graph, directed=False)
        parts = {
            (tuple(np.flatnonzero(label[:n] == k)), tuple(np.flatnonzero(label[n:] == k)))
            for k in set(label[n:].tolist())
        }
        found = [(tuple(rows), tuple(rates)) for rows, rates in connected(touched)]
        assert set(found) == parts
        assert len(found) == len(parts)


def hinges(count):
    """A chain of joints about z without coordinates, each held by a coupling."""
    model = pin.Model()
    for k in range(count):
        model.addJoint(k, pin.JointModelRZ(), pin.SE3.Identity(), f"joint_{k}")
    closures = tuple(Coupling(f"joint_{k}") for k in range(count))
    none = Friction(np.zeros(count), np.zeros(count))
    springs = Springs(np.zeros(count), np.zeros(count))
    nothing = np.empty(0, dtype=np.intp)
    return Mechanism(model, closures, nothing, np.empty((count, 0)), (), none, springs)
