# SPDX-License-Identifier: BSD-2-Clause
"""Inertia of what moves with the length of a line: pistons, winches, tendons with armature."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, LineForce
from sst_pin.verification.lagrange import LagrangeMultipliers
from tests.support import any_chain

#: MuJoCo's test of the inertia of a tendon, `ten_armature_1`: a pendulum with a spring and a tendon
#: of 9 kg from its middle to a point of the world.
TENDON = """<mujoco><option gravity="0 0 0"/><worldbody><site name="world" pos=".5 0 -.5"/>
<body><joint name="swing" axis="0 -1 0" stiffness="100" springref="90"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -1"/><geom size=".08" pos="0 0 -1"/>
<site name="middle" pos="0 0 -.5"/></body></worldbody><tendon>
<spatial name="t" armature="9"><site site="middle"/><site site="world"/></spatial></tendon></mujoco>
"""
#: The same with a slide of that armature between the two points, `ten_armature_1_equiv`; links of
#: 1e-9 kg, where MuJoCo's file has 1e-3 and 0.1 kg.
SLIDE = """<mujoco><option gravity="0 0 0"/><worldbody><site name="world" pos=".5 0 -.5"/>
<body><joint name="swing" axis="0 -1 0" stiffness="100" springref="90"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -1"/><geom size=".08" pos="0 0 -1"/>
<body pos="0 0 -.5" euler="0 90 0"><joint name="turn" axis="0 -1 0"/>
<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>
<body><joint name="slide" type="slide" axis="0 0 1" armature="9"/>
<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>
<site name="end" pos="0 0 .5"/></body></body></body></worldbody>
<equality><connect name="c" site1="world" site2="end"/></equality></mujoco>"""


def pair(tmp_path) -> tuple[ClosedChain, ClosedChain]:
    """The two robots of MuJoCo."""
    robots = []
    for name, text in (("tendon", TENDON), ("slide", SLIDE)):
        path = tmp_path / f"{name}.xml"
        path.write_text(text)
        robots.append(ClosedChain.from_mjcf(path, actuated=["swing"]))
    return robots[0], robots[1]


@pytest.mark.slow
def test_a_tendon_moves_as_its_rigid_equivalent_of_mujoco(tmp_path):
    tendon, slide = pair(tmp_path)
    assert tendon.lines[0].mass == 9
    t = np.linspace(0, 1, 101)
    one = tendon.simulate([0.0], [0.0], [0.0], t)
    start = slide.assemble({"swing": 0.0})
    two = slide.simulate([0.0], start, [0.0], t)
    assert np.ptp(one.q[:, 0]) > 0.5  # it swings
    # The links of 1e-9 kg are 1e-9 of the 2 kg of the pendulum.
    np.testing.assert_allclose(two.q[:, 0], one.q[:, 0], atol=1e-7)


def test_accelerations_are_those_of_mujoco(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    tendon, _ = pair(tmp_path)
    mj = mujoco.MjModel.from_xml_string(TENDON)
    data = mujoco.MjData(mj)
    for q, v in np.random.default_rng(0).uniform(-1, 1, (5, 2)):
        data.qpos, data.qvel = [q], [3 * v]
        mujoco.mj_forward(mj, data)
        np.testing.assert_allclose(
            tendon.compute_accelerations([q], [3 * v], [0.0]), data.qacc, rtol=1e-9
        )


def test_a_piston_on_a_rail_is_added_to_the_mass_of_the_slide():
    """By hand: 2 kg on a rail, pushed by a ram of 3 kg at right angles to it, 1 m beside it."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "rail")
    model.appendBodyToJoint(1, pin.Inertia(2, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    aside = pin.SE3(np.eye(3), np.array([0, 1.0, 0]))
    model.addFrame(pin.Frame("aside", 0, aside, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("eye", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    ram = LineForce("aside", "eye", name="ram", mass=3)
    chain = ClosedChain(model, [], ["rail"], lines=[ram])
    for x, speed, acceleration in ((0.0, 2.0, 0.0), (1.5, -1.0, 0.7), (-0.4, 0.0, 1.0)):
        length = np.hypot(x, 1)
        stretch = (speed**2 + x * acceleration) / length - (x * speed) ** 2 / length**3
        force = 2 * acceleration + 3 * stretch * x / length
        state = [x], [speed], [acceleration]
        np.testing.assert_allclose(chain.compute_torques(*state), [force], atol=1e-12)
        # The rail carries the part of the ram's force at right angles to it.
        w = chain.reactions(*state)
        np.testing.assert_allclose(w.of("rail")[_FORCE][1], -3 * stretch / length, atol=1e-12)
        np.testing.assert_allclose(
            chain.kinetic_energy([x], [speed]),
            2 * speed**2 / 2 + 3 * (x * speed / length) ** 2 / 2,
            rtol=1e-12,
        )


#: Where a wrench has its force.
_FORCE = slice(3)


def test_lagrange_multipliers_agree_on_masses_of_lines():
    chain = any_chain.lines()
    assert any(line.mass for line in chain.lines)
    lagrange = LagrangeMultipliers(chain)
    for q, va, aa in zip(*any_chain.states(chain, 3, seed=4), strict=True):
        f = chain.generalized_forces(q, va, aa)
        np.testing.assert_allclose(lagrange.generalized_forces(q, va, aa), f, rtol=1e-9)
        tau = [3.0, -2.0]
        given = chain.compute_accelerations(q, va, tau)
        np.testing.assert_allclose(lagrange.accelerations(q, va, tau), given, rtol=1e-8)


@pytest.mark.slow
def test_the_energy_of_a_free_motion_is_kept():
    chain = any_chain.lines()
    frictionless = chain.with_parameters({"gas.damping": 0.0, "gas.coulomb": 0.0})
    t = np.linspace(0, 0.5, 201)
    motion = frictionless.simulate(np.zeros(2), frictionless.generic_configuration(), [1.0], t)
    # Splines through 201 samples integrate powers to 1e-8 of the 10 J that move.
    assert np.abs(sst_pin.energy_error(frictionless, motion)).max() < 1e-7


def test_a_line_whose_inertia_alone_moves_is_no_motion_without_mass():
    """A massless rod end on a rail that a winch pulls has direct dynamics."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "rail")
    model.addFrame(pin.Frame("eye", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    far = pin.SE3(np.eye(3), np.array([2.0, 0, 0]))
    model.addFrame(pin.Frame("winch", 0, far, pin.FrameType.OP_FRAME))
    rope = LineForce("winch", "eye", name="rope", mass=4)
    chain = ClosedChain(model, [], ["rail"], lines=[rope])
    np.testing.assert_allclose(chain.compute_accelerations([0.0], [0.0], [8.0]), [2.0], rtol=1e-12)


def test_a_negative_mass_is_refused():
    with pytest.raises(sst_pin.InputError, match="mass of line a-b: -1 is negative"):
        LineForce("a", "b", mass=-1)


def test_the_armature_of_a_fixed_tendon_is_read_where_it_has_one_joint(tmp_path):
    """MuJoCo is the referee."""
    mujoco = pytest.importorskip("mujoco")
    text = """<mujoco><worldbody><body name="a"><joint name="ja" axis="0 1 0" armature="0.1"/>
        <geom size=".1" mass="1" pos=".3 0 0"/><body name="b" pos=".5 0 0"><joint name="jb"
        type="slide" axis="1 0 0"/><geom size=".1" mass="2"/></body></body></worldbody><tendon>
        <fixed armature="3"><joint joint="ja" coef="-0.4"/></fixed><fixed armature="5">
        <joint joint="jb" coef="2"/></fixed></tendon></mujoco>"""
    path = tmp_path / "drums.xml"
    path.write_text(text)
    chain = ClosedChain.from_mjcf(path, actuated=["ja", "jb"])
    assert chain.model.armature.tolist() == pytest.approx([0.1 + 3 * 0.16, 20])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = [0.3, 0.1], [1.0, -0.5], [2.0, 3.0]
    mujoco.mj_inverse(model, data)
    torques = chain.compute_torques(data.qpos, data.qvel, data.qacc)
    assert torques == pytest.approx(data.qfrc_inverse, rel=1e-12)
