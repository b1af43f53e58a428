# SPDX-License-Identifier: BSD-2-Clause
"""A motion never changes its assembly mode unnoticed, on either path."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from tests.support.by_hand import add, at, mark
from tests.support.link_tables import two_link_angles
from tests.support.planar_bars import planar

CRANK, START = 0.3, 0.7


def linkage(base, bars, closed, motor, coordinates=None, joint=pin.JointModelRZ, moment=0.02):
    """Bars in a plane without gravity."""
    model, ground = pin.Model(), "universe"
    if base is not None:
        body = pin.Inertia(2.0, np.array([0.1, 0.0, 0.05]), np.diag([0.05, 0.08, 0.1]))
        ground = model.names[add(model, 0, base, "base", at(), body)]
    planar([(k, on or ground, x, end) for k, (on, x, end, _) in bars.items()], joint, model, moment)
    model.gravity.linear = np.zeros(3)
    if base is None:
        home = [bars[name][-1] for name in list(model.names)[1:]]
        model.referenceConfigurations["home"] = np.array(home)
    closures = [sst_pin.Closure(f"{a}_end", f"{b}_end", "3d") for a, b in closed]
    return sst_pin.ClosedChain(model, closures, [motor], coordinates=coordinates)


def four_bar(lengths, angles, base=None, **options):
    """Lengths of crank, coupler, rocker and ground; angles of the first three near home."""
    crank, coupler, rocker, ground = lengths
    bars = {
        "crank": ("", 0.0, crank, angles[0]),
        "coupler": ("crank", crank, coupler, angles[1]),
        "rocker": ("", ground, rocker, angles[2]),
    }
    return linkage(base, bars, [("coupler", "rocker")], "crank", **options)


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
    ("count", "in_a_chain", "compiled"),
    [
        (1, False, False),
        pytest.param(1, False, True, marks=pytest.mark.slow),
        pytest.param(2, False, False, marks=pytest.mark.slow),  # on one crank
        pytest.param(3, True, True, marks=pytest.mark.slow),
    ],
)
def test_parallelograms_stop_before_they_are_flat(count, in_a_chain, compiled):
    """However many loops become singular at once, with any tolerance, start, rate and step."""
    chain, random = parallelograms(count, in_a_chain), np.random.default_rng(0)
    if compiled:
        chain.compile()
    for tolerance in (1e-12, 1e-3):
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


@pytest.mark.parametrize(
    ("base", "joint"),
    [
        (pin.JointModelFreeFlyer(), pin.JointModelRZ),
        (pin.JointModelPlanar(), pin.JointModelRZ),
    ],
)
def test_a_tumbling_base_is_no_singularity(base, joint):
    """At loose tolerances the integrator's quaternions drift; the linkage is far from singular."""
    options = {"coordinates": ["base", "crank"], "joint": joint}
    chain = four_bar((0.2, 0.5, 0.4, 0.5), (1.0, -1.0, 1.0), base, **options)
    va = np.full(chain.degrees_of_freedom, 3.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = chain.simulate(
            [0], chain.generic_configuration(), va, [0, 1, 3], rtol=1e-3, atol=1e-3
        )
    assert len(motion) == 3
    assert max(chain.condition_number(motion.q)) < 10


def plate_on_cranks():
    """A plate that three equal cranks carry, not in a row."""
    model, home, closures = pin.Model(), [], []
    model.gravity.linear = np.zeros(3)

    def body(name, on, x, y, angle):
        inertia = pin.Inertia(1.0, np.array([0.1, 0.02, 0]), np.diag([0.01, 0.02, 0.02]))
        home.append(angle)
        return add(model, on, pin.JointModelRZ(), name, at(x, y), inertia)

    places = (0.0, 0.0), (0.5, 0.1), (0.2, 0.45)
    cranks = [body(f"crank{k}", 0, x, y, START) for k, (x, y) in enumerate(places)]
    rod = body("plate", cranks[0], 0.2, 0.0, -START)
    for k in (1, 2):
        mark(model, rod, f"plate_{k}", at(*places[k]))
        mark(model, cranks[k], f"pin_{k}", at(0.2))
        closures.append(sst_pin.Closure(f"plate_{k}", f"pin_{k}", "hinge"))
    model.referenceConfigurations["home"] = np.array(home)
    return sst_pin.ClosedChain(model, closures, ["crank0"])


def test_loops_that_are_flat_one_after_the_other_turn_where_others_hold_them():
    """Each loop is singular somewhere, both together nowhere: cranks turn evenly, without end."""
    chain, t = plate_on_cranks(), np.linspace(0, 3.2, 65)  # a whole turn
    turned = chain.home + 2.0 * t[:, None] * np.sign(chain.home)
    assert np.abs(chain.residual(turned)).max() < 1e-12
    for tolerance in (1e-9, 1e-3):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = chain.simulate([0], chain.home, [2.0], t, rtol=tolerance, atol=tolerance)
        assert np.abs(motion.q - turned).max() < 1e-7
    q, _ = chain.rollout(np.zeros((128, 1)), chain.home, [2.0], 0.025)
    assert np.abs(q[::2] - turned).max() < 1e-7
    motion = sst_pin.coordinate_motion(chain, t, turned[:, :1], chain.home)
    assert np.abs(motion.q - turned).max() < 1e-9


#: Crank, coupler, rocker and ground of linkages whose cranks turn fully, but only just.
NEARLY_FLAT = (0.13, 0.52, 0.131, 0.53), (0.2, 0.5, 0.4, 0.301), (0.2, 0.5, 0.4, 0.30001)
UP = 1.5, -1.0, 1.5


@pytest.mark.parametrize("bars", [NEARLY_FLAT[0], NEARLY_FLAT[2]])
def test_energy_is_kept_at_any_tolerance_next_to_flat_positions(bars):
    """Where a step is cut it is integrated anew; coordinates that determine little are exacter."""
    chain = four_bar(bars, UP)
    start = chain.assemble(chain.home)
    for tolerance, rate in ((1e-3, -5.0), (1e-5, 2.5)):
        motion = chain.simulate(
            [0], start, [rate], np.linspace(0, 1, 11), rtol=tolerance, atol=tolerance
        )
        energy = chain.kinetic_energy(motion.q, motion.va)
        assert np.ptp(energy) < 100 * tolerance * energy[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bars", "moment"),
    [(NEARLY_FLAT[1], 0.001), (NEARLY_FLAT[2], 0.02)],
)
def test_a_rollout_ends_before_a_bend_for_which_its_step_is_too_long(bars, moment):
    """Energy is kept in its own coordinates too; kernels end where the reference path does."""
    chain, kernels = (four_bar(bars, UP, moment=moment) for _ in range(2))
    start = chain.assemble(chain.home)
    kernels.compile(start)
    for rate, dt in ((-3.0, 0.005), (-1.0, 0.02), (4.0, 0.02)):
        tau, result = np.zeros((int(3 / dt), 1)), []
        for robot in (chain, kernels):
            q, va = robot.rollout(tau, start, [rate], dt, on_error="nan")
            result.append(int(np.isfinite(q[:, 0]).sum()))
            energy = chain.kinetic_energy(q[: result[-1]], va[: result[-1]])
            assert np.ptp(energy) < 0.3 * energy[0]
        assert result[0] == result[1]


@pytest.mark.parametrize("first", [1.6, 4.2, -1.5])
def test_a_motion_starts_in_the_mode_of_home_however_far_its_first_sample_is(first):
    """The crank turns fully, so that home's mode reaches every sample; no jump, no warning."""
    chain = four_bar((0.2, 0.45, 0.4, 0.5), (1.0, 1.0, 1.0))

    def true(x):
        rest = 0.5 - 0.2 * np.cos(x), -0.2 * np.sin(x)
        coupler, knee = two_link_angles(rest, (0.45, 0.4), -1)
        return np.array([x, coupler - x, coupler + knee + np.pi]).real

    model = chain.model
    model.referenceConfigurations["home"] = true(0.8)
    chain = sst_pin.ClosedChain(model, chain.closures, ["crank"])
    t = np.linspace(0, 0.5, 11)
    x = first + 0.3 * np.sin(t)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = sst_pin.coordinate_motion(chain, t, x[:, None])
        named = chain.assemble({"crank": first})
    expected = np.array([true(each) for each in x])
    assert np.abs(np.exp(1j * motion.q) - np.exp(1j * expected)).max() < 1e-9
    assert np.abs(np.exp(1j * named) - np.exp(1j * true(first))).max() < 1e-9
