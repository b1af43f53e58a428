# SPDX-License-Identifier: BSD-2-Clause
"""The command `sst-pin` as a function, and calls in a process that lacks a package."""

import subprocess
import sys

from sst_pin.cli import main

#: A four-bar in a plane.
BARS = """<mujoco model="bars">
  <worldbody>
    <body name="crank"><joint name="crank" axis="0 1 0"/><geom size="0.02" pos="0.05 0 0"/>
      <body name="coupler" pos="0.1 0 0"><joint name="elbow" axis="0 1 0"/>
        <geom size="0.02" pos="0.15 0 0"/></body></body>
    <body name="rocker" pos="0.3 0 0"><joint name="rocker" axis="0 1 0"/>
      <geom size="0.02" pos="0.1 0 0"/></body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.3 0 0"/></equality>
  <actuator><motor joint="crank"/></actuator>
  <keyframe><key name="home" qpos="0.5 -0.9443 -0.9443"/></keyframe>
</mujoco>"""


def run(capsys, *arguments):
    """Exit code, output, errors."""
    try:
        code = main([str(a) for a in arguments])
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, out, err


def said_without(package, call):
    """What the error of a missing extra says when a call on `sst_pin` needs a package."""
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "import sst_pin\n"
        f"try: {call}\n"
        "except sst_pin.errors.MissingExtraError as error: print(error)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout
