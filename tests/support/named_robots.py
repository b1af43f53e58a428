# SPDX-License-Identifier: BSD-2-Clause
"""Robots of the gallery and others, by a name."""

import tempfile
import warnings
from functools import cache
from pathlib import Path

import sst_pin
from tests.gallery import EVERY_ROBOT
from tests.support import any_chain
from tests.support.files import load

cassie = load("examples/cassie.py")

PULL = {"stiffness": 30, "rest_length": 0.1, "damping": 0.3, "preload": 2}
LINE = sst_pin.LineForce("point_arm_2", "point_arm_5", **PULL)
OTHERS = {
    "coupled": any_chain.coupled,
    "rods": any_chain.rods,
    "line": lambda: any_chain.chain(lines=[LINE]),
    "tree": lambda: any_chain.with_joint("free-flyer", kind=""),  # without closures, in space
    "wheel": lambda: any_chain.rolling(False),
}


@cache
def robot_named(name):
    """A robot of the gallery, of `OTHERS`, or one with a joint of this kind."""
    if name == "sst":
        return sst_pin.SST(sst_pin.Parameters(viscous_friction=0.1, coulomb_friction=0.02))
    if name in ("cassie", "floating cassie"):
        locked = cassie.HELD if name == "cassie" else ()  # on a stand, or free with soft springs
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "cassie.xml")
            path.write_text(cassie.mjcf())
            with warnings.catch_warnings():
                # Friction of a ball acts about the axes that are not locked: what is wanted here.
                warnings.simplefilter("ignore", sst_pin.DescriptionWarning)
                return sst_pin.ClosedChain.from_mjcf(path, locked=locked)
    if name in any_chain.JOINTS or name in any_chain.IN_A_ROW:
        return any_chain.with_joint(name)
    return (OTHERS.get(name) or EVERY_ROBOT[name])()
