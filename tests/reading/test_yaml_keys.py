# SPDX-License-Identifier: BSD-2-Clause
"""The YAML beside a URDF says the whole robot: springs, friction, rotors, couplings, joints."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.model.closures import Distance, Rolling
from sst_pin.reading import parse_cuts

BODY = """<inertial><mass value="1"/><origin xyz="0.1 0 0.05"/>
<inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
JOINT = """<link name="{0}_link">{2}</link><joint name="{0}" type="continuous">
<parent link="{1}"/><child link="{0}_link"/><origin xyz="0.2 0 0"/><axis xyz="0 1 0"/></joint>"""
NAMES = ("shoulder", "elbow", "wrist")
PARENTS = ("base", "shoulder_link", "elbow_link")
URDF = "".join(JOINT.format(*each, BODY) for each in zip(NAMES, PARENTS, strict=True))
URDF = f'<robot name="arm"><link name="base"/>{URDF}</robot>'


@pytest.fixture
def read(tmp_path):
    """The arm with a YAML beside it."""

    def arm(cuts="", motors="[shoulder, elbow, wrist]", urdf=URDF, **options):
        path = tmp_path / "arm.urdf"
        path.write_text(urdf)
        path.with_suffix(".yaml").write_text(f"name_mot: {motors}\n{cuts}")
        return sst_pin.ClosedChain.from_urdf(path, **options)

    return arm


NUMBERS = """
joint_spring:
  elbow: {stiffness: 3, reference: 0.2}
  wrist: {stiffness: 5}
viscous_friction: {shoulder: 0.4}
coulomb_friction: {wrist: 0.3}
armature:
  elbow: 0.02
  wrist: {rotor_inertia: 1e-4, gear_ratio: 20}
"""


def test_springs_friction_and_rotors_add_their_torques(read):
    """By their laws, joint by joint, to the torques of the arm without them."""
    q, v, a = np.random.default_rng(0).normal(size=(3, 3))
    law = [0.4 * v[0], 3 * (q[1] - 0.2) + 0.02 * a[1]]
    law.append(5 * q[2] + 0.3 * np.sign(v[2]) + 1e-4 * 20**2 * a[2])
    more = read(NUMBERS).compute_torques(q, v, a) - read().compute_torques(q, v, a)
    np.testing.assert_allclose(more, law, atol=1e-13)


def test_the_yaml_counts_where_the_urdf_says_something_else(read):
    urdf = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="7"/>')
    chain = read("viscous_friction: {elbow: 0.5}", urdf=urdf)
    np.testing.assert_array_equal(chain.mechanism.friction.viscous, [7, 0.5, 7])


def test_rates_of_a_joint_with_several_have_numbers_of_their_own(read):
    chain = read(
        "joint_type: {elbow: universal, wrist: ball}\njoint_spring: {elbow_Y: {stiffness: 2}}\n"
        "viscous_friction: {elbow_X: 0.1, wrist: 0.2, wrist_wz: 0.7}",
        "[shoulder]",
    )
    viscous = dict(zip(chain.rate_names, chain.mechanism.friction.viscous, strict=True))
    expected = {"elbow_X": 0.1, "wrist_wx": 0.2, "wrist_wy": 0.2, "wrist_wz": 0.7}
    assert viscous == {"shoulder": 0, "elbow_Y": 0, **expected}
    assert (
        dict(zip(chain.rate_names, chain.mechanism.springs.stiffness, strict=True))["elbow_Y"] == 2
    )


def test_a_joint_may_follow_several_others(read):
    chain = read("coupling: {wrist: {shoulder: 0.5, elbow: [0.1, -2, 3]}}", "[shoulder, elbow]")
    q = np.array([0.3, -0.4, 0])
    q[2] = 0.5 * 0.3 + 0.1 - 2 * -0.4 + 3 * 0.4**2
    np.testing.assert_allclose(chain.residual(q), 0, atol=1e-15)
    assert chain.degrees_of_freedom == 2


def test_a_coupling_counts_in_the_place_of_a_mimic_joint(read):
    mimic = '<mimic joint="elbow" multiplier="-1"/></joint></robot>'
    urdf = URDF.replace("</joint></robot>", mimic)
    assert len(read(urdf=urdf, motors="[shoulder]").closures) == 1
    chain = read("coupling: {wrist: {shoulder: 2}}", "[shoulder, elbow]", urdf)
    assert chain.closures == (sst_pin.Coupling("wrist", {"shoulder": (0, 2)}),)


def test_joints_locked_in_the_yaml_are_locked(read):
    """Their motors, springs and friction go with them."""
    chain = read(f"{NUMBERS}locked: [wrist]", locked=["shoulder"])
    assert chain.joint_names == chain.motor_names == ("elbow",)
    assert chain.model == read(NUMBERS, locked=["wrist", "shoulder"]).model


def test_a_tendon_of_unknown_joints_is_named(read, tmp_path):
    with pytest.raises(sst_pin.UnknownNameError, match="joint 'knee'"):
        read(motors="[{split: {elbow: 1, knee: -0.5}}]")
    problems = map(str, sst_pin.validate(tmp_path / "arm.urdf"))
    assert "error: motor knee: no moving joint of this name in the model" in problems


def test_a_motor_may_be_a_tendon_with_a_name(read):
    chain = read(motors="[shoulder, {split: {elbow: 1, wrist: -0.5}}]")
    assert chain.motor_names == ("shoulder", "split")
    np.testing.assert_array_equal(chain.actuation, [[1, 0], [0, 1], [0, -0.5]])


@pytest.mark.parametrize(
    ("kind", "closure"),
    [
        ("Ball", sst_pin.Closure("a", "b", "3d")),
        ("3D", sst_pin.Closure("a", "b", "3d")),
        ("Hinge", sst_pin.Closure("a", "b", "hinge")),
        ("distance 0.25", Distance("a", "b", 0.25)),
        ("rolling 0.1", Rolling("a", "b", 0.1)),
    ],
)
def test_a_loop_is_closed_in_any_way(kind, closure):
    """Kinds of `Closure` in small or large letters, and those that have a length."""
    text = f"closed_loop: [[a, b]]\ntype: [{kind}]\nname_mot: []"
    assert parse_cuts(text, "cuts").closures == (closure,)


@pytest.mark.parametrize(
    ("cuts", "told"),
    [
        ("springs: {}", "springs: unknown; do you mean joint_spring; known: closed_loop"),
        ("lines: []", "lines: unknown; do you mean line_force; known"),
        ("ropes: []", "ropes: unknown; do you mean contacts; known"),
        ("brake: []", "brake: unknown; do you mean brakes; known"),
        ("closures: [[a, b]]", "closures: unknown; do you mean closed_loop; known"),
        ("xyz: []", "xyz: unknown; known"),
        ("brakes: elbow", r"brakes: a list is needed, such as brakes: \[axis_1\]"),
        ("contacts: {tip: 1}", r"a list is needed, such as contacts: \[\{frame: sole"),
        ("line_force: [[a, b]]", r"is not a mapping, such as line_force: \[\{frames: \[a, b\]"),
        ("contacts: [tip]", r"contacts: 'tip' is not a mapping, such as contacts: \[\{frame: sole"),
        ("contacts: [{fram: tip}]", "contacts: fram unknown; do you mean frame; known: frame"),
        ("contacts: [{frame: tip, mu: 1}]", "contacts: mu unknown; do you mean friction; known"),
        ("line_force: [{frames: [a, b], k: 9}]", "k unknown; do you mean stiffness; known"),
        (
            "line_force: [{frames: [a, b], pull_only: 1}]",
            "pull_only unknown; do you mean pulls_only",
        ),
        ("joint_limit: {elbow: {uper: 3}}", "joint_limit: uper unknown; do you mean upper; known"),
        (
            "joint_spring: {elbow: {xyz: 3}}",
            "joint_spring: xyz unknown; known: stiffness, reference",
        ),
        ("armature: {elbow: {ratio: 3}}", "armature: ratio unknown; do you mean gear_ratio; known"),
        ("joint_spring: [elbow]", "joint_spring: a mapping from names is needed"),
        ("joint_spring: {elbow: 3}", "joint_spring: '3' is not a mapping"),
        ("joint_spring: {elbow: {reference: 3}}", "joint_spring: {.*} has no stiffness"),
        ("joint_spring: {knee: {stiffness: 3}}", "joint 'knee' not in the model; known: shoulder"),
        ("viscous_friction: {elbow: -1}", "viscous_friction: -1 of elbow is negative"),
        ("armature: {elbow: soft}", "armature: rotor_inertia 'soft' is not a number"),
        ("joint_type: {elbow: sliding}", "joint_type: 'sliding' unknown; known: FIXED, BALL"),
        ("coupling: {wrist: {}}", "coupling: wrist follows no joint; `locked` holds joints"),
        ("coupling: {wrist: {wrist: 2}}", "coupling: wrist is coupled to itself"),
        ("coupling: {wrist: {elbow: [a]}}", "coupling: 'a' is not a number"),
        ("locked: [knee]", "joint 'knee' not in the model"),
        ("closed_loop: [[a, b]]\ntype: [distance -1]", "unknown; known: 6d.*distance LENGTH"),
        ("closed_loop: [[a, b]]\ntype: [knot]", "unknown; known: 6d.*distance LENGTH"),
        ("joint_type: {elbow: ball}\nlocked: [elbow_z]", "known: shoulder, elbow, wrist, elbow_wx"),
    ],
)
def test_values_that_cannot_be_meant_are_refused(read, cuts, told):
    with pytest.raises(sst_pin.SSTError, match=told) as caught:
        read(cuts)
    assert "arm.yaml" in str(caught.value)


def test_a_neutral_spring_of_a_ball_needs_no_reference(read):
    chain = read("joint_type: {elbow: ball}\njoint_spring: {elbow: {stiffness: 2}}", "[shoulder]")
    np.testing.assert_array_equal(chain.mechanism.springs.reference, pin.neutral(chain.model))


def test_a_tendon_without_a_name_in_its_place_is_refused(read):
    with pytest.raises(sst_pin.DescriptionError, match="name_mot: '' is not a name"):
        read(motors="[{'': {shoulder: 1}}]")


def test_a_negative_rotor_inertia_is_an_estimate_and_is_read(read):
    assert read("armature: {elbow: -0.001}").model.armature.tolist() == [0, -0.001, 0]


def test_a_value_that_is_no_list_is_one_problem():
    """Its letters are not counted as entries."""
    with pytest.raises(sst_pin.DescriptionError) as caught:
        parse_cuts("closed_loop: abc\ntype: []\nname_mot: [a]\n", "cuts")
    assert caught.value.problems == ["closed_loop: a list is needed"]
