# SPDX-License-Identifier: BSD-2-Clause
"""Readers refuse what they cannot read: by name, all faults together, and quickly.

The words are those of `validate`.
"""

import re
import shutil
import sys
import xml.etree.ElementTree as ET
from contextlib import contextmanager
from pathlib import Path

import pytest

import sst_pin
from sst_pin.reading import parse_cuts
from sst_pin.reading.urdf import Urdf
from sst_pin.sst.robot_wrapper import load
from tests.support.files import ROOT

EXAMPLES = ROOT / "examples"
DELTA = EXAMPLES / "delta.urdf"


@contextmanager
def at_once(text):
    """Ends what calls functions more often than in proportion to the length of a text."""
    left = 200_000 + 10 * len(text)

    def count(*_):
        nonlocal left
        left -= 1
        assert left > 0

    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(None)


@pytest.fixture
def files(tmp_path):
    """A joint of the delta that turns, the link that it carries, and a function that writes all."""
    root, path = ET.parse(DELTA).getroot(), tmp_path / "robot.urdf"
    path.with_suffix(".yaml").write_bytes(DELTA.with_suffix(".yaml").read_bytes())
    joint = root.find("joint[@type='revolute']")
    link = root.find(f"link[@name='{joint.find('child').get('link')}']")

    def write():
        path.write_text(ET.tostring(root, encoding="unicode"))
        return path

    return joint, link, write


def refused(path):
    """What the reader says, which must be what `validate` says."""
    with pytest.raises(sst_pin.DescriptionError) as caught:
        sst_pin.ClosedChain.from_urdf(path)
    records = [f"{p.where}: {p.text}" for p in sst_pin.validate(path) if p.severity == "error"]
    said = [problem.replace("not a URDF: ", "file: ") for problem in caught.value.problems]
    assert said
    assert all(records.count(problem) == 1 for problem in said)
    return caught.value.problems


@pytest.mark.parametrize(
    ("place", "text"),
    [
        *(("mass", text) for text in ("0.3kg", "${m}", "nan", "1e999", "0x1p-3", "1_0", "", "٣")),
        *((place, "0,3") for place in ("mass", "inertia", "centre", "axis", "origin", "limit")),
    ],
)
def test_a_number_that_cannot_be_read_is_refused(files, place, text):
    """Pinocchio's parser makes the link massless and goes on."""
    joint, link, write = files
    element, key, vector = {
        "mass": (link.find("inertial/mass"), "value", False),
        "inertia": (link.find("inertial/inertia"), "ixx", False),
        "centre": (link.find("inertial/origin"), "xyz", True),
        "axis": (joint.find("axis"), "xyz", True),
        "origin": (joint.find("origin"), "rpy", True),
        "limit": (joint.find("limit"), "effort", False),
    }[place]
    element.set(key, f"{text} 0 1" if vector else text)
    (problem,) = refused(write())
    assert link.get("name") in problem or joint.get("name") in problem
    assert "number" in problem


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda joint, link: link.find("inertial/mass").set("value", "-1"), "is negative, -1 kg"),
        (lambda joint, link: ET.SubElement(joint, "dynamics", damping="1_0"), "is not a number"),
        (lambda joint, link: ET.SubElement(joint, "dynamics", damping="-1"), "is negative: it"),
        (lambda joint, link: joint.find("axis").set("xyz", "0 1e-200 0"), "its axis is zero"),
        (lambda joint, link: joint.find("axis").set("xyz", "0 1e200 0"), "its axis is too long"),
        (lambda joint, link: joint.find("limit").set("lower", "9"), "lower limit 9 above"),
        (lambda joint, link: joint.find("limit").set("effort", "-1"), "effort='-1' is negative"),
        (lambda joint, link: joint.find("origin").set("ypr", "1 0 0"), "<origin> has no ypr"),
        (lambda joint, link: setattr(joint.find("axis"), "tag", "axs"), "did you mean axis?"),
        (lambda joint, link: ET.SubElement(joint, "dynamics", dampnig="1"), "did you mean damping"),
        (lambda joint, link: ET.SubElement(link.find("inertial"), "mass"), "2 <mass>; only one is"),
        (lambda joint, link: setattr(joint, "tag", "xacro:joint"), "is a xacro file"),
        (lambda joint, link: joint.set("name", "universe"), "Pinocchio's base has this name"),
        (lambda joint, link: link.set("name", "base"), "link base: 2 have this name"),
        (lambda joint, link: joint.attrib.pop("name"), "joint: 1 without a name"),
        (lambda joint, link: joint.find("parent").set("link", "bass"), "parent bass is not a link"),
        (lambda joint, link: joint.set("type", "Revolute"), "type 'Revolute' unknown"),
    ],
)
def test_what_would_be_read_as_something_else_is_refused(files, change, word):
    """A number that is not meant, a word that is nearly another, one of two."""
    joint, link, write = files
    change(joint, link)
    assert any(word in problem for problem in refused(write()))


def test_what_makers_add_to_the_dynamics_of_joints_is_told(files):
    """Stiffness and friction of Franka's own, for one; a zero is nothing."""
    joint, _, write = files
    ET.SubElement(joint, "dynamics", damping="0", K="7000", mu_coulomb="0")
    text = f"joints {joint.get('name')}: dynamics K=... is not read"
    with pytest.warns(sst_pin.DescriptionWarning, match=text) as caught:
        sst_pin.ClosedChain.from_urdf(path := write())
    assert [warning.filename for warning in caught] == [__file__]
    assert f"warning: {text}" in map(str, sst_pin.validate(path))


def test_an_error_names_a_link_whose_name_ends_as_a_file():
    text = (
        '<robot name="r"><link name="profile"><inertial><mass value="x"/></inertial></link></robot>'
    )
    robot = Urdf(text, "r.urdf")
    with pytest.raises(sst_pin.DescriptionError, match="link profile: "):
        robot.tree()


def test_missing_joints_are_named_in_the_order_of_their_kinds():
    names = [f"joint_{k}" for k in range(20)]
    with pytest.raises(sst_pin.DescriptionError) as caught:
        Urdf.read(DELTA).tree(dict.fromkeys(names, "BALL"))
    assert re.findall(r"joint_\d+", str(caught.value)) == names


def large_urdf(links):
    """Links one after the other."""
    unit = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    body = f'<inertial><mass value="1"/>{unit}</inertial>'
    parts = [f'<link name="l{i}">{body}</link>' for i in range(links)]
    parts += [
        f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i in range(1, links)
    ]
    return f'<robot name="large">{"".join(parts)}</robot>'


#: Each ten of the one before.
ENTITIES = "".join(f"<!ENTITY a{i + 1} '{f'&a{i};' * 10}'>" for i in range(12))
ANCHORS = "".join(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 10)}]\n" for i in range(8))


@pytest.mark.filterwarnings("ignore:.*no moving link has mass")
@pytest.mark.parametrize(
    ("urdf", "word"),
    [
        ("<robot name='r'>" + "<link/>" * 10_001 + "</robot>", "10001 elements; at most"),
        (large_urdf(402), "401 moving joints; at most"),
        ("<robot name='r'>" + "<a>" * 20_000, "not XML"),
        (" " * 20_000_000, "more than"),
        (f"<!DOCTYPE r [<!ENTITY a0 'mass'>{ENTITIES}]><robot name='&a12;'/>", "not XML"),
        ("<robot name='r'><link name='l'/></robot>", None),  # the least that is read
    ],
    ids=["links", "joints", "depth", "bytes", "entities", "least"],
)
def test_a_urdf_beyond_all_robots_is_refused_at_once(tmp_path, urdf, word):
    """Neither minutes nor gigabytes; 2000 joints would ask Pinocchio's data for 400 GB."""
    path, cuts = tmp_path / "large.urdf", tmp_path / "large.yaml"
    path.write_text(urdf)
    cuts.write_text("closed_loop: [[l0, l1]]\ntype: [6d]\nname_mot: [j1]\n")
    with at_once(urdf), pytest.raises(sst_pin.SSTError) as caught:
        sst_pin.ClosedChain.from_urdf(path)
    assert word is None or word in str(caught.value)
    with at_once(urdf):
        problems = sst_pin.validate(path)
    assert word is None or any(word in str(problem) for problem in problems)


CUTS = "closed_loop: [[a, b]]\ntype: [6d]\nname_mot: [c]\n"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (CUTS + "gravity: [0, 0, -1]\ngravity: [0, 0, -9.81]", "gravity: appears twice"),
        (CUTS + "line_force: [{frames: [a, b], damping: 1, damping: 2}]", "damping: appears twice"),
        (CUTS + "gravity: [0, no, -9.81]", "gravity: ['0', 'no', '-9.81'] is not a list of three"),
        (CUTS + "gravity: [0, -9.81]", "gravity: "),
        (CUTS + "gravity: 9.81", "gravity: "),
        (CUTS.replace("[c]", "['']"), "name_mot: '' is not a name"),
        (CUTS.replace("[a, b]", "[a, [b]]"), "closed_loop: ['a', ['b']] is not a pair"),
        (CUTS + "joint_name: [a, a]\njoint_type: [FIXED, FIXED]", "joint_name: a appears twice"),
        (CUTS + "joint_name: [a]", "joint_name has 1 entries, joint_type has 0"),
        ("[a, b]", "no keys"),
        (CUTS + "---\n" + CUTS, "not YAML"),
        ("a b\nc: d", "not YAML: mapping values are not allowed here at line 2, column 2"),
        ("? [a]\n: b", "not YAML"),
        ("a: &a [*a]", "not YAML"),
        ("[" * 20_000, "too deep"),
        ("- " * 20_000, "too deep"),
        (f"a0: &a0 [x]\n{ANCHORS}type: [*a8]\nname_mot: *a8\ngravity: *a8\n", "name_mot: "),
        ("a: " + "x" * 1_000_000, "more than"),
    ],
)
def test_cuts_that_say_something_else_are_refused_at_once(text, word):
    """The message lists every problem in words that a person can read."""
    with at_once(text), pytest.raises(sst_pin.DescriptionError) as caught:
        parse_cuts(text, "cuts")
    assert word in str(caught.value)
    assert len(str(caught.value)) < 10_000


def test_names_and_numbers_of_cuts_are_those_that_stand_there():
    """YAML would make 8 of 010, True of on, a text of 1e1; a mark of order stands before none."""
    text = "closed_loop: [[010, on]]\ntype: [6D]\nname_mot: [1.50]\ngravity: [0, +.5, -1e1]"
    cuts = parse_cuts(text, "cuts")
    (closure,) = cuts.closures
    assert (closure.frame_a, closure.frame_b, closure.kind) == ("010", "on", "6d")
    assert cuts.actuated == ("1.50",)
    assert cuts.gravity.tolist() == [0, 0.5, -10]


def test_an_srdf_of_unknown_links_is_refused(tmp_path):
    shutil.copytree(Path(sst_pin.URDF_PATH).parent, tmp_path, dirs_exist_ok=True)
    srdf = tmp_path / "sst.srdf"
    srdf.write_text(srdf.read_text().replace('link1="link_1"', 'link1="link_9"', 1))
    told = "sst.srdf: disable_collisions: no link link_9 in the URDF"
    with pytest.raises(sst_pin.DescriptionError) as caught:
        load(tmp_path / "sst.urdf")
    assert told in " ".join(str(caught.value).split())


@pytest.mark.parametrize("encoding", ["iso-8859-1", "utf-16", "utf-8-sig"])
def test_a_description_is_read_in_the_encoding_that_it_declares(tmp_path, encoding):
    """A mark of the byte order is no part of it."""
    path, head = tmp_path / "delta.urdf", f'<?xml version="1.0" encoding="{encoding[:10]}"?>'
    text = DELTA.read_text().replace('<?xml version="1.0"?>', head.replace("-sig", ""))
    path.write_bytes(text.replace("A delta", "Länge").encode(encoding))
    cuts = DELTA.with_suffix(".yaml").read_text()
    path.with_suffix(".yaml").write_text(cuts, encoding="utf-8-sig")
    assert sst_pin.ClosedChain.from_urdf(path).mobility().degrees_of_freedom == 3


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", "<robot name='ä'/>".encode("latin-1")])
def test_a_file_that_is_no_text_is_named(tmp_path, content):
    path = tmp_path / "robot.urdf"
    path.write_bytes(content)
    for kind in (sst_pin.ClosedChain, sst_pin.SST):
        with pytest.raises(sst_pin.DescriptionError, match=r"robot\.urdf:\s+the URDF cannot be"):
            kind.from_urdf(path)
