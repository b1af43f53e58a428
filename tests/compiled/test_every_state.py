# SPDX-License-Identifier: BSD-2-Clause
"""Kernels against the reference path on very many states, close to singular ones too."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import SST, ClosureError, SingularConfigurationError
from sst_pin.dynamics.quantities import Quantity
from tests.gallery import EVERY_ROBOT

#: Condition numbers up to which states are taken.
WORST = 1e4
#: A kernel leaves states to the reference path where one of its pivots is a thousandth of its size
#: elsewhere or less, or several small ones at once make elements grow, the order of elimination
#: being fixed. Pivots vanish on surfaces: of regular states that is some thousandths, of
#: ill-conditioned ones any part.
HANDED_OVER = 0.02
ILL = 100
NAMES = ["SST", *EVERY_ROBOT]


def wander(chain, start, count, seed):
    """Assembled configurations along random motions, each up to a singular configuration or so.

    Where the loops no longer close, or the condition number is above `WORST`, the step is halved,
    so that the motions end in states ever closer to singular ones.
    """
    random, result, conditions = np.random.default_rng(seed), [], []
    while len(result) < count:
        q, size = start, 0.3
        direction = chain.noc(q, np.zeros(chain.degrees_of_freedom)).L
        direction = direction @ random.normal(size=direction.shape[1])
        direction *= 0.3 / np.abs(direction).max()
        for _ in range(60):
            try:
                moved = chain.assemble(pin.integrate(chain.model, q, size * direction), fixed=())
                condition = chain.condition_number(moved)
            except (ClosureError, SingularConfigurationError):
                condition = np.inf
            if condition > WORST:
                size /= 2
                if size < 1e-4:
                    break
                continue
            q = moved
            result.append(q)
            conditions.append(condition)
    return np.array(result[:count]), np.array(conditions[:count])


def of_rounding(chain, forces_of, q, va, aa):
    """The most that forces change when q moves by its rounding, in 16 directions.

    Loops are open by some roundings, and q is known no better than that.
    """
    step = np.maximum(np.spacing(np.abs(q)), np.abs(chain.residual(q)).max())
    signs = np.random.default_rng(2).choice([-1, 1], size=(16, len(q)))
    return np.abs(forces_of(q + signs * step, va, aa) - forces_of(q, va, aa)).max()


def of_parts(forces_of, q, va, aa):
    """The largest force that the rates or the accelerations of a motion need alone."""
    alone = forces_of(q, va, 0 * aa), forces_of(q, 0 * va, aa)
    return np.abs(alone).max()


@pytest.mark.parametrize(
    ("name", "configurations"),
    [("five_bar", 20), *(pytest.param(n, 400, marks=pytest.mark.slow) for n in NAMES)],
)
def test_kernels_give_the_numbers_of_the_reference_path_or_leave_the_state_to_it(
    name, configurations
):
    """Five motions at each configuration; 1e-11 of the largest force of the motion.

    Above a condition number of 450 a hundred roundings times this number are more: both paths
    have no more digits there. Nor have they where great forces all but cancel each other: a motion
    that is beyond this may differ by as much of the forces that its rates and its accelerations
    need alone, or by what one rounding of q changes, in each of the two paths. Accelerations are
    judged by the forces that they take.
    """
    kernels, reference = (SST() if name == "SST" else EVERY_ROBOT[name]() for _ in range(2))
    kernels.compile()
    q, conditions = wander(reference, reference.home, configurations, 0)
    q, conditions = np.repeat(q, 5, axis=0), np.repeat(conditions, 5)
    va, aa = np.random.default_rng(1).normal(size=(2, len(q), reference.degrees_of_freedom))
    motors = len(reference.motor_names)
    allowed = np.maximum(1e-11, 100 * np.finfo(float).eps * conditions)
    assert kernels.backend.startswith("compiled")
    tau, result, backend = np.empty((len(q), motors)), np.empty_like(aa), kernels.engine.kernels
    expected = reference.compute_torques(q, va, aa)
    left = backend.kernel(Quantity("torques")).many((q, va, aa), tau)
    kept = np.delete(np.arange(len(q)), left)
    size = np.abs(expected).max(axis=1)
    for i in kept[~(np.abs(tau - expected).max(axis=1) < allowed * size)[kept]]:
        motion = q[i], va[i], aa[i]
        rounding = of_rounding(reference, reference.compute_torques, *motion)
        parts = of_parts(reference.compute_torques, *motion)
        assert np.abs(tau[i] - expected[i]).max() < max(2 * rounding, allowed[i] * parts)
    also_left = backend.kernel(Quantity("accelerations")).many((q, va, expected), result)
    kept = np.delete(np.arange(len(q)), also_left)
    forces_of = reference.generalized_forces
    taken, forces = (forces_of(q[kept], va[kept], x[kept]) for x in (result, aa))
    far = np.abs(taken - forces).max(axis=1)
    for k in np.flatnonzero(~(far < allowed[kept] * np.abs(forces).max(axis=1))):
        i = kept[k]
        rounding = of_rounding(reference, forces_of, q[i], va[i], aa[i])
        assert far[k] < max(2 * rounding, allowed[i] * of_parts(forces_of, q[i], va[i], aa[i]))
    for indices in (left, also_left):
        assert (conditions[indices] < ILL).sum() <= HANDED_OVER * len(q)
