# SPDX-License-Identifier: BSD-2-Clause
"""Elimination block by block, and loops that share links."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, Distance, robots
from sst_pin.compiled import kernels, shared_links
from sst_pin.compiled.elimination import (
    Blocks,
    Definition,
    Factors,
    Orthogonal,
    triangular_blocks,
)
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from tests.gallery import n_four_bar


def equations(chain):
    return Equations(chain.mechanism, sample_configurations(chain.engine.reference))


def tilted(chain):
    """The same robot with its base at an oblique placement: no entry of Phi is zero by chance."""
    model = chain.model.copy()
    turn = pin.exp3(np.array([0.3, 1.2, -0.7]))
    base = pin.SE3(turn, np.array([1, -2, 0.5]))
    for i in range(1, model.njoints):
        if not model.parents[i]:
            model.jointPlacements[i] = base * model.jointPlacements[i]
    for frame in model.frames:
        if not frame.parentJoint and frame.name != "universe":
            frame.placement = base * frame.placement
    return ClosedChain(model, chain.closures, chain.motor_names)


def operations(kernel):
    inputs = [*kernel.inputs.values(), kernel.parameters]
    results = [ca.vertcat(kernel.output, kernel.checks)]
    return ca.Function("count", inputs, results, {"cse": True}).n_instructions()


def test_blocks_are_found_in_a_matrix_whose_rows_and_columns_are_shuffled():
    random = np.random.default_rng(0)
    sizes = [1, 3, 2, 1, 2]
    ends = np.cumsum(sizes)
    block_of = np.repeat(range(5), sizes)
    pattern = block_of[:, None] == block_of  # dense blocks
    pattern |= (block_of[:, None] > block_of) & (random.uniform(size=(9, 9)) < 0.5)
    order = random.permutation(9)
    blocks = triangular_blocks(pattern[np.ix_(order, order)])
    assert sorted(sorted(order[block].tolist()) for block in blocks) == [
        list(range(end - size, end)) for end, size in zip(ends, sizes, strict=True)
    ]
    known = set()
    for block in blocks:
        known.update(block.tolist())
        for i in block:
            assert known.issuperset(np.flatnonzero(pattern[np.ix_(order, order)][i]))


def test_blocks_solve_with_an_auxiliary_unknown_and_without_one_alike():
    """The matrix [A 0; C B], where C x is known by an auxiliary unknown only."""
    random = np.random.default_rng(1)
    A, B, row, column = (random.normal(size=size) for size in ((2, 2), (2, 2), 2, 2))
    whole = np.block([[A, np.zeros((2, 2))], [np.outer(column, row), B]])
    entries = [dict(enumerate(line)) for line in whole]
    blocks = [Factors(entries, [(0, 0), (1, 1)]), Factors(entries, [(2, 2), (3, 3)])]
    auxiliary = {7: dict(enumerate(-row)) | {9: 1.0}}  # x_9 = row . (x_0, x_1)
    for i in (0, 1):
        auxiliary[i] = entries[i]
        auxiliary[2 + i] = {9: column[i]} | {2 + j: B[i, j] for j in (0, 1)}
    b = random.normal(size=4)
    by_auxiliary = Blocks(auxiliary, [blocks[0], Definition(7, 9), blocks[1]])
    for system in (Blocks(dict(enumerate(entries)), blocks), by_auxiliary):
        x = system.solve(dict(enumerate(b)))
        y = system.solve_transposed(dict(enumerate(b)))
        assert np.allclose([x[j] for j in range(4)], np.linalg.solve(whole, b), rtol=1e-12)
        assert np.allclose([y[i] for i in range(4)], np.linalg.solve(whole.T, b), rtol=1e-12)
        assert x.keys() == y.keys() == set(range(4))


def rows_of_a_hand(fingers):
    """Random rows of six motors for each finger: three columns of all, then three of its own."""
    random = np.random.default_rng(2)
    rows = []
    for finger in range(fingers):
        columns = [0, 1, 2, *range(3 + 3 * finger, 6 + 3 * finger)]
        rows += [dict(zip(columns, random.normal(size=6), strict=True)) for _ in range(6)]
    return rows, range(3 + 3 * fingers)


def test_orthogonal_factors_solve_least_squares_and_least_norms():
    """The condition number is 6."""
    rows, columns = rows_of_a_hand(3)
    A = np.array([[row.get(j, 0.0) for j in columns] for row in rows])
    factors = Orthogonal(rows, dict.fromkeys(range(18), 1.0), columns)
    random = np.random.default_rng(3)
    b, c = random.normal(size=18), random.normal(size=12)
    x = factors.solve(dict(enumerate(b)))
    y = factors.solve_transposed(dict(enumerate(c)))
    assert np.allclose([x[j] for j in columns], np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-11)
    assert np.allclose([y[i] for i in range(18)], np.linalg.pinv(A.T) @ c, rtol=1e-11)


def test_twice_the_fingers_take_twice_the_operations_of_orthogonal_factors():
    """2.3 leaves some room: with the shared columns first it would take 6.5 times as many."""

    def count(fingers):
        rows, columns = rows_of_a_hand(fingers)
        entries = [{j: ca.SX.sym("a") for j in row} for row in rows]
        factors = Orthogonal(entries, dict.fromkeys(range(len(rows)), 1.0), columns)
        inputs = ca.vertcat(*(x for row in entries for x in row.values()))
        return ca.Function("count", [inputs], [ca.vertcat(*factors.squares)]).n_instructions()

    assert count(8) < 2.3 * count(4)


@pytest.mark.parametrize("placed", [lambda chain: chain, tilted], ids=["upright", "tilted"])
def test_loops_on_shared_links_move_as_on_the_reference_path(placed):
    """1e-10: the condition number of its loops is below 1e3, roundings are 1e-16 for each cell."""
    chain = placed(robots.scissor_lift(5))
    e = equations(chain)
    assert len(e.factors.parts) == 6  # a loop for each cell and that of the platform's slider
    random = np.random.default_rng(2)
    q = chain.generic_configuration()
    va, aa = random.normal(size=(2, 1))
    numbers = e.parameters.pack(chain.mechanism, chain.mechanism.friction)
    expected = {
        "generalized_forces": (chain.generalized_forces(q, va, aa), aa),
        "accelerations": (chain.compute_accelerations(q, va, [300.0]), np.array([300.0])),
        "torque_derivatives": (np.hstack(chain.torque_derivatives(q, va, aa)), aa),
    }
    for name, (reference, last) in expected.items():
        kernel = kernels.make(e, name)
        inputs = [*kernel.inputs.values(), kernel.parameters]
        function = ca.Function("kernel", inputs, [kernel.output, kernel.checks])
        output, checks = function(q, va, last, numbers)
        assert (checks.full() <= 1).all()
        error = np.abs(output.full().ravel() - np.ravel(reference)).max()
        assert error < 1e-10 * np.abs(reference).max()


def chain_with_mimic_joint():
    """A planar chain of six joints on rods to the base; the last joint mimics the second one."""
    random = np.random.default_rng(1)
    model = pin.Model()
    for k in range(6):
        offset = pin.SE3(np.eye(3), np.array([0.4, 0.1, 0]))
        joint = model.addJoint(k, pin.JointModelRZ(), offset, f"joint_{k}")
        inertia = pin.Inertia(1.0, np.array([0.1, 0.05, 0.0]), 0.02 * np.eye(3))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model = pin.transformJointIntoMimic(model, 2, 6, 0.7, 0.1)
    q = pin.neutral(model) + 0.3 * random.normal(size=model.nq)
    rods = []
    for joint in (2, 3, 4, 6):
        ends = {}
        for name, body in (("ground", 0), ("end", joint)):
            place = pin.SE3(np.eye(3), np.array([*random.normal(size=2), 0]))
            ends[name] = model.addFrame(
                pin.Frame(f"{name}_{joint}", body, place, pin.FrameType.OP_FRAME)
            )
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        ground, end = (data.oMf[ends[name]].translation for name in ("ground", "end"))
        length = float(np.linalg.norm(end - ground))
        rods.append(Distance(f"ground_{joint}", f"end_{joint}", length))
    model.referenceConfigurations["home"] = q
    return ClosedChain(model, rods, ["joint_0"])


def test_a_rate_that_moves_several_shared_links_counts_in_each(monkeypatch):
    """Of a joint that a mimic joint follows, the twist of one link has only a part."""
    monkeypatch.setattr(shared_links, "_WORTH", 0.0)  # twists, although so small a robot has none
    chain = chain_with_mimic_joint()
    kernel = kernels.make(equations(chain), "accelerations")
    numbers = equations(chain).parameters.pack(chain.mechanism, chain.mechanism.friction)
    run = ca.Function("run", [*kernel.inputs.values(), kernel.parameters], [kernel.output])
    result = float(run(chain.home, [1.0], [0.5], numbers))
    # Two elimination orders of a well-conditioned system agree to some thousand roundings.
    assert result == pytest.approx(
        float(chain.compute_accelerations(chain.home, [1.0], [0.5])[0]), rel=1e-11
    )


@pytest.mark.parametrize("robot", [robots.scissor_lift, n_four_bar])
def test_twice_the_cells_take_twice_the_operations(robot):
    """2.3 leaves some room: a square would take 4 times as many."""
    small, large = equations(robot(4)), equations(robot(8))
    for quantity in ("generalized_forces", "accelerations", "torque_derivatives"):
        count = operations(kernels.make(small, quantity))
        assert operations(kernels.make(large, quantity)) < 2.3 * count, quantity
