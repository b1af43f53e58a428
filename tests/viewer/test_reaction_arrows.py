# SPDX-License-Identifier: BSD-2-Clause
"""Arrows of reactions in the viewer: where the forces act, as long as they are large."""

import numpy as np
import pinocchio as pin
import pytest

import any_chain
import sst_pin
from sst_pin import robots
from sst_pin.cli import main
from sst_pin.viewer import Viewer
from sst_pin.viewer.sketch import pulls_of


def drawn(viewer, robot, q, placements):
    """Start of each arrow, and the way to its tip, base axes."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    for pull in pulls_of(robot, viewer._scene.size):
        at = data.oMi[int(pull.shape.mover)].homogeneous @ placements[f"robot/{pull.shape.node}"]
        yield at[:3, 3], at[:3, 2]


@pytest.mark.parametrize("name", ["delta", "stewart"])
def test_arrows_are_the_forces_of_the_reactions(name):
    robot = getattr(robots, name)()
    q, tau = robot.home, np.linspace(1, 2, len(robot.motor_names))
    viewer = Viewer(robot, reactions=True)
    placed = {}
    viewer._drawing.place = lambda q, effort: placed.update(
        type(viewer._drawing)._placements(viewer._drawing, q, effort)
    )
    viewer.show(q, tau)
    w = robot.reactions(q, np.zeros(robot.degrees_of_freedom), tau=tau)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    ends = [data.oMf[robot.model.getFrameId(closure.frame_b)] for closure in robot.closures]
    places = [*data.oMi[1:], *ends]
    forces = np.concatenate([w.joints, w.closures])[:, 3:]
    forces = np.array([at.rotation @ f for at, f in zip(places, forces, strict=True)])
    starts, ways = map(np.array, zip(*drawn(viewer, robot, q, placed), strict=True))
    assert starts == pytest.approx(np.array([at.translation for at in places]), abs=1e-12)
    sizes = np.linalg.norm(forces, axis=1)
    large = sizes > 0.01 * sizes.max()  # arrows have a smallest size
    factor = np.linalg.norm(ways, axis=1).max() / sizes.max()
    assert ways[large] == pytest.approx(factor * forces[large], abs=1e-9 * factor)
    assert f"the largest is {sizes.max():.3g} N" in viewer.html


def test_forces_that_are_not_unique_are_named_and_drawn_with_stiffnesses_only():
    robot = robots.four_bar()
    swing = robot.simulate([0], robot.home, [0], np.linspace(0, 0.1, 5))
    with robot.show(swing, open_browser=False, reactions=True) as viewer:
        assert "Not unique, so not drawn: crank, coupler, rocker" in viewer.html
        assert "Dark arrows" not in viewer.html
    soft = dict.fromkeys((*robot.joint_names, str(robot.closures[0])), np.ones(6))
    with robot.show(swing, open_browser=False, reactions=soft) as viewer:
        assert "Not unique" not in viewer.html
        assert "Dark arrows" in viewer.html
        assert viewer._panel["layers"]["reactions"]
    assert "reactions" not in Viewer(robot)._panel["layers"]


@pytest.mark.parametrize("reactions", ["yes", 1, None, {"crank": [1, 2]}])
def test_what_is_no_switch_and_no_stiffness_is_refused(reactions):
    with pytest.raises(sst_pin.InputError, match="stiffness"):
        Viewer(robots.four_bar(), reactions=reactions)


def test_a_motion_under_other_loads_and_an_open_loop_have_no_arrows_in_silence():
    robot = robots.five_bar()
    motion = robot.simulate([0, 0], robot.home, [0, 0], [0, 0.1, 0.2])
    heavy = robot.trajectory(motion.t, motion.q, motion.va, motion.aa, motion.tau + 1)
    viewer = Viewer(robot, reactions=True)
    with pytest.raises(sst_pin.InputError, match="other forces than its torques"):
        viewer.play(heavy)
    viewer.show(np.add(robot.home, [0, 0.1, 0, 0]))
    assert "No reactions: " in viewer.html


@pytest.mark.parametrize("make", [any_chain.coupled, lambda: any_chain.rolling(False)])
def test_couplings_and_wheels_have_pages_too(make):
    chain = make()
    count = len(list(pulls_of(chain, 1.0)))
    couplings = sum(isinstance(c, sst_pin.Coupling) for c in chain.closures)
    assert count == chain.model.njoints - 1 + len(chain.closures) - couplings
    assert "<html" in Viewer(chain, reactions=True).html


def test_the_command_shows_reactions(tmp_path):
    page = tmp_path / "delta.html"
    assert main(["show", "--robot", "delta", "--reactions", "--html", str(page)]) == 0
    assert "Dark arrows" in page.read_text()
