# SPDX-License-Identifier: BSD-2-Clause
"""The biped of tests/gallery/on_feet.py in MuJoCo, as stiff as it allows."""

import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

import sst_pin
from tests.gallery.on_feet import biped


def mujoco_biped(step: float, stiffness: float, damping: float, friction: float) -> mujoco.MjModel:
    """The biped with position actuators of these gains, for `implicitfast`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "biped.xml")
        sst_pin.write_mjcf(biped(friction=friction), path)
        root = ET.parse(path).getroot()
    option = root.find("option")
    assert option is not None
    option.attrib |= {"timestep": str(step), "integrator": "implicitfast"}
    for pair in root.iter("pair"):
        pair.attrib |= {"solref": f"{2 * step} 1", "solimp": "0.99 0.999 0.001"}
    for motor in root.iter("motor"):
        motor.tag = "position"
        motor.attrib |= {"kp": str(stiffness), "kv": str(damping)}
        motor.attrib.pop("ctrlrange", None)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def start_of(chain: sst_pin.ClosedChain, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """qpos at home, with w first in quaternions, and the positions that the motors hold."""
    home, qpos = chain.home, np.zeros(model.nq)
    qpos[:7] = home[[0, 1, 2, 6, 3, 4, 5]]
    order = [model.joint(name).qposadr[0] for name in chain.position_names[7:]]
    qpos[order] = home[7:]
    return qpos, qpos[[model.joint(name).qposadr[0] for name in chain.motor_names]]
