# SPDX-License-Identifier: BSD-2-Clause
"""Paths and options that are none, for the readers, `validate`, `load` and the writers.

What may stand in a description is changed at random by `test_fuzz_files.py`.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import sst_pin
from sst_pin import ClosedChain
from tests.fuzz.call_world import ODD_PATHS, World
from tests.fuzz.judged_calls import Call
from tests.fuzz.signature_calls import each

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


def calls(w: World) -> Iterator[Call]:
    """All of them."""
    yield from _paths(w)
    yield from _mjcfs(w)
    yield from _loads(w)
    yield from _exports(w)


def errors_of(path: Any, cuts: Any = None) -> list[sst_pin.Problem]:
    """What `validate` calls errors; none would be silent."""
    found = [p for p in sst_pin.validate(path, cuts) if p.severity == "error"]
    if found:
        raise sst_pin.DescriptionError(str(path), [str(problem) for problem in found])
    return found


def _paths(w: World) -> Iterator[Call]:
    Path("file").write_text("x")
    Path("empty.urdf").write_text("")
    Path("binary.urdf").write_bytes(bytes(range(256)) * 10)
    Path("utf16.urdf").write_bytes(FOUR_BAR.encode("utf-16"))
    Path("latin.urdf").write_bytes(FOUR_BAR.replace("four_bar", "\xe9").encode("latin-1"))
    Path("loop.urdf").symlink_to("loop.urdf")
    odd = {name: path for name, path in ODD_PATHS.items() if not str(path).endswith(".csv")}
    odd |= {
        "NUL": "a\0b.urdf",
        "300 letters": "a" * 300 + ".urdf",
        "surrogate": "\ud800.urdf",
        "missing": "missing.urdf",
        "an empty file": "empty.urdf",
        "a binary file": "binary.urdf",
        "UTF-16": "utf16.urdf",
        "Latin-1": "latin.urdf",
        "a link to itself": "loop.urdf",
        "zeros without end": "/dev/zero",
        "/dev/null": "/dev/null",
    }
    readers: dict[str, Callable[[Any], Any]] = {
        "ClosedChain.from_urdf": ClosedChain.from_urdf,
        "SST.from_urdf": sst_pin.SST.from_urdf,
        "from_urdf(sst.urdf, cuts)": lambda path: ClosedChain.from_urdf(sst_pin.URDF_PATH, path),
        "ClosedChain.from_mjcf": ClosedChain.from_mjcf,
        "SST.from_mjcf": sst_pin.SST.from_mjcf,
        "load": sst_pin.load,
        "validate": errors_of,
        "validate(sst.urdf, cuts)": lambda path: errors_of(sst_pin.URDF_PATH, path),
    }
    for reader, read in readers.items():
        for name, path in odd.items():
            right = None
            if path is None and "cuts)" in reader:  # the file beside the URDF
                right = _is_the_sst
            elif name == "UTF-16":  # XML may be, and the four-bar is; without a YAML it is a tree
                right = _is_the_tree
            yield Call(f"{reader}: {name}", lambda r=read, p=path: r(p), right)
    yield Call("Trajectory.load(/dev/zero)", lambda: sst_pin.Trajectory.load("/dev/zero"))


def _is_the_sst(found: ClosedChain | list[str]) -> bool:
    """Whether the SST was read, or has no errors."""
    return found == [] or found.degrees_of_freedom == 3


def _is_the_tree(found: ClosedChain | list[str]) -> bool:
    """Whether the four-bar's tree was read, or has no errors."""
    return found == [] or found.position_names == ("crank", "coupler", "rocker")


def _mjcfs(w: World) -> Iterator[Call]:
    """Files that lead to others or to nothing, and joints to be held that are none."""
    mesh = '<asset><mesh name="m" file="m.stl"/></asset><worldbody>'
    include = '<include file="odd.xml"/><worldbody>'
    odd = [FOUR_BAR_MJCF.replace("<worldbody>", new) for new in (mesh, include)]
    for text in ("", "<robot/>", "<mujoco/>", *odd):

        def tried(text: str = text) -> ClosedChain:
            Path("odd.xml").write_text(text, encoding="utf-8")
            return ClosedChain.from_mjcf("odd.xml")

        yield Call(f"from_mjcf of {text[-200:]}", tried)
    Path("four_bar.xml").write_text(FOUR_BAR_MJCF, encoding="utf-8")
    held = "crank", 5, None, [None], ["krank"], [0], [["crank"]], ["crank", "coupler", "rocker"]
    read = partial(ClosedChain.from_mjcf, "four_bar.xml")
    yield from each("from_mjcf, locked", lambda x: read(locked=x), held)


def _loads(w: World) -> Iterator[Call]:
    Path("plain.urdf").write_text(FOUR_BAR, encoding="utf-8")
    Path("plain.yaml").write_text(FOUR_BAR_CUTS, encoding="utf-8")
    yield Call("load of no SST", lambda: sst_pin.load("plain.urdf"))
    yield Call("SST.from_urdf of no SST", lambda: sst_pin.SST.from_urdf("plain.urdf"))
    order = w.cuts.replace("[gamma_1, gamma_2,", "[gamma_2, gamma_1,")
    yield Call("motors in another order", lambda: sst_pin.SST.from_urdf(w.described(cuts=order)))


def _exports(w: World) -> Iterator[Call]:
    from sst_pin.compiled.export import c_files

    for name, folder in ODD_PATHS.items():
        if name in ("None", "number", "bytes", "list"):
            yield Call(f"c_files(robot, {name})", lambda f=folder: c_files(w.robot, f))

    def named(files: Any) -> bool:
        return [path.name for path in files] == ["robot.h", "robot.c", "main.c"]

    yield Call("c_files(chain)", lambda: c_files(w.chain, "c"), named)

    def renamed() -> Any:
        urdf = w.urdf.replace('<robot name="sst"', '<robot name="a */ int b; /* \\ ??/"')
        return c_files(sst_pin.SST.from_urdf(w.described(urdf)), "c")

    yield Call(
        "c_files of a robot called a */ int b;",
        renamed,
        lambda files: all(isinstance(path, Path) for path in files),
    )
