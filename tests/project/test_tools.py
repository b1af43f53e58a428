# SPDX-License-Identifier: BSD-2-Clause
"""Other people's tools see the same robot, and docs/tools.md says what they see.

Tools with a wheel of 100 MB, a compiler or a browser behind them are marked `tools`.
"""

import ctypes
import inspect
import logging
import re
import shutil
import sys
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sst_pin
from tests.support.files import load

script = load("scripts/pages/make_tools_table.py")
TOOLS, measure = script.TOOLS, script.measure
measuring = inspect.getmodule(measure)

PAGE = script.PAGE.read_text(encoding="utf-8")
FOLDER = Path(sst_pin.PACKAGE_PATH)
#: In the extra `dev`, and quick.
LIGHT = {"pin", "mujoco", "yourdfpy"}


def marked(kinds):
    marks = {True: [], False: [pytest.mark.tools]}
    light = [(kind, kind.distribution in LIGHT) for kind in kinds]
    return [pytest.param(kind, id=kind.__name__, marks=marks[quick]) for kind, quick in light]


def installed(kind):
    if reason := kind.missing():
        pytest.skip(reason)
    return kind


@pytest.fixture(params=marked(TOOLS))
def kind(request):
    """Each tool that is installed."""
    return installed(request.param)


@pytest.fixture(params=marked(kind for kind in TOOLS if kind.closing))
def closed(request):
    """Each that simulates the closed robot."""
    return installed(request.param)


measured = cache(measure)


def test_tool_has_our_joints_masses_parts_poses_and_torques(kind):
    """Whatever it can tell: nine joints, 3.68 kg, twelve parts, the rest to 1e-9."""
    facts = measured(kind)
    # A root without an inertial is 1 kg to urchin, which has no dynamics to use it in.
    mass = 4.68 if kind.name == "urchin" else 3.68
    exact = ((facts.joints, 9), (facts.visuals, 12), (facts.mass, pytest.approx(mass, abs=1e-9)))
    assert all(found is None or found == wanted for found, wanted in exact)
    assert all(error is None or error < 1e-9 for error in (facts.pose_error, facts.torque_error))
    # What can be loaded without a word is.
    unknown = ["Unknown tag \"mujoco\" in /robot[@name='sst']"]
    assert facts.warnings == (unknown if kind.name == "urdf_parser_py" else [])


def test_closed_robot_falls_in_the_tool_as_it_does_here(closed, robot):
    """To the error of its steps; the arcs of the star hold together."""
    facts = measured(closed)
    if closed.step is None:
        # Runge-Kutta: 200 steps of rounding, or the give of the welds (test_mjcf.py).
        allowed = 1e-11 if closed.name == "Pinocchio" else 1e-8
        assert max(facts.gap, facts.fall_error) < allowed
        return
    # The new rates move the joints all through a step: half a step ahead of what they should.
    around = np.array([0, measuring.FALL - 1e-3, measuring.FALL + 1e-3])
    motion = robot.simulate(np.zeros(3), robot.home, np.zeros(3), around)
    _, before, after = Rotation.from_matrix(robot.platform_orientation(motion.q))
    speed = (before.inv() * after).magnitude() / 2e-3
    assert facts.fall_error == pytest.approx(closed.step / 2 * speed, rel=0.05)
    assert facts.gap < 1e-6


def test_page_says_what_the_tool_sees(kind):
    assert list(script.problems(PAGE, [(kind, measured(kind))])) == []


def test_page_has_every_tool():
    for name in script.HEADERS:
        _, *rows = script.read_table(PAGE, name)
        assert [row[0] for row in rows] == [kind.name for kind in TOOLS]
    assert all(section(kind) for kind in TOOLS)


def section(kind):
    """How to load it, in the page's words."""
    return PAGE.split(f"\n### {kind.name.partition(',')[0]}\n")[1].split("\n##")[0]


@pytest.mark.parametrize("kind", marked(kind for kind in TOOLS if "```python" in section(kind)))
def test_code_of_the_page_runs(kind, monkeypatch):
    """The command of the page, run in the root of the repository."""
    installed(kind)
    monkeypatch.chdir(script.PAGE.parents[1])
    for block in re.findall(r"^```python\n(.*?)^```$", section(kind), re.MULTILINE | re.DOTALL):
        exec(block, {})


@pytest.mark.parametrize(
    ("old", "new", "column"),
    [
        ("| `sst.urdf` | none | 9 | 3.68 | 12 |", "| `sst.urdf` | none | 9 | 4.68 | 12 |", "4.68"),
        ("| Pinocchio | 19 | 0e+00 |", "| Pinocchio | 19 | 1e-10 |", "1e-10"),
    ],
)
def test_check_sees_a_cell_that_is_not_so(old, new, column):
    kind = measuring.Pinocchio
    assert old in PAGE
    (problem,) = script.problems(PAGE.replace(old, new), [(kind, measured(kind))])
    assert column in problem.splitlines()[0]
    assert column not in problem.splitlines()[1]


@pytest.mark.parametrize(
    ("old", "new", "fact"),
    [
        ('<mass value="0.06" />', '<mass value="0.07" />', "mass"),
        ('iyy="0.005"', 'iyy="0.0051"', "torque_error"),
        ('rpy="1.570796326794896 0.0 1.57', 'rpy="1.571796326794896 0.0 1.57', "pose_error"),
        ('type="revolute"', 'type="fixed"', "joints"),
    ],
)
def test_measurement_sees_a_file_that_says_something_else(tmp_path, old, new, fact):
    """The number that must be off is; one would not notice from a table of agreements."""
    folder = tmp_path / "urdf"
    shutil.copytree(FOLDER, folder)
    text = (FOLDER / "sst.urdf").read_text(encoding="utf-8")
    assert old in text
    (folder / "sst.urdf").write_text(text.replace(old, new, 1), encoding="utf-8")
    if fact == "joints":
        assert len(measuring.Pinocchio(folder).joints) == 8
        return
    facts, ours = measure(measuring.Pinocchio, folder), measured(measuring.Pinocchio)
    assert getattr(facts, fact) - getattr(ours, fact) > 1e-6


def test_every_way_to_warn_is_noticed():
    """C writes past Python, and late; what was written before is not taken for it."""
    c = ctypes.CDLL(None)
    c.puts(b"before")
    with measuring.written() as lines:
        c.puts(b"from C")
        print("print", file=sys.stderr)
        logging.getLogger("some.tool").warning("log")
        warnings.warn("warning", stacklevel=1)
    assert sorted(lines) == ["UserWarning: warning", "from C", "log", "print"]
