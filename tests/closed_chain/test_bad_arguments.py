# SPDX-License-Identifier: BSD-2-Clause
"""Arguments whose shape, values or order would be lost, and models that were changed badly."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from sst_pin.compiled.export import c_files
from sst_pin.compiled.page_code import functions_of
from sst_pin.errors import DescriptionError, InputError, SingularConfigurationError
from tests.support import any_chain
from tests.support.motor_cases import five_bar


def remade(chain: ClosedChain, **options) -> ClosedChain:
    return ClosedChain(chain.model, chain.closures, ["a1", "b1"], **options)


@pytest.mark.parametrize("length", [0.0, 2.0, 1e200])
def test_a_spring_is_at_rest_on_the_manifold(length):
    ball = any_chain.with_joint("spherical")
    reference = pin.neutral(ball.model)
    quaternion = ball.model.joints[ball.model.getJointId("body")].idx_q
    reference[quaternion : quaternion + 4] *= length
    with pytest.raises(InputError, match="spring_reference: the length of a quaternion"):
        ClosedChain(ball.model, ball.closures, ball.motor_names, spring_reference=reference)


@pytest.mark.parametrize(
    "make",
    [
        lambda: sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH, locked={"gamma_1": 0.7}),
        lambda: sst_pin.ClosedChain.from_mjcf(sst_pin.sst.MJCF_PATH, locked={"gamma_1": 0.7}),
        lambda: five_bar(["a1"]).assemble(np.zeros(4), fixed={"a1": 0.9}),
        lambda: five_bar(["a1"]).with_coordinates({"a1": 1, "b1": 2}),
        lambda: five_bar(["a1"], coordinates={"a1", "b1"}),
    ],
)
def test_values_beside_names_and_names_without_order_are_refused(make):
    with pytest.raises(InputError, match=r"sequence of names|the order of the names"):
        make()


@pytest.mark.parametrize("name", ["damping", "effortLimit", "lowerPositionLimit"])
def test_arrays_of_a_model_with_a_wrong_size_are_refused(name):
    """Pinocchio would read past their end."""
    chain = five_bar(["a1", "b1"])
    setattr(chain.model, name, np.zeros(3))
    for make in (chain.refresh, lambda: remade(chain), lambda: remade(chain, locked=["a2"])):
        with pytest.raises(DescriptionError, match=f"{name}: 3 numbers, 4 are needed"):
            make()


def test_a_pose_of_a_wrong_size_is_named_when_joints_are_locked():
    chain = five_bar(["a1", "b1"])
    chain.model.referenceConfigurations["rest"] = np.zeros(2)
    with pytest.raises(DescriptionError, match="pose rest: 2 numbers, 4 are needed"):
        remade(chain, locked=["a2"])


def rigid() -> ClosedChain:
    """A five-bar whose ends are welded to the base."""
    chain = five_bar(["a1"])
    model, home = chain.model, chain.generic_configuration()
    model.referenceConfigurations["home"] = home
    p, R = chain.frame_placement(home, "fa")
    model.addFrame(pin.Frame("w", 0, pin.SE3(R, p), pin.FrameType.OP_FRAME))
    return ClosedChain(model, [*chain.closures, Closure("fa", "w", "6d")], ["a1"])


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
@pytest.mark.parametrize(
    "use",
    [
        lambda c, q: c.compute_torques(q, [0], [0]),
        lambda c, q: c.rollout(np.zeros((2, 1)), q, [], 1e-3),
        lambda c, q: c.simulate([0], q, [], [0, 0.1]),
        lambda c, q: c.compile(all=True),
        lambda c, q: c.casadi(),
        lambda c, q: c_files(c, "x"),
        lambda c, q: functions_of(c.engine.reference, q),
    ],
)
def test_where_nothing_moves_there_are_no_dynamics(use):
    chain = rigid()
    with pytest.raises(DescriptionError, match="nothing can move"):
        use(chain, chain.home)


@pytest.mark.filterwarnings("ignore:.*the closures hold the joints of the motors")
def test_where_nothing_moves_no_other_coordinates_are_proposed():
    chain = rigid().with_coordinates(["a1"])
    with pytest.raises(SingularConfigurationError, match="; nothing can move here"):
        chain.compute_torques(chain.home, [0], [0])


def _turned(R):
    return pin.SE3(np.array(R, dtype=float), np.zeros(3))


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        (
            "frames",
            pin.Frame("e", 99, pin.SE3.Identity(), pin.FrameType.OP_FRAME),
            "parent joint 99",
        ),
        (
            "frames",
            pin.Frame("e", 1, _turned(np.eye(3) / 2), pin.FrameType.OP_FRAME),
            "frame e: .* is no rotation",
        ),
        ("jointPlacements", _turned(2 * np.eye(3)), "joint a2: .* is no rotation"),
        ("jointPlacements", _turned(np.diag((1, 1, -1))), "joint a2: .* is no rotation"),
        ("jointPlacements", _turned(1e200 * np.eye(3)), "joint a2: .* is no rotation"),
        ("jointPlacements", pin.SE3(np.eye(3), np.array([np.inf, 0, 0])), "joint a2: not finite"),
        ("inertias", pin.Inertia(np.inf, np.zeros(3), np.eye(3)), "body of joint a2: not finite"),
        ("inertias", pin.Inertia(1, np.array([0, np.inf, 0]), np.eye(3)), "body of joint a2"),
        ("names", "", "joint 2: it has no name"),
        ("parents", 2, "joint 2: its parent 2 does not come before it"),
        ("parents", 77, "joint 2: its parent 77 does not come before it"),
        ("names", "universe", "joint universe: the world has this name"),
    ],
)
def test_what_no_robot_has_is_refused_by_name(attribute, value, said):
    chain = five_bar(["a1", "b1"])
    getattr(chain.model, attribute)[2] = value
    for make in (chain.refresh, lambda: remade(chain)):
        with pytest.raises(DescriptionError, match=said):
            make()


@pytest.mark.parametrize("sampled", [False, True])
def test_a_torque_may_change_what_it_is_given(sampled):
    chain = five_bar(["a1", "b1"])
    q, va, t = chain.generic_configuration(), np.full(2, 0.1), np.linspace(0, 0.05, 6)

    def torque(t, q, va):
        q += 1
        va[:] = 99
        return np.zeros(2)

    source = sst_pin.SampledTorque(torque, 0.01) if sampled else torque
    motion = chain.simulate(source, q, va, t, rtol=1e-9, atol=1e-9)
    expected = chain.simulate([0, 0], q, va, t, rtol=1e-9, atol=1e-9)
    assert motion.q == pytest.approx(expected.q, abs=1e-7)
    assert motion.va == pytest.approx(expected.va, abs=1e-6)
