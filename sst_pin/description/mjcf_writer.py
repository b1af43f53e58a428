# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain as MJCF, the format of MuJoCo."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import SubElement

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..closed_chain import ClosedChain
from ..errors import DescriptionError, DescriptionWarning, warn_caller
from ..files import require_ending, text_writer, write_files
from ..model.closures import Brake, Closure, Constraint, Coupling, Distance, Rolling, frames_of
from ..model.lines import LineForce
from ..model.mechanism import Mechanism
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id, frame_named
from ..summaries import listed
from .mjcf_joints import MjcfJoint, joints_of, principal_axes
from .urdf_writer import numbers, rounded

#: Runge-Kutta: on the paper's circle its error is 1e-5 rad where Euler's is 1e-2. For large robots
#: MuJoCo takes sparse Jacobians by default, and version 4.0.0 factorises them wrongly.
_OPTION = {"timestep": "0.0005", "integrator": "RK4", "jacobian": "dense"}
#: Critically damped with a time constant of two steps; MuJoCo lengthens it with a longer step.
_EQUALITY = {"solref": "0.001 1", "solimp": "0.9999 0.9999 0.001"}
#: The smallest mass and moment that MuJoCo compiles, [kg], [kg m^2].
_LEAST_MASS, _LEAST_INERTIA = 1e-12, 1e-14
#: A smaller relative violation of the triangle inequality of moments is rounding.
_ROUNDING = 1e-9
#: Larger limits are left out.
_FAR = 1e9
#: URDF demands a largest velocity; this or a larger one stands for none, [rad/s] or [m/s].
_FAST = 1e3
_FIXED, _BALL = Closure.KINDS["6d"], Closure.KINDS["3d"]
_HERE, _WORLDS = pin.SE3.Identity(), ("universe", "world")
_SINGLE = ("hinge", "slide")
_POINTS, _LINK = (pin.FrameType.OP_FRAME, pin.FrameType.SENSOR), pin.FrameType.BODY
_LOOK = {"mass": "0", "group": "2", "contype": "0", "conaffinity": "0"}
#: Types of geoms, and what gives their sizes.
_SHAPES: dict[type, tuple[str, Callable[[Any], Iterable[float]]]] = {
    coal.Sphere: ("sphere", lambda s: [s.radius]),
    coal.Capsule: ("capsule", lambda s: [s.radius, s.halfLength]),
    coal.Cylinder: ("cylinder", lambda s: [s.radius, s.halfLength]),
    coal.Ellipsoid: ("ellipsoid", lambda s: s.radii),
    coal.Box: ("box", lambda s: s.halfSide),
}


def write_mjcf(chain: ClosedChain, path: str | Path, force: bool = False) -> None:
    """Write a robot as a closed MJCF, which MuJoCo simulates and `ClosedChain.from_mjcf` reads.

    Args:
        chain: The robot; its home and other named configurations become keyframes.
        path: The file, its ending .xml or .mjcf.
        force: Whether an existing file may be replaced.

    Raises:
        DescriptionError: For what MJCF cannot say: rolling contacts, universal, cylindrical,
            prismatic and planar closures, helical and planar joints. The message lists all.
        OutputError: If the file cannot be written, or exists.

    Warns:
        DescriptionWarning: If bodies without mass get a little, or shapes are left out.

    Example:
        >>> sst_pin.write_mjcf(sst_pin.robots.five_bar(), "five_bar.xml")
        >>> sst_pin.ClosedChain.from_mjcf("five_bar.xml").motor_names
        ('shoulder_1', 'shoulder_2')
    """
    require_ending(path, ".xml", ".mjcf")
    writer = MjcfWriter(chain.mechanism)
    writer.add_shapes(chain.visual_model)
    known = chain.mechanism.model.referenceConfigurations
    configurations = {item.key(): item.data() for item in known}
    if "home" in configurations:
        configurations["home"] = chain.home
    writer.add_keyframes(configurations)
    write_files({Path(path): text_writer(writer.text())}, force)
    for note in writer.notes:
        warn_caller(f"{path}: {note}", DescriptionWarning)


#: Radius of the sphere of a point, [m].
POINT = 1e-9
#: Geoms that touch nothing but by their pairs.
_UNTOUCHED = {"contype": "0", "conaffinity": "0"}


class MjcfWriter:
    """Builds an MJCF; with `plain` only the bodies and their joints.

    `bodies` are the elements of the bodies, by joint; `joints` are MuJoCo's joints in its order;
    `notes` say what is left out or written with other numbers.
    """

    def __init__(self, mechanism: Mechanism, plain: bool = False) -> None:
        self._mechanism, self._tree = mechanism, NormalTree(mechanism.model)
        self._model = model = self._tree.model
        self.root = ET.Element("mujoco", model=model.name)
        SubElement(self.root, "compiler", angle="radian", autolimits="true")
        SubElement(self.root, "option", _OPTION, gravity=numbers(model.gravity.linear))
        SubElement(SubElement(self.root, "default"), "equality", _EQUALITY)
        self._world = base = SubElement(self.root, "worldbody")
        self._names = self._body_names()
        if self._names[0] != "universe":
            base = SubElement(self._world, "body", name=self._names[0])
        # Free bodies must be in the world. The others are written there too, so that the order of
        # the joints stays.
        floats = any(_is_free(model.joints[j]) for j in model.children[0])
        self._base = self._world if floats else base
        self._bodies, self.joints = [base] * model.njoints, list[MjcfJoint]()
        self._problems, self.notes, self._plain = list[str](), list[str](), plain
        self._with_velocity_limit = list[str]()
        self._ends = {name for closure in mechanism.closures for name in frames_of(closure)}
        self._ends |= {x for line in mechanism.lines.forces for x in (line.frame_a, line.frame_b)}
        self._ends |= {x for rope in mechanism.contacts.ropes for x in (rope.frame_a, rope.frame_b)}
        self._children(0)
        self.bodies = [self._bodies[index] for index in self._tree.bodies]
        if not plain:
            self._add_sites()
            self._add_forces_and_motors()
            self._add_contacts()
            for k, closure in enumerate(mechanism.closures):
                self._close(k, closure)
            self._add_mimics()
            if fast := self._with_velocity_limit:
                text = f"largest velocities of the joints {listed(fast)} are left out"
                self.notes.append(f"{text}: MuJoCo has none")

    def _body_names(self) -> dict[int, str]:
        """Name of the body of each joint: of a link that stands at the joint, else of the joint.

        A name that is a frame elsewhere is left to the site at this frame.
        """
        names = dict(enumerate(self._model.names))
        for frame in list(self._model.frames)[::-1]:
            if frame.type != _LINK or frame.name in _WORLDS:
                continue
            if frame.placement.isIdentity():
                names[frame.parentJoint] = frame.name
        at_joints = {(f.name, f.parentJoint) for f in self._model.frames if _is_at_joint(f)}
        points = {f.name for f in self._model.frames if f.type in (*_POINTS, _LINK)}
        for joint, name in names.items():
            if name in points and (name, joint) not in at_joints:
                names[joint] = f"{name}_joint"
        return names

    def text(self) -> str:
        """The file; an error if MJCF cannot express a part of the robot."""
        if self._problems:
            raise DescriptionError(f"model {self._mechanism.model.name}", self._problems)
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def qpos(self, q: Array) -> Array:
        """MuJoCo's coordinates for a configuration."""
        return np.concatenate([joint.qpos(q) for joint in self.joints])

    def add_keyframes(self, configurations: Mapping[str, Array]) -> None:
        """Add configurations by name."""
        for name, q in configurations.items():
            SubElement(self._section("keyframe"), "key", name=name, qpos=numbers(self.qpos(q)))

    def add_shapes(self, shapes: pin.GeometryModel, **how: str) -> None:
        """Add shapes; by default they are visual: without mass and without contacts."""
        for k, shape in enumerate(shapes.geometryObjects):
            geometry, look = shape.geometry, how or {**_LOOK, "rgba": rounded(shape.meshColor)}
            attributes = look | _pose(shape.placement, rounded)
            if type(geometry) in _SHAPES:
                kind, size = _SHAPES[type(geometry)]
                attributes |= {"type": kind, "size": rounded(list(size(geometry)))}
            elif isinstance(geometry, coal.BVHModelBase):
                mesh = self._section("asset"), "mesh", {"name": f"shape_{k}", "inertia": "shell"}
                faces = (geometry.tri_indices(i) for i in range(geometry.num_tris))
                corners = " ".join(str(face[i]) for face in faces for i in range(3))
                points = rounded(geometry.vertices().ravel())
                SubElement(*mesh, vertex=points, face=corners)
                attributes |= {"type": "mesh", "mesh": f"shape_{k}"}
            else:
                self.notes.append(f"shape {shape.name} is left out: MuJoCo has none of its kind")
                continue
            SubElement(self.bodies[shape.parentJoint], "geom", attributes)

    def _section(self, name: str) -> ET.Element:
        """A section of the file; the first call adds it."""
        section = self.root.find(name)
        return SubElement(self.root, name) if section is None else section

    def _children(
        self, parent: int, before: Sequence[MjcfJoint] = (), start: pin.SE3 = _HERE
    ) -> None:
        """Add the bodies that a joint bears; they get the joints of empty bodies `before` them."""
        model = self._model
        for index in model.children[parent]:
            joints, at = list[MjcfJoint](), model.jointPlacements[index]
            try:
                joints = joints_of(self._mechanism.model, self._tree, index)
            except DescriptionError as error:
                self._problems += error.problems
            joints = [joint.seen_from(at) for joint in before] + joints
            bearer = self._bodies[parent] if parent else self._base
            if self._is_empty(index) and all(joint.kind in _SINGLE for joint in joints):
                self._bodies[index] = bearer
                self._children(index, joints, start * at)
                self._bodies[index] = self._bodies[model.children[index][0]]
                continue
            name = {"name": self._names[index]}
            self._bodies[index] = body = SubElement(bearer, "body", name | _pose(start * at))
            self.joints += joints
            for joint in joints:
                SubElement(body, "joint", self._joint(joint))
            self._add_inertia(index)
            self._children(index)

    def _is_empty(self, index: int) -> bool:
        """Whether a joint bears one other joint only, such as the first axis of a universal one."""
        model, kind = self._model, pin.FrameType.JOINT
        frames = [frame for frame in model.frames if frame.parentJoint == index]
        bare = all(frame.type == kind and frame.name not in self._ends for frame in frames)
        empty = model.inertias[index] == pin.Inertia.Zero()
        return bool(bare and empty and len(model.children[index]) == 1)

    def _joint(self, joint: MjcfJoint) -> dict[str, str]:
        attributes, single = {"name": joint.name, "type": joint.kind}, joint.kind in _SINGLE
        if single:
            attributes |= {"axis": numbers(joint.axis)}
            attributes |= {"pos": numbers(joint.point)} if joint.point.any() else {}
        if self._plain or joint.mimics:
            return attributes
        mechanism, model = self._mechanism, self._mechanism.model
        friction, springs, kind = mechanism.friction, mechanism.springs, joint.kind
        numbers_of = {"damping": friction.viscous, "frictionloss": friction.coulomb}
        numbers_of |= {"armature": model.armature, "stiffness": springs.stiffness}
        for name, of_rates in numbers_of.items():
            value = of_rates[joint.rates]
            if np.ptp(value) or (kind == "free" and name != "damping" and value.any()):
                text = f"joint {joint.name}: no {name} of single rates of a {kind} joint"
                self._problems.append(text)
            attributes |= {name: numbers(value[:1])} if value.any() else {}
        if "stiffness" in attributes:
            rest = joint.qpos(springs.reference)
            if single:
                attributes["springref"] = numbers(rest)
            elif np.abs(rest - np.eye(4)[0]).max() > 1e-12:
                self._problems.append(f"joint {joint.name}: a spring of a ball rests at zero only")
        fastest = model.velocityLimit[joint.rates]
        if ((fastest > 0) & (fastest < _FAST)).any():
            self._with_velocity_limit.append(joint.name)
        ends = np.array([model.lowerPositionLimit, model.upperPositionLimit])[:, joint.entries]
        if single and ends.size == 2 and (np.abs(ends) < _FAR).any():
            attributes["range"] = numbers(ends.clip(-_FAR, _FAR).ravel())
        effort = self._shared_effort(joint) if single else 0.0
        if effort:
            attributes["actuatorfrcrange"] = numbers([-effort, effort])
        return attributes

    def _shared_effort(self, joint: MjcfJoint) -> float:
        """The largest force on a joint of motors that act on others too; 0 if it has no limit."""
        motors, effort = self._mechanism.motors, self._mechanism.model.upperEffortLimit
        rate = int(joint.rates[0])
        shared = (motors != 0).sum(axis=0) > 1
        limit = float(effort[rate])
        return limit if motors[rate, shared].any() and 0 < limit < _FAR else 0.0

    def _add_inertia(self, index: int) -> None:
        inertia, name = self._model.inertias[index], self._names[index]
        moments, R = principal_axes(inertia.inertia)
        if inertia.mass < _LEAST_MASS or moments.min() < _LEAST_INERTIA:
            text = f"at least {_LEAST_MASS:g} kg and {_LEAST_INERTIA:g} kg m^2"
            needs = "MuJoCo needs mass, and inertia about all axes"
            self.notes.append(f"body {name}: {needs}; each is written as {text}")
        moments, large = np.maximum(moments, _LEAST_INERTIA), moments.argmax()
        most = np.delete(moments, large).sum()  # the triangle inequality
        if moments[large] > most * (1 + _ROUNDING):
            text = f"one of the principal moments {moments.round(6)} exceeds the sum of the others"
            self._problems.append(f"body {name}: {text}, which no body has")
        moments[large] = min(moments[large], most)
        attributes = {"pos": numbers(inertia.lever), "diaginertia": numbers(moments)}
        attributes["mass"] = numbers([max(inertia.mass, _LEAST_MASS)])
        SubElement(self._bodies[index], "inertial", _pose(pin.SE3(R, inertia.lever)) | attributes)

    def _add_sites(self) -> None:
        """Sites at frames other than joints and bodies, and at all ends of closures and lines."""
        bodies, sites = set(self._names.values()), set[str]()
        for i, frame in enumerate(self._model.frames):
            name = frame.name
            world = frame.parentJoint == 0 and frame.placement.isIdentity()
            is_point = frame.type in _POINTS or (frame.type == _LINK and not world)
            is_end = name in self._ends and frame_id(self._model, name) == i
            if is_end or (is_point and name not in bodies and name not in sites):
                self._site(name, frame.parentJoint, frame.placement)
                sites.add(name)

    def _site(self, name: str, joint: int, at: pin.SE3) -> None:
        SubElement(self._bodies[joint], "site", {"name": _site_name(name)} | _pose(at))

    def _close(self, k: int, closure: Constraint) -> None:
        if isinstance(closure, Coupling):
            self._couple(closure)
        elif isinstance(closure, Rolling):
            self._problems.append(f"closure {closure}: MuJoCo has no rolling without slip")
        elif isinstance(closure, Brake):
            self._problems.append(f"{closure}: MuJoCo has no brakes; write the robot without them")
        elif isinstance(closure, Distance):
            self._rod(f"rod_{k}", closure)
        else:
            rows = closure.held
            self._connect("weld" if rows == _FIXED else "connect", *frames_of(closure))
            if rows[:3] == _BALL[:3] and rows.count(False) == 1:
                self._connect("connect", *self._beside(k, closure, rows.index(False) - 3))
            elif rows not in (_FIXED, _BALL):
                kind = closure.kind if isinstance(closure.kind, str) else "of these directions"
                self._problems.append(f"closure {closure}: MuJoCo has no closure {kind}")

    def _connect(self, kind: str, a: str, b: str) -> None:
        where = {"name": f"{a}-{b}", "site1": _site_name(a), "site2": _site_name(b)}
        SubElement(self._section("equality"), kind, where)

    def _beside(self, k: int, hinge: Closure, axis: int) -> Iterator[str]:
        """Two sites aside on the axis of a hinge; two connected points make a hinge."""
        aside = pin.SE3(np.eye(3), self._mechanism.length * np.eye(3)[axis])
        for end in frames_of(hinge):
            frame = frame_named(self._model, end)
            self._site(f"{end}_axis_{k}", frame.parentJoint, frame.placement * aside)
            yield f"{end}_axis_{k}"

    def _rod(self, name: str, rod: Distance) -> None:
        """A tendon of constant length."""
        model, data = self._mechanism.model, self._mechanism.model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        a, b = (data.oMf[frame_id(model, end)].translation for end in frames_of(rod))
        self._spatial({"name": name}, *frames_of(rod))
        length = numbers([rod.distance - np.linalg.norm(b - a), 0, 0, 0, 0])
        SubElement(self._section("equality"), "tendon", tendon1=name, polycoef=length)

    def _spatial(self, attributes: dict[str, str], *frames: str) -> None:
        """A line between two frames."""
        tendon = SubElement(self._section("tendon"), "spatial", attributes)
        for frame in frames:
            SubElement(tendon, "site", site=_site_name(frame))

    def _fixed(self, name: str, shares: Mapping[str, float]) -> str:
        """A tendon whose length is a sum of joint coordinates."""
        tendon = SubElement(self._section("tendon"), "fixed", name=name)
        for joint, share in shares.items():
            SubElement(tendon, "joint", joint=joint, coef=numbers([share]))
        return name

    def _couple(self, coupling: Coupling) -> None:
        """A joint as a polynomial of another; sums of joints are tendons."""
        known, offset = {joint.name for joint in self.joints}, coupling.offset
        rows = {name: np.trim_zeros(p, "b") for name, p in coupling.polynomials.items()}
        curved = [name for name, p in rows.items() if len(p) > 2] or list(rows)[:1]
        if len(curved) > 1 or max(map(len, rows.values()), default=0) > 5 or not known >= {*rows}:
            text = "MuJoCo has polynomials of one joint, up to the fourth power"
            self._problems.append(f"coupling {coupling}: {text}")
            return
        polynomial = np.zeros(5)
        polynomial[0] = offset + sum(p[0] for p in rows.values() if len(p))
        for name in curved:
            polynomial[1 : len(rows[name])] = rows[name][1:]
        others = {name: -p[1] for name, p in rows.items() if name not in curved and len(p) > 1}
        sides, kind = [coupling.joint, *curved], "joint"
        if others:
            kind, count = "tendon", len(self.root.findall("tendon/fixed"))
            sides = [self._fixed(f"sum_{count}", {coupling.joint: 1.0} | others)]
            sides += [self._fixed(f"sum_{count + 1}", {name: 1.0}) for name in curved]
        names = {f"{kind}{i}": side for i, side in enumerate(sides, 1)}
        SubElement(self._section("equality"), kind, names, polycoef=numbers(polynomial))

    def _add_mimics(self) -> None:
        leaders = self._by_rate()
        for joint in self.joints:
            if joint.mimics:
                names = {"joint1": joint.name, "joint2": leaders[int(joint.rates[0])]}
                polynomial = numbers([joint.offset, joint.factor, 0, 0, 0])
                SubElement(self._section("equality"), "joint", names, polycoef=polynomial)

    def _by_rate(self) -> dict[int, str]:
        """Names of hinges and slides, by the index of their rate."""
        single = (j for j in self.joints if j.kind in _SINGLE and not j.mimics)
        return {int(joint.rates[0]): joint.name for joint in single}

    def _add_forces_and_motors(self) -> None:
        mechanism = self._mechanism
        for line in mechanism.lines.forces:
            attributes, rest = {"name": line.name}, 0.0
            if line.stiffness:
                rest = line.rest_length - line.preload / line.stiffness
                attributes |= {"stiffness": numbers([line.stiffness])}
                attributes |= {"springlength": numbers([rest])}
            if rest < 0 or (line.preload and not line.stiffness):
                text = f"its preload {line.preload:g} N: a tendon of MuJoCo has no constant force"
                self._problems.append(f"line {line}: {text}")
            if line.pulls_only:
                attributes["springlength"] = numbers([0, rest])
                if line.damping or not line.stiffness:
                    text = "of the cables of MuJoCo only the springs are slack; its damper is not"
                    self._problems.append(f"line {line}: {text}")
            attributes |= {"damping": numbers([line.damping])} if line.damping else {}
            attributes |= {"armature": numbers([line.mass])} if line.mass else {}
            if line.lower or line.upper < _FAR:
                attributes |= {"range": numbers([line.lower, min(line.upper, _FAR)])}
            if line.velocity < _FAR:
                self.notes.append(f"line {line}: its largest velocity is left out")
            if line.mass and self._joins_branches(line):
                text = "its mass: MuJoCo leaves out the inertia of a tendon between two branches"
                self._problems.append(f"line {line}: {text}")
            self._spatial(attributes, line.frame_a, line.frame_b)
        for k, name in enumerate(mechanism.motor_names):
            self._add_motor(name, mechanism.motors[:, k], mechanism.lines.motors[:, k])

    def _joins_branches(self, line: LineForce) -> bool:
        """Whether both ends move relative to the last body that carries both."""
        frames = (frame_named(self._model, name) for name in (line.frame_a, line.frame_b))
        a, b = (set(self._model.supports[frame.parentJoint]) for frame in frames)
        return bool(a - b) and bool(b - a)

    def _add_contacts(self) -> None:
        """Spheres and planes that touch in pairs, and ropes as tendons of limited length."""
        contacts, planes = self._mechanism.contacts, dict[str, str]()
        for contact in contacts.points:
            frame, ground = (
                frame_named(self._model, name) for name in (contact.frame, contact.ground)
            )
            if ground.parentJoint:
                text = "planes of MuJoCo stand still, and its ground moves"
                self._problems.append(f"contact {contact}: {text}")
                continue
            if contact.restitution:
                self.notes.append(f"contact {contact}: its restitution is left out")
            if contact.ground not in planes:
                planes[contact.ground] = f"{contact.ground} plane"
                plane = {"name": planes[contact.ground], "type": "plane", "size": "1 1 1"}
                SubElement(self._base, "geom", plane | _UNTOUCHED | _pose(ground.placement))
            sphere = {"name": f"{contact} sphere", "type": "sphere", "mass": "0"}
            sphere |= {"size": numbers([max(contact.radius, POINT)])}
            place = pin.SE3(np.eye(3), frame.placement.translation)
            bearer = self._bodies[frame.parentJoint]
            SubElement(bearer, "geom", sphere | _UNTOUCHED | _pose(place))
            pair = {"name": contact.name, "geom1": sphere["name"], "geom2": planes[contact.ground]}
            sliding = [contact.friction, contact.friction, 0, 0, 0]
            pair |= {"condim": "3", "friction": numbers(sliding)}
            SubElement(self._section("contact"), "pair", pair)
        for rope in contacts.ropes:
            attributes = {"name": rope.name, "range": numbers([0, rope.length])}
            self._spatial(attributes, rope.frame_a, rope.frame_b)

    def _add_motor(self, name: str, on_rates: Array, on_lines: Array) -> None:
        forces, effort = self._mechanism.lines.forces, self._mechanism.model.upperEffortLimit
        single = self._by_rate()
        rates, lines = np.flatnonzero(on_rates), np.flatnonzero(on_lines)
        motor = {"name": name}
        if not len(rates) and on_lines[lines].tolist() == [1]:
            motor["tendon"] = forces[lines[0]].name
            if (limit := forces[lines[0]].effort) < _FAR:
                motor["ctrlrange"] = numbers([-limit, limit])
        elif len(lines) or not single.keys() >= set(rates.tolist()):
            text = "it acts on more than hinges and slides, or one line"
            self._problems.append(f"motor {name}: {text}")
        elif on_rates[rates].tolist() == [1]:
            motor["joint"] = single[int(rates[0])]
            if 0 < (limit := float(effort[rates[0]])) < _FAR:
                motor["ctrlrange"] = numbers([-limit, limit])
        else:
            motor["tendon"] = self._fixed(name, {single[int(k)]: on_rates[k] for k in rates})
        SubElement(self._section("actuator"), "motor", motor)


def _is_free(joint: Any) -> bool:
    return bool(joint.shortname() == "JointModelFreeFlyer")


def _is_at_joint(frame: pin.Frame) -> bool:
    return frame.type != pin.FrameType.JOINT and bool(frame.placement.isIdentity())


def _site_name(frame: str) -> str:
    """The name of the site at a frame; `from_mjcf` refuses a site with the name of the base."""
    return "universe_site" if frame == "universe" else frame


def _pose(at: pin.SE3, write: Callable[[Any], str] = numbers) -> dict[str, str]:
    """Position and orientation, where they are not zero."""
    from scipy.spatial.transform import Rotation

    pose = {"pos": write(at.translation)} if at.translation.any() else {}
    if not np.array_equal(at.rotation, np.eye(3)):
        w = Rotation.from_matrix(at.rotation).as_quat(canonical=True)[[3, 0, 1, 2]]
        pose["quat"] = write(w)
    return pose
