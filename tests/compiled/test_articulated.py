# SPDX-License-Identifier: BSD-2-Clause
"""The inertia matrix, factorised by articulated bodies with loops."""

import casadi as ca
import numpy as np
import pytest

from sst_pin import ClosedChain, LineForce, robots
from sst_pin.compiled.articulated import ArticulatedBodies, groups
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from tests.gallery import ladder
from tests.support.derivative_cases import CASES


def equations_of(chain, near=None):
    return Equations(chain.mechanism, sample_configurations(chain.engine.reference, near))


def with_rotors_and_a_ram():
    """A ladder with rotors, and a cylinder of 3 kg from its second cell to its fourth one."""
    chain = ladder(4)
    model = chain.model.copy()
    model.armature = np.linspace(0.01, 0.03, model.nv)
    ram = LineForce("end_of_right_2", "end_of_rung_4", mass=3)
    return ClosedChain(model, chain.closures, chain.motor_names, lines=[ram])


def in_groups(e):
    tied = (e.tree.lines[k].row for k in e.parameters.line_masses(e.p))
    return groups(e.kinematics.tree, e.L, tied)


def test_the_cells_of_a_ladder_are_groups_from_the_tip_to_the_ground():
    chain = ladder(3)
    found = in_groups(equations_of(chain))
    assert [group.coordinates for group in found] == [[2], [1], [0]]
    for k, group in zip((3, 2, 1), found, strict=True):
        names = {chain.model.names[i] for i in group.links}
        assert names == {f"right_{k}", f"left_{k}", f"rung_{k}"}
        assert chain.model.names[group.base] == (f"rung_{k - 1}" if k > 1 else "universe")


def test_a_loop_around_others_is_one_group_with_them():
    """The crossings of a scissor lift are loops that all hang on the ground."""
    (group,) = in_groups(equations_of(robots.scissor_lift(2)))
    assert group.base == 0
    assert len(group.links) == robots.scissor_lift(2).model.nv


@pytest.mark.parametrize("name", ["ladder", "leg", "floating four-bar", "geared"])
def test_accelerations_are_those_of_the_inertia_matrix_of_the_reference_path(name):
    make, *arguments = CASES[name]
    case = make(*arguments)
    assert_inertia_is_that_of_the_reference_path(case.chain, case.home)


def test_rotors_and_masses_of_lines_count():
    chain = with_rotors_and_a_ram()
    e = assert_inertia_is_that_of_the_reference_path(chain, chain.generic_configuration())
    # The ram ties the cells whose joints are between its ends.
    assert [sorted(group.coordinates) for group in in_groups(e)] == [[1, 2, 3], [0]]


def assert_inertia_is_that_of_the_reference_path(chain, near):
    """1e-9: the condition numbers of the matrices are below 1e6."""
    e = equations_of(chain, near)
    factors = ArticulatedBodies(e.kinematics, e.tree, e.L, in_groups(e))
    n = chain.degrees_of_freedom
    b = ca.SX.sym("b", n)
    results = [factors.solve(b), ca.vertcat(*factors.diagonal), ca.vertcat(*factors.inverses)]
    function = ca.Function("solve", [e.q, e.p, b], results)
    p = e.parameters.pack(chain.mechanism, chain.mechanism.friction)
    random = np.random.default_rng(0)
    for q in sample_configurations(chain.engine.reference, near):
        inertia = chain.reduced_terms(q, np.zeros(n)).inertia
        forces = random.normal(size=n)
        x, diagonal, inverses = (result.full().ravel() for result in function(q, p, forces))
        assert np.allclose(x, np.linalg.solve(inertia, forces), rtol=1e-9, atol=1e-9 * abs(x).max())
        assert np.allclose(diagonal, np.diag(inertia), rtol=1e-10)
        assert np.isclose(np.prod(inverses), 1 / np.linalg.det(inertia), rtol=1e-9)
    return e


def test_each_cell_of_a_ladder_costs_the_same():
    """Operations of the factors and of a solution, within 2 %."""
    counts = []
    for cells in (4, 6, 8):
        e = equations_of(ladder(cells))
        factors = ArticulatedBodies(e.kinematics, e.tree, e.L, in_groups(e))
        b = ca.SX.sym("b", cells)
        function = ca.Function("count", [e.q, e.p, b], [factors.solve(b)], {"cse": True})
        counts.append(function.n_instructions())
    first, second = np.diff(counts)
    assert abs(second - first) < 0.02 * first
