# SPDX-License-Identifier: BSD-2-Clause
"""From measured poses of a frame to a calibrated URDF."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import sst_pin
from command_line import run

URDF = Path(__file__).parents[2] / "examples" / "delta.urdf"
MOTORS = ["motor_1", "motor_2", "motor_3"]
FRAME = "platform_3b"
OFFSETS = np.array([2e-3, -1e-3, 1e-3])
HEAD = ",".join([*(f"{name}_deg" for name in MOTORS), *(f"{FRAME}_{c}_mm" for c in "xyz")])
TURN = "".join(f",{FRAME}_q{c}" for c in "wxyz")


@pytest.fixture
def poses(here):
    """Poses where the motors stand a little off from what they tell."""
    chain, rows = sst_pin.ClosedChain.from_urdf(URDF), []
    data, random = chain.model.createData(), np.random.default_rng(0)
    q = chain.assemble(dict.fromkeys(MOTORS, 0.2))
    for _ in range(8):
        x = 0.2 + random.uniform(-0.1, 0.1, 3)
        q = q.copy()
        q[[chain.position_names.index(name) for name in MOTORS]] = x + OFFSETS
        q = chain.assemble(q)
        pin.framesForwardKinematics(chain.model, data, q)
        at = data.oMf[chain.model.getFrameId(FRAME)]
        turn = pin.Quaternion(at.rotation).coeffs()[[3, 0, 1, 2]]
        rows.append([*np.degrees(x), *(1e3 * at.translation), *turn])
    np.savetxt(here / "poses.csv", rows, "%.12g", ",", header=HEAD + TURN, comments="")
    return here / "poses.csv"


def calibrated(capsys, *options, robot=URDF, output="made.urdf"):
    return run(
        capsys,
        *("calibrate", "poses.csv", "-o", output, "--robot", robot),
        *("--frame", FRAME, "--which", "motor_*.ry", *options),
    )


@pytest.mark.parametrize("columns", [6, 10])
@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
def test_offsets_of_motors_go_into_a_urdf_that_is_a_robot(poses, capsys, columns):
    """With the orientation and without."""
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join(",".join(line.split(",")[:columns]) for line in lines))
    code, out, error = calibrated(capsys)
    assert code == 0, error
    assert "motor_2.ry" in out
    assert "8 poses -> made.urdf" in out
    made = sst_pin.ClosedChain.from_urdf(poses.parent / "made.urdf")
    drawn = sst_pin.ClosedChain.from_urdf(URDF)
    for name, offset in zip(MOTORS, OFFSETS, strict=True):
        k = drawn.model.getJointId(name)
        moved = drawn.model.jointPlacements[k].actInv(made.model.jointPlacements[k])
        assert_allclose(pin.log3(moved.rotation), [0, offset, 0], atol=1e-8)
    assert calibrated(capsys)[0] == 2  # the files are there
    code, out, _ = calibrated(capsys, output="-")
    assert out.startswith("<?xml")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (f"{FRAME}_y_mm", "y", f"one column {FRAME}_y_m or {FRAME}_y_mm"),
        (f"{FRAME}_qx", "qx", f"{FRAME}_qx"),
        ("motor_2_deg", "elbow", "motor_2"),
        (
            "\n",
            "\n12,12,12,0,0,-300,2,0,0,0\n",
            "line 2: quaternion of length 2, expected 1, in platform_3b_qx",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::sst_pin.DescriptionWarning")
def test_a_table_without_poses_is_refused_in_one_line(poses, capsys, old, new, told):
    poses.write_text(poses.read_text().replace(old, new, 1))
    code, _, error = calibrated(capsys)
    assert code == 2
    assert told in error.splitlines()[-1]  # below the warning about the assembly mode


@pytest.mark.parametrize("robot", ["delta", "nowhere.urdf"])
def test_the_robot_is_a_urdf(poses, capsys, robot):
    code, _, error = calibrated(capsys, robot=robot)
    assert code == 2
    assert "--robot" in error
