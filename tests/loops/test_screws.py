# SPDX-License-Identifier: BSD-2-Clause
"""Screws as a hinge, a slide and a coupling: a nut with many turns."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, Coupling, Distance

#: Of the screw, [m] per turn; masses of the nut and of the load, [kg]; the load's lever, [m].
PITCH, NUT, LOAD, LEVER = 0.004, 0.5, 20.0, 0.3
PER_RADIAN = PITCH / (2 * np.pi)
TURNS = 12.25


def jack(**more) -> ClosedChain:
    """A screw of 1e-4 kg m^2 that turns about z lifts its nut, which a rod connects to a lever.

    The lever turns about y; a load hangs at its end, level where the nut is at 0.1 m.
    """
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "screw")
    spindle = pin.Inertia(0.1, np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]))
    model.appendBodyToJoint(1, spindle, pin.SE3.Identity())
    model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "nut")
    model.appendBodyToJoint(2, pin.Inertia(NUT, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    hinge = pin.SE3(np.eye(3), np.array([LEVER, 0, 0.2]))
    model.addJoint(0, pin.JointModelRY(), hinge, "lever")
    load = pin.Inertia(LOAD, np.array([-LEVER, 0, 0]), 0.01 * np.eye(3))
    model.appendBodyToJoint(3, load, pin.SE3.Identity())
    for name, joint, place in (("pin", 2, (0, 0, 0)), ("end", 3, (-LEVER, 0, 0))):
        at = pin.SE3(np.eye(3), np.array(place, dtype=float))
        model.addFrame(pin.Frame(name, joint, at, pin.FrameType.OP_FRAME))
    model.referenceConfigurations["home"] = np.array([0.1 / PER_RADIAN, 0.1, 0.0])
    closures = [Coupling("nut", {"screw": (0.0, PER_RADIAN)}), Distance("pin", "end", 0.1)]
    return ClosedChain(model, closures, ["screw"], **more)


def test_a_nut_keeps_its_pitch_over_many_turns():
    chain = jack()
    start = chain.home[0]
    for turns in (-TURNS, 0.5, TURNS):
        q = chain.assemble({"screw": start + 2 * np.pi * turns})
        assert q[0] == pytest.approx(start + 2 * np.pi * turns, abs=1e-12)
        np.testing.assert_allclose(q[1], 0.1 + turns * PITCH, atol=1e-12)
    q = chain.frame_configuration("pin", [0, 0, 0.1 + TURNS * PITCH])
    np.testing.assert_allclose(q[0], start + 2 * np.pi * TURNS, rtol=1e-9)


@pytest.mark.parametrize("path", ["reference", "casadi"])
def test_the_torque_of_a_screw_lifts_its_load_by_hand(path):
    """By hand: the nut carries its weight and, where the lever is level, that of the load."""
    chain = jack()
    q, one = chain.home, np.ones(1)
    rest = 0 * one
    rate, turn = PER_RADIAN, PER_RADIAN / LEVER  # of the nut and of the lever, per rad of screw
    inertia = 1e-4 + NUT * rate**2 + (0.01 + LOAD * LEVER**2) * turn**2
    weight = 9.81 * (NUT + LOAD) * rate
    if path == "casadi":
        pytest.importorskip("casadi")
        torques = chain.casadi().torques
        still, moving = (float(torques(q, rest, x)) for x in (rest, one))
    else:
        still, moving = (chain.compute_torques(q, rest, x)[0] for x in (rest, one))
    np.testing.assert_allclose(still, weight, rtol=1e-10)
    np.testing.assert_allclose(moving - still, inertia, rtol=1e-9)
    w = chain.reactions(q)
    np.testing.assert_allclose(w.of("nut after screw")[2], weight / rate, rtol=1e-10)


def test_a_brake_on_a_screw_holds_what_its_motor_holds():
    chain = jack()
    brakes = chain.with_brakes(["screw"]).reactions(chain.home).brakes
    np.testing.assert_allclose(
        brakes["screw"], chain.compute_torques(chain.home, [0.0], [0.0])[0], rtol=1e-10
    )


def test_a_screw_that_runs_down_turns_many_times_and_keeps_its_energy():
    chain = jack()
    t = np.linspace(0, 0.3, 101)
    motion = chain.simulate([0.0], chain.home, [0.0], t)
    turns = (motion.q[0, 0] - motion.q[-1, 0]) / (2 * np.pi)
    assert turns > 3
    np.testing.assert_allclose(motion.q[:, 1], PER_RADIAN * motion.q[:, 0], atol=1e-11)
    moved = chain.kinetic_energy(motion.q[-1], motion.va[-1])
    # There is no motor and no friction; the integrator has 12 digits.
    assert np.abs(sst_pin.energy_error(chain, motion)).max() < 1e-8 * moved


def test_a_joint_that_forgets_its_turns_carries_no_nut():
    """Cosine and sine of an unbounded joint say nothing about whole turns."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "screw")
    model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "nut")
    with pytest.raises(sst_pin.DescriptionError, match="screw has 2 coordinates"):
        ClosedChain(model, [Coupling("nut", {"screw": (0, PER_RADIAN)})], ["screw"])
