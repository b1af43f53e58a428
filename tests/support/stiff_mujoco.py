# SPDX-License-Identifier: BSD-2-Clause
"""Motions of a robot in MuJoCo with contacts, loops and stops that are as stiff as it allows."""

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

import sst_pin


def stiff_mujoco(chain: sst_pin.ClosedChain, step: float) -> mujoco.MjModel:
    """The robot for `implicitfast`; two steps are the shortest time constant of constraints."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.xml")
        sst_pin.write_mjcf(chain, path)
        root = ET.parse(path).getroot()
    option, closures = root.find("option"), root.find("equality")
    assert option is not None
    assert closures is not None
    option.attrib |= {"timestep": str(step), "integrator": "implicitfast"}
    time = f"{2 * step} 1"
    for pair in root.iter("pair"):
        pair.attrib |= {"solref": time, "solimp": "0.99 0.999 0.001"}
    for closure in closures:
        closure.attrib |= {"solref": time, "solimp": "0.999 0.9999 0.001"}
    for joint in root.iter("joint"):
        if "range" in joint.attrib:
            joint.attrib |= {"solreflimit": time, "solimplimit": "0.99 0.999 0.001"}
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def falls_in_mujoco(
    chain: sst_pin.ClosedChain, step: float, steps: int
) -> tuple[list[str], np.ndarray]:
    """Names of the joints with one position, and these positions from `home` on, (steps + 1, k)."""
    model = stiff_mujoco(chain, step)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    single = {model.joint(k).name: int(model.joint(k).qposadr[0]) for k in range(model.njnt)}
    names = [name for name in chain.position_names if name in single]
    places = [single[name] for name in names]
    positions = [data.qpos[places]]
    for _ in range(steps):
        mujoco.mj_step(model, data)
        positions.append(data.qpos[places])
    return names, np.array(positions)
