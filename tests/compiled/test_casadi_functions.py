# SPDX-License-Identifier: BSD-2-Clause
"""The dynamics as functions of CasADi."""

import pickle

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.robots import five_bar, four_bar, scissor_lift, stewart
from tests.support import any_chain, link_tables
from tests.support.command_line import said_without
from tests.support.derivative_cases import WIDTH, derivative, of_gallery

#: Redundant rows, and a turn in q as a point of a circle; all kinds of rows: test_equations.py.
CHAINS = {"four-bar": four_bar, "planar": lambda: any_chain.with_joint("planar")}
#: Each takes seconds.
LARGE = {
    "SST": sst_pin.SST,
    "free-flyer": lambda: any_chain.with_joint("free-flyer", kind="hinge"),
    "Stewart": stewart,
}


@pytest.fixture(
    scope="module", params=[*CHAINS, *(pytest.param(n, marks=pytest.mark.slow) for n in LARGE)]
)
def chain(request):
    return (CHAINS | LARGE)[request.param]()


@pytest.fixture(scope="module")
def functions(chain):
    return chain.casadi()


def states(chain, count):
    return zip(*any_chain.states(chain, count, 0), strict=True)


def close(actual, expected, tolerance):
    expected = np.asarray(expected)
    actual = actual if isinstance(actual, np.ndarray) else ca.DM(actual).full()
    actual = actual.reshape(expected.shape)
    error = np.abs(actual - expected).max(initial=0)
    assert error <= tolerance * np.abs(expected).max(initial=1)


def test_functions_give_what_the_chain_gives(chain, functions):
    """Friction sharp, so that the sign is one: rates are above 1e-2 where it counts."""
    sharp = chain.casadi(sign_width=1e-9)
    for q, va, aa in states(chain, 3):
        f = chain.generalized_forces(q, va, aa)
        close(sharp.generalized_forces(q, va, aa), f, 1e-11)
        if functions.motors == functions.n:
            close(sharp.torques(q, va, aa), chain.compute_torques(q, va, aa), 1e-11)
        tau = np.linspace(-1, 1, functions.motors)
        close(sharp.accelerations(q, va, tau), chain.compute_accelerations(q, va, tau), 1e-9)
        close(functions.rates(q, va), chain.joint_rates(q, va), 1e-11)
        frame = chain.model.frames[-1].name
        close(functions.frame_jacobian(frame)(q), chain.frame_jacobian(q, frame), 1e-11)
        assert np.abs(functions.residual(q).full()).max() < 1e-9


def test_a_step_is_that_of_a_rollout(chain, functions):
    """No joint faster than 1: what the loops open by within a step is below 1e-15."""
    for q, va, _ in states(chain, 2):
        tau = np.linspace(-1, 1, functions.motors)
        slow = va / np.abs(chain.joint_rates(q, va)).max()
        motion = chain.rollout(tau[None], q, slow, 1e-4)
        q_next, va_next = functions.step(q, slow, tau, 1e-4)
        close(q_next, motion.q[1], 1e-12)
        close(va_next, motion.va[1], 1e-9)


def test_derivatives_along_tangents_are_those_of_the_closed_robot(chain, functions):
    f = functions.generalized_forces
    for q, va, aa in states(chain, 2):
        d = chain.torque_derivatives(q, va, aa)
        by_q, by_va, by_aa = f.jacobian()(q, va, aa, 0)
        close(by_q @ functions.tangent(q), d.dq, 1e-10)
        close(by_va, d.dva, 1e-10)
        close(by_aa, d.daa, 1e-10)
        for given, expected in zip(functions.torque_derivatives(q, va, aa), d, strict=True):
            close(given, expected, 1e-10)
        tau = np.linspace(-1, 1, functions.motors)
        da = chain.acceleration_derivatives(q, va, tau)
        for given, expected in zip(functions.acceleration_derivatives(q, va, tau), da, strict=True):
            close(given, expected, 1e-9)
        close(functions.q_rates(q, va), functions.tangent(q) @ va, 1e-13)


@pytest.fixture(scope="module")
def loaded_five_bar():
    """A five-bar with friction and springs, its functions, and a state."""
    case = of_gallery("five_bar")
    q, va, aa, _ = next(case.states(1))
    return case, case.chain.casadi(case.home, sign_width=WIDTH), (q, va, aa)


def test_second_derivatives_are_those_of_differences_and_symmetric(loaded_five_bar):
    """Differences of exact first derivatives; each coordinate is one joint."""
    case, functions, (q, va, aa) = loaded_five_bar
    n, (way, dva, daa) = len(va), (case.way(q, np.random.default_rng(k)) for k in range(3))

    def first(s):
        at = case.at(q, way, s), va + s * dva, aa + s * daa
        return np.concatenate(case.chain.torque_derivatives(*at, sign_width=WIDTH), axis=1)

    blocks = functions.torque_derivatives.jacobian()(q, va, aa, 0, 0, 0)
    second, tangent = [], functions.tangent(q).full()
    for k in range(3):  # rows of dq, dva, daa, column after column, by q, va, aa
        by_q, *others = (x.full() for x in blocks[3 * k : 3 * k + 3])
        rows = np.hstack([by_q @ tangent, *others])
        second.append(rows.reshape(n, n, 3 * n).swapaxes(0, 1))
    second = np.concatenate(second, axis=1)
    close(second @ np.concatenate([way, dva, daa]), derivative(first), 1e-7)
    close(second, np.swapaxes(second, 1, 2), 1e-12)
    assert not second[:, 2 * n :, n:].any()  # torques are linear in aa, with factors of q


def test_derivatives_of_a_step_are_those_of_differences(loaded_five_bar):
    """Differences of rollouts by the chain, from neighbours and with other torques."""
    case, functions, (q, va, _) = loaded_five_bar
    random, chain, dt = np.random.default_rng(0), case.chain, 1e-4
    tau, push = random.uniform(-1, 1, (2, len(chain.motor_names)))
    way, dva = case.way(q, random), case.way(q, random)

    def end(s):
        at = case.at(q, way, s), va + s * dva
        motion = chain.rollout([tau + s * push], *at, dt, sign_width=WIDTH)
        return np.concatenate([motion.q[1], motion.va[1]])

    blocks = [x.full() for x in functions.step.jacobian()(q, va, tau, dt, 0, 0)]
    by_q, by_va, by_tau = (np.vstack([blocks[k], blocks[k + 4]]) for k in range(3))
    slope = by_q @ functions.tangent(q).full() @ way + by_va @ dva + by_tau @ push
    close(slope, derivative(end), 1e-7)


def test_the_residual_fixes_all_but_the_coordinates(chain, functions):
    """The rows are independent and complete: they allow the tangent's motions only."""
    q = chain.generic_configuration()
    rows = functions.residual.jacobian()(q, 0).full()
    T = functions.tangent(q).full()
    assert len(rows) == functions.nq - functions.n
    assert np.linalg.matrix_rank(rows, 1e-9) == len(rows)
    assert np.abs(rows @ T).max() < 1e-11 * np.abs(T).max()
    assert np.linalg.matrix_rank(T, 1e-9) == functions.n


def test_wrenches_are_an_input_where_they_are_asked_for():
    chain = link_tables.four_bar(link_tables.SKEW_PLANE).chain()
    functions = chain.casadi(external_wrenches=True, sign_width=1e-9)
    wrenches = np.random.default_rng(0).normal(size=(len(chain.joint_names), 6))
    for q, va, aa in states(chain, 2):
        f = chain.generalized_forces(q, va, aa, external_wrenches=wrenches)
        close(functions.generalized_forces(q, va, aa, wrenches), f, 1e-11)
        named = functions.torques(q=q, va=va, aa=aa, external_wrenches=wrenches)
        tau = chain.compute_torques(q, va, aa, external_wrenches=wrenches)
        close(named["tau"], tau, 1e-11)
        # No joint faster than 1, nor its rate: the loops open by less than 1e-12 within a step.
        slow = va / np.abs(chain.joint_rates(q, va)).max()
        slowly = aa / np.abs(chain.joint_accelerations(q, 0 * va, aa)).max()
        tau = chain.compute_torques(q, slow, slowly, external_wrenches=wrenches)
        motion = chain.rollout(tau[None], q, slow, 1e-5, external_wrenches=wrenches)
        close(functions.step(q, slow, tau, 1e-5, wrenches)[0], motion.q[1], 1e-12)


def test_compiled_functions_are_the_plain_ones_with_their_first_derivatives():
    """Values and Jacobians to rounding; there are no second derivatives.

    Rows of one number, those of a four-bar, a matrix library may take for columns.
    """
    for chain in (four_bar(), five_bar()):
        plain, ours = chain.casadi(), chain.casadi(compiled=True)
        assert ours.torques.class_name() == "External"
        for q, va, aa in states(chain, 2):
            for name, arguments in {"torques": (q, va, aa), "residual": (q,)}.items():
                f, g = getattr(plain, name), getattr(ours, name)
                close(g(*arguments), f(*arguments), 1e-13)
                jacobians = [h.jacobian().call([*arguments, 0]) for h in (g, f)]
                for block, expected in zip(*jacobians, strict=True):
                    close(block, expected, 1e-12)
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated for jac_torques"):
        ours.torques.jacobian().jacobian()


def test_functions_pickle_map_and_know_names():
    chain = four_bar()
    functions = chain.casadi()
    assert functions.torques.name_in() == ["q", "va", "aa"]
    assert functions.step.name_out() == ["q_next", "va_next"]
    again = pickle.loads(pickle.dumps(functions.torques))
    q, va, aa = any_chain.states(chain, 4, 0)
    expected = [again(*state).full().ravel() for state in zip(q, va, aa, strict=True)]
    assert np.array_equal(functions.torques.map(4)(q.T, va.T, aa.T).full().T, expected)
    assert "nq=3, n=1, motors=1" in repr(functions)


def test_what_there_is_not_has_its_error():
    known = scissor_lift()
    homeless = pin.Model(known.model)
    del homeless.referenceConfigurations["home"]
    lift = sst_pin.ClosedChain(homeless, known.closures, known.motor_names)
    assert lift.compute_torques(known.home, [0.0], [0.0]).shape == (1,)  # it stands opened
    assert lift.casadi().n == known.degrees_of_freedom
    known = four_bar()
    idle = sst_pin.ClosedChain(known.model, known.closures, [])
    with pytest.raises(sst_pin.errors.ActuationError, match="0 of 1 forces along the coordinates"):
        _ = idle.casadi().torques
    q, va = known.home, [0.2]
    given = idle.casadi().acceleration_derivatives(q, va, [])
    for ours, expected in zip(given, idle.acceleration_derivatives(q, va, []), strict=True):
        close(ours, expected, 1e-9)
    with pytest.raises(sst_pin.UnknownNameError, match="nowhere"):
        idle.casadi().frame_placement("nowhere")
    with pytest.raises(sst_pin.InputError, match="sign_width"):
        four_bar().casadi(sign_width=0)


def test_without_casadi_the_extra_is_named():
    assert "[compile]" in said_without("casadi", "sst_pin.robots.four_bar().casadi()")
