# SPDX-License-Identifier: BSD-2-Clause
"""Arguments whose shape, values or order would be lost, and models that were changed badly."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Closure
from sst_pin.compiled.export import c_files
from sst_pin.errors import DescriptionError, InputError, SingularConfigurationError, SSTError
from tests.support import any_chain
from tests.support.motor_cases import five_bar


def remade(chain: ClosedChain, **options) -> ClosedChain:
    return ClosedChain(chain.model, chain.closures, ["a1", "b1"], **options)


@pytest.mark.parametrize("length", [0.0, 1e-3, 2.0, 1e200])
def test_a_spring_is_at_rest_on_the_manifold(length):
    ball = any_chain.with_joint("spherical")
    reference = pin.neutral(ball.model)
    quaternion = ball.model.joints[ball.model.getJointId("body")].idx_q
    reference[quaternion : quaternion + 4] *= length
    with pytest.raises(InputError, match="spring_reference: the length of a quaternion"):
        ClosedChain(ball.model, ball.closures, ball.motor_names, spring_reference=reference)


def test_a_spring_reference_counts_as_a_quaternion_of_length_one():
    ball = any_chain.with_joint("spherical")
    joint = ball.model.joints[ball.model.getJointId("body")]
    stiffness, reference = np.zeros(ball.model.nv), pin.neutral(ball.model)
    stiffness[joint.idx_v : joint.idx_v + 3] = 3.0
    made = []
    for length in (1, 1 + 4e-7):
        rest = reference.copy()
        rest[joint.idx_q : joint.idx_q + 4] *= length
        sprung = {"stiffness": stiffness, "spring_reference": rest}
        made.append(ClosedChain(ball.model, ball.closures, ball.motor_names, **sprung))
    q = made[0].generic_configuration()
    forces = [
        chain.generalized_forces(q, *np.zeros((2, chain.degrees_of_freedom))) for chain in made
    ]
    assert forces[1] == pytest.approx(forces[0], rel=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: sst_pin.ClosedChain.from_urdf(sst_pin.URDF_PATH, locked={"gamma_1": 0.7}),
        lambda: sst_pin.ClosedChain.from_mjcf(sst_pin.MJCF_PATH, locked={"gamma_1": 0.7}),
        lambda: five_bar(["a1"]).assemble(np.zeros(4), fixed={"a1": 0.9}),
        lambda: five_bar(["a1"]).with_coordinates({"a1": 1, "b1": 2}),
        lambda: five_bar(["a1"], coordinates={"a1", "b1"}),
    ],
)
def test_values_beside_names_and_names_without_order_are_refused(make):
    with pytest.raises(InputError, match=r"sequence of names|the order of the names"):
        make()


def test_names_of_joints_that_are_held_may_be_a_set():
    chain = five_bar(["a1", "b1"])
    q = chain.generic_configuration()
    assert np.array_equal(chain.assemble(q + 0.01, fixed={"a1", "b1"}), chain.assemble(q + 0.01))


def test_coordinates_may_come_from_an_iterator_and_stay():
    chain = five_bar(["a1", "b1"], coordinates=iter(["a2", "b2"]))
    chain.refresh()
    assert chain.coordinates == ("a2", "b2")


@pytest.mark.parametrize("name", ["inertias", "jointPlacements", "joints", "parents", "supports"])
@pytest.mark.parametrize("change", ["shorter", "longer", "empty"])
def test_lists_of_a_model_that_were_resized_are_refused_before_a_copy(name, change):
    """Pinocchio would end the process."""
    chain = five_bar(["a1", "b1"])
    entries = getattr(chain.model, name)
    if change == "longer":
        entries.append(entries[len(entries) - 1])
    for _ in range({"shorter": 1, "longer": 0, "empty": len(entries)}[change]):
        del entries[len(entries) - 1]
    for make in (chain.refresh, lambda: remade(chain), lambda: remade(chain, locked=["a2"])):
        with pytest.raises(DescriptionError, match=f"{name}: . entries, 5 are needed"):
            make()


@pytest.mark.parametrize("parent", [2, 3, 77])
def test_a_parent_comes_before_its_joint(parent):
    chain = five_bar(["a1", "b1"])
    chain.model.parents[2] = parent
    with pytest.raises(
        DescriptionError, match=f"joint 2: its parent {parent} does not come before"
    ):
        chain.refresh()


def test_entries_of_joints_are_those_of_the_model():
    chain = five_bar(["a1", "b1"])
    chain.model.joints[1].setIndexes(1, 3, 3)
    with pytest.raises(DescriptionError, match="joint 1: its entries in q and v"):
        chain.refresh()


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
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    place = data.oMf[model.getFrameId("fa")]
    model.addFrame(pin.Frame("w", 0, place, pin.FrameType.OP_FRAME))
    return ClosedChain(model, [*chain.closures, Closure("fa", "w", "6d")], ["a1"])


@pytest.mark.parametrize(
    "use",
    [
        lambda c, q: c.rollout(np.zeros((2, 1)), q, [], 1e-3),
        lambda c, q: c.simulate([0], q, [], [0, 0.1]),
        lambda c, q: c.compile(all=True),
        lambda c, q: c.casadi(),
        lambda c, q: c_files(c, "x"),
        lambda c, q: c._page_functions(q),
    ],
)
def test_where_nothing_moves_there_are_no_dynamics(use):
    chain = rigid()
    with pytest.raises(DescriptionError, match="nothing can move"):
        use(chain, chain.home)


def test_where_nothing_moves_no_other_coordinates_are_proposed():
    chain = rigid().with_coordinates(["a1"])
    with pytest.raises(SingularConfigurationError, match="; nothing can move here"):
        chain.compute_torques(chain.home, [0], [0])


@pytest.mark.parametrize("power", [160, 200, 300])
@pytest.mark.parametrize("name", ["free-flyer", "spherical"])
def test_rollouts_at_rates_too_large_to_square_end(name, power):
    chain = any_chain.with_joint(name)
    q, n = chain.generic_configuration(), chain.degrees_of_freedom
    tau = np.zeros((3, len(chain.motor_names)))
    with pytest.raises(SSTError):
        chain.rollout(tau, q, np.full(n, 10.0**power), 1e-3)
    motion = chain.rollout(tau, q, np.full(n, 10.0**power), 1e-3, on_error="nan")
    assert np.isnan(motion.q[-1]).all()


def _turned(R):
    return pin.SE3(np.array(R, dtype=float), np.zeros(3))


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("frames", pin.Frame("e", 99, pin.SE3.Identity(), pin.FrameType.OP_FRAME), "no joint 99"),
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
        ("names", "universe", "joint universe: the world has this name"),
    ],
)
def test_what_no_robot_has_is_refused_by_name(attribute, value, said):
    chain = five_bar(["a1", "b1"])
    getattr(chain.model, attribute)[2] = value
    for make in (chain.refresh, lambda: remade(chain)):
        with pytest.raises(DescriptionError, match=said):
            make()


def test_an_infinite_rotor_and_a_frame_too_many_are_refused():
    chain = five_bar(["a1", "b1"])
    chain.model.armature[0] = np.inf
    with pytest.raises(DescriptionError, match="armature: not finite"):
        chain.refresh()
    chain = five_bar(["a1", "b1"])
    chain.model.frames.append(chain.model.frames[1])
    with pytest.raises(DescriptionError, match=r"frames: . entries, . are needed"):
        chain.refresh()


@pytest.mark.parametrize("compiled", [False, True], ids=["reference", "compiled"])
def test_a_negative_inertia_is_called_so(compiled):
    chain = five_bar(["a1", "b1"])
    chain.model.inertias[1] = pin.Inertia(-9.0, np.array([0.4, 0, 0]), 1e-3 * np.eye(3))
    chain.refresh()
    if compiled:
        chain.compile()
    with pytest.raises(SingularConfigurationError, match="the inertia of a body is negative"):
        chain.compute_accelerations(chain.generic_configuration(), [0, 0], [0, 0])


@pytest.mark.parametrize("sampled", [False, True])
def test_a_torque_may_change_what_it_is_given(sampled):
    chain = five_bar(["a1", "b1"])
    q, va, t = chain.generic_configuration(), np.full(2, 0.1), np.linspace(0, 0.05, 6)

    def torque(t, q, va):
        q += 1
        va[:] = 99
        return np.zeros(2)

    given = sst_pin.SampledTorque(torque, 0.01) if sampled else torque
    motion = chain.simulate(given, q, va, t, rtol=1e-9, atol=1e-9)
    expected = chain.simulate([0, 0], q, va, t, rtol=1e-9, atol=1e-9)
    assert motion.q == pytest.approx(expected.q, abs=1e-7)
    assert motion.va == pytest.approx(expected.va, abs=1e-6)
