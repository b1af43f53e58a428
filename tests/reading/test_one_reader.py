# SPDX-License-Identifier: BSD-2-Clause
"""A file is read once, whoever reads it, and errors of the robot name it."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from tests.support.files import ROOT

EXAMPLES = ROOT / "examples"


@pytest.fixture
def shipped(tmp_path):
    """The files of the SST, which may be changed."""
    return shutil.copytree(Path(sst_pin.URDF_PATH).parent, tmp_path / "sst")


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("[rod_1b_end", "[toe", "frame 'toe' not in"),
        ("motor_1", "moter_1", "joint 'moter_1' not in"),
    ],
)
def test_an_unknown_name_is_told_with_the_file(tmp_path, old, new, fault):
    """Both files: the one that has the name and the one that lacks it."""
    names = ("delta.urdf", "delta.yaml")
    delta, file = (Path(shutil.copy(EXAMPLES / name, tmp_path)) for name in names)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(sst_pin.UnknownNameError) as caught:
        sst_pin.ClosedChain.from_urdf(delta)
    assert all(text in str(caught.value) for text in (str(delta), str(file), fault))


def test_an_sst_brings_the_poses_of_its_files(shipped):
    """Those of an SRDF and of keyframes, like any robot that is read."""
    path = shipped / Path(sst_pin.sst.MJCF_PATH).name
    path.write_text(path.read_text().replace('<key name="home"', '<key name="shown"'))
    for reader, file in (("from_urdf", sst_pin.URDF_PATH), ("from_mjcf", path)):
        read = [getattr(kind, reader)(file) for kind in (sst_pin.SST, sst_pin.ClosedChain)]
        poses = (chain.model.referenceConfigurations for chain in read)
        ours, theirs = ({pair.key(): pair.data().tolist() for pair in each} for each in poses)
        assert {name: ours[name] for name in theirs} == theirs != {}
        assert ours.keys() <= {"home", *theirs}  # an SST knows its own
    assert "shown" in ours


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<weld ", "<connect ", r"B \(3d\).*an SST has the welds \(6d\)"),
        ('site2="closedloop2_B"', 'site2="closedloop2_B" active="false"', "equalities"),
        ('"gamma_3" joint="gamma_3"', '"gamma_3" joint="mu_3"', "mu_3"),
        ('"beta_2" type="hinge" axis="0', '"beta_2" type="hinge" axis="9', "beta_2"),
    ],
)
def test_an_mjcf_of_other_equalities_motors_or_axes_is_no_sst(shipped, old, new, told):
    path = shipped / Path(sst_pin.sst.MJCF_PATH).name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(sst_pin.DescriptionError, match=told):
        sst_pin.SST.from_mjcf(path)


@pytest.mark.parametrize(
    ("read", "old", "new"),
    [
        (sst_pin.SST.from_urdf, "[6d, 6d]", "[3d, 6d]"),
        (sst_pin.SST.from_urdf, "2_A, closedloop2", "1_A, closedloop1"),
        (sst_pin.load, "gamma_3]", "mu_3]"),
    ],
)
def test_a_yaml_of_other_cuts_is_no_sst(shipped, read, old, new):
    path = shipped / "sst.yaml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(sst_pin.DescriptionError, match="an SST has") as caught:
        read(shipped / "sst.urdf")
    assert str(path) in str(caught.value)


SITES = '<site site="P_1"/><site site="E"/>'
TENDON = f'<tendon><spatial stiffness="1">{SITES}</spatial></tendon></mujoco>'


@pytest.mark.parametrize(
    ("old", "new"),
    [('<joint name="mu_1"', '<joint name="mu_1" stiffness="2"'), ("</mujoco>", TENDON)],
)
def test_springs_of_an_mjcf_are_not_lost_in_an_sst(shipped, old, new):
    """They act as in every other chain; `Parameters` have none, and say so."""
    path = shipped / Path(sst_pin.sst.MJCF_PATH).name
    path.write_text(path.read_text().replace(old, new, 1))
    robot, chain = sst_pin.SST.from_mjcf(path), sst_pin.ClosedChain.from_mjcf(path)
    q = robot.home
    tau = robot.compute_torques(q, [1, 0, 0], [0, 0, 0])
    np.testing.assert_allclose(tau, chain.compute_torques(q, [1, 0, 0], [0, 0, 0]), atol=1e-12)
    assert np.abs(tau - sst_pin.SST().compute_torques(q, [1, 0, 0], [0, 0, 0])).max() > 1e-3
    with pytest.raises(sst_pin.DescriptionError, match="springs"):
        _ = robot.parameters


def test_the_shapes_of_an_mjcf_stay_with_its_robot(shipped):
    """The file is compiled once; a copy in another process needs it no more."""
    chain = sst_pin.ClosedChain.from_mjcf(shipped / Path(sst_pin.sst.MJCF_PATH).name)
    shutil.rmtree(shipped)
    copy = pickle.loads(pickle.dumps(chain))
    bodies = [len(c.visual_model.geometryObjects) for c in (chain, copy)]
    assert bodies[0] == bodies[1] > 0
