# SPDX-License-Identifier: BSD-2-Clause
"""Loads of joints and closures along a motion."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import robots
from tests.support.oblique import with_oblique_axes

DELTA = robots.delta()


@pytest.fixture(scope="module")
def motion():
    torque = np.array([0.3, -0.2, 0.1])
    return DELTA.simulate(torque, DELTA.home, np.zeros(3), 0.1 * np.linspace(0, 1, 11) ** 2)


def test_peaks_and_means_are_those_of_the_reactions(motion):
    w = DELTA.reactions(motion.q, motion.va, tau=motion.tau)
    rows = {(row.name, row.kind): row for row in DELTA.loads(motion).rows}
    assert len(rows) == 2 * len(w.names)
    for name in w.names:
        for kind, part in (("force", slice(0, 3)), ("moment", slice(3, 6))):
            row, vectors = rows[name, kind], w.of(name)[:, part]
            sizes = np.linalg.norm(vectors, axis=1)
            assert row.peak == pytest.approx(sizes.max(), rel=1e-12)
            mean = np.trapezoid(sizes**2, motion.t) / 0.1
            assert row.rms**2 == pytest.approx(mean, rel=1e-12)
            at = np.flatnonzero(motion.t == row.time)[0]
            assert row.peak * np.array(row[4:7]) == pytest.approx(vectors[at], abs=1e-12)
            assert row.determined
    for row in DELTA.loads(motion[:1]).rows:  # one sample is its own mean
        assert row.rms == pytest.approx(row.peak, rel=1e-12)


def test_what_is_not_unique_is_no_number_in_the_table():
    chain = robots.four_bar()
    swing = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))
    rows = {(row.name, row.kind): row for row in chain.loads(swing).rows}
    moment = rows["crank", "moment"]
    assert moment.components == "z"  # that of the motor
    assert "; z is not unique" in repr(chain.loads(swing))
    w = chain.reactions(swing.q, swing.va, tau=swing.tau)
    for name in w.names:
        row, in_plane = rows[name, "force"], w.of(name)[:, :2]
        assert row.components == "xy"
        assert not row.determined
        assert row.peak == pytest.approx(np.linalg.norm(in_plane, axis=1).max(), rel=1e-12)
        assert np.isnan(row.z)
    (pin,) = chain.closures
    doubled = sst_pin.ClosedChain(chain.model, [pin, pin], chain.motor_names)
    (row,) = (r for r in doubled.loads(swing).rows if r.name == f"{pin} (1)" and r.kind == "force")
    assert row.components == ""
    assert np.isnan([row.peak, row.time, row.rms]).all()
    assert "not unique; see stiffness=" in repr(doubled.loads(swing))
    soft = dict.fromkeys((*chain.joint_names, str(chain.closures[0])), np.ones(6))
    assert all(np.isfinite(row.peak) for row in chain.loads(swing, stiffness=soft).rows)


def test_loads_in_axes_along_the_plane_are_those_of_a_robot_with_such_axes():
    """The own axes of the joints are oblique to the plane, so that nothing there is unique."""
    aligned = robots.four_bar()
    oblique = with_oblique_axes(aligned, 3)
    t = np.linspace(0, 0.1, 11)
    swing = aligned.simulate([0], aligned.home, [0], t)
    same = oblique.trajectory(t, swing.q, swing.va, swing.aa, swing.tau)
    data = aligned.model.createData()
    pin.forwardKinematics(aligned.model, data, aligned.home)
    R = data.oMi[1].rotation  # its z axis is the normal of the plane
    rows = oblique.loads(same, axes=R).rows
    assert all(not r.components for r in oblique.loads(same).rows if r.kind == "force")
    for row, expected in zip(rows, aligned.loads(swing, axes=R).rows, strict=True):
        assert row.components == expected.components
        assert row.peak == pytest.approx(expected.peak, rel=1e-9, nan_ok=True)
        assert row[4:7] == pytest.approx(expected[4:7], abs=1e-9, nan_ok=True)
        if row.kind == "force":
            assert row.components == "xy"
    with pytest.raises(sst_pin.InputError, match="not orthonormal"):
        oblique.loads(same, axes=2 * R)


def test_the_table_has_no_noise():
    """Forces in the plane of a planar robot make no moments in its plane; rounding is 0."""
    chain = robots.slider_crank()
    swing = chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))
    soft = dict.fromkeys((*chain.joint_names, *map(str, chain.closures)), np.ones(6))
    rows = chain.loads(swing, stiffness=soft).rows
    peaks = np.array([row.peak for row in rows])
    assert (peaks == 0).any()
    assert peaks[peaks > 0].min() > 1e-9 * peaks.max() * chain.mechanism.length


def test_a_motion_under_other_loads_is_refused(motion):
    heavy = DELTA.trajectory(motion.t, motion.q, motion.va, motion.aa, motion.tau + 1)
    with pytest.raises(sst_pin.InputError, match="other forces than its torques"):
        DELTA.loads(heavy)
    with pytest.raises(sst_pin.InputError, match="belongs to another robot"):
        robots.stewart().loads(motion)


def test_the_table_is_written_and_read_by_pandas(motion, tmp_path):
    pandas = pytest.importorskip("pandas")
    table = DELTA.loads(motion)
    table.save(tmp_path / "loads.csv")
    read = pandas.read_csv(tmp_path / "loads.csv")
    pandas.testing.assert_frame_equal(read, table.to_dataframe(), rtol=1e-15)
    with pytest.raises(sst_pin.OutputError, match="exists"):
        table.save(tmp_path / "loads.csv")
