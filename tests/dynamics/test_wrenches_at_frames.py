# SPDX-License-Identifier: BSD-2-Clause
"""A wrench w = [force; moment] at the origin of a frame does the work of J^T w, J of that frame."""

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import ClosedChain, robots
from sst_pin.errors import InputError, SingularConfigurationError, UnknownNameError
from tests.support import any_chain

#: Both sides are the same sums in another order.
ROUNDING = 1e-11
#: Central differences over 1e-5: their error is 1e-10 of the third derivative, rounding 1e-11.
STEP, DIFFERENCES = 1e-5, 1e-7


def with_edges():
    """An ankle with frames that are far from mass centres and joints."""
    chain = robots.ankle()
    model = pin.Model(chain.model)
    places = {"edge": (model.njoints - 1, [0.1, -0.2, 0.3]), "heel": (1, [-0.3, 0.05, 0.1])}
    for name, (joint, place) in places.items():
        placement = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array(place))
        model.addFrame(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))
    return chain.with_model(model)


@pytest.fixture(
    scope="module", params=["reference", pytest.param("compiled", marks=pytest.mark.slow)]
)
def chain(request):
    robot = with_edges()
    if request.param == "compiled":
        robot.compile()
    return robot


@pytest.fixture(scope="module")
def states(chain):
    return any_chain.states(chain, 3, 0)


@pytest.fixture(scope="module")
def load():
    generator = np.random.default_rng(2)
    return {name: generator.normal(size=6) for name in ("edge", "heel")}


def close(actual, expected, tolerance=ROUNDING):
    assert np.abs(actual - expected).max() < tolerance * (1 + np.abs(expected).max())


def work(chain, q, load):
    return sum(
        (chain.frame_jacobian(q, name).mT @ w[..., None])[..., 0] for name, w in load.items()
    )


def test_a_wrench_at_a_frame_does_its_work_in_batches(chain, states, load):
    q, va, aa = states
    each = load | {"edge": load["edge"] * np.array([[1.0], [2.0], [-1.0]])}  # one for each sample
    expected = work(chain, q, each)
    f = chain.generalized_forces(q, va, aa)
    close(chain.generalized_forces(q, va, aa, external_wrenches=each), f - expected)
    of_motors = np.linalg.solve(chain.actuator_jacobian(q).mT, expected[..., None])[..., 0]
    tau = chain.compute_torques(q, va, aa)
    close(chain.compute_torques(q, va, aa, external_wrenches=each), tau - of_motors)
    loaded = chain.compute_accelerations(q, va, tau, external_wrenches=each)
    close(loaded, chain.compute_accelerations(q, va, tau + of_motors))
    close(chain.reactions(q, va, aa, external_wrenches=each).motors, tau - of_motors)


def test_one_sample_is_a_batch_of_one(chain, states, load):
    q, va, aa = (x[1] for x in states)
    f = chain.generalized_forces(q, va, aa)
    loaded = chain.generalized_forces(q, va, aa, external_wrenches=load)
    close(loaded, f - work(chain, q, load))


def test_derivatives_know_that_the_frame_moves_with_its_body(chain, states, load):
    q, va, aa = (x[1] for x in states)
    push = {"external_wrenches": {name: 30 * w for name, w in load.items()}}
    tau = chain.compute_torques(q, va, aa)
    motors = chain.coordinates

    def moved(k, step):
        at = {name: q[chain.position_names.index(name)] for name in motors}
        at[motors[k]] += step
        other = q.copy()
        for name, x in at.items():
            other[chain.position_names.index(name)] = x
        return chain.assemble(other)

    slopes = (
        (chain.torque_derivatives(q, va, aa, **push).dq, chain.generalized_forces, aa),
        (chain.acceleration_derivatives(q, va, tau, **push).dq, chain.compute_accelerations, tau),
    )
    for dq, function, x in slopes:
        for k in range(len(motors)):
            ahead, behind = (function(moved(k, s), va, x, **push) for s in (STEP, -STEP))
            close(dq[:, k], (ahead - behind) / (2 * STEP), DIFFERENCES)


def test_a_simulation_pushes_at_the_frame_where_it_is(chain, states, load):
    q, va, _ = (x[1] for x in states)
    zero, t = np.zeros(len(chain.motor_names)), np.linspace(0, 0.01, 5)
    constant = chain.simulate(zero, q, va, t, external_wrenches=load)
    of_time = chain.simulate(zero, q, va, t, external_wrenches=lambda t, q, va: load)
    close(of_time.q, constant.q)
    aa = chain.compute_accelerations(constant.q, constant.va, zero, external_wrenches=load)
    close(constant.aa, aa, 1e-9)  # the loops of a simulated motion are closed to 1e-10


def test_what_no_frame_can_carry_is_refused(chain, states):
    q, va, aa = (x[1] for x in states)
    with pytest.raises(UnknownNameError, match="nowhere"):
        chain.compute_torques(q, va, aa, external_wrenches={"nowhere": np.zeros(6)})
    with pytest.raises(InputError, match=r"\['edge'\].*shape"):
        chain.compute_torques(q, va, aa, external_wrenches={"edge": np.zeros(3)})
    with pytest.raises(InputError, match="fixed to the base"):
        chain.compute_torques(q, va, aa, external_wrenches={"universe": np.zeros(6)})
    with pytest.raises(InputError, match="does not fit q"):
        chain.compute_torques(states[0], va, aa, external_wrenches={"edge": np.zeros((2, 6))})


@pytest.mark.parametrize("method", ["torque_derivatives", "acceleration_derivatives"])
def test_out_may_be_the_memory_of_the_configurations(chain, states, load, method):
    q, va, last = states
    compute = getattr(chain, method)
    expected = np.concatenate(compute(q, va, last, external_wrenches=load), axis=-1)
    out = np.zeros(expected.shape)
    same = out.reshape(-1)[: q.size].reshape(q.shape)
    same[:] = q
    compute(same, va, last, external_wrenches=load, out=out)
    close(out, expected)


def test_a_coordinate_without_mass_has_its_own_error():
    """The term of a wrench at a frame needs the inverse of M, which is singular here."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    wheel = model.addJoint(base, pin.JointModelRZ(), place, "wheel")
    model.addFrame(pin.Frame("rim", wheel, place, pin.FrameType.OP_FRAME))
    chain = ClosedChain(model, [], ["base", "wheel"])
    push = {"external_wrenches": {"rim": np.ones(6)}}
    rest = np.zeros(2)
    with pytest.raises(SingularConfigurationError, match="no mass"):
        chain.acceleration_derivatives(rest, rest, rest, **push)
    with pytest.raises(SingularConfigurationError, match="no mass"):
        chain.linearize(rest, rest, rest, **push)
    without_error = chain.acceleration_derivatives(rest, rest, rest, on_error="nan", **push)
    assert np.isnan(np.concatenate(without_error, axis=-1)).all()
