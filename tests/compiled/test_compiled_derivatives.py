# SPDX-License-Identifier: BSD-2-Clause
"""Derivatives on CasADi's symbols and by compiled kernels, held against the reference path."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain
from sst_pin.compiled import kernels
from sst_pin.compiled.compiled_backend import DERIVATIVES, CompiledBackend
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.generator_inputs import sample_configurations
from sst_pin.dynamics.quantities import Quantity
from sst_pin.model.mechanism import Friction
from tests.support.derivative_cases import (
    CASES,
    WIDTH,
    Case,
    assert_frames_move_as_differences_say,
    carried_four_bar,
    close,
    floating_four_bar,
    of_gallery,
)

#: Kernels for many samples, and for one.
ALL = (*DERIVATIVES, *(key._replace(along=True) for key in DERIVATIVES))
#: The others take a second or more.
QUICK = ("floating four-bar", "geared", "four_bar", "five_bar")
SOME = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]
COMPILED = {"five-bar": lambda: of_gallery("five_bar"), "floating four-bar": floating_four_bar}


def numbers(case, keys):
    """The reference path, kernels as functions of numbers, and f differentiated by CasADi."""
    chain = case.chain
    reference, mechanism = chain.engine.reference, chain.mechanism
    samples = sample_configurations(reference, case.home)
    equations = Equations(mechanism, samples, loaded=True, smooth=True)
    friction = mechanism.friction
    p = equations.parameters.pack(mechanism, Friction(friction.viscous, friction.coulomb, WIDTH))
    functions = {}
    for key in keys:
        (kernel,) = kernels.entry(equations, key)
        results = [ca.vertcat(kernel.output, ca.mmax(kernel.checks))]
        inputs = [*kernel.inputs.values(), kernel.parameters]
        functions[key] = ca.Function(kernel.name, inputs, results)
    e, f = equations, equations.generalized_forces
    along = ca.horzcat(*(e.kinematics.q_rates(L) for L in e.L))
    plain = ca.horzcat(ca.jacobian(f, e.q) @ along, ca.jacobian(f, ca.vertcat(e.va, e.aa)))
    plain = ca.Function("plain", [e.q, e.va, e.aa, e.loads, e.p], [ca.densify(plain)])

    def evaluated(key, q, va, x, wrenches):
        n = chain.degrees_of_freedom
        ways = [[way] for way in np.eye(n)] if key.along else [[]]
        columns = [functions[key](q, va, x, wrenches.ravel(), *way, p).full() for way in ways]
        results = np.hstack(columns)
        assert results[-1].max() <= 1  # the kernel vouches for it
        return results[:-1].reshape(n, -1)

    return evaluated, lambda *state: plain(*state[:3], state[3].ravel(), p).full()


def assert_all_ways_agree(case, count, keys=ALL):
    """The reference path's derivatives, those by one factorisation, and CasADi's of f itself."""
    chain = case.chain
    if len(chain.motor_names) != chain.degrees_of_freedom:
        keys = [key for key in keys if key != DERIVATIVES[1]._replace(along=True)]
    evaluated, plain = numbers(case, keys)
    options = {"sign_width": WIDTH}
    for k, (q, va, aa, wrenches) in enumerate(case.states(count)):
        options["external_wrenches"] = wrenches
        df = np.concatenate(chain.torque_derivatives(q, va, aa, **options), axis=1)
        close(plain(q, va, aa, wrenches), df, 1e-10)
        tau = np.linspace(-2, 3, len(chain.motor_names))
        da = np.concatenate(chain.acceleration_derivatives(q, va, tau, **options), axis=1)
        for key in keys:
            x, expected = (aa, df) if key.name == "torque_derivatives" else (tau, da)
            d = evaluated(key, q, va, x, wrenches)
            close(d, expected, 1e-10)
            if k > 2:
                continue
            inertia, motors = chain.noc(q, va).inertia, chain.actuator_jacobian(q).T
            by_x = d[:, 2 * len(va) :]
            if key.name == "torque_derivatives":
                close(by_x, inertia, 1e-12)
            else:  # condition numbers of inertia matrices of mixed units are up to 1e4
                close(inertia @ by_x, motors, 1e-10)


@pytest.mark.parametrize("name", SOME)
def test_derivatives_are_those_of_the_reference_path_and_casadis_own(name):
    """20 states; friction and springs everywhere, wrenches on all bodies."""
    make, *arguments = CASES[name]
    assert_all_ways_agree(make(*arguments), 20)


def test_a_turn_of_the_base_about_the_vertical_changes_nothing():
    """The yaw column of a four-bar on a yaw joint is zero, by every kernel."""
    model, closures, motors, start = carried_four_bar(pin.JointModelRZ())
    chain, random = ClosedChain(model, closures, motors), np.random.default_rng(0)
    case = Case(chain, chain, np.zeros(model.nv), chain.assemble(start))
    evaluated, _ = numbers(case, ALL)
    for q, va, x, wrenches in case.states(20):
        for key in ALL:
            dq = evaluated(key, q, va, random.uniform(-2, 2) * x, 0 * wrenches)[:, :2]
            assert np.abs(dq[:, 0]).max() < 1e-12 * np.abs(dq).max()


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=() if name == "five-bar" else pytest.mark.slow)
        for name in COMPILED
    ],
)
def compiled(request):
    """A case twice: by kernels, and by the reference path."""
    ours, reference = COMPILED[request.param](), COMPILED[request.param]()
    ours.chain.compile(ours.home, derivatives=True)
    return ours, reference


@pytest.mark.parametrize("name", COMPILED)
def test_compile_with_derivatives_has_all_of_linearize_ready(name, monkeypatch):
    """What moving axes do to a displacement too, where there are some."""
    asked = []
    monkeypatch.setattr(CompiledBackend, "make", lambda _, keys: asked.extend(keys))
    case = COMPILED[name]()
    case.chain.compile(case.home, derivatives=True)
    assert set(DERIVATIVES) < set(asked)
    assert (Quantity("displacement_rates") in asked) == (name == "floating four-bar")


OF_FRAMES = ("frame_jacobian_rate", "frame_velocity_derivatives", "frame_drift")


@pytest.mark.slow
def test_kernels_of_frames_say_what_differences_say(compiled):
    case, random = compiled[0], np.random.default_rng(2)
    for q, va, _, _ in case.states(5):
        assert_frames_move_as_differences_say(case, q, va, random)


@pytest.mark.slow
def test_the_reference_path_computes_a_frame_that_no_kernel_vouches_for(compiled):
    """A loop open by more than a kernel takes, and less than is an error."""
    ours, reference = compiled[0].chain, compiled[1].chain
    q, va, _, _ = map(np.array, zip(*compiled[0].states(6), strict=True))
    frame, rows = ours.model.frames[-1].name, np.empty((6, 6))
    closed, left = q[2, -1], []
    for step in np.geomspace(1e-8, 1e-4, 60):
        q[2, -1] = closed + step
        left = ours.engine.kernel(Quantity("frame_drift", frame)).many((q, va), rows)
        if len(left):
            break
    assert list(left) == [2]
    for name in OF_FRAMES:
        got, expected = (np.stack(getattr(x, name)(q, va, frame)) for x in (ours, reference))
        close(got, expected, 1e-11)
        one = np.stack(getattr(ours, name)(q[2], va[2], frame))
        many = got[:, 2] if name == "frame_velocity_derivatives" else got[2]
        assert np.array_equal(one, many)
