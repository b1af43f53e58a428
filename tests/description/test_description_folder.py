# SPDX-License-Identifier: BSD-2-Clause
"""The contract of a description's folder, for the shipped one and one written by a command."""

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import yaml

import sst_pin
from sst_pin.cli import main

FILES = {f"sst.{ending}" for ending in ("urdf", "yaml", "srdf", "xml", "png")}
FILES |= {"scene.xml", "README.md", "LICENSE", "package.xml", "CMakeLists.txt"}
#: Links without mass, which MJCF has as sites.
FRAMES = {f"closedloop{loop}_{end}" for loop in (1, 2) for end in "AB"} | {"E", "P_1", "P_2", "P_3"}
OPTIONS = "--alpha=110,120,130 --base-radius=0.3 --star-radius=0.5 --link-mass=0.5 --star-mass=3 "
OPTIONS += "--passive-mass=0.1 --viscous-friction=0.1 --coulomb-friction=0.2 --gravity=-1,0,-9.5"
DESCRIBED = [*OPTIONS.split(), "--base-directions", "-1,0,0.1 0,1,0.2 0,0.3,2"]


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    folder = tmp_path_factory.mktemp("described") / "robot"
    assert main(["describe", "-o", str(folder), *DESCRIBED]) == 0
    return folder


@pytest.fixture(params=["shipped", "described"])
def folder(request):
    if request.param == "shipped":
        return Path(sst_pin.sst.PACKAGE_PATH)
    return request.getfixturevalue("described")


def xml(folder, name):
    return ET.parse(folder / name).getroot()


def names(root, path, key="name"):
    return [element.get(key) for element in root.iterfind(path)]


def test_folder_holds_what_its_readme_lists(folder):
    result = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    meshes = {name for name in result if name.startswith("meshes/")}
    assert result - meshes == FILES
    readme = (folder / "README.md").read_text()
    files, _ = readme.split("## How to load it")
    named = set(re.findall(r"^\| (`[^|]*) \|", files, re.MULTILINE))
    listed = {name for cell in named for name in re.findall(r"`([\w.]+/?)`", cell)}
    assert listed == (FILES | {"meshes/"}) - {"README.md"}
    assert "![" in readme
    assert (folder / "sst.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_code_of_the_folders_readme_runs_in_it(folder):
    readme = (folder / "README.md").read_text()
    (block,) = re.findall(r"^```python\n(.*?)^```$", readme, re.M | re.S)
    code = block + "print(robot.home, wrapper.q0, tree.nq, closed.key(0).name)"
    command = [sys.executable, "-B", "-c", code]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert result.stdout.endswith("9 home\n")


def test_nothing_points_outside_the_folder(folder):
    """Relative names only, of files that are there; no macros; each mesh as STL and OBJ."""
    used = set()
    for name in ("sst.urdf", "sst.xml"):
        text = (folder / name).read_text()
        assert not re.search(r"""package://|file://|\$\{|\.\./|file(?:name)?="/""", text), name
        meshes = set(re.findall(r'file(?:name)?="([^"]*)"', text))
        used |= meshes
        assert all((folder / mesh).is_file() for mesh in meshes)
    there = {f"meshes/{path.name}" for path in (folder / "meshes").iterdir()}
    assert there == used | {name.replace(".obj", ".stl") for name in used}
    assert names(xml(folder, "scene.xml"), "include", "file") == ["sst.xml"]


@pytest.mark.parametrize("kind", [pin.GeometryType.VISUAL, pin.GeometryType.COLLISION])
def test_every_body_has_a_picture_and_primitives(folder, kind):
    """As Pinocchio reads them."""
    urdf = str(folder / "sst.urdf")
    model = pin.buildModelFromUrdf(urdf)
    shapes = pin.buildGeomFromUrdf(model, urdf, kind, package_dirs=[str(folder)]).geometryObjects
    bodies = {f"{body}_{k}" for body in ("link", "passive", "star") for k in (1, 2, 3)}
    assert {shape.name.rsplit("_", 1)[0] for shape in shapes} == {"base", *bodies}
    seen = kind == pin.GeometryType.VISUAL
    for shape in shapes:
        assert isinstance(shape.geometry, coal.BVHModelBase) == seen
        assert shape.meshPath.endswith(".obj") == seen


def test_all_files_name_the_same_things(folder):
    """Joints, links, frames, motors and closures of URDF, YAML, SRDF and MJCF."""
    urdf, srdf, mjcf = (xml(folder, name) for name in ("sst.urdf", "sst.srdf", "sst.xml"))
    cuts = yaml.safe_load((folder / "sst.yaml").read_text())
    joints = [j.get("name") for j in urdf.iterfind("joint") if j.get("type") != "fixed"]
    assert names(mjcf, ".//joint[@axis]") == joints
    assert names(srdf, "group[@name='all']/joint") == joints
    motors = names(srdf, "group[@name='motors']/joint")
    assert motors == cuts["name_mot"] == names(mjcf, "actuator/motor", "joint")
    assert set(names(srdf, "passive_joint")) == set(joints) - set(motors)
    links = set(names(urdf, "link"))
    bodies = set(names(mjcf, ".//body"))
    assert bodies <= links
    assert set(names(mjcf, ".//site")) == FRAMES <= links
    for pair in srdf.iterfind("disable_collisions"):
        assert {pair.get("link1"), pair.get("link2")} <= bodies
    welds = [[w.get("site1"), w.get("site2")] for w in mjcf.iterfind("equality/weld")]
    assert welds == cuts["closed_loop"]
    poses = names(srdf, "group_state")
    assert poses == names(mjcf, "keyframe/key") == ["home", "circle_start"]
    for pose in poses:
        values = names(srdf, f"group_state[@name='{pose}']/joint", "value")
        (key,) = names(mjcf, f"keyframe/key[@name='{pose}']", "qpos")
        assert key.split() == values


def test_check_urdf_has_no_objection(folder):
    """The program that ROS users check with; it comes with Pinocchio."""
    command = [Path(sys.executable).with_name("check_urdf"), folder / "sst.urdf"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Successfully Parsed" in result.stdout


def test_options_of_describe_reach_the_robot(described):
    p = sst_pin.SST.from_urdf(described / "sst.urdf").parameters
    paper = sst_pin.Parameters()
    directions = np.array([[-1, 0, 0.1], [0, 1, 0.2], [0, 0.3, 2]])
    expected = directions / np.linalg.norm(directions, axis=1)[:, None]
    assert p.base_directions == pytest.approx(expected, abs=1e-15)
    assert np.degrees(p.arc_angles) == pytest.approx([110, 120, 130], abs=1e-12)
    assert (p.base_radius, p.star_radius) == pytest.approx((0.3, 0.5), abs=1e-15)
    assert (p.links[2].mass, p.passive_links[1].mass, p.star.mass) == (0.5, 0.1, 3)
    # Heavier by density: the inertia goes with the mass.
    assert p.star.inertia == pytest.approx(paper.star.inertia * 3 / 2.6, abs=1e-15)
    assert (p.viscous_friction == 0.1).all()
    assert (p.coulomb_friction == 0.2).all()
    assert p.gravity.tolist() == [-1, 0, -9.5]


def test_describe_takes_its_own_urdf_back(described, tmp_path, capsys):
    """--robot of a described robot writes that robot, changed by the options only."""
    urdf = ["--robot", str(described / "sst.urdf")]
    assert main(["describe", *urdf, "-o", str(tmp_path), "--star-mass", "4"]) == 0
    assert "22 files" in capsys.readouterr().out
    folders = described, tmp_path
    before, after = (sst_pin.SST.from_urdf(f / "sst.urdf").parameters for f in folders)
    assert after.star.mass == 4
    assert after.arc_angles == pytest.approx(before.arc_angles, abs=4e-15)
    assert after.links[0].inertia == pytest.approx(before.links[0].inertia, abs=1e-15)
    assert after.gravity.tolist() == before.gravity.tolist()
