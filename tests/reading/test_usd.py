# SPDX-License-Identifier: BSD-2-Clause
"""USDs with rigid bodies and joints, some of which close loops."""

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import any_chain
import sst_pin
from planar_bars import planar
from sst_pin import ClosedChain, Closure, DescriptionError, robots

pytest.importorskip("pxr", reason="usd-core has no wheel for this machine")

#: A four-bar in centimetres and grams: cranks of 20 and 25 cm, a coupler and a base of 50 cm.
BAR = """
def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
    double3 xformOp:translate = ({at}, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float physics:mass = 500
    point3f physics:centerOfMass = ({middle}, 0, 0)
    float3 physics:diagonalInertia = (10000, 20000, 30000)
{more}
}}
"""
JOINT = """
def {kind} "{name}" ({apis}) {{
    rel physics:body0 = {body0}
    rel physics:body1 = {body1}
    point3f physics:localPos0 = {pos0}
    point3f physics:localPos1 = {pos1}
{more}
}}
"""
HEAD = '#usda 1.0\n(\nmetersPerUnit = 0.01\nkilogramsPerUnit = 0.001\nupAxis = "Y"\n)\n'


def bar(name, at, middle, more=""):
    return BAR.format(name=name, at=at, middle=middle, more=more)


def joint(name, body0, body1, pos0="(0, 0, 0)", pos1="(0, 0, 0)", more="", **others):
    kind, apis = others.get("kind", "PhysicsRevoluteJoint"), others.get("apis", "")
    apis = apis and f'prepend apiSchemas = ["{apis}"]'
    ends = {f"body{k}": f"<{b}>" if b else "None" for k, b in ((0, body0), (1, body1))}
    more = 'uniform token physics:axis = "Z"\n' * (kind[7:11] in ("Revo", "Pris")) + more
    return JOINT.format(kind=kind, name=name, apis=apis, pos0=pos0, pos1=pos1, more=more, **ends)


PARTS = (
    bar("crank", 0, 12.5),
    bar("coupler", 25, 25),
    bar("rocker", 50, 12.5),
    joint("turn", "", "/crank", apis="PhysicsDriveAPI:angular"),
    joint("elbow", "/crank", "/coupler", "(25, 0, 0)"),
    joint("foot", "/rocker", "", "(0, 0, 0)", "(50, 0, 0)"),
    joint(
        "pin", "/coupler", "/rocker", "(50, 0, 0)", "(25, 0, 0)",
        "uniform bool physics:excludeFromArticulation = 1",
    ),
)  # fmt: skip


def named_home(chain):
    return "home" in [pair.key() for pair in chain.model.referenceConfigurations]


def written(path, parts=PARTS, head=HEAD):
    path.write_text(head + "".join(parts), encoding="utf-8")
    return path


def test_a_four_bar_in_centimetres_is_that_by_hand(tmp_path):
    """Its foot is turned by the rocker's angle, in the file by the negative."""
    usd = ClosedChain.from_urdf(written(tmp_path / "bar.usda"))
    cranks = ("turn", "universe", 0, 0.25), ("foot", "universe", 0.5, 0.25)
    model = planar([*cranks, ("elbow", "turn", 0.25, 0.5)])
    model.gravity.linear = np.array([0, -9.81, 0])
    for k in (1, 2, 3):
        model.inertias[k] = pin.Inertia(0.5, model.inertias[k].lever, np.diag([1e-3, 2e-3, 3e-3]))
    hand = ClosedChain(model, [Closure("elbow_end", "foot_end", "hinge")], ["turn"])
    order = [hand.position_names.index(x) for x in usd.position_names]
    assert usd.motor_names == ("turn",)
    assert [c.kind for c in usd.closures] == ["hinge"]
    for angle in (0.7, 1.4):
        q = hand.assemble({"turn": angle, "elbow": -angle, "foot": angle})
        same = np.where(np.array(usd.position_names) == "foot", -1, 1) * q[order]
        assert np.abs(usd.residual(same)).max() < 1e-12
        tau = hand.compute_torques(q, [2.0], [3.0])
        found = usd.compute_torques(same, [2.0], [3.0])
        assert_allclose(found, tau, rtol=1e-6)  # single precision


def quaternion(R):
    x, y, z, w = pin.Quaternion(R).coeffs().tolist()
    return f"({w}, {x}, {y}, {z})"


def usda_of(chain, q):
    """A chain of hinges, slides and balls as USD, its bodies drawn at q, each scaled twofold."""
    model, data = chain.model, chain.model.createData()
    g = model.gravity.linear
    size = float(np.linalg.norm(g))
    down = tuple((g / (size or 1)).tolist())
    parts = [
        f'def PhysicsScene "scene" {{\nvector3f physics:gravityDirection = {down}\n'
        f"float physics:gravityMagnitude = {size!r}\n}}\n"
    ]
    pin.computeJointJacobians(model, data, q)
    for j in range(1, model.njoints):
        body, M = model.inertias[j], data.oMi[j].homogeneous.T.copy()
        M[:3] *= 2  # row vectors: lengths in the body count twice
        rows = ", ".join(f"({', '.join(repr(float(x)) for x in row)})" for row in M)
        moments, axes = np.linalg.eigh(body.inertia)
        axes *= np.sign(np.linalg.det(axes))
        parts.append(
            f'def Xform "{model.names[j]}_body" (prepend apiSchemas = ["PhysicsRigidBodyAPI",'
            f' "PhysicsMassAPI"]) {{\nmatrix4d xformOp:transform = ({rows})\n'
            'uniform token[] xformOpOrder = ["xformOp:transform"]\n'
            f"float physics:mass = {body.mass!r}\n"
            f"point3f physics:centerOfMass = {tuple((body.lever / 2).tolist())}\n"
            f"float3 physics:diagonalInertia = {tuple(moments.tolist())}\n"
            f"quatf physics:principalAxes = {quaternion(axes)}\n}}\n"
        )

    def added(name, kind, ends, places, more=""):
        lines = [f'def {kind} "{name}" {more} {{']
        for k, (body, place) in enumerate(zip(ends, places, strict=True)):
            if body:
                lines.append(f"rel physics:body{k} = </{model.names[body]}_body>")
            p = place.translation / (2 if body else 1)
            lines.append(f"point3f physics:localPos{k} = {tuple(p.tolist())}")
            lines.append(f"quatf physics:localRot{k} = {quaternion(place.rotation)}")
        return lines

    here, kinds = pin.SE3.Identity(), {"R": "Revolute", "P": "Prismatic", "S": "Spherical"}
    for j in range(1, model.njoints):
        short, at = model.joints[j].shortname()[10:], model.jointPlacements[j]
        along = np.array([0, 0, 1.0])
        if short[0] != "S":
            J = pin.getJointJacobian(model, data, j, pin.LOCAL)[:, model.joints[j].idx_v]
            along = J[3:] if short[0] == "R" else J[:3]
        turn = pin.SE3(pin.Quaternion.FromTwoVectors(np.eye(3)[2], along).matrix(), np.zeros(3))
        name = model.names[j]
        drive = name in chain.motor_names
        api = "linear" if short[0] == "P" else "angular"
        more = f'(prepend apiSchemas = ["PhysicsDriveAPI:{api}"])' if drive else ""
        kind = f"Physics{kinds[short[0]]}Joint"
        lines = added(name, kind, (model.parents[j], j), (at * turn, here * turn), more)
        if short[0] != "S":
            lines.append('uniform token physics:axis = "Z"')
        parts.append("\n".join([*lines, "}\n"]))
    for k, closure in enumerate(chain.closures):
        frames = [model.frames[model.getFrameId(f)] for f in (closure.frame_a, closure.frame_b)]
        kind = {"6d": "Fixed", "3d": "Spherical", "hinge": "Revolute", "prismatic": "Prismatic"}
        ends, places = zip(*((f.parentJoint, f.placement) for f in frames), strict=True)
        lines = added(f"cut_{k}", f"Physics{kind[closure.kind]}Joint", ends, places)
        if closure.kind in ("hinge", "prismatic"):
            lines.append('uniform token physics:axis = "Z"')
        parts.append("\n".join([*lines, "uniform bool physics:excludeFromArticulation = 1", "}\n"]))
    return parts


ROBOTS = {
    **{x: getattr(robots, x) for x in ("four_bar", "five_bar", "planar_3rrr", "ladder", "andrews")},
    **{f"cut {kind}": partial(any_chain.chain, kind=kind) for kind in ("3d", "hinge", "prismatic")},
    "ball": partial(any_chain.with_joint, "spherical"),
    "slide": partial(any_chain.with_joint, "PX"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_written_as_usd_have_the_same_torques(name, tmp_path):
    """To the single precision of the places, masses and turns in a USD."""
    given = ROBOTS[name]()
    model = pin.Model(given.model)
    model.friction[:], model.damping[:], model.armature[:] = 0, 0, 0
    chain = ClosedChain(model, given.closures, given.motor_names, coordinates=given.coordinates)
    home = chain.home if named_home(chain) else chain.generic_configuration()
    head = '#usda 1.0\n(\nmetersPerUnit = 1\nkilogramsPerUnit = 1\nupAxis = "Z"\n)\n'
    path = written(tmp_path / "robot.usda", usda_of(chain, home), head)
    usd = ClosedChain.from_urdf(path).with_coordinates(chain.coordinates)
    drives = {x for x in chain.motor_names if chain.model.existJointName(x)}
    assert set(usd.motor_names) == drives
    order = [usd.position_names.index(x) for x in chain.position_names]
    assert_allclose(usd.home[order], home, atol=1e-5)
    va, aa = np.random.default_rng(0).normal(size=(2, chain.degrees_of_freedom))
    expected = chain.generalized_forces(home, va, aa)
    found = usd.generalized_forces(usd.assemble(usd.home, fixed=()), va, aa)
    assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


def test_loops_are_cut_where_no_drive_is(tmp_path):
    """A ring of three bars that float: one of its joints is cut, none with a drive."""
    drive = {"apis": "PhysicsDriveAPI:angular"}
    parts = [
        *(bar(name, 0, 5) for name in "abc"),
        joint("ab", "/a", "/b", "(10, 0, 0)"),
        joint("bc", "/b", "/c", "(10, 0, 0)", **drive),
        joint("ca", "/c", "/a", "(10, 0, 0)", **drive),
    ]
    ring = ClosedChain.from_urdf(written(tmp_path / "ring.usda", parts))
    assert set(ring.motor_names) == {"bc", "ca"}
    assert [str(c) for c in ring.closures] == ["ab_A - ab_B"]


def test_limits_are_in_degrees_and_in_the_unit_of_the_stage(tmp_path):
    limits = "float physics:lowerLimit = -90\nfloat physics:upperLimit = 45\n"
    parts = [
        bar("arm", 0, 10),
        bar("slide", 30, 10),
        joint("turn", "", "/arm", more=limits),
        joint("push", "/arm", "/slide", "(30, 0, 0)", more=limits, kind="PhysicsPrismaticJoint"),
    ]
    chain = ClosedChain.from_urdf(written(tmp_path / "arm.usda", parts), actuated=["turn", "push"])
    assert_allclose(chain.model.lowerPositionLimit, [-np.pi / 2, -0.9], rtol=1e-6)
    assert_allclose(chain.model.upperPositionLimit, [np.pi / 4, 0.45], rtol=1e-6)


def test_what_no_joint_holds_floats_and_what_is_kinematic_is_the_base(tmp_path):
    parts = [bar("a", 0, 10), bar("b", 30, 10), joint("turn", "/a", "/b", "(30, 0, 0)")]
    free = ClosedChain.from_urdf(written(tmp_path / "free.usda", parts), actuated=["turn"])
    assert free.joint_names == ("floating_base", "turn")
    parts[0] = bar("a", 0, 10, "bool physics:kinematicEnabled = 1")
    held = ClosedChain.from_urdf(written(tmp_path / "held.usda", parts), actuated=["turn"])
    assert held.joint_names == ("turn",)
    off = joint("off", "", "/a", more="bool physics:jointEnabled = 0")
    same = ClosedChain.from_urdf(written(tmp_path / "off.usda", [*parts, off]), actuated=["turn"])
    assert same.joint_names == ("turn",)


def test_bodies_that_are_drawn_where_their_joints_do_not_let_them_be_give_no_home(tmp_path):
    assert named_home(ClosedChain.from_urdf(written(tmp_path / "bar.usda")))
    parts = (*PARTS[:1], bar("coupler", 26, 25), *PARTS[2:])
    assert not named_home(ClosedChain.from_urdf(written(tmp_path / "apart.usda", parts)))


SCENE = 'def PhysicsScene "{}" {{\nfloat physics:gravityMagnitude = {}\n}}\n'
CUT = "uniform bool physics:excludeFromArticulation = 1"
WRONG_LIMITS = "float physics:lowerLimit = 5\nfloat physics:upperLimit = 1"
FLAT = bar("x", 0, 1).replace("= (0, 0, 0)", "= (1, 0, 1)").replace(":translate", ":scale")


@pytest.mark.parametrize(
    ("part", "told"),
    [
        (bar("x", 0, 1).replace("float physics:mass = 500", ""), "no physics:mass, which USD"),
        (bar("x", 0, 1).replace("(10000, 2", "(0, 0, 0) #"), "no physics:diagonalInertia"),
        (bar("x", 0, 1, "bool physxRigidBody:disableGravity = 1"), "disableGravity is not read"),
        (joint("x", "", "/crank", kind="PhysicsDistanceJoint"), "PhysicsDistanceJoint is not"),
        (joint("x", "", "/crank", kind="PhysicsJoint"), "type PhysicsJoint is not supported"),
        (joint("x", "", "/nowhere"), "/x: body1: no prim /nowhere"),
        (joint("x", "/crank", "/crank"), "connects crank with itself"),
        (joint("x", "", "/crank", apis="PhysxMimicJointAPI:rotX"), "JointAPI:rotX is not read"),
        *(
            (joint("x", "", "/crank", more=f"{kind} {name} = {value}"), f"{name} is not read")
            for kind, name, value in (
                ("float", "physxJoint:armature", 0.1),
                ("float", "physxJointAxis:angular:armature", 3),
                ("double", "mjc:armature", 3),
                ("double", "mjc:stiffness", 30),
                ("float", "newton:friction", 3),
                ("float", "newton:gravityScale", 0),
                ("bool", "physxRigidBody:enableGyroscopicForces", 0),
                ("rel", "newton:mimicJoint", "</turn>"),
            )
        ),
        (joint("x", "", "/crank", apis="NewtonMimicAPI"), "NewtonMimicAPI is not read"),
        ('def MjcTendon "t" {}', "MjcTendon is not read"),
        (SCENE.format("a", 3) + SCENE.format("b", 4), "several scenes with different gravity"),
        (joint("x", "", "/rocker", more=CUT, apis="PhysicsDriveAPI:angular"), "x: closes a loop"),
        (joint("x", "", "/crank", more=WRONG_LIMITS), "its lower limit is above"),
        (FLAT, "shears, mirrors or is singular"),
    ],
)
def test_what_acts_and_is_not_read_is_refused_by_name(part, told, tmp_path):
    path = written(tmp_path / "bar.usda", (*PARTS, part))
    with pytest.raises(DescriptionError) as caught:
        ClosedChain.from_urdf(path)
    assert told in str(caught.value)
    assert any(told in str(problem) for problem in sst_pin.validate(path))


def test_what_is_added_and_moves_nothing_is_no_fault(tmp_path):
    """Solvers, contacts, limits, and properties with the value that they have anyway."""
    more = """bool physics:jointEnabled = 0\nfloat physxJoint:maxJointVelocity = 3
    double mjc:armature = 0\nfloat newton:gravityScale = 1\nint mjc:group = 2
    float physxLimit:angular:stiffness = 9\nbool physxArticulation:enabledSelfCollisions = 1"""
    part = joint("x", "", "/crank", more=more, apis="PhysxJointAPI")
    chain = ClosedChain.from_urdf(written(tmp_path / "bar.usda", (*PARTS, part)))
    assert chain.motor_names == ("turn",)


def test_files_that_are_no_usd_are_refused(tmp_path):
    for text in ("", "#usda 1.0\ndef {", "#usda 1.0\n"):
        path = tmp_path / "robot.usda"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(DescriptionError, match=r"cannot be read|no prim has"):
            ClosedChain.from_urdf(path)
    with pytest.raises(DescriptionError, match="cannot be read"):
        ClosedChain.from_urdf(tmp_path / "none.usd")
