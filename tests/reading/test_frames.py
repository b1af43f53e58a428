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
