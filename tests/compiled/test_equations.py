# SPDX-License-Identifier: BSD-2-Clause
"""The equations on symbols, held against the reference path by numbers put in."""

import casadi as ca
import numpy as np
import pytest

from sst_pin.compiled import kernels
from sst_pin.compiled.elimination import pivot_order
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from tests.gallery import ladder
from tests.support import any_chain, link_tables

SPRUNG = ("translation", "spherical", "continuous", "universal")
MIMICKING = ("6d", "3d", "hinge")
#: A planar joint is in test_casadi_functions.py and below a disc; joints are in welded loops.
CHAINS = (
    {
        f"joint {name}": lambda name=name: any_chain.with_joint(name)
        for name in any_chain.JOINTS
        if name != "planar"
    }
    | {
        f"closure {kind}": lambda kind=kind: any_chain.chain(kind=kind)
        for kind in any_chain.CLOSURES
        if kind != "6d"
    }
    | {f"springs {name}": lambda name=name: any_chain.sprung(name) for name in SPRUNG}
    | {f"mimic {kind}": lambda kind=kind: any_chain.mimicking(kind) for kind in MIMICKING}
    | {
        "floating on a plane": lambda: any_chain.with_joint("free-flyer", kind="planar"),
        "welded in a row": any_chain.welded_in_a_row,
        "rods": any_chain.rods,
        "coupled": any_chain.coupled,
        "disc": lambda: any_chain.rolling(False),
        "ball": lambda: any_chain.rolling(True),
        "coordinates other than motors": lambda: any_chain.chain(
            kind="3d", coordinates=["arm_1", "arm_2", "arm_3", "arm_4"], actuated=["body"]
        ),
        "planar 3-RRR": lambda: link_tables.planar_3rrr().chain(),
        "loops that hang on loops": lambda: ladder(3),
    }
)
#: One of each sort; the others are slow tests.
QUICK = (
    *("joint HZ", "closure universal", "springs spherical", "mimic hinge", "floating on a plane"),
    *("welded in a row", "rods", "coupled", "ball", "loops that hang on loops"),
    "coordinates other than motors",
)


class Numbers:
    """Kernels of a chain as functions of numbers."""

    def __init__(self, chain):
        chain.generic_configuration()
        self.mechanism = chain.mechanism
        samples = sample_configurations(chain.engine.reference)
        self.equations = Equations(self.mechanism, samples)
        self.made = {}

    def __call__(self, name, *inputs):
        if name not in self.made:
            quantity, _, frame = name.partition(" ")
            kernel = kernels.make(self.equations, quantity, frame=frame or None)
            given = [*kernel.inputs.values(), kernel.parameters]
            self.made[name] = ca.Function("kernel", given, [kernel.output, kernel.checks])
        numbers = self.equations.parameters.pack(self.mechanism, self.mechanism.friction)
        output, checks = self.made[name](*inputs, numbers)
        assert (checks.full() <= 1).all()
        return output.full().ravel()


def relative(a, b):
    return np.abs(np.ravel(a) - np.ravel(b)).max() / np.abs(b).max()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CHAINS]
)
def test_every_joint_and_closure_gives_what_the_reference_path_gives(name):
    """To rounding times the condition numbers, which are below 100."""
    chain = CHAINS[name]()
    numbers, n = Numbers(chain), chain.degrees_of_freedom
    random = np.random.default_rng(1)
    for q, va, aa in zip(*any_chain.states(chain, 3, 0), strict=True):
        f = chain.generalized_forces(q, va, aa)
        tau = random.normal(size=len(chain.motor_names))
        assert relative(numbers("generalized_forces", q, va, aa), f) < 1e-11
        accelerations = chain.compute_accelerations(q, va, tau)
        assert relative(numbers("accelerations", q, va, tau), accelerations) < 1e-9
        assert relative(numbers("rates", q, va), chain.joint_rates(q, va)) < 1e-11
        terms = chain.reduced_terms(q, va)
        row = np.concatenate([np.ravel(term) for term in terms])
        for got, term in zip(
            np.split(numbers("reduced_terms", q, va), [n * n, 2 * n * n, 2 * n * n + n]),
            terms,
            strict=True,
        ):
            assert np.abs(got - np.ravel(term)).max() < 1e-11 * np.abs(row).max()
        dv = chain.joint_accelerations(q, va, aa)
        assert relative(numbers("joint_accelerations", q, va, aa), dv) < 1e-11
        frame = chain.model.frames[-1].name
        J = chain.frame_jacobian(q, frame)
        assert relative(numbers(f"frame_jacobian {frame}", q), J) < 1e-11
        for way in ("frame_jacobian_rate", "frame_velocity_derivatives", "frame_drift"):
            expected = np.hstack(getattr(chain, way)(q, va, frame)).ravel()
            error = np.abs(numbers(f"{way} {frame}", q, va) - expected).max()
            assert error < 1e-11 * max(np.abs(expected).max(), np.abs(J).max())


@pytest.mark.parametrize("name", any_chain.IN_A_ROW)
def test_a_joint_of_several_turns_is_these_turns_in_a_row(name):
    one = any_chain.with_joint(name)
    row = any_chain.chain(any_chain.IN_A_ROW[name][1])
    numbers = Numbers(one)
    row.generic_configuration()
    assert row.degrees_of_freedom == one.degrees_of_freedom
    for q, va, aa in zip(*any_chain.states(row, 3, 0), strict=True):
        expected = row.generalized_forces(q, va, aa)
        assert relative(numbers("generalized_forces", q, va, aa), expected) < 1e-11


def test_pivots_avoid_elements_that_vanish_in_a_sample():
    """The first entry is the sparsest pivot but vanishes in the second sample."""
    values = np.array([[[1.0, 0.0], [1.0, 1.0]], [[1e-9, 0.0], [1.0, 1.0]]])
    values[:, 0, 1] = 0.5
    order, _ = pivot_order(values.any(axis=0), values)
    assert (0, 0) not in order
