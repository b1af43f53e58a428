# SPDX-License-Identifier: BSD-2-Clause
"""Tolerances to first order, against 1e5 four-bars with random lengths in closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import robots
from sst_pin.design import clearance, tolerances

DEVIATIONS = {"crank.length": 2e-4, "coupler.length": 3e-4, "rocker.length": 1e-4}
SAMPLES = 100_000
WEIGHTS = {  # differences along the crank's angle, of sixth order
    1: np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
    2: np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
}
H = 1e-2


def motion_of(chain: sst_pin.ClosedChain) -> sst_pin.Trajectory:
    crank = np.array([1.1, 1.8, 2.6])
    q = [chain.assemble({"crank": x}) for x in crank]
    return chain.trajectory([0.0, 0.1, 0.2], q, [[3.0], [2.0], [-4.0]], [[5.0], [-20.0], [10.0]])


def four_bars(lengths: np.ndarray, crank: float, va: float, aa: float, masses: np.ndarray):
    """Pose, torque and clearance of four-bars with these lengths, in closed form, (samples,).

    Bars are as heavy as before, with their mass centres where they were.
    """
    a, b, c = lengths[..., None]
    turn = np.exp(1j * (crank + H * np.arange(-3, 4)))
    pin, ground = a * turn, 0.2
    d = ground - pin
    x = (np.abs(d) ** 2 + b**2 - c**2) / (2 * np.abs(d))
    coupler = (x + 1j * np.sqrt(b**2 - x**2)) * d / np.abs(d) / b  # to the left of d
    rocker = (pin + b * coupler - ground) / c
    centres = [0.05 * turn, pin + 0.25 * coupler, ground + 0.125 * rocker]
    angles = [np.unwrap(np.angle(z)) for z in (turn, coupler, rocker)]
    first, second = ([z @ (WEIGHTS[k] / H**k) for z in [*centres, *angles]] for k in (1, 2))
    bars = np.array([0.1, 0.5, 0.25])
    inertias = masses * (3 * 0.008**2 + bars**2) / 12  # of cylinders
    tau = np.zeros(len(lengths[0]))
    for m, moment, k in zip(masses, inertias, range(3), strict=True):
        force = m * (first[k] * aa + second[k] * va**2 + 9.81j)
        tau += (force * first[k].conj()).real
        tau += moment * first[k + 3] * (first[k + 3] * aa + second[k + 3] * va**2)
    point = (pin + 0.5 * coupler)[:, 3]
    ratios = np.array([np.ones_like(tau), first[4] - 1, first[5]])
    return point, angles[1][:, 3], tau, 1 / np.linalg.norm(ratios, axis=0)


def test_deviations_are_those_of_1e5_four_bars_with_random_lengths():
    chain = robots.four_bar()
    motion = motion_of(chain)
    result = tolerances(chain, motion, DEVIATIONS, "platform")
    masses = np.array([body.mass for body in list(chain.model.inertias)[1:]])
    random = np.random.default_rng(0)
    errors = random.normal(size=(3, SAMPLES)) * np.array(list(DEVIATIONS.values()))[:, None]
    drawn = np.array([0.1, 0.25, 0.25])[:, None]
    for k in range(len(motion)):
        state = float(motion.q[k, 0]), float(motion.va[k, 0]), float(motion.aa[k, 0]), masses
        point, angle, tau, clear = four_bars(drawn, *state)
        pose = chain.platform_pose(motion.q[k])
        assert_allclose([point[0].real, point[0].imag], pose[[0, 2], 3], atol=1e-9)
        assert_allclose(tau, motion.tau[k], rtol=1e-6)  # the differences' truncation
        assert_allclose(clear, clearance(chain, motion.q[k]), rtol=1e-6)
        point, angle, tau, clear = four_bars(drawn + errors, *state)
        # 1e5 samples leave 0.2 % of a standard deviation.
        assert_allclose(result.pose[k, [0, 2]], [point.real.std(), point.imag.std()], rtol=0.02)
        assert_allclose(np.linalg.norm(result.pose[k, 3:]), angle.std(), rtol=0.02)
        assert_allclose(result.torques[k], tau.std(), rtol=0.02)
        assert_allclose(result.clearance[k], clear.std(), rtol=0.02)


def test_shares_are_those_of_each_tolerance_alone_and_sum_to_one():
    chain = robots.four_bar()
    motion = motion_of(chain)
    result = tolerances(chain, motion, DEVIATIONS, "platform")
    for k, (name, size) in enumerate(DEVIATIONS.items()):
        alone = tolerances(chain, motion, {name: size}, "platform")
        for subject, part, whole in (
            ("torques", alone.torques, result.torques),
            ("clearance", alone.clearance, result.clearance),
            ("position", alone.pose[:, :3], result.pose[:, :3]),
        ):
            expected = (part**2).sum() / (whole**2).sum()
            assert_allclose(result.shares[subject][k], expected, rtol=1e-12)
    for share in result.shares.values():
        assert share.sum() == pytest.approx(1)


def test_a_pattern_gives_each_parameter_a_tolerance_of_its_own():
    chain = robots.four_bar()
    motion = motion_of(chain)
    result = tolerances(chain, motion, {"*.length": 1e-4, "crank.mass": 0.0}, "platform")
    assert result.names == ("crank.length", "coupler.length", "rocker.length", "crank.mass")
    assert not result.shares["torques"][3]
    assert "coupler.length" in str(result)


def test_wrong_tolerances_are_refused():
    chain = robots.four_bar()
    motion = motion_of(chain)
    for wrong in ({"rod.length": 1e-4}, {"crank.length": -1e-4}, {"coupler.z": 1e-4}):
        with pytest.raises((sst_pin.UnknownNameError, sst_pin.InputError)):
            tolerances(chain, motion, wrong, "platform")


def test_bars_show_the_shares():
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    from sst_pin import plots

    chain = robots.four_bar()
    result = tolerances(chain, motion_of(chain), DEVIATIONS, "platform")
    ax = plots.tolerance_shares(Figure().add_subplot(), result)
    labels = [label.get_text() for label in ax.get_yticklabels()]
    widths = [[bar.get_width() for bar in bars] for bars in ax.containers]
    shown = dict(zip(labels, np.sum(widths, axis=0), strict=True))
    expected = 100 * np.sum(list(result.shares.values()), axis=0)
    assert_allclose([shown[name] for name in result.names], expected)
    assert list(shown.values()) == sorted(shown.values(), reverse=True)


@pytest.mark.parametrize("value", [None, 5, "x", {}, np.zeros(3)], ids=lambda x: type(x).__name__)
def test_what_is_no_motion_no_mapping_or_no_configuration_is_refused(value):
    chain = robots.four_bar()
    with pytest.raises(sst_pin.InputError, match="a Trajectory is needed"):
        tolerances(chain, value, DEVIATIONS, "platform")
    with pytest.raises(sst_pin.SSTError, match=r"q: |the loops are open"):
        clearance(chain, value)
    if not isinstance(value, dict):
        with pytest.raises(sst_pin.InputError, match="a mapping of names to numbers is needed"):
            tolerances(chain, motion_of(chain), value, "platform")
