# SPDX-License-Identifier: BSD-2-Clause
"""The conventions of other people's loaders."""

import sys
import types
from importlib import import_module
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import sst_pin


def test_load_is_a_robot_wrapper_with_geometry_and_poses(robot):
    """model, q0, visual and collision models, as example_robot_data has them."""
    wrapper = sst_pin.load()
    assert isinstance(wrapper, pin.RobotWrapper)
    assert wrapper.model.nq == wrapper.model.nv == 9
    assert np.array_equal(wrapper.q0, robot.home)
    assert wrapper.model.gravity.linear.tolist() == [0, 0, -9.81]
    assert wrapper.visual_model.ngeoms == 12
    assert all(Path(g.meshPath).is_file() for g in wrapper.visual_model.geometryObjects)
    poses = wrapper.model.referenceConfigurations
    start = robot.inverse_kinematics(sst_pin.paper_circle([0.0]).R[0])
    for name, q in (("home", robot.home), ("circle_start", start)):
        assert poses[name] == pytest.approx(q, abs=1e-14)  # files have 14 decimals
        assert np.abs(robot.residual(poses[name])).max() < 1e-14


def test_named_poses_are_free_of_collisions():
    """The pairs that the SRDF leaves are checked; bodies that always touch are not among them."""
    wrapper = sst_pin.load()
    model, collision = wrapper.model, wrapper.collision_model

    def links(pair):
        frames = (collision.geometryObjects[i].parentFrame for i in (pair.first, pair.second))
        return frozenset(model.frames[f].name for f in frames)

    for name in ("home", "circle_start"):
        q = model.referenceConfigurations[name]
        assert not pin.computeCollisions(
            model, wrapper.data, collision, wrapper.collision_data, q, False
        )
    checked = {links(pair) for pair in collision.collisionPairs}
    assert frozenset({"passive_1", "star_2"}) in checked
    assert frozenset({"link_1", "link_2"}) in checked
    assert frozenset({"base", "link_1"}) not in checked
    assert frozenset({"star_1", "star_3"}) not in checked


def test_load_says_what_is_missing(tmp_path):
    (tmp_path / "sst.urdf").write_bytes(Path(sst_pin.URDF_PATH).read_bytes())
    with pytest.raises(sst_pin.DescriptionError, match="SRDF beside the URDF"):
        sst_pin.load(tmp_path / "sst.urdf")
    (tmp_path / "sst.srdf").write_bytes(Path(sst_pin.SRDF_PATH).read_bytes())
    with pytest.raises(sst_pin.DescriptionError, match="shapes cannot be loaded"):
        sst_pin.load(tmp_path / "sst.urdf")


@pytest.mark.parametrize("tool", ["pinocchio", "mujoco", "yourdfpy"])
def test_loaders_of_robot_descriptions_take_our_paths(tool, monkeypatch):
    module = types.ModuleType("robot_descriptions.sst_description")
    for name in ("REPOSITORY_PATH", "PACKAGE_PATH", "URDF_PATH", "MJCF_PATH", "SRDF_PATH"):
        path = getattr(sst_pin, name)
        assert isinstance(path, str)
        assert Path(path).exists()
        setattr(module, name, path)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    loader = import_module(f"robot_descriptions.loaders.{tool}")
    loaded = loader.load_robot_description("sst_description")
    if tool == "pinocchio":
        assert loaded.visual_model.ngeoms == 12
        assert loaded.model.nq == 9
    elif tool == "mujoco":
        assert (loaded.nq, loaded.neq) == (9, 2)
        scene = loader.load_robot_description("sst_description", variant="scene")
        assert scene.geom("floor").id >= 0
    else:
        assert len(loaded.actuated_joint_names) == 9
        assert len(loaded.scene.geometry) == 12
