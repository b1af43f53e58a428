# SPDX-License-Identifier: BSD-2-Clause
"""Whatever an MJCF may say, in any attribute of MuJoCo's schema, is read rightly or refused."""

import re
import xml.etree.ElementTree as ET
from copy import deepcopy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import sst_pin
from sst_pin.loops.loops import Loops
from sst_pin.model.checks import tendon_of
from sst_pin.reading.mjcf import read_mjcf

#: A tree of hinges and slides with an instance of every element that can act on its joints.
BASE = """
<mujoco>
<compiler/><option actuatorgroupdisable="3"><flag/></option><size/>
<default><joint/><geom/><site/><equality/><tendon/></default>
<worldbody>
  <body name="a" pos="0.1 0.2 0.3"><inertial pos="0 0 .1" mass="2" diaginertia=".2 .3 .4"/>
    <joint name="a" axis="0 1 0" stiffness="3" damping="0.2" springref="10"/>
    <geom name="shape" size=".1 .2 .3" type="box" mass="1"/><site name="at_a"/>
    <body name="b" pos="0 0 .5"><joint name="b" type="slide" axis="1 0 0" stiffness="2"/>
      <geom size=".1 .2 .3" type="ellipsoid" mass="1.5"/><site name="at_b"/></body>
    <frame><body name="d" pos="0 .3 0"><joint name="d"/><geom size=".1"/></body></frame>
  </body>
</worldbody>
<tendon><fixed name="sum"><joint joint="a" coef="1"/><joint joint="b" coef="2"/></fixed>
  <spatial name="line"><site site="at_a"/><site site="at_b"/></spatial></tendon>
<equality><connect name="c" body1="b" body2="d" anchor="0 0 0"/>
  <weld name="w" body1="b" body2="d"/><joint name="j" joint1="a" joint2="b"/>
  <tendon name="t" tendon1="sum"/></equality>
<actuator><general joint="a"/><motor joint="a"/><position joint="b"/><velocity joint="b"/>
  <intvelocity joint="a" actrange="-1 1"/><damper joint="a" ctrlrange="0 1" kv="1"/>
  <cylinder joint="a"/><pid joint="a" kp="1" kv="1" input="pos vel ff"/>
  <muscle tendon="sum" lengthrange="-1 1"/>
  <dcmotor joint="b" motorconst=".1" resistance="1" input="pos vel"/>
  <orientation site="at_a" refsite="at_b" kp="1" group="3"/></actuator>
<contact><pair geom1="shape" geom2="shape"/><exclude body1="a" body2="d"/></contact>
<keyframe><key name="home"/></keyframe>
</mujoco>
"""
TRIALS = ("true", "0.3", "0.1 0.2 0.3", "disable", "enable")
#: Elements that cannot act on a tree, or are taken by MuJoCo from elements of `BASE`.
ELSEWHERE = {
    "compiler/lengthrange", "statistic", "extension", "asset", "sensor", "visual", "custom",
    "(world)body/attach", "(world)body/camera", "(world)body/light", "(world)body/flexcomp",
    "deformable", "tendon/spatial/geom", "tendon/spatial/pulley", "(world)body/freejoint",
    "equality/flex", "equality/flexstrain", "actuator/adhesion", "actuator/plugin", "default",
    "(world)body/plugin", "(world)body/geom/plugin",
}  # fmt: skip


def schema():
    """Attributes by element, as MuJoCo prints them."""
    path, result = [], {}
    for line in mujoco.mj_printSchema(False, False).splitlines():
        words = line.split()
        if "(" in line and len(words) > 1 and words[1] in ("(!)", "(*)", "(?)", "(R)"):
            path[(len(line) - len(line.lstrip())) // 3 :] = [words[0]]
            words = words[2:]
        result.setdefault("/".join(path[1:]), []).extend(words)
    return {name: attributes for name, attributes in result.items() if name}


def elements(root):
    """Elements of `BASE` by their name in the schema."""
    result = {}

    def walk(element, path):
        for child in element:
            inside = path if child.tag in ("worldbody", "body", "frame") else [*path, child.tag]
            if child.tag in ("worldbody", "body"):
                inside = ["(world)body"]
            if child.tag != "worldbody":  # which has no attributes
                result.setdefault("/".join(inside), []).append(child)
            walk(child, inside)

    walk(root, [])
    return result


def disagreements(path, text):
    """What differs between MuJoCo's tree and ours; empty where the reader refuses the file."""
    path.write_text(text)
    mj = mujoco.MjModel.from_xml_path(str(path))
    try:
        read = read_mjcf(path)
    except sst_pin.DescriptionError:
        return "refused"
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, model = mujoco.MjData(mj), read.model
    options = {"stiffness": read.stiffness, "spring_reference": read.spring_reference}
    # MuJoCo's dry friction is a constraint.
    options["lines"] = [replace(line, coulomb_friction=0.0) for line in read.lines]
    options["weight_shares"] = read.weight_shares
    options["coulomb_friction"] = np.zeros(model.nv)
    names = list(model.names)[1:]
    chain = sst_pin.ClosedChain(model, [], [], coordinates=names, **options)
    for q, v, dv in np.random.default_rng(0).normal(size=(2, 3, model.nv)):
        data.qpos, data.qvel, data.qacc = q, v, dv
        mujoco.mj_inverse(mj, data)
        ours = chain.generalized_forces(q, v, dv)
        if np.abs(ours - data.qfrc_inverse).max() > 1e-9 * (1 + np.abs(ours).max()):
            return "differs"
    return "read"


#: Elements whose attributes are set one by one; those of springs, dampers, bodies, media.
ACTING = ("(world)body", "(world)body/inertial", "(world)body/joint", "tendon/fixed", "option")


def test_every_element_of_the_schema_is_known():
    elsewhere = tuple(f"{name}/" for name in ELSEWHERE)
    missing = set(schema()) - set(elements(ET.fromstring(BASE)))
    assert [name for name in missing if not f"{name}/".startswith(elsewhere)] == []


#: Elements whose attributes are names and sizes of memory.
ONLY_NAMES = {"default", "tendon/spatial/site", "contact/exclude", "size"}
#: A flag by which `mj_inverse` is that of MuJoCo's discrete time.
DISCRETE = "invdiscrete"
ELEMENTS = sorted(elements(ET.fromstring(BASE)))


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in ACTING else pytest.mark.slow) for n in ELEMENTS]
)
def test_every_attribute_is_read_as_mujoco_reads_it_or_refused(tmp_path, name):
    """Forces of a tree at random states, against `mj_inverse`, for each value that it takes."""
    root = ET.fromstring(BASE)
    assert disagreements(tmp_path / "r.xml", BASE) == "read"
    taken = 0
    for attribute in (attribute for attribute in schema()[name] if attribute != DISCRETE):
        for value in TRIALS:
            changed = deepcopy(root)
            elements(changed)[name][0].set(attribute, value)
            try:
                result = disagreements(tmp_path / "r.xml", ET.tostring(changed, encoding="unicode"))
            except (ValueError, mujoco.FatalError):
                continue  # MuJoCo does not take it
            assert result != "differs", (attribute, value)
            taken += 1
    assert taken or name in ONLY_NAMES or not schema()[name]


EQUALITIES = [name for name in ELEMENTS if name.startswith("equality/")]


def equality_disagreements(path, text):
    """Whether MuJoCo's equalities at `qpos0` hold what our closures do, as far as they are read."""
    path.write_text(text)
    mj = mujoco.MjModel.from_xml_path(str(path))
    try:
        read = read_mjcf(path)
    except sst_pin.DescriptionError:
        return "refused"
    mj.opt.jacobian, data = mujoco.mjtJacobian.mjJAC_DENSE, mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    theirs = data.efc_J[: data.nefc * mj.nv].reshape(-1, mj.nv)[rows]
    loops = Loops(read.model, read.closures)
    loops.evaluate(np.array(data.qpos))
    closed = np.abs(data.efc_pos[rows]).max(initial=0) < 1e-9
    if closed != (np.abs(loops.f).max(initial=0) < 1e-9):
        return "differs"
    Phi = loops.Phi
    ranks = {np.linalg.matrix_rank(A) for A in (Phi, theirs, np.vstack([Phi, theirs]))}
    return "differs" if closed and len(ranks) > 1 else "read"


@pytest.mark.parametrize("name", EQUALITIES)
def test_every_attribute_of_an_equality_closes_loops_as_in_mujoco_or_is_refused(tmp_path, name):
    """With each kind alone: the same motions are free, and the loops are open or closed alike."""
    root = ET.fromstring(BASE)
    root.remove(root.find("actuator"))
    equalities = root.find("equality")
    for element in [e for e in equalities if e is not elements(root)[name][0]]:
        equalities.remove(element)
    assert equality_disagreements(tmp_path / "r.xml", ET.tostring(root, "unicode")) == "read"
    outcomes = set()
    for attribute in schema()[name]:
        for value in (*TRIALS, "0", "0 2", "1 2 3 1 0 0 0", "at_a", "d"):
            changed = deepcopy(root)
            elements(changed)[name][0].set(attribute, value)
            try:
                text = ET.tostring(changed, "unicode")
                outcomes.add(equality_disagreements(tmp_path / "r.xml", text))
            except ValueError:
                continue  # MuJoCo does not take it
            assert "differs" not in outcomes, (attribute, value)
    assert "read" in outcomes


@pytest.mark.parametrize(
    "text",
    [
        '<pid joint="a" kp="1" kv="1" input="pos vel"/><motor joint="b"/>',
        '<motor joint="d"/><dcmotor joint="b" motorconst=".1" resistance="1" input="pos vel"/>',
        '<motor tendon="sum"/><pid joint="d" kp="1" kv="1" gear="2"/><motor joint="a" gear="3"/>',
    ],
)
def test_the_motors_push_where_the_actuators_do(tmp_path, text):
    """Whatever the number of their controls; up to the gear, against MuJoCo's own moment arms."""
    path = tmp_path / "r.xml"
    motors = f"<actuator>{text}</actuator>"
    path.write_text(re.sub("<actuator>.*</actuator>", motors, BASE, flags=re.S))
    mj = mujoco.MjModel.from_xml_path(str(path))
    data, moments = mujoco.MjData(mj), np.zeros((mj.nactuator, mj.nv))
    mujoco.mj_forward(mj, data)
    result = data.moment_rownnz, data.moment_rowadr, data.moment_colind
    mujoco.mju_sparse2dense(moments, data.actuator_moment, *result)
    for motor, row in zip(read_mjcf(path).actuated, moments, strict=True):
        _, shares = tendon_of(motor)
        ours = np.array([shares.get(name, 0.0) for name in ("a", "b", "d")])
        np.testing.assert_allclose(row / np.linalg.norm(row), ours / np.linalg.norm(ours))


FLEX = """<mujoco><worldbody><flexcomp name="flex" type="grid" count="3 {}" spacing=".1 .1 .1"
  mass="1" radius=".01">{}</flexcomp></worldbody></mujoco>"""
ROPE, CLOTH = '1 1" dim="1', '3 1" dim="2'
ELASTIC = '<elasticity young="1e3" thickness=".01" elastic2d="{}"/>'


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (FLEX.format(ROPE, '<edge stiffness="3"/>'), "stiffness of a flex's edges"),
        (FLEX.format(ROPE, '<edge damping="3"/>'), "damping of a flex's edges"),
        (FLEX.format(CLOTH, ELASTIC.format("both")), "elasticity of a flex"),
        (FLEX.format(CLOTH, ELASTIC.format("bend")), "bending stiffness of a flex"),
    ],
)
def test_what_acts_and_is_not_read_is_named(tmp_path, text, problem):
    (tmp_path / "r.xml").write_text(text)
    with pytest.raises(sst_pin.DescriptionError, match=problem):
        read_mjcf(tmp_path / "r.xml")
