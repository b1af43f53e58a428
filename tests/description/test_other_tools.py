# SPDX-License-Identifier: BSD-2-Clause
"""Other people's tools load the description as docs/evidence.md says."""

import pytest

from tests.support.files import ROOT

URDF = str(ROOT / "urdf" / "sst.urdf")


def test_drake_loads_the_description():
    parsing = pytest.importorskip("pydrake.multibody.parsing", reason="extra 'tools'")
    plants = pytest.importorskip("pydrake.multibody.plant", reason="extra 'tools'")
    plant = plants.MultibodyPlant(1e-3)
    parsing.Parser(plant).AddModels(URDF)
    plant.Finalize()
    assert plant.num_positions() == 9


def test_pybullet_loads_the_description():
    pybullet = pytest.importorskip("pybullet", reason="extra 'tools'")
    client = pybullet.connect(pybullet.DIRECT)
    try:
        robot = pybullet.loadURDF(URDF, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        joints = range(pybullet.getNumJoints(robot))
        types = [pybullet.getJointInfo(robot, joint)[2] for joint in joints]
        assert types.count(pybullet.JOINT_REVOLUTE) == 9
    finally:
        pybullet.disconnect(client)
