# SPDX-License-Identifier: BSD-2-Clause
"""Warnings about where a robot starts and what holds it name cures that work."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.errors import ClosureError, DescriptionWarning
from sst_pin.loops.start import start_of


def four_bar(kind, crank=(0, 0, 0.3), coupler=(0.6, 0, 0.2), rocker=(0, 0, 0.5)):
    """Hinges about y; the frames of the closure have the axes of the links."""
    model, joints = pin.Model(), dict[str, int]()
    for name, parent, place in (("crank", "", [0, 0, 0]), ("rocker", "", [0.6, 0, 0])):
        joints[name] = add(model, joints.get(parent, 0), name, place)
    joints["coupler"] = add(model, joints["crank"], "coupler", crank)
    for name, joint, place in (
        ("coupler_end", "coupler", coupler),
        ("rocker_end", "rocker", rocker),
    ):
        end = pin.SE3(np.eye(3), np.array(place))
        model.addFrame(pin.Frame(name, joints[joint], end, pin.FrameType.OP_FRAME))
    return sst_pin.ClosedChain(
        model, [sst_pin.Closure("coupler_end", "rocker_end", kind)], ["crank"]
    )


def add(model, parent, name, place):
    joint = model.addJoint(parent, pin.JointModelRY(), pin.SE3(np.eye(3), np.array(place)), name)
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1, 0.1, 0.1, 0.1), pin.SE3.Identity())
    return joint


@pytest.mark.parametrize(
    ("points", "warning"),
    [
        ([(0, 0, 0.3), (0.6, 0, 0.2), (0, 0, 0.5)], "hold the joints of the motors"),
        ([(0.3, 0, 0), (0.6, 0, 0), (0.3, 0, 0)], "lead to no other pose"),  # in line at zero
    ],
)
def test_a_hinge_across_the_axes_of_the_joints_is_explained(points, warning):
    match = f"{warning}.*a hinge turns about z of its frames"
    with pytest.warns(DescriptionWarning, match=match):
        four_bar("hinge", *points)
    assert four_bar("3d", *points).degrees_of_freedom == 1


def test_positions_of_dependent_joints_with_fixed_choose_the_assembly():
    """Rounded positions of all joints do not close the loop; with `fixed=` they are a guess."""
    chain = four_bar("3d")
    model = chain.model.copy()
    model.jointPlacements[1].translation[2] = 0.02  # open at zero
    chain = chain.with_model(model)
    with pytest.warns(DescriptionWarning, match=r"assemble\(positions, fixed="):
        start_of(chain.engine)
    q = chain.assemble({"crank": 0.1, "rocker": 0.0, "coupler": 0.0}, fixed=["crank"])
    rounded = dict(zip(chain.position_names, q.round(1).tolist(), strict=True))
    with pytest.raises(ClosureError):
        chain.assemble(rounded)
    again = chain.assemble(rounded, fixed=["crank"])
    assert np.abs(again - q).max() < 1e-9  # both are closed to rounding with the same crank


@pytest.mark.parametrize("position", [None, "x", [1.0], 1j, np.nan])
def test_positions_of_coordinates_that_are_no_numbers_are_refused_by_name(position):
    chain = sst_pin.robots.four_bar()
    with pytest.raises(sst_pin.errors.InputError, match="crank"):
        chain.assemble({"crank": position})
