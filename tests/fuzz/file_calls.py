# SPDX-License-Identifier: BSD-2-Clause
"""Descriptions that are none, for the readers, `validate`, `load` and the writers."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import plain_reading
from call_world import ODD_PATHS, World
from judged_calls import Call
from signature_calls import same

import sst_pin
from sst_pin import ClosedChain

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
    yield from _urdfs(w)
    yield from _cuts(w)
    yield from _mjcfs(w)
    yield from _loads(w)
    yield from _exports(w)


def reads(name: str, urdf: str = FOUR_BAR, cuts: str = FOUR_BAR_CUTS) -> ClosedChain:
    """The chain of a description written for it."""
    path = Path(f"{name}.urdf")
    path.write_text(urdf, encoding="utf-8")
    path.with_suffix(".yaml").write_text(cuts, encoding="utf-8")
    return ClosedChain.from_urdf(path)


def as_it_stands(urdf: str, cuts: str = FOUR_BAR_CUTS) -> Callable[[ClosedChain], bool]:
    """Whether a chain has the torques that its files describe."""

    def right(chain: ClosedChain) -> bool:
        n = len(chain.actuated)
        state = chain.assemble(FOUR_BAR_GUESS), np.full(n, 0.5), np.full(n, -0.3)
        try:
            wanted = plain_reading.torques_of(urdf, cuts, chain, *state)
        except Exception:  # it cannot be read
            return False
        return same(wanted)(chain.compute_torques(*state))

    return right


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
            default = path is None and "cuts)" in reader  # the file beside the URDF
            yield Call(
                f"{reader}: {name}",
                lambda r=read, p=path: r(p),
                (lambda value: True) if default else None,
            )
    yield Call("Trajectory.load(/dev/zero)", lambda: sst_pin.Trajectory.load("/dev/zero"))


def _urdfs(w: World) -> Iterator[Call]:
    def changed(*pairs: tuple[str, str], count: int = 1) -> str:
        text = FOUR_BAR
        for old, new in pairs:
            assert old in text, old
            text = text.replace(old, new, count)
        return text

    link = '<link name="x"/>'
    joint = (
        '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    entities = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(12))
    bomb = f'<!DOCTYPE r [<!ENTITY a0 "ha">{entities}]><robot name="&a12;"/>'
    deep = "<robot name='r'>" + "<a>" * 200_000 + "</a>" * 200_000 + "</robot>"
    rows = [f'<link name="l{i}"/>' for i in range(20_000)]
    row = [joint.format(f"j{i}", "revolute", f"l{i}", f"l{i + 1}") for i in range(19_999)]
    star = [joint.format(f"j{i}", "revolute", "l0", f"l{i + 1}") for i in range(19_999)]
    odd = {
        "no robot": "<model/>",
        "robot without links": '<robot name="r"/>',
        "a comment": "<!-- -->",
        "a name twice among joints": changed(('name="rocker" type', 'name="crank" type')),
        "a name twice among links": changed(('<link name="weight">', '<link name="end">')),
        "two parents": changed(
            ("</robot>", joint.format("x", "fixed", "rocker", "pivot") + "</robot>")
        ),
        "its own parent": changed(('<parent link="crank"/>', '<parent link="rocker"/>')),
        "two roots": changed(("</robot>", f"{link}</robot>")),
        "no parent": changed(('<parent link="crank"/>', "")),
        "an unknown parent": changed(('<parent link="crank"/>', '<parent link="krank"/>')),
        "no child": changed(('<child link="coupler"/>', "")),
        "floating": changed(('type="continuous"', 'type="floating"')),
        "planar": changed(('type="continuous"', 'type="planar"')),
        "type unknown": changed(('type="continuous"', 'type="ball"')),
        "type Revolute": changed(('type="continuous"', 'type="Revolute"')),
        "no type": changed((' type="continuous"', "")),
        "axis zero": changed(('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>')),
        "axis of two": changed(('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>')),
        "axis NaN": changed(('<axis xyz="0 0 1"/>', '<axis xyz="0 nan 1"/>')),
        "mass 0,3": changed(('value="1.5"', 'value="1,5"')),
        "mass 0.3kg": changed(('value="1.5"', 'value="1.5kg"')),
        "mass ${m}": changed(('value="1.5"', 'value="${m}"')),
        "mass nan": changed(('value="1.5"', 'value="nan"')),
        "mass 1e999": changed(('value="1.5"', 'value="1e999"')),
        "mass -1": changed(('value="1.5"', 'value="-1"')),
        "mass empty": changed(('value="1.5"', 'value=""')),
        "mass of two": changed(('value="1.5"', 'value="1 2"')),
        "mass missing": changed(('<mass value="1.5"/>', "")),
        "mass attribute missing": changed((' value="1.5"', "")),
        "mass 1_5": changed(('value="1.5"', 'value="1_5"')),
        "mass in Arabic": changed(('value="1.5"', 'value="\u0663"')),
        "mass 0x1p1": changed(('value="1.5"', 'value="0x1p1"')),
        "inertia missing": changed(
            ('<inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0" izz="0.25"/>', "")
        ),
        "inertia of five": changed((' izz="0.25"', "")),
        "inertia negative": changed(('ixx="0.1"', 'ixx="-0.1"')),
        "inertia no body has": changed(('izz="0.25"', 'izz="25"')),
        "inertia NaN": changed(('ixx="0.1"', 'ixx="nan"')),
        "mass centre of two": changed(('<origin xyz="0.5 0 0"', '<origin xyz="0.5 0"')),
        "mass centre 0,5": changed(('<origin xyz="0.5 0 0"', '<origin xyz="0,5 0 0"')),
        "origin of four": changed(('<origin xyz="1 0 0"', '<origin xyz="1 0 0 0"')),
        "origin inf": changed(('<origin xyz="1 0 0"', '<origin xyz="inf 0 0"')),
        "rpy words": changed(('rpy="0 0 0.1"', 'rpy="0 0 pi"')),
        "damping 0,4": changed(('damping="0.4"', 'damping="0,4"')),
        "damping NaN": changed(('damping="0.4"', 'damping="nan"')),
        "damping negative": changed(('damping="0.4"', 'damping="-0.4"')),
        "friction inf": changed(('friction="0.3"', 'friction="inf"')),
        "limits crossed": changed(('lower="-3" upper="3"', 'lower="3" upper="-3"')),
        "limit words": changed(('lower="-3"', 'lower="-3rad"')),
        "no limit": changed(('<limit lower="-3" upper="3" effort="9" velocity="9"/>', "")),
        "no inertial": changed(
            (FOUR_BAR[FOUR_BAR.index('<inertial><origin xyz="0.5') : FOUR_BAR.index("</link>")], "")
        ),
        "entities without end": bomb,
        "an entity from outside": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
        '<robot name="&x;"/>',
        "200,000 elements deep": deep,
        "20,000 links in a row": f"<robot name='r'>{''.join(rows)}{''.join(row)}</robot>",
        "20,000 links in a star": f"<robot name='r'>{''.join(rows)}{''.join(star)}</robot>",
        "two inertials": changed(("</inertial></link>", "</inertial><inertial/></link>")),
        "an empty name": changed(('<link name="weight">', '<link name="">')),
    }
    for name, text in odd.items():
        yield Call(f"from_urdf: {name}", lambda t=text: reads("odd", t), as_it_stands(text))

        def judge(text: str = text) -> Any:
            Path("odd.urdf").write_text(text, encoding="utf-8")
            Path("odd.yaml").write_text(FOUR_BAR_CUTS, encoding="utf-8")
            return errors_of("odd.urdf")

        yield Call(f"validate: {name}", judge)
    wanted = reads("plain")
    q = wanted.assemble(FOUR_BAR_GUESS)
    tau = wanted.compute_torques(q, [0.5], [-0.3])
    neutral = {
        "spaces": changed(('value="1.5"', 'value=" 1.5  "'), ('xyz="1 0 0"', 'xyz=" 1  0\t0 "')),
        "exponents": changed(('value="1.5"', 'value="+1.5e0"'), ('xyz="1 0 0"', 'xyz="1. .0 -0"')),
        "no optional origin": changed(('<origin xyz="0 0 0" rpy="0 0 0"/>', "")),
        "a long axis": changed(('<axis xyz="0 0 1"/>', '<axis xyz="0 0 5"/>')),
        "a byte order mark": "\ufeff" + FOUR_BAR,
        "comments": changed(("<link", "<!-- 1,5 -->\n<link"), count=99),
        "other elements": changed(("</robot>", '<gazebo><mass value="x"/></gazebo></robot>')),
        "a name in Chinese": changed(("four_bar", "\u56db\u8fde\u6746")),
    }
    for name, text in neutral.items():
        yield Call(
            f"from_urdf with {name}: the same torques",
            lambda t=text: reads("neutral", t).compute_torques(q, [0.5], [-0.3]),
            same(tau),
        )


def _cuts(w: World) -> Iterator[Call]:
    def changed(old: str, new: str) -> str:
        assert old in FOUR_BAR_CUTS
        return FOUR_BAR_CUTS.replace(old, new)

    levels = "".join(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 10)}]\n" for i in range(9))
    odd = {
        "empty": "",
        "a list": "[1, 2]",
        "a number": "5",
        "not YAML": "a: [",
        "a tab": "a:\n\t- b",
        "two documents": FOUR_BAR_CUTS + "---\n" + FOUR_BAR_CUTS,
        "an object": "!!python/object/apply:os.system ['true']",
        "a key unknown": FOUR_BAR_CUTS + "gravitiy: [0, 0, 0]\n",
        "a key twice": FOUR_BAR_CUTS + "gravity: [0, 0, 0]\n",
        "a key of another case": changed("gravity", "Gravity"),
        "a key that is a list": FOUR_BAR_CUTS + "? [a]\n: b\n",
        "nested aliases": f"a0: &a0 ha\n{levels}" + FOUR_BAR_CUTS,
        "nested aliases in closed_loop": f"a0: &a0 ha\n{levels}" + changed("[[end, pivot]]", "*a9"),
        "an alias of itself": changed("[[end, pivot]]", "&x [*x]"),
        "20,000 brackets": "closed_loop: " + "[" * 20_000 + "]" * 20_000,
        "20,000 braces": "a: " + "{b: " * 20_000,
        "400 digits in gravity": changed("-9.81", "9" * 400),
        "5,000 digits in gravity": changed("-9.81", "9" * 5000),
        "words in gravity": changed("-9.81", "down"),
        "a bool in gravity": changed("-9.81", "true"),
        "NaN in gravity": changed("-9.81", ".nan"),
        "inf in gravity": changed("-9.81", "-.inf"),
        "a date in gravity": changed("-9.81", "2026-01-01"),
        "sexagesimal gravity": changed("-9.81", "9:81"),
        "an exponent that YAML reads as text": changed("-9.81", "-981e-2"),
        "two in gravity": changed("[0.5, -9.81, 0.0]", "[0, -9.81]"),
        "gravity null": changed("[0.5, -9.81, 0.0]", ""),
        "gravity a number": changed("[0.5, -9.81, 0.0]", "9.81"),
        "gravity a mapping": changed("[0.5, -9.81, 0.0]", "{x: 0, y: 0, z: 1}"),
        "gravity text": changed("[0.5, -9.81, 0.0]", "'abc'"),
        "no closed_loop": changed("closed_loop: [[end, pivot]]", ""),
        "no closures": changed("[[end, pivot]]", "[]").replace("[3d]", "[]"),
        "closed_loop null": changed("[[end, pivot]]", ""),
        "closed_loop flat": changed("[[end, pivot]]", "[end, pivot]"),
        "closed_loop of three": changed("[[end, pivot]]", "[[end, pivot, crank]]"),
        "closed_loop of numbers": changed("[[end, pivot]]", "[[1, 2]]"),
        "closed_loop of nulls": changed("[[end, pivot]]", "[[null, ~]]"),
        "frames unknown": changed("[[end, pivot]]", "[[end, privot]]"),
        "a frame twice": changed("[[end, pivot]]", "[[end, end]]"),
        "a type too many": changed("[3d]", "[3d, 3d]"),
        "a type unknown": changed("[3d]", "[4d]"),
        "a type null": changed("[3d]", "[null]"),
        "a type that is a list": changed("[3d]", "[[3d]]"),
        "types text": changed("[3d]", "3d"),
        "motors text": changed("[crank]", "crank"),
        "motors null": changed("[crank]", ""),
        "motors of numbers": changed("[crank]", "[0]"),
        "motors unknown": changed("[crank]", "[krank]"),
        "motors twice": changed("[crank]", "[crank, crank]"),
        "a motor that is a list": changed("[crank]", "[[crank]]"),
        "a fixed joint as motor": changed("[crank]", "[screwed]"),
        "joint_name without type": FOUR_BAR_CUTS + "joint_name: [crank]\n",
        "joint_type unknown": FOUR_BAR_CUTS + "joint_name: [crank]\njoint_type: [BALL]\n",
        "joint_name unknown": FOUR_BAR_CUTS + "joint_name: [krank]\njoint_type: [FIXED]\n",
        "joint_name twice": FOUR_BAR_CUTS
        + "joint_name: [rocker, rocker]\njoint_type: [FIXED, SPHERICAL]\n",
        "joint_name null": FOUR_BAR_CUTS + "joint_name:\njoint_type:\n",
    }
    for name, text in odd.items():
        yield Call(
            f"cuts: {name}", lambda t=text: reads("cut", cuts=t), as_it_stands(FOUR_BAR, text)
        )

        def judge(text: str = text) -> Any:
            Path("cut.urdf").write_text(FOUR_BAR, encoding="utf-8")
            Path("cut.yaml").write_text(text, encoding="utf-8")
            return errors_of("cut.urdf")

        if not name.startswith("an exponent"):  # which is right
            yield Call(f"validate, cuts: {name}", judge)


def _mjcfs(w: World) -> Iterator[Call]:
    plain, motor = FOUR_BAR_MJCF, '<motor name="crank" joint="crank"/>'

    def read(text: str, **options: Any) -> ClosedChain:
        Path("odd.xml").write_text(text, encoding="utf-8")
        return ClosedChain.from_mjcf("odd.xml", **options)

    odd = {
        "nothing": "",
        "another root": "<robot/>",
        "an empty model": "<mujoco/>",
        "no equalities": plain.replace('<connect site1="end" site2="pivot"/>', ""),
        "a motor on nothing": plain.replace(motor, '<motor joint="krank"/>'),
        "a motor on a site": plain.replace(motor, '<motor site="end"/>'),
        "a word for a mass": plain.replace('mass="1.5"', 'mass="heavy"'),
        "a NaN for a mass": plain.replace('mass="1.5"', 'mass="nan"'),
        "a negative mass": plain.replace('mass="1.5"', 'mass="-1"'),
        "an inertia no body has": plain.replace("0.1 0.2 0.25", "0.1 0.2 25"),
        "an axis of zero": plain.replace('axis="0 0 1" ', 'axis="0 0 0" '),
        "a mesh that is missing": plain.replace(
            "<worldbody>", '<asset><mesh name="m" file="m.stl"/></asset><worldbody>'
        ),
        "an include of itself": plain.replace(
            "<worldbody>", '<include file="odd.xml"/><worldbody>'
        ),
    }
    for name, text in odd.items():
        yield Call(f"from_mjcf: {name}", lambda t=text: read(t))
    for locked in (
        "crank",
        5,
        None,
        [None],
        ["krank"],
        [0],
        [["crank"]],
        ["crank", "coupler", "rocker"],
    ):
        yield Call(f"from_mjcf(locked={locked!r})", lambda v=locked: read(plain, locked=v))


def _loads(w: World) -> Iterator[Call]:
    yield Call("load of no SST", lambda: reads("plain") and sst_pin.load("plain.urdf"))
    yield Call(
        "SST.from_urdf of no SST", lambda: reads("plain") and sst_pin.SST.from_urdf("plain.urdf")
    )
    yield Call("load of a URDF without its SRDF", lambda: sst_pin.load(w.described(name="without")))
    yield Call(
        "load of a URDF without its meshes",
        lambda: (
            Path("bare.srdf").write_text('<robot name="sst"/>')
            and sst_pin.load(w.described(name="bare"))
        ),
    )
    for name, text in {"no XML": "x", "empty": "", "of another robot": '<robot name="x"/>'}.items():

        def load(text: str = text) -> Any:
            folder = Path("whole")
            if not folder.exists():
                folder.mkdir()
                (folder / "meshes").symlink_to(Path(sst_pin.PACKAGE_PATH) / "meshes")
            (folder / "sst.urdf").write_text(w.urdf)
            (folder / "sst.yaml").write_text(w.cuts)
            (folder / "sst.srdf").write_text(text)
            return sst_pin.load(folder / "sst.urdf")

        yield Call(
            f"load beside an SRDF {name}",
            load,
            (lambda robot: robot.model.nq == 9) if name == "of another robot" else None,
        )
    changed = w.urdf.replace('name="mu_2"', 'name="my_2"')
    yield Call(
        "SST.from_urdf, a joint renamed", lambda: sst_pin.SST.from_urdf(w.described(changed))
    )
    yield Call(
        "SST.from_urdf, motors in another order",
        lambda: sst_pin.SST.from_urdf(
            w.described(cuts=w.cuts.replace("[gamma_1, gamma_2,", "[gamma_2, gamma_1,"))
        ),
    )


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
