# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives on CasADi's symbols and by compiled kernels, held against the reference path."""

import casadi as ca
import numpy as np
import pytest

from sst_pin.compiled import equations, kernels
from sst_pin.compiled.compiled_backend import DERIVATIVES, CompiledBackend
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from sst_pin.dynamics.quantities import Quantity
from sst_pin.model.mechanism import Friction
from tests.support.derivative_cases import CASES, WIDTH, close

#: Axes that move, polynomials and a rod, a plain loop; the others take a second or more.
QUICK = ("floating four-bar", "geared", "five_bar")
SOME = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in CASES
    if name != "four_bar"  # it goes through the code of a five-bar
]


def by_directions(kernel):
    """The function of a kernel along directions: its result and checks."""
    of = kernel.along
    solution = ca.SX(0, 1) if of.solution is None else of.solution.factors
    inputs = [*kernel.inputs.values(), kernel.parameters]
    once = ca.Function("once", inputs, [kernel.output, solution, kernel.checks])
    passes = [ca.Function("x", [*inputs, x.direction], [x.results, x.checks]) for x in of.passes]

    def computed(*numbers):
        known, factors, checks = (x.full().ravel() for x in once(*numbers))
        result, checks = np.zeros(of.size), [checks]
        result[of.places] = known
        for described, function in zip(of.passes, passes, strict=True):
            directions = np.eye(len(described.coordinates))
            for k, direction in zip(described.coordinates, directions, strict=True):
                column, more = (x.full().ravel() for x in function(*numbers, direction))
                for place, x in zip(described.places, column, strict=True):
                    result[place.first + k * place.stride] = x
                checks.append(more)
        if of.solution is not None:
            order, size = of.solution.order, len(of.solution.order)
            L = np.eye(size)
            for (i, j), x in zip(of.solution.entries, factors[size:], strict=True):
                L[i, j] = x
            A = np.empty((size, size))
            A[np.ix_(order, order)] = L / factors[:size] @ L.T
            result = np.linalg.solve(A, result.reshape(size, -1)).ravel()
        return result, np.concatenate(checks)

    return computed


@pytest.mark.parametrize("name", SOME)
def test_derivatives_are_those_of_the_reference_path_and_casadis_own(name):
    """The reference path's, those by one factorisation, and CasADi's of f itself.

    Five states; friction and springs everywhere, wrenches on all bodies.
    """
    make, *arguments = CASES[name]
    case = make(*arguments)
    chain, mechanism, n = case.chain, case.chain.mechanism, case.chain.degrees_of_freedom
    samples = sample_configurations(chain.engine.reference, case.home)
    e = Equations(mechanism, samples, loaded=True, smooth=True)
    friction = Friction(mechanism.friction.viscous, mechanism.friction.coulomb, WIDTH)
    p, functions = e.parameters.pack(mechanism, friction), {}
    sided = {}
    for key in DERIVATIVES:
        (kernel,) = kernels.entry(e, key)
        results = [ca.vertcat(kernel.output, ca.mmax(kernel.checks))]
        inputs = [*kernel.inputs.values(), kernel.parameters]
        functions[key] = ca.Function(kernel.name, inputs, results)
        (kernel,) = kernels.entry(e, key._replace(along=True))
        sided[key] = by_directions(kernel)
    f, along = e.generalized_forces, ca.horzcat(*(e.kinematics.q_rates(L) for L in e.L))
    plain = ca.horzcat(ca.jacobian(f, e.q) @ along, ca.jacobian(f, ca.vertcat(e.va, e.aa)))
    plain = ca.Function("plain", [e.q, e.va, e.aa, e.loads, e.p], [ca.densify(plain)])
    for q, va, aa, wrenches in case.states(5):
        options = {"sign_width": WIDTH, "external_wrenches": wrenches}
        df = np.concatenate(chain.torque_derivatives(q, va, aa, **options), axis=1)
        close(plain(q, va, aa, wrenches.ravel(), p).full(), df, 1e-10)
        tau = np.linspace(-2, 3, len(chain.motor_names))
        da = np.concatenate(chain.acceleration_derivatives(q, va, tau, **options), axis=1)
        for key, function in functions.items():
            x, expected = (aa, df) if key.name == "torque_derivatives" else (tau, da)
            *result, checks = function(q, va, x, wrenches.ravel(), p).full()
            assert checks.max() <= 1  # the kernel vouches for it
            close(np.reshape(result, (n, -1)), expected, 1e-10)
            result, checks = sided[key](q, va, x, wrenches.ravel(), p)
            assert checks.max() <= 1
            close(result.reshape(n, -1), expected, 1e-10)


@pytest.mark.parametrize(
    "name", ["floating four-bar", pytest.param("ladder", marks=pytest.mark.slow)]
)
def test_derivatives_by_articulated_bodies_are_the_same(name, monkeypatch):
    """As above, with the inertia factorised as that of robots with many coordinates."""
    monkeypatch.setattr(equations, "_LEAST_FOR_ARTICULATED", 0)
    monkeypatch.setattr(equations, "_MOST_FOR_WHOLE", 0)
    test_derivatives_are_those_of_the_reference_path_and_casadis_own(name)


@pytest.mark.parametrize("name", ["five_bar", "floating four-bar"])
def test_compile_with_derivatives_has_all_of_linearize_ready(name, monkeypatch):
    """What moving axes do to a displacement too, where there are some."""
    asked = []
    monkeypatch.setattr(CompiledBackend, "make", lambda _, keys: asked.extend(keys))
    make, *arguments = CASES[name]
    case = make(*arguments)
    case.chain.compile(case.home, derivatives=True)
    assert set(DERIVATIVES) < set(asked)
    assert (Quantity("displacement_rates") in asked) == (name == "floating four-bar")
