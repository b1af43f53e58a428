# SPDX-License-Identifier: BSD-2-Clause
"""Any closed chain as MJCF, the format of MuJoCo."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
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

#: Integrator: on the paper's circle the error of Runge-Kutta is 1e-5 rad, that of Euler 1e-2 rad.
#: Jacobian: for large robots MuJoCo uses sparse Jacobians by default, and version 4.0.0 factorises
#: them wrongly.
_OPTION = {"timestep": "0.0005", "integrator": "RK4", "jacobian": "dense"}
#: Closures are critically damped with a time constant of two steps. MuJoCo lengthens it for longer
#: steps.
_EQUALITY = {"solref": "0.001 1", "solimp": "0.9999 0.9999 0.001"}
#: The smallest mass and moment that MuJoCo compiles, [kg], [kg m^2].
_LEAST_MASS = 1e-12
_LEAST_INERTIA = 1e-14
#: A smaller relative violation of the triangle inequality of moments is rounding.
_ROUNDING = 1e-9
#: Larger limits are left out.
_FAR = 1e9
#: URDF demands a largest velocity; this or a larger one stands for none, [rad/s] or [m/s].
_FAST = 1e3
#: Largest entry of the rotation at which the spring of a ball is relaxed that counts as zero.
_REST_ROUNDING = 1e-12
#: Degree of MuJoCo's polynomials of joints.
_MAX_DEGREE = 4
_FIXED = Closure.KINDS["6d"]
_BALL = Closure.KINDS["3d"]
_IDENTITY = pin.SE3.Identity()
_WORLDS = ("universe", "world")
#: Joints of one rate.
_SINGLE = ("hinge", "slide")
_POINTS = (pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)
_LINK = pin.FrameType.BODY
#: Attributes of shapes without mass and contacts, in the group of visual geoms.
_LOOK = {"mass": "0", "group": "2", "contype": "0", "conaffinity": "0"}
#: Radius of the sphere of a point, [m].
POINT = 1e-9
#: Geoms that touch nothing but by their pairs.
_UNTOUCHED = {"contype": "0", "conaffinity": "0"}
#: For each shape its type of geom and the function that returns its sizes.
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
        DescriptionError: If the robot has parts that MJCF cannot express: rolling contacts,
            universal, cylindrical, prismatic and planar closures, helical and planar joints. The
            message lists all.
        OutputError: If the file cannot be written, or exists.

    Warns:
        DescriptionWarning: If bodies without mass get a little, shapes are left out, or a brake
            becomes an equality that holds at home only.

    Example:
        >>> sst_pin.write_mjcf(sst_pin.robots.five_bar(), "five_bar.xml")
        >>> sst_pin.ClosedChain.from_mjcf("five_bar.xml").motor_names
        ('shoulder_1', 'shoulder_2')
    """
    require_ending(path, ".xml", ".mjcf")
    known = chain.mechanism.model.referenceConfigurations
    configurations = {item.key(): item.data() for item in known}
    if "home" in configurations:
        configurations["home"] = chain.home
    writer = MjcfWriter(chain.mechanism, home=configurations.get("home"))
    writer.add_shapes(chain.visual_model)
    writer.add_keyframes(configurations)
    write_files({Path(path): text_writer(writer.text())}, force)
    for note in writer.notes:
        warn_caller(f"{path}: {note}", DescriptionWarning)


class MjcfWriter:
    """Builds an MJCF; with `plain` only the bodies and their joints.

    `bodies` are the elements of the bodies, by joint; `joints` are MuJoCo's joints in its order;
    `notes` say what is left out or written with other numbers. Brakes hold at the configuration
    `home`, shape (nq,); without it they are problems.
    """

    def __init__(
        self, mechanism: Mechanism, plain: bool = False, home: Array | None = None
    ) -> None:
        self._mechanism = mechanism
        self._home = home
        self._plain = plain
        self._problems = list[str]()
        self.notes = list[str]()
        self._tree = NormalTree(mechanism.model)
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
        self._bodies = [base] * model.njoints
        self.joints = list[MjcfJoint]()
        self._with_velocity_limit = list[str]()
        self._end_frames = set[str]()  # of closures, lines and ropes
        for closure in mechanism.closures:
            self._end_frames.update(frames_of(closure))
        for line in mechanism.lines.forces:
            self._end_frames.update((line.frame_a, line.frame_b))
        for rope in mechanism.contacts.ropes:
            self._end_frames.update((rope.frame_a, rope.frame_b))
        self._add_children(0)
        self.bodies = [self._bodies[index] for index in self._tree.bodies]
        if not plain:
            self._add_sites()
            self._add_forces_and_motors()
            self._add_contacts()
            for k, closure in enumerate(mechanism.closures):
                self._close(k, closure)
            self._add_mimics()
            if self._with_velocity_limit:
                names = listed(self._with_velocity_limit)
                text = f"largest velocities of the joints {names} are left out"
                self.notes.append(f"{text}: MuJoCo has none")

    def _body_names(self) -> dict[int, str]:
        """Name of the body of each joint: the name of a link at the joint, else of the joint.

        If a frame elsewhere has this name, its site gets it, and the body `NAME_joint`.
        """
        names = dict(enumerate(self._model.names))
        for frame in list(self._model.frames)[::-1]:  # so that the first link counts
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
            geometry = shape.geometry
            look = how or {**_LOOK, "rgba": rounded(shape.meshColor)}
            attributes = look | _pose(shape.placement, rounded)
            if type(geometry) in _SHAPES:
                kind, size = _SHAPES[type(geometry)]
                attributes |= {"type": kind, "size": rounded(list(size(geometry)))}
            elif isinstance(geometry, coal.BVHModelBase):
                self._add_mesh(f"shape_{k}", geometry)
                attributes |= {"type": "mesh", "mesh": f"shape_{k}"}
            else:
                self.notes.append(f"shape {shape.name} is left out: MuJoCo has none of its kind")
                continue
            SubElement(self.bodies[shape.parentJoint], "geom", attributes)

    def _add_mesh(self, name: str, geometry: coal.BVHModelBase) -> None:
        corners = list[str]()
        for i in range(geometry.num_tris):
            triangle = geometry.tri_indices(i)
            corners += [str(triangle[k]) for k in range(3)]
        SubElement(
            self._section("asset"),
            "mesh",
            {"name": name, "inertia": "shell"},  # for meshes that enclose no volume too
            vertex=rounded(geometry.vertices().ravel()),
            face=" ".join(corners),
        )

    def _section(self, name: str) -> ET.Element:
        """A section of the file; the first call adds it."""
        section = self.root.find(name)
        return SubElement(self.root, name) if section is None else section

    def _add_children(
        self, parent: int, before: Sequence[MjcfJoint] = (), start: pin.SE3 = _IDENTITY
    ) -> None:
        """Add the bodies that move with a joint, and all bodies after them.

        In MuJoCo a body can have several joints, so an empty body between two joints is left out.
        Its joints are in `before`, and `start` is its placement in the last body that is written.
        """
        model = self._model
        for index in model.children[parent]:
            at = model.jointPlacements[index]
            joints = [joint.seen_from(at) for joint in before]
            try:
                joints += joints_of(self._mechanism.model, self._tree, index)
            except DescriptionError as error:
                self._problems += error.problems
            parent_body = self._bodies[parent] if parent else self._base
            if self._is_empty(index) and all(joint.kind in _SINGLE for joint in joints):
                self._bodies[index] = parent_body
                self._add_children(index, joints, start * at)
                self._bodies[index] = self._bodies[model.children[index][0]]
                continue
            name = {"name": self._names[index]}
            body = SubElement(parent_body, "body", name | _pose(start * at))
            self._bodies[index] = body
            self.joints += joints
            for joint in joints:
                SubElement(body, "joint", self._joint(joint))
            self._add_inertia(index)
            self._add_children(index)

    def _is_empty(self, index: int) -> bool:
        """Whether the body of a joint only carries one other joint.

        Example: the body between the axes of a universal joint.
        """
        model = self._model
        frames = [frame for frame in model.frames if frame.parentJoint == index]
        has_only_joint_frames = all(
            frame.type == pin.FrameType.JOINT and frame.name not in self._end_frames
            for frame in frames
        )
        is_massless = bool(model.inertias[index] == pin.Inertia.Zero())
        has_one_child = len(model.children[index]) == 1
        return has_only_joint_frames and is_massless and has_one_child

    def _joint(self, joint: MjcfJoint) -> dict[str, str]:
        """Attributes of a joint."""
        attributes = {"name": joint.name, "type": joint.kind}
        is_single = joint.kind in _SINGLE
        if is_single:
            attributes["axis"] = numbers(joint.axis)
            if joint.point.any():
                attributes["pos"] = numbers(joint.point)
        if self._plain or joint.mimics:
            return attributes
        attributes |= self._joint_numbers(joint)
        if "stiffness" in attributes:
            reference = joint.qpos(self._mechanism.springs.reference)
            if is_single:
                attributes["springref"] = numbers(reference)
            elif np.abs(reference - np.eye(4)[0]).max() > _REST_ROUNDING:
                text = "a spring of a ball can be relaxed at zero only"
                self._problems.append(f"joint {joint.name}: {text}")
        fastest = self._mechanism.model.velocityLimit[joint.rates]
        if ((fastest > 0) & (fastest < _FAST)).any():
            self._with_velocity_limit.append(joint.name)
        if is_single:
            attributes |= self._joint_limits(joint)
        return attributes

    def _joint_numbers(self, joint: MjcfJoint) -> dict[str, str]:
        """Friction, rotor and spring of a joint; MuJoCo has one number for all its rates."""
        mechanism = self._mechanism
        by_rate = {
            "damping": mechanism.friction.viscous,
            "frictionloss": mechanism.friction.coulomb,
            "armature": mechanism.model.armature,
            "stiffness": mechanism.springs.stiffness,
        }
        attributes = {}
        for name, of_rates in by_rate.items():
            values = of_rates[joint.rates]
            differ = np.ptp(values)
            # `from_mjcf` reads only the damping of a free joint.
            is_refused_for_free = joint.kind == "free" and name != "damping" and values.any()
            if differ or is_refused_for_free:
                text = f"joint {joint.name}: no {name} of single rates of a {joint.kind} joint"
                self._problems.append(text)
            if values.any():
                attributes[name] = numbers(values[:1])
        return attributes

    def _joint_limits(self, joint: MjcfJoint) -> dict[str, str]:
        """Limits of the position and of the force of a hinge or a slide."""
        model = self._mechanism.model
        limits = {}
        ends = np.array([model.lowerPositionLimit, model.upperPositionLimit])[:, joint.entries]
        # A continuous joint has two entries, cosine and sine, and no range.
        if ends.size == 2 and (np.abs(ends) < _FAR).any():
            limits["range"] = numbers(ends.clip(-_FAR, _FAR).ravel())
        effort = self._shared_effort(joint)
        if effort:
            limits["actuatorfrcrange"] = numbers([-effort, effort])
        return limits

    def _shared_effort(self, joint: MjcfJoint) -> float:
        """The largest force on a joint of motors that act on others too; 0 if it has no limit."""
        motors = self._mechanism.actuation
        rate = int(joint.rates[0])
        acts_on_several = (motors != 0).sum(axis=0) > 1
        limit = float(self._mechanism.model.upperEffortLimit[rate])
        if motors[rate, acts_on_several].any() and 0 < limit < _FAR:
            return limit
        return 0.0

    def _add_inertia(self, index: int) -> None:
        """Add mass and inertia of a body, with MuJoCo's smallest values where they are smaller."""
        inertia = self._model.inertias[index]
        name = self._names[index]
        moments, R = principal_axes(inertia.inertia)
        if inertia.mass < _LEAST_MASS or moments.min() < _LEAST_INERTIA:
            text = f"at least {_LEAST_MASS:g} kg and {_LEAST_INERTIA:g} kg m^2"
            needs = "MuJoCo needs mass, and inertia about all axes"
            self.notes.append(f"body {name}: {needs}; each is written as {text}")
        largest = moments.argmax()
        moments = np.maximum(moments, _LEAST_INERTIA)
        sum_of_others = np.delete(moments, largest).sum()
        if moments[largest] > sum_of_others * (1 + _ROUNDING):
            text = f"one of the principal moments {moments.round(6)} exceeds the sum of the others"
            self._problems.append(f"body {name}: {text}, which no body has")
        # MuJoCo refuses even rounding beyond the triangle inequality.
        moments[largest] = min(moments[largest], sum_of_others)
        attributes = {"pos": numbers(inertia.lever), "diaginertia": numbers(moments)}
        attributes["mass"] = numbers([max(inertia.mass, _LEAST_MASS)])
        SubElement(self._bodies[index], "inertial", _pose(pin.SE3(R, inertia.lever)) | attributes)

    def _add_sites(self) -> None:
        """Sites at frames other than joints and bodies, and at all ends of closures and lines."""
        bodies = set(self._names.values())
        sites = set[str]()
        for i, frame in enumerate(self._model.frames):
            name = frame.name
            is_world = frame.parentJoint == 0 and frame.placement.isIdentity()
            is_point = frame.type in _POINTS or (frame.type == _LINK and not is_world)
            is_end = name in self._end_frames and frame_id(self._model, name) == i
            if is_end or (is_point and name not in bodies and name not in sites):
                self._site(name, frame.parentJoint, frame.placement)
                sites.add(name)

    def _site(self, name: str, joint: int, at: pin.SE3) -> None:
        SubElement(self._bodies[joint], "site", {"name": _site_name(name)} | _pose(at))

    def _close(self, k: int, closure: Constraint) -> None:
        """Add closure `k`, or a problem if MuJoCo has none of its kind."""
        if isinstance(closure, Coupling):
            self._couple(closure)
        elif isinstance(closure, Rolling):
            self._problems.append(f"closure {closure}: MuJoCo has no rolling without slip")
        elif isinstance(closure, Brake):
            self._hold(closure)
        elif isinstance(closure, Distance):
            self._rod(f"rod_{k}", closure)
        else:
            self._close_frames(k, closure)

    def _close_frames(self, k: int, closure: Closure) -> None:
        held = closure.held
        kind = "weld" if held == _FIXED else "connect"
        self._connect(kind, closure.frame_a, closure.frame_b)
        is_hinge = held[:3] == _BALL[:3] and held.count(False) == 1
        if is_hinge:
            # Two connected points make a hinge.
            axis = held.index(False) - 3
            site_a = self._site_on_axis(k, closure.frame_a, axis)
            site_b = self._site_on_axis(k, closure.frame_b, axis)
            self._connect("connect", site_a, site_b)
        elif held not in (_FIXED, _BALL):
            words = closure.kind if isinstance(closure.kind, str) else "of these directions"
            self._problems.append(f"closure {closure}: MuJoCo has no closure {words}")

    def _connect(self, kind: str, frame_a: str, frame_b: str) -> None:
        attributes = {
            "name": f"{frame_a}-{frame_b}",
            "site1": _site_name(frame_a),
            "site2": _site_name(frame_b),
        }
        SubElement(self._section("equality"), kind, attributes)

    def _site_on_axis(self, k: int, frame_name: str, axis: int) -> str:
        """Add another site on an axis of a frame of closure `k`; returns its name."""
        offset = pin.SE3(np.eye(3), self._mechanism.length * np.eye(3)[axis])
        frame = frame_named(self._model, frame_name)
        site = f"{frame_name}_axis_{k}"
        self._site(site, frame.parentJoint, frame.placement * offset)
        return site

    def _rod(self, name: str, rod: Distance) -> None:
        """Add a tendon of constant length; MuJoCo's length is relative to the one at q = 0."""
        self._spatial({"name": name}, rod.frame_a, rod.frame_b)
        at_zero = self._distance(rod.frame_a, rod.frame_b, pin.neutral(self._mechanism.model))
        polynomial = numbers([rod.distance - at_zero, 0, 0, 0, 0])
        SubElement(self._section("equality"), "tendon", tendon1=name, polycoef=polynomial)

    def _hold(self, brake: Brake) -> None:
        """Add an equality that holds a joint or a line where it is at `home`."""
        home = self._home
        if home is None:
            text = "MuJoCo holds at one position only; name a configuration home"
            self._problems.append(f"{brake}: {text}")
            return
        rate = self._mechanism.rate_of(brake)
        if rate is not None:
            name = self._by_rate().get(rate)
            if name is None:
                text = "MuJoCo holds no single rate of a ball or a free joint; use hinges in series"
                self._problems.append(f"{brake}: {text}")
                return
            (joint,) = (joint for joint in self.joints if joint.name == name)
            kind = "joint"
            position = float(joint.qpos(home)[0])
        else:
            assert brake.frames is not None
            name = brake.name
            kind = "tendon"
            at_zero = self._distance(*brake.frames, pin.neutral(self._mechanism.model))
            position = self._distance(*brake.frames, home) - at_zero
        polynomial = numbers([position, 0, 0, 0, 0])
        SubElement(self._section("equality"), kind, {f"{kind}1": name}, polycoef=polynomial)
        self.notes.append(f"{brake}: written as an equality, which holds it at home only")

    def _distance(self, frame_a: str, frame_b: str, q: Array) -> float:
        """Distance of the origins of two frames at a configuration."""
        model = self._mechanism.model
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        a = data.oMf[frame_id(model, frame_a)].translation
        b = data.oMf[frame_id(model, frame_b)].translation
        return float(np.linalg.norm(b - a))

    def _spatial(self, attributes: dict[str, str], frame_a: str, frame_b: str) -> None:
        """Add a tendon along the line between two frames."""
        tendon = SubElement(self._section("tendon"), "spatial", attributes)
        for frame in (frame_a, frame_b):
            SubElement(tendon, "site", site=_site_name(frame))

    def _fixed(self, name: str, shares: Mapping[str, float]) -> str:
        """Add a tendon whose length is a sum of joint positions; returns its name."""
        tendon = SubElement(self._section("tendon"), "fixed", name=name)
        for joint, share in shares.items():
            SubElement(tendon, "joint", joint=joint, coef=numbers([share]))
        return name

    def _couple(self, coupling: Coupling) -> None:
        """Add a joint as a polynomial of another one; sums of joints are tendons.

        follower - (linear terms of other joints) = polynomial of one joint
        """
        rows = {name: np.trim_zeros(p, "b") for name, p in coupling.polynomials.items()}
        # The joint of the polynomial: the one that is not linear, or the first if all are.
        arguments = [name for name, powers in rows.items() if len(powers) > 2]
        if not arguments:
            arguments = list(rows)[:1]  # none if the follower is constant
        degree = max((len(powers) for powers in rows.values()), default=0) - 1
        known = {joint.name for joint in self.joints}
        if len(arguments) > 1 or degree > _MAX_DEGREE or not known >= {*rows}:
            text = "MuJoCo has polynomials of one joint, up to the fourth power"
            self._problems.append(f"coupling {coupling}: {text}")
            return
        polynomial = np.zeros(_MAX_DEGREE + 1)
        polynomial[0] = coupling.offset + sum(powers[0] for powers in rows.values() if len(powers))
        for name in arguments:
            polynomial[1 : len(rows[name])] = rows[name][1:]
        others = {
            name: -powers[1]
            for name, powers in rows.items()
            if name not in arguments and len(powers) > 1
        }
        kind = "joint"
        sides = [coupling.joint, *arguments]
        if others:
            kind = "tendon"
            count = len(self.root.findall("tendon/fixed"))
            sides = [self._fixed(f"sum_{count}", {coupling.joint: 1.0} | others)]
            sides += [self._fixed(f"sum_{count + 1}", {name: 1.0}) for name in arguments]
        names = {f"{kind}{i}": side for i, side in enumerate(sides, 1)}
        SubElement(self._section("equality"), kind, names, polycoef=numbers(polynomial))

    def _add_mimics(self) -> None:
        """Add an equality for each joint that mimics another one."""
        leaders = self._by_rate()
        for joint in self.joints:
            if joint.mimics:
                names = {"joint1": joint.name, "joint2": leaders[int(joint.rates[0])]}
                polynomial = numbers([joint.offset, joint.factor, 0, 0, 0])
                SubElement(self._section("equality"), "joint", names, polycoef=polynomial)

    def _by_rate(self) -> dict[int, str]:
        """Names of hinges and slides, by the index of their rate."""
        names = dict[int, str]()
        for joint in self.joints:
            if joint.kind in _SINGLE and not joint.mimics:
                names[int(joint.rates[0])] = joint.name
        return names

    def _add_line(self, line: LineForce) -> None:
        """Add a force along a line as a tendon."""
        attributes = {"name": line.name}
        rest_length = 0.0
        if line.stiffness:
            # The preload of a spring shifts its rest length.
            rest_length = line.rest_length - line.preload / line.stiffness
            attributes["stiffness"] = numbers([line.stiffness])
            attributes["springlength"] = numbers([rest_length])
        if rest_length < 0 or (line.preload and not line.stiffness):
            text = f"its preload {line.preload:g} N: a tendon of MuJoCo has no constant force"
            self._problems.append(f"line {line}: {text}")
        if line.pulls_only:
            attributes["springlength"] = numbers([0, rest_length])
            if line.damping or not line.stiffness:
                text = "of the cables of MuJoCo only the springs are slack; its damper is not"
                self._problems.append(f"line {line}: {text}")
        if line.damping:
            attributes["damping"] = numbers([line.damping])
        if line.mass:
            attributes["armature"] = numbers([line.mass])
        if line.lower or line.upper < _FAR:
            attributes["range"] = numbers([line.lower, min(line.upper, _FAR)])
        if line.velocity < _FAR:
            self.notes.append(f"line {line}: its largest velocity is left out")
        if line.mass and self._joins_branches(line):
            text = "its mass: MuJoCo leaves out the inertia of a tendon between two branches"
            self._problems.append(f"line {line}: {text}")
        self._spatial(attributes, line.frame_a, line.frame_b)

    def _add_forces_and_motors(self) -> None:
        mechanism = self._mechanism
        for line in mechanism.lines.forces:
            self._add_line(line)
        for k, name in enumerate(mechanism.motor_names):
            self._add_motor(name, mechanism.actuation[:, k], mechanism.lines.actuation[:, k])

    def _joins_branches(self, line: LineForce) -> bool:
        """Whether both ends move relative to the last body that carries both."""
        frame_a = frame_named(self._model, line.frame_a)
        frame_b = frame_named(self._model, line.frame_b)
        supports_a = set(self._model.supports[frame_a.parentJoint])
        supports_b = set(self._model.supports[frame_b.parentJoint])
        return not supports_a <= supports_b and not supports_b <= supports_a

    def _add_contacts(self) -> None:
        """Spheres and planes that touch in pairs, and ropes as tendons of limited length."""
        contacts = self._mechanism.contacts
        planes = dict[str, str]()
        for contact in contacts.points:
            frame = frame_named(self._model, contact.frame)
            ground = frame_named(self._model, contact.ground)
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
            body = self._bodies[frame.parentJoint]
            SubElement(body, "geom", sphere | _UNTOUCHED | _pose(place))
            pair = {"name": contact.name, "geom1": sphere["name"], "geom2": planes[contact.ground]}
            sliding = [contact.friction, contact.friction, 0, 0, 0]
            pair |= {"condim": "3", "friction": numbers(sliding)}
            SubElement(self._section("contact"), "pair", pair)
        for rope in contacts.ropes:
            attributes = {"name": rope.name, "range": numbers([0, rope.length])}
            self._spatial(attributes, rope.frame_a, rope.frame_b)

    def _add_motor(self, name: str, on_rates: Array, on_lines: Array) -> None:
        """Add a motor by its shares in the forces on rates and lines."""
        single = self._by_rate()
        rates = np.flatnonzero(on_rates)
        lines = np.flatnonzero(on_lines)
        motor = {"name": name}
        if not len(rates) and len(lines) == 1:
            line = self._mechanism.lines.forces[lines[0]]
            factor = float(on_lines[lines[0]])
            motor["tendon"] = line.name
            if factor != 1:
                motor["gear"] = numbers([factor])
                text = "its factor is a gear; from_mjcf reads a motor with the factor 1"
                self.notes.append(f"motor {name}: {text}")
            if line.effort < _FAR:
                largest = line.effort / abs(factor)
                motor["ctrlrange"] = numbers([-largest, largest])
        elif len(lines) or not single.keys() >= set(rates.tolist()):
            text = "it acts on more than hinges and slides, or one line"
            self._problems.append(f"motor {name}: {text}")
        elif on_rates[rates].tolist() == [1]:
            motor["joint"] = single[int(rates[0])]
            effort = float(self._mechanism.model.upperEffortLimit[rates[0]])
            if 0 < effort < _FAR:
                motor["ctrlrange"] = numbers([-effort, effort])
        else:
            shares = {single[int(rate)]: on_rates[rate] for rate in rates}
            motor["tendon"] = self._fixed(name, shares)
        SubElement(self._section("actuator"), "motor", motor)


def _is_free(joint: Any) -> bool:
    return bool(joint.shortname() == "JointModelFreeFlyer")


def _is_at_joint(frame: pin.Frame) -> bool:
    return frame.type != pin.FrameType.JOINT and bool(frame.placement.isIdentity())


def _site_name(frame: str) -> str:
    """The name of the site at a frame; `from_mjcf` refuses a site with the name of the base."""
    return "universe_site" if frame == "universe" else frame


def _pose(at: pin.SE3, write: Callable[[Any], str] = numbers) -> dict[str, str]:
    """Attributes for position and orientation; zeros are left out."""
    from scipy.spatial.transform import Rotation

    pose = {}
    if at.translation.any():
        pose["pos"] = write(at.translation)
    if not np.array_equal(at.rotation, np.eye(3)):
        x, y, z, w = Rotation.from_matrix(at.rotation).as_quat(canonical=True)
        pose["quat"] = write(np.array([w, x, y, z]))
    return pose
