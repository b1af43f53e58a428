# SPDX-License-Identifier: BSD-2-Clause
"""Robots whose numbers have few digits: their overconstrained loops close and move all the same."""

import re
import warnings
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from sst_pin import ClosedChain, ClosureError, DescriptionWarning, SSTError
from tests.support import rounded_robots as rr

#: How far torques of a robot may be off, relative to the largest, in units of its last digit.
EXPLAINED = 300


def with_warnings(make, *arguments, **options):
    """What `make` gives, and the texts of its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = make(*arguments, **options)
    assert all(w.category is DescriptionWarning for w in caught)
    return result, [str(w.message) for w in caught]


def motions(chain, count=3):
    """Configurations near home, none near a singularity; rates and accelerations."""
    random = np.random.default_rng(0)
    n, result = chain.degrees_of_freedom, []
    while len(result) < count:
        moved = pin.integrate(chain.model, chain.home, random.uniform(-0.3, 0.3, chain.model.nv))
        with suppress(ClosureError):
            q = chain.assemble(moved, chain.coordinates)
            if chain.condition_number(q) < 2 * chain.condition_number(chain.home):
                result.append(q)
    return np.array(result), *random.normal(size=(2, count, n))


def forces(chain, q, va, aa):
    """Torques in the configurations next to q in which the coordinates stand as there."""
    q = np.array([chain.assemble(x, chain.coordinates) for x in q])
    return q, chain.generalized_forces(q, va, aa)


def agree(exact, chain):
    """Freedoms and coordinates of a rounded robot are those of the exact one."""
    assert chain.degrees_of_freedom == exact.degrees_of_freedom
    assert chain.coordinates == exact.coordinates
    mobility, other = chain.mobility(), exact.mobility()
    assert (mobility.rank, mobility.held) == (other.rank, other.held)


def compare(exact, chain, digits):
    """A rounded robot moves as the exact one, and its torques are the same but for its digits."""
    agree(exact, chain)
    q, va, aa = motions(exact)
    f = exact.generalized_forces(q, va, aa)
    q, rounded = forces(chain, q, va, aa)
    assert np.abs(chain.residual(q)).max() < 1e-11
    assert np.abs(rounded - f).max() < EXPLAINED * 10.0**-digits * np.abs(f).max()
    for x, rates in zip(q, va, strict=True):  # an identity of the exact robot, as exact as there
        assert np.abs(chain.Phi(x) @ chain.noc(x, rates).L).max() < 1e-13


@pytest.mark.parametrize("digits", [7, 4])
@pytest.mark.parametrize("name", rr.PLANS)
def test_a_rounded_robot_moves_as_the_exact_one(name, digits):
    plan = rr.drawn_by_cad(rr.PLANS[name](), seed=0)
    chain, records = with_warnings(rr.rounded(plan, digits).chain)
    assert len(records) == 1
    compare(plan.chain(), chain, digits)


def read(plan, digits, folder):
    """The robot as a file says it."""
    path = folder / "robot.urdf"
    text, yaml = rr.urdf_of(plan, digits)
    path.with_suffix(".yaml").write_text(yaml)
    path.write_text(text)
    return ClosedChain.from_urdf(path)


@pytest.mark.parametrize("name", ["four-bar with hinge", "spherical 3-RRR"])
def test_files_of_few_digits_are_read(tmp_path, name):
    digits = 5
    plan = rr.drawn_by_cad(rr.PLANS[name](), seed=3)
    plan.model.damping[:] = 0
    chain, records = with_warnings(read, plan, digits, tmp_path)
    assert sum("few digits" in text for text in records) == 1
    exact = plan.chain(coordinates=chain.coordinates)
    q, va, aa = motions(exact)
    f = exact.generalized_forces(q, va, aa)
    assert chain.degrees_of_freedom == exact.degrees_of_freedom
    q = np.array([chain.assemble(x, chain.coordinates) for x in q])
    difference = chain.generalized_forces(q, va, aa) - f
    assert np.abs(difference).max() < EXPLAINED * 10.0**-digits * np.abs(f).max()


def test_a_right_angle_of_five_digits_is_one(tmp_path):
    """A four-bar drawn in the x-z plane by rpy="1.5708 0 0", which is off by 3.7e-6 rad."""
    plan = rr.bar("hinge")
    upright = pin.SE3(pin.exp3(np.pi / 2 * np.eye(3)[0]), np.zeros(3))
    for j in (1, 3):
        plan.model.jointPlacements[j] = upright * plan.model.jointPlacements[j]
    plan.model.gravity.linear = np.array([0, 0, -9.81])
    text, yaml = rr.urdf_of(plan, 4)
    assert 'rpy="1.5708 ' in text
    (tmp_path / "bar.urdf").write_text(text)
    (tmp_path / "bar.yaml").write_text(yaml)
    chain = ClosedChain.from_urdf(tmp_path / "bar.urdf")
    q = chain.assemble([1.2, -0.725, 1.969], ["crank"])
    exact = rr.bar("hinge").chain()
    assert_allclose(
        chain.compute_torques(q, [1], [1]), exact.compute_torques(exact.home, [1], [1]), rtol=1e-4
    )


def test_the_warning_says_which_loops_are_open_how_far_and_what_was_changed():
    plan = rr.bar("hinge", across=2e-4)
    chain, (records,) = with_warnings(plan.chain)
    assert "coupler_end - rocker_end" in records
    assert "few digits" in records
    metres, degrees, by_metres, by_degrees = map(
        float, re.findall(r"([\d.e-]+) (?:m|degrees)\b", records)
    )
    assert metres == pytest.approx(2e-4, rel=0.02)
    places = zip(plan.model.frames, chain.mechanism.model.frames, strict=True)
    ways = [pin.log6(a.placement.actInv(b.placement)).vector for a, b in places]
    places = zip(plan.model.jointPlacements, chain.mechanism.model.jointPlacements, strict=True)
    ways += [pin.log6(a.actInv(b)).vector for a, b in places]
    assert by_metres == pytest.approx(np.abs(ways)[:, :3].max(), rel=0.05)
    assert np.radians(by_degrees) == pytest.approx(np.abs(ways)[:, 3:].max(), rel=0.05)
    assert by_metres < metres
    assert degrees < 0.1


def test_a_chain_made_of_a_corrected_one_warns_no_more():
    chain, records = with_warnings(rr.rounded(rr.drawn_by_cad(rr.PLANS["SST"](), 0), 5).chain)
    assert records
    _, records = with_warnings(chain.with_coordinates, chain.coordinates)
    assert not records


def test_validate_notes_few_digits_and_finds_no_error(tmp_path):
    plan = rr.drawn_by_cad(rr.PLANS["four-bar with hinge"](), seed=3)
    with_warnings(read, plan, 5, tmp_path)
    problems, records = with_warnings(sst_pin.validate, tmp_path / "robot.urdf")
    assert not records
    assert {p.severity for p in problems} == {"note"}
    assert sum("few digits" in p.text for p in problems) == 1


@pytest.mark.parametrize("kind", ["3d", "hinge"])
def test_a_closure_two_millimetres_across_the_plane_is_refused(kind):
    """On a robot of 0.4 m, when it is made; the error names the loop and the best pose's gap."""
    plan = rr.bar(kind, across=2e-3)
    with pytest.raises(ClosureError, match="coupler_end - rocker_end") as caught:
        plan.chain()
    assert caught.value.residual == pytest.approx(2e-3, rel=0.01)


@pytest.mark.parametrize("kind", ["3d", "hinge"])
@pytest.mark.parametrize("tilted", ["crank", "coupler", "rocker"])
def test_an_axis_tilted_by_a_degree_holds_the_robot(kind, tilted):
    plan = rr.bar(kind, tilt=np.radians(1), tilted=tilted)
    with pytest.raises(SSTError):
        plan.chain().compute_torques(plan.model.referenceConfigurations["home"], [0], [0])


def test_a_motor_whose_joint_is_held_is_named():
    """A loop of three bars holds its motor; an arm beside it moves."""
    bars = [("crank", "universe", 0.0, 0.3), ("strut", "universe", 0.4, 0.2)]
    model = rr.planar([*bars, ("arm", "universe", 1.0, 0.3)])
    closures = [sst_pin.Closure("crank_end", "strut_end", "3d")]
    with pytest.warns(DescriptionWarning, match="joints of the motors crank, which cannot move"):
        chain = ClosedChain(model, closures, ["crank", "arm"])
    assert chain.coordinates == ("arm",)
