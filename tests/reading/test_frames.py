# SPDX-License-Identifier: BSD-2-Clause
"""A name in a file means on the chain what it means in the file: bodies, links, frames, sites."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import sst_pin

GEOM = '<geom type="box" size=".1 .2 .3" pos=".1 0 .2"/>'


def random_mjcf(seed: int) -> str:
    """A tree whose joints, bodies and sites share names, with joints beside the bodies' origins."""
    rng = np.random.default_rng(seed)

    def triple() -> str:
        return " ".join(map(str, rng.normal(size=3).round(3)))

    def body(depth: int, name: str) -> str:
        named = rng.random() < 0.5
        joints = ""
        kinds = (
            ["ball"]
            if rng.random() < 0.3
            else rng.choice(["hinge", "slide"], 3)[: rng.integers(1, 4)]
        )
        for k, kind in enumerate(kinds):
            word = f'name="{name if k == 0 else f"{name}{k}"}"' if named else ""
            joints += f'<joint {word} type="{kind}" pos="{triple()}" axis="{triple()}"/>'
        sites = f'<site name="{name}" pos="{triple()}"/><site name="s_{name}" euler="{triple()}"/>'
        children = "".join(
            body(depth + 1, name + x) for x in "lr"[: rng.integers(2 - depth, 3 - depth)]
        )
        at = f'pos="{triple()}" euler="{triple()}"'
        return f'<body name="{name}" {at}>{joints}{GEOM}{sites}{children}</body>'

    fixed = f'<body name="table" pos="{triple()}">{GEOM}</body>'
    floats = f'<body name="box" pos="{triple()}"><freejoint/>{GEOM}</body>'
    bodies = [body(0, "a"), fixed, floats, body(0, "b")]
    rng.shuffle(bodies)
    return f"<mujoco><worldbody>{''.join(bodies)}</worldbody></mujoco>"


def read(text: str, tmp_path) -> tuple[sst_pin.ClosedChain, mujoco.MjModel]:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    return sst_pin.ClosedChain.from_mjcf(path), mujoco.MjModel.from_xml_path(str(path))


def placements(mj: mujoco.MjModel, qpos) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Poses of bodies and sites in MuJoCo; a site beside its body is NAME_site."""
    data = mujoco.MjData(mj)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mj, data)
    bodies = {mj.body(i).name: (data.xpos[i], data.xmat[i]) for i in range(1, mj.nbody)}
    sites = {mj.site(i).name: (data.site_xpos[i], data.site_xmat[i]) for i in range(mj.nsite)}
    apart = {f"{name}_site" if name in bodies else name: place for name, place in sites.items()}
    return {**apart, **bodies}


def qpos_of(chain: sst_pin.ClosedChain, q) -> np.ndarray:
    """MuJoCo's coordinates: quaternions with the scalar first."""
    qpos = np.array(q)
    for joint in chain.model.joints[1:]:
        if joint.nq > joint.nv:
            last = slice(joint.idx_q + joint.nq - 4, joint.idx_q + joint.nq)
            qpos[last] = np.roll(qpos[last], 1)
    return qpos


@pytest.mark.parametrize("seed", range(3))
def test_bodies_and_sites_of_an_mjcf_are_where_mujoco_has_them(seed, tmp_path):
    chain, mj = read(random_mjcf(seed), tmp_path)
    q = np.array(chain.home)
    rates = np.random.default_rng(seed).normal(size=chain.model.nv)
    q = pin.integrate(chain.model, q, rates)
    expected = placements(mj, qpos_of(chain, q))
    for name, (position, orientation) in expected.items():
        p, R = chain.frame_placement(q, name)
        np.testing.assert_allclose(p, position, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(R.ravel(), orientation, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("seed", range(3))
def test_names_and_home_of_a_written_mjcf_mean_the_same(seed, tmp_path):
    chain, _ = read(random_mjcf(seed), tmp_path)
    rates = np.random.default_rng(seed).normal(size=chain.model.nv)
    chain.model.referenceConfigurations["home"] = pin.integrate(chain.model, chain.home, rates)
    chain.refresh()
    sst_pin.write_mjcf(chain, tmp_path / "again.xml")
    again = sst_pin.ClosedChain.from_mjcf(tmp_path / "again.xml")
    assert again.joint_names == chain.joint_names
    np.testing.assert_allclose(again.home, chain.home, atol=1e-12)
    joints = set(chain.joint_names)
    for frame in chain.model.frames:
        mine, theirs = (each.frame_placement(each.home, frame.name) for each in (chain, again))
        for x, y in zip(mine, theirs, strict=True):
            np.testing.assert_allclose(x, y, atol=1e-12, err_msg=frame.name)
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "again.xml"))
    data = mujoco.MjData(mj)
    data.qpos[:] = mj.key("home").qpos
    mujoco.mj_kinematics(mj, data)
    assert {mj.joint(i).name for i in range(mj.njnt)} == joints
    p, _ = chain.frame_placement(chain.home, "box")
    np.testing.assert_allclose(data.body("box").xpos, p, atol=1e-12)


I_ONE = "<inertia><ixx>.1</ixx><iyy>.1</iyy><izz>.1</izz></inertia>"


def se3(text: str) -> pin.SE3:
    """A pose of an SDF."""
    x, y, z, roll, pitch, yaw = map(float, text.split())
    c, s = np.cos, np.sin
    Rx = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    Ry = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    Rz = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    return pin.SE3(Rz @ Ry @ Rx, np.array([x, y, z]))


#: A frame, what it is attached to, what its pose is relative to ("" by default), its pose; joints
#: have parent and child too. Each comes after those that it names.
FRAMES = [
    ("link", "a", "", "", "1 0 2 0.1 0.2 0.3"),
    ("link", "b", "", "a", "0.5 -0.2 1 0 0.4 0"),
    ("frame", "on_b", "b", "", "0.8 0.1 0 0.3 0 0"),
    ("frame", "on_that", "on_b", "a", "0 0 0.7 0 0 0.2"),
    ("joint", "j1", ("world", "a"), "", "-0.5 0 0 0 0.1 0"),
    ("joint", "j2", ("a", "on_that"), "", ""),
    ("frame", "on_joint", "j2", "", "0 0.3 0 0 0 0.5"),
    ("link", "c", "", "on_joint", "0 0 0 0.2 0 0"),
    ("joint", "j3", ("on_joint", "c"), "on_b", "0.1 0.2 0 0 0 0"),
]


def sdf_of_frames() -> str:
    """The frames as an SDF; all joints turn about their y."""
    text = ""
    for tag, name, to, relative, pose in FRAMES:
        of = f' relative_to="{relative}"' if relative else ""
        placed = f"<pose{of}>{pose}</pose>" if pose else ""
        if tag == "link":
            inertial = f"<inertial><mass>1</mass>{I_ONE}</inertial>"
            text += f'<link name="{name}">{placed}{inertial}</link>'
        elif tag == "frame":
            text += f'<frame name="{name}" attached_to="{to}">{placed}</frame>'
        else:
            ends = f"<parent>{to[0]}</parent><child>{to[1]}</child>"
            axis = "<axis><xyz>0 1 0</xyz></axis>"
            text += f'<joint name="{name}" type="revolute">{placed}{ends}{axis}</joint>'
    return f'<sdf version="1.9"><model name="m">{text}</model></sdf>'


def poses_of_frames(turns: dict[str, float]) -> dict[str, pin.SE3]:
    """The frames in the world by the rules of SDFormat 1.9, with joints at angles."""
    at, body = {"": pin.SE3.Identity()}, {"world": "world"}
    for tag, name, to, relative, pose in FRAMES:
        default = {"link": "", "frame": to, "joint": to[1] if tag == "joint" else ""}[tag]
        at[name] = at[relative or default] * (se3(pose) if pose else pin.SE3.Identity())
        body[name] = {"link": name, "frame": body.get(to), "joint": None}[tag]
        if tag == "joint":
            body[name] = body[to[1]]
    moved, now = {"world": pin.SE3.Identity()}, {}
    for tag, name, to, *_ in FRAMES:  # the joints come from the base to the tip
        if tag == "joint":
            a, b, y = body[to[0]], body[to[1]], np.array([0, turns[name], 0])
            turn = at[name] * pin.SE3(pin.exp3(y), np.zeros(3)) * at[name].inverse()
            moved[b] = moved[a] * turn
    for _, name, *_ in FRAMES:
        now[name] = moved[body[name]] * at[name]
    return now


def test_links_frames_and_joints_of_an_sdf_are_where_the_rules_of_the_format_put_them(tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_text(sdf_of_frames())
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["j1", "j2", "j3"])
    assert chain.joint_names == ("j1", "j2", "j3")
    q = np.array([0.4, -0.7, 1.1])
    for name, expected in poses_of_frames(dict(zip(chain.joint_names, q, strict=True))).items():
        p, R = chain.frame_placement(q, name)
        np.testing.assert_allclose(p, expected.translation, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(R, expected.rotation, atol=1e-12, err_msg=name)


def test_a_link_of_a_urdf_comes_before_the_joint_of_its_name_elsewhere(tmp_path):
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    inertial += 'iyz="0"/></inertial>'
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint>'
        for name, parent, child in (("arm", "base", "upper"), ("elbow", "upper", "arm"))
    )
    links = "".join(f'<link name="{x}">{inertial}</link>' for x in ("base", "upper", "arm"))
    frame = '<frame name="tool" link="arm" xyz="1 0 0" rpy="0 0 0.5"/>'
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">{links}{joints}{frame}</robot>')
    chain = sst_pin.ClosedChain.from_urdf(path, actuated=["arm", "elbow"])
    p, _ = chain.frame_placement([0, 0], "arm")
    np.testing.assert_allclose(p, [0, 0, 2], atol=1e-15)
    p, R = chain.frame_placement([0, np.pi / 2], "tool")
    np.testing.assert_allclose(p, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(R[:, 2], [1, 0, 0], atol=1e-15)
