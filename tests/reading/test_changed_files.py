# SPDX-License-Identifier: BSD-2-Clause
"""Files changed at random are refused, or read with exactly the numbers in the file.

Torques of what was read are compared with those of `plain_reading`, which reads the file once more
with other means and solves for Lagrange multipliers. The default run takes the same few hundred
files each time; `-m slow` takes ten times as many.
"""

import csv
import io
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st

import sst_pin
from sst_pin.simulation.motion_files import read_motion
from sst_pin.sst.paper import example_1
from sst_pin.sst.star_tables import star_motion
from tests.support import plain_reading
from tests.support.mutations import changed_csv, changed_xml, changed_yaml

#: Both sides are solved by least squares with rounding of 1e-13 times a condition below 1e4.
CLOSE = 1e-7
#: The drift of MuJoCo's closures is a central difference.
CLOSE_IN_DIFFERENCES = 1e-4

#: A four-bar in the plane, 1 + 2 + 1.5 on 2.2 m, cut at the end of its rocker.
FOUR_BAR = """<robot name="four_bar">
  <link name="base"/>
  <link name="crank"><inertial><origin xyz="0.5 0 0" rpy="0 0 0.1"/><mass value="1.5"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>
  <link name="coupler"><inertial><origin xyz="1 0.1 0" rpy="0 0 0"/><mass value="2"/>
    <inertia ixx="0.2" ixy="0" ixz="0" iyy="0.3" iyz="0" izz="0.4"/></inertial></link>
  <link name="rocker"><inertial><origin xyz="0.7 0 0" rpy="0 0 0"/><mass value="1.2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.15"/></inertial></link>
  <link name="weight"><inertial><origin xyz="0 0.1 0" rpy="0.2 0 0"/><mass value="0.3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="end"/>
  <link name="pivot"/>
  <joint name="crank" type="revolute"><parent link="base"/><child link="crank"/>
    <origin xyz="0 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/>
    <dynamics damping="0.4" friction="0.3"/></joint>
  <joint name="coupler" type="continuous"><parent link="crank"/><child link="coupler"/>
    <origin xyz="1 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="rocker" type="revolute"><parent link="coupler"/><child link="rocker"/>
    <origin xyz="2 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/>
    <dynamics damping="0.2" friction="0"/></joint>
  <joint name="screwed" type="fixed"><parent link="coupler"/><child link="weight"/>
    <origin xyz="1.5 0.2 0" rpy="0 0 0.5"/></joint>
  <joint name="at_end" type="fixed"><parent link="rocker"/><child link="end"/>
    <origin xyz="1.5 0 0" rpy="0 0 0"/></joint>
  <joint name="at_base" type="fixed"><parent link="base"/><child link="pivot"/>
    <origin xyz="2.2 0 0" rpy="0 0 0"/></joint>
</robot>
"""
FOUR_BAR_MJCF = """<mujoco model="four_bar"><compiler angle="radian"/>
  <option gravity="0.5 -9.81 0"/>
  <worldbody><body name="crank" pos="0 0 0"><joint name="crank" axis="0 0 1" armature="0.1"/>
    <inertial pos="0.5 0 0" mass="1.5" diaginertia="0.1 0.2 0.25"/>
    <body name="coupler" pos="1 0 0"><joint name="coupler" axis="0 0 1" damping="0.1"/>
      <inertial pos="1 0 0" mass="2" diaginertia="0.2 0.3 0.4"/>
      <body name="rocker" pos="2 0 0"><joint name="rocker" axis="0 0 1" frictionloss="0.2"/>
        <inertial pos="0.7 0 0" mass="1.2" diaginertia="0.1 0.1 0.15"/>
        <site name="end" pos="1.5 0 0"/></body></body></body>
    <site name="pivot" pos="2.2 0 0"/></worldbody>
  <equality><connect site1="end" site2="pivot"/></equality>
  <actuator><motor name="crank" joint="crank"/></actuator></mujoco>
"""
FOUR_BAR_CUTS = """closed_loop: [[end, pivot]]
type: [3d]
name_mot: [crank]
gravity: [0.5, -9.81, 0.0]
"""
#: Near its assembly.
FOUR_BAR_GUESS = (0.8, -0.8, -1.9)
#: Attributes of MJCF that change the dynamics.
MJCF_EXTRA = tuple(
    (element, *change.split("="))
    for element, changes in {
        "option": "density=1000, viscosity=1, wind=1 0 0, timestep=0.1, integrator=implicit",
        "body": "gravcomp=1, mocap=true, quat=0.5 0.5 0.5 0.5, euler=0 0 0.3",
        "inertial": "quat=0.5 0.5 0.5 0.5, mass=5",
        "joint": (
            "armature=0.5, ref=0.3, springref=0.3, stiffness=2, damping=3, frictionloss=3, "
            "pos=0.1 0 0, type=slide, type=ball, type=free, limited=true, "
            "actuatorgravcomp=true"
        ),
        "motor": "gear=2, jointinparent=crank",
        "compiler": (
            "angle=degree, boundmass=5, boundinertia=1, settotalmass=3, "
            "inertiafromgeom=true, balanceinertia=true, fusestatic=true"
        ),
        "connect": "active=false",
    }.items()
    for change in changes.split(", ")
)


#: Properties of random files: the strategy, how many files the default run takes, the property.
FUZZED = {}


def fuzzed(examples, strategy):
    """Take up a property of random files, a function of a folder and a text."""

    def take(judge):
        FUZZED[judge.__name__] = strategy, examples, judge
        return judge

    return take


def require_same_torques(chain, expected, close):
    """Torques in some motion are the expected ones; loops that do not close are no fault here."""
    n = len(chain.actuated)
    va, aa = np.full(n, 0.5), np.full(n, -0.3)
    start = dict(zip(("crank", "coupler", "rocker"), FOUR_BAR_GUESS, strict=True))
    guess = [start.get(name, 0.1) for name in chain.joint_names]
    try:
        q = chain.assemble(guess, fixed=())
        tau = chain.compute_torques(q, va, aa)
    except sst_pin.SSTError:
        # The judge's loops are open too, or its coordinates are others.
        with suppress(sst_pin.SSTError, np.linalg.LinAlgError):
            expected(chain, np.array(guess), va, aa)  # it can be read all the same
        return
    wanted = expected(chain, q, va, aa)
    scale = 1 + np.abs(wanted).max()
    assert np.abs(tau - wanted).max() < close * scale, (tau, wanted)


def read_or_refused(read, path, content):
    """What a reader makes of a file, None where it refuses it."""
    if isinstance(content, str):
        content = content.encode(errors="replace")
    path.write_bytes(content)
    with suppress(sst_pin.SSTError):
        return read(path)
    return None


def require_right(folder, urdf, cuts):
    """A description is refused by name, or its torques are those of its own numbers."""
    (folder / "robot.yaml").write_text(cuts, encoding="utf-8", errors="replace")
    if chain := read_or_refused(sst_pin.ClosedChain.from_urdf, folder / "robot.urdf", urdf):
        judge = partial(plain_reading.torques_of, urdf, cuts)
        require_same_torques(chain, judge, CLOSE)


@fuzzed(60, changed_xml(FOUR_BAR))
def urdf(folder, text):
    """A URDF is refused, or its numbers are those that stand in it."""
    require_right(folder, text, FOUR_BAR_CUTS)


@fuzzed(60, changed_yaml(FOUR_BAR_CUTS))
def cuts(folder, text):
    """The YAML beside a URDF is refused, or closures, motors and gravity are those in the file."""
    require_right(folder, FOUR_BAR, text)


@fuzzed(40, changed_xml(FOUR_BAR_MJCF, MJCF_EXTRA))
def mjcf(folder, text):
    """An MJCF is refused, or its torques are MuJoCo's own."""
    if chain := read_or_refused(sst_pin.ClosedChain.from_mjcf, folder / "robot.xml", text):
        judge = partial(plain_reading.torques_by_mujoco, text)
        require_same_torques(chain, judge, CLOSE_IN_DIFFERENCES)


@fuzzed(12, changed_xml(FOUR_BAR))
def validated(folder, text):
    """`validate` comes to an end, and finds an error in what `from_urdf` refuses."""
    path = folder / "robot.urdf"
    path.with_suffix(".yaml").write_text(FOUR_BAR_CUTS, encoding="utf-8")
    chain = read_or_refused(sst_pin.ClosedChain.from_urdf, path, text)
    errors = [p for p in sst_pin.validate(path) if p.severity == "error"]
    assert errors or chain


def rows_of(text):
    """Header and numbers of a CSV, by the strict reading; ValueError or worse for anything else."""
    header, *rows = [row for row in csv.reader(io.StringIO(text)) if any(map(str.strip, row))]
    header = [name.strip() for name in header]
    names = [{"t": "t_s", "time": "t_s", "time_s": "t_s"}.get(name, name) for name in header]
    if len(set(names)) != len(names):
        raise plain_reading.UnreadableError("a column twice")
    values = np.array([plain_reading.numbers(" ".join(row), len(names)) for row in rows])
    return dict(zip(names, values.T, strict=True))


ROBOT = sst_pin.SST()
MOTION = example_1(ROBOT, np.linspace(0, 0.05, 8))
EXAMPLE = Path(__file__).parents[2] / "examples" / "figure_eight.csv"
STAR = "\n".join(["t_s,qw,qx,qy,qz", *EXAMPLE.read_text().splitlines()[1:9], ""])


def saved(name):
    """What the file of the motion holds."""
    file = io.BytesIO()
    MOTION.writer(name)(file)
    return file.getvalue()


@fuzzed(60, changed_csv(saved("motion.csv").decode()))
def trajectories(folder, text):
    """A motion is read with exactly the numbers of the CSV, or refused."""
    motion = read_or_refused(sst_pin.Trajectory.load, folder / "motion.csv", text)
    if motion is None:
        return
    table = rows_of(text.removeprefix("\ufeff"))  # a byte order mark
    assert np.array_equal(motion.t, table["t_s"])
    for i, (name, unit) in enumerate(zip(motion.joint_names, motion.units, strict=True)):
        assert np.array_equal(motion.q[:, i], table[f"{name}_{unit}"])
    for k, (name, unit) in enumerate(zip(motion.coordinates, motion.rate_units, strict=True)):
        assert np.array_equal(motion.va[:, k], table[f"{name}_{unit}_s"])
        assert np.array_equal(motion.aa[:, k], table[f"{name}_{unit}_s2"])
    for k, (name, unit) in enumerate(zip(motion.actuated, motion.torque_units, strict=True)):
        assert np.array_equal(motion.tau[:, k], table[f"tau_{name}_{unit}"])


def read_star(path):
    return read_motion(ROBOT.engine, path, partial(star_motion, ROBOT))


@fuzzed(25, changed_csv(STAR))
def motions_of_the_star(folder, text):
    """Torques are found along the orientations that stand in the CSV, or refused."""
    motion = read_or_refused(read_star, folder / "star.csv", text)
    if motion is None:
        return
    table = rows_of(text.removeprefix("\ufeff"))  # a byte order mark
    assert np.array_equal(motion.t, table["t_s"])
    found = ROBOT.platform_orientation(motion.q)
    if "qw" in table:
        p = np.column_stack([table[name] for name in ("qw", "qx", "qy", "qz")])
        p /= np.linalg.norm(p, axis=1)[:, None]
        w, v = p[:, 0], p[:, 1:]
        x = np.column_stack([np.ones(len(p)), np.zeros((len(p), 2))])
        s = x + 2 * np.cross(v, np.cross(v, x) + w[:, None] * x)  # the first axis, turned
        assert np.abs(found[:, :, 0] - s).max() < 1e-9
    tau = sst_pin.SST().compute_torques(motion.q, motion.va, motion.aa)
    assert np.abs(tau - motion.tau).max() < CLOSE * (1 + np.abs(tau).max())


def spoilt_bytes(content):
    """A byte changed, or the end cut off."""
    place = st.integers(0, len(content) - 1)
    exchanged = st.tuples(place, st.integers(0, 255)).map(
        lambda x: content[: x[0]] + bytes([x[1]]) + content[x[0] + 1 :]
    )
    return exchanged | place.map(lambda i: content[:i])


@fuzzed(50, spoilt_bytes(saved("motion.npz")))
def archives(folder, content):
    """An NPZ with a wrong byte gives the motion that was saved, or none."""
    motion = read_or_refused(sst_pin.Trajectory.load, folder / "motion.npz", content)
    assert motion is None or motion == MOTION


@pytest.mark.parametrize("more", [1, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FUZZED)
def test_files_changed_at_random_are_refused_or_read_rightly(name, more, tmp_path):
    strategy, examples, judge = FUZZED[name]

    @settings(
        max_examples=more * examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def holds(text):
        note(str(text)[:5000])
        judge(tmp_path, text)

    holds()
