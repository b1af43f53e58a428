# SPDX-License-Identifier: BSD-2-Clause
"""A motion never changes its assembly mode unnoticed, on either path."""

import warnings
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import sst_pin

CRANK, START = 0.3, 0.7
PARALLELOGRAMS = {"one": (1, False), "two on one crank": (2, False), "three in a chain": (3, True)}


def along_x(x):
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


def linkage(base, bars, closed, motor, coordinates=None, joint=pin.JointModelRZ):
    """Bars in a plane without gravity."""
    model = pin.Model()
    if base is not None:
        model.addJoint(0, base, pin.SE3.Identity(), "base")
        body = pin.Inertia(2.0, np.array([0.1, 0.0, 0.05]), np.diag([0.05, 0.08, 0.1]))
        model.appendBodyToJoint(1, body, pin.SE3.Identity())
    for name, (parent, place, length, _) in bars.items():
        on = model.getJointId(parent) if parent else int(base is not None)
        k = model.addJoint(on, joint(), along_x(place), name)
        inertia = pin.Inertia(1.0, np.array([length / 2, 0, 0]), np.diag([0.01, 0.02, 0.02]))
        model.appendBodyToJoint(k, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_end", k, 0, along_x(length), pin.FrameType.OP_FRAME))
    model.gravity.linear = np.zeros(3)
    if base is None:
        home = [bars[name][-1] for name in list(model.names)[1:]]
        model.referenceConfigurations["home"] = np.array(home)
    closures = [sst_pin.Closure(f"{a}_end", f"{b}_end", "3d") for a, b in closed]
    return sst_pin.ClosedChain(model, closures, [motor], coordinates=coordinates)


def parallelograms(count, in_a_chain):
    """Their loops are flat at once; the coupler keeps its direction in the mode of home."""
    bars, closed = {"crank": ("", 0.0, CRANK, START)}, []
    drive, foot = "crank", 0.0
    for k in range(count):
        width = 0.8 if in_a_chain else 0.8 + 0.24 * k
        bars[f"coupler{k}"] = (drive, CRANK, width, -START)
        bars[f"rocker{k}"] = ("", foot + width, CRANK, START)
        closed.append((f"coupler{k}", f"rocker{k}"))
        if in_a_chain:
            drive, foot = f"rocker{k}", foot + width
    return linkage(None, bars, closed, "crank")


def off_mode(chain, q):
    """How far couplers have turned, shape of q without its last axis."""
    names = chain.position_names
    couplers = [i for i, name in enumerate(names) if name.startswith("coupler")]
    crank = [names.index("crank")]
    return np.abs(np.sin((q[..., couplers] + q[..., crank]) / 2)).max(axis=-1)


@pytest.mark.parametrize(
    ("which", "compiled"),
    [
        ("three in a chain", False),
        *(pytest.param(name, False, marks=pytest.mark.slow) for name in list(PARALLELOGRAMS)[:2]),
        *(pytest.param(name, True, marks=pytest.mark.slow) for name in PARALLELOGRAMS),
    ],
)
def test_parallelograms_stop_before_they_are_flat(which, compiled):
    """However many loops become singular at once, with any tolerance, start, rate and step."""
    chain, random = parallelograms(*PARALLELOGRAMS[which]), np.random.default_rng(0)
    if compiled:
        chain.compile()
    for tolerance in (1e-12, 1e-6, 1e-3):
        with pytest.warns(sst_pin.SingularityWarning):
            motion = chain.simulate(
                [0], chain.home, [2.0], np.linspace(0, 5, 50), rtol=tolerance, atol=tolerance
            )
        stop = float(motion.stopped.split("t = ")[1].split(" s")[0])
        # The condition number is 1e4 so near to the flat position; nothing turns in other ways.
        assert stop == pytest.approx((np.pi - START) / 2, abs=1e-3)
        assert off_mode(chain, motion.q).max() < 1e-9
    for _ in range(10 if compiled else 4):
        dt = 10 ** random.uniform(-3 if compiled else -2, -1)
        rate = random.uniform(1, 4) * random.choice([-1, 1])
        start = random.uniform(0.3, 1.2)
        q0 = chain.assemble(np.sign(chain.home) * start)
        torques = np.zeros((int(8 / abs(rate) / dt), 1))
        q, _ = chain.rollout(torques, q0, [rate], dt, on_error="nan")
        ends = int(np.isfinite(q[:, 0]).sum()) - 1
        to_flat = (np.pi - start if rate > 0 else start) / abs(rate)
        assert to_flat - 1.001 * dt <= ends * dt <= to_flat
        assert off_mode(chain, q[: ends + 1]).max() < 1e-9


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_four_bars_do_not_step_over_a_gap(compiled):
    """Next to change points: where the loop cannot be closed over a small angle of the crank."""
    random = np.random.default_rng(1)
    for gap in (1e-2, 1e-4, -1e-3):
        # Longest and shortest together exceed the others by the gap: no full turn.
        bars = {
            "crank": ("", 0.0, 0.3, 1.0),
            "coupler": ("crank", 0.3, 0.8 - gap, -1.0),
            "rocker": ("", 0.8, 0.3, 1.0),
        }
        chain = linkage(None, bars, [("coupler", "rocker")], "crank")
        home = chain.assemble(chain.home)
        if compiled:
            chain.compile(home)
        forward = along(chain, home) @ chain.joint_rates(home, [1.0])
        for _ in range(3):
            rate, dt = random.uniform(1, 4), 10 ** random.uniform(-2, -1)
            torques = np.zeros((int(6 / rate / dt), 1))
            q, va = chain.rollout(torques, home, [rate], dt, on_error="nan")
            held = q[np.isfinite(q[:, 0])]
            # A step that is too long for the bend near the gap ends the motion.
            energy = chain.kinetic_energy(held, va[: len(held)])
            assert np.ptp(energy) < 0.3 * energy[0]
            # The middle of the way between two states is not out of reach, and the motion goes
            # one way along the curve of its mode, also where the crank turns back.
            for a, b in pairwise(held):
                middle = chain.assemble((a + b) / 2, fixed=[])
                assert along(chain, middle) @ (b - a) * forward > 0


def along(chain, q):
    """The tangent of the planar loop's motions, which turns round only at singularities."""
    return np.cross(*chain.Phi(q)[:2])


FREE = pin.JointModelFreeFlyer(), pin.JointModelRZ
BALL = pin.JointModelSpherical(), pin.JointModelRUBZ
PLANE = pin.JointModelPlanar(), pin.JointModelRZ


@pytest.mark.parametrize(
    ("base", "joint", "compiled"),
    [
        (*FREE, False),
        (*BALL, False),
        (*PLANE, True),
        *(pytest.param(*base, True, marks=pytest.mark.slow) for base in (FREE, BALL)),
        pytest.param(*PLANE, False, marks=pytest.mark.slow),
    ],
)
def test_a_tumbling_base_is_no_singularity(base, joint, compiled):
    """At loose tolerances the integrator's quaternions drift; the linkage is far from singular."""
    bars = {
        "crank": ("", 0.0, 0.2, 1.0),
        "coupler": ("crank", 0.2, 0.5, -1.0),
        "rocker": ("", 0.5, 0.4, 1.0),
    }
    chain = linkage(base, bars, [("coupler", "rocker")], "crank", ["base", "crank"], joint)
    if compiled:
        chain.compile()
    va = np.full(chain.degrees_of_freedom, 3.0)
    for tolerance in (1e-6, 1e-3):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = chain.simulate(
                [0], chain.generic_configuration(), va, [0, 1, 3], rtol=tolerance, atol=tolerance
            )
        assert len(motion) == 3
        assert max(chain.condition_number(motion.q)) < 10
