# SPDX-License-Identifier: BSD-2-Clause
"""An MJCF under construction: its constructor writes the tree, other modules add to it.

The bodies are those of the normal tree of the robot (`model.normal_tree`), which has the robot's
motions and only joints that MuJoCo has, or almost: universal joints are hinges in series there.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import SubElement

import coal
import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import DescriptionError
from ..model.closures import frames_of
from ..model.mechanism import Mechanism
from ..model.normal_tree import NormalTree
from ..model.tree import frame_id
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
#: Larger limits are left out.
FAR = 1e9
_IDENTITY = pin.SE3.Identity()
#: Joints of one rate.
SINGLE = ("hinge", "slide")
#: Types of frames that are points on a body, and of those that are links.
_POINTS = (pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)
_LINK = pin.FrameType.BODY
#: The smallest mass and moment that MuJoCo compiles, [kg], [kg m^2].
_LEAST_MASS = 1e-12
_LEAST_INERTIA = 1e-14
#: A smaller relative violation of the triangle inequality of moments is rounding.
_ROUNDING = 1e-9
#: URDF demands a largest velocity; this or a larger one stands for none, [rad/s] or [m/s].
_FAST = 1e3
#: Largest entry of the rotation at which the spring of a ball is relaxed that counts as zero.
_REST_ROUNDING = 1e-12
#: Attributes of shapes without mass and contacts, in the group of visual geoms.
_VISUAL = {"mass": "0", "group": "2", "contype": "0", "conaffinity": "0"}
#: For each shape its type of geom and the function that returns its sizes.
_SHAPES: dict[type, tuple[str, Callable[[Any], Iterable[float]]]] = {
    coal.Sphere: ("sphere", lambda s: [s.radius]),
    coal.Capsule: ("capsule", lambda s: [s.radius, s.halfLength]),
    coal.Cylinder: ("cylinder", lambda s: [s.radius, s.halfLength]),
    coal.Ellipsoid: ("ellipsoid", lambda s: s.radii),
    coal.Box: ("box", lambda s: s.halfSide),
}


class MjcfDocument:
    """An MJCF with the bodies and joints of a robot.

    Attributes:
        root: The root of the file.
        model: The normal tree.
        joints: MuJoCo's joints, in its order.
        bodies: The element of the body of each joint of the robot's own model, the base first.
        base: The element of the base; planes stand there.
        notes: What is left out or written with other numbers.
        problems: What MJCF cannot express.
    """

    def __init__(self, mechanism: Mechanism, *, with_numbers: bool = True) -> None:
        """Without numbers, joints have no friction, rotors, springs and limits."""
        self._mechanism = mechanism
        self._with_numbers = with_numbers
        self.problems = list[str]()
        self.notes = list[str]()
        self.joints = list[MjcfJoint]()
        tree = NormalTree(mechanism.model)
        self._tree = tree
        self.model = tree.model
        self.root = ET.Element("mujoco", model=self.model.name)
        SubElement(self.root, "compiler", angle="radian", autolimits="true")
        SubElement(self.root, "option", _OPTION, gravity=numbers(self.model.gravity.linear))
        SubElement(SubElement(self.root, "default"), "equality", _EQUALITY)

        # The base is the world, or a body of another name in it. Free bodies must be in the world.
        # If there is one, the others are written there too, so that the order of the joints stays.
        world = SubElement(self.root, "worldbody")
        base = world
        self._names = self._body_names()
        if self._names[0] != "universe":
            base = SubElement(world, "body", name=self._names[0])
        floats = any(_is_free(self.model.joints[j]) for j in self.model.children[0])
        self.base = world if floats else base

        #: Frames at the ends of closures, lines and ropes.
        self._end_frames = set[str]()
        for closure in mechanism.closures:
            self._end_frames.update(frames_of(closure))
        for line in mechanism.lines.forces:
            self._end_frames.update((line.frame_a, line.frame_b))
        for rope in mechanism.contacts.ropes:
            self._end_frames.update((rope.frame_a, rope.frame_b))

        #: The body of each joint of the normal tree, filled from the base on.
        self._body_of = [base] * self.model.njoints
        self._with_velocity_limit = list[str]()
        self._add_children(0)
        self.bodies = [self._body_of[index] for index in tree.bodies]
        if self._with_velocity_limit:
            names = listed(self._with_velocity_limit)
            text = f"largest velocities of the joints {names} are left out"
            self.notes.append(f"{text}: MuJoCo has none")

    def text(self) -> str:
        """The file; an error if MJCF cannot express a part of the robot."""
        if self.problems:
            raise DescriptionError(f"model {self._mechanism.model.name}", self.problems)
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def qpos(self, q: Array) -> Array:
        """MuJoCo's coordinates for a configuration."""
        return np.concatenate([joint.qpos(q) for joint in self.joints])

    def by_rate(self) -> dict[int, str]:
        """Names of hinges and slides, by the index of their rate in v."""
        names = dict[int, str]()
        for joint in self.joints:
            if joint.kind in SINGLE and not joint.mimics:
                names[int(joint.rates[0])] = joint.name
        return names

    # --- parts that are added -----------------------------------------------------------------

    def section(self, name: str) -> ET.Element:
        """A section of the file; the first call adds it."""
        section = self.root.find(name)
        return SubElement(self.root, name) if section is None else section

    def add_keyframes(self, configurations: Mapping[str, Array]) -> None:
        """Add configurations by name."""
        for name, q in configurations.items():
            SubElement(self.section("keyframe"), "key", name=name, qpos=numbers(self.qpos(q)))

    def add_shapes(self, shapes: pin.GeometryModel, **how: str) -> None:
        """Add shapes with these attributes, by default visual ones without mass and contacts."""
        for k, shape in enumerate(shapes.geometryObjects):
            geometry = shape.geometry
            look = how or {**_VISUAL, "rgba": rounded(shape.meshColor)}
            attributes = look | pose_attributes(shape.placement, rounded)
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
        """Add a mesh to the assets."""
        corners = list[str]()
        for i in range(geometry.num_tris):
            triangle = geometry.tri_indices(i)
            corners += [str(triangle[k]) for k in range(3)]
        SubElement(
            self.section("asset"),
            "mesh",
            {"name": name, "inertia": "shell"},  # for meshes that enclose no volume too
            vertex=rounded(geometry.vertices().ravel()),
            face=" ".join(corners),
        )

    def add_sites(self) -> None:
        """Add sites at frames other than joints and bodies, and at ends of closures and lines."""
        bodies = set(self._names.values())
        sites = set[str]()
        for i, frame in enumerate(self.model.frames):
            name = frame.name
            is_world = frame.parentJoint == 0 and frame.placement.isIdentity()
            is_point = frame.type in _POINTS or (frame.type == _LINK and not is_world)
            is_end = name in self._end_frames and frame_id(self.model, name) == i
            if is_end or (is_point and name not in bodies and name not in sites):
                self.add_site(name, frame.parentJoint, frame.placement)
                sites.add(name)

    def add_site(self, name: str, joint: int, at: pin.SE3) -> None:
        """Add a site on the body of a joint of the normal tree."""
        SubElement(self._body_of[joint], "site", {"name": site_name(name)} | pose_attributes(at))

    def add_geom(self, joint: int, attributes: dict[str, str]) -> None:
        """Add a geom to the body of a joint of the normal tree."""
        SubElement(self._body_of[joint], "geom", attributes)

    def add_line_tendon(self, attributes: dict[str, str], frame_a: str, frame_b: str) -> None:
        """Add a tendon along the line between two frames."""
        tendon = SubElement(self.section("tendon"), "spatial", attributes)
        for frame in (frame_a, frame_b):
            SubElement(tendon, "site", site=site_name(frame))

    def add_sum_tendon(self, name: str, shares: Mapping[str, float]) -> str:
        """Add a tendon whose length is a sum of joint positions; returns its name."""
        tendon = SubElement(self.section("tendon"), "fixed", name=name)
        for joint, share in shares.items():
            SubElement(tendon, "joint", joint=joint, coef=numbers([share]))
        return name

    # --- the tree ------------------------------------------------------------------------------

    def _body_names(self) -> dict[int, str]:
        """Name of the body of each joint: the name of a link at the joint, else of the joint.

        If a frame elsewhere has this name, its site gets it, and the body `NAME_joint`.
        """
        names = dict(enumerate(self.model.names))
        for frame in list(self.model.frames)[::-1]:  # so that the first link counts
            if frame.type != _LINK or frame.name in ("universe", "world"):
                continue
            if frame.placement.isIdentity():
                names[frame.parentJoint] = frame.name
        at_joints = {(f.name, f.parentJoint) for f in self.model.frames if _is_at_joint(f)}
        points = {f.name for f in self.model.frames if f.type in (*_POINTS, _LINK)}
        for joint, name in names.items():
            if name in points and (name, joint) not in at_joints:
                names[joint] = f"{name}_joint"
        return names

    def _add_children(
        self, parent: int, joints_before: Sequence[MjcfJoint] = (), start: pin.SE3 = _IDENTITY
    ) -> None:
        """Add the bodies that move with a joint, and all bodies after them.

        In MuJoCo a body can have several joints, so an empty body between two joints is left out.
        Its joints are in `joints_before`, and `start` is its placement in the last body that is
        written.
        """
        model = self.model
        for index in model.children[parent]:
            at = model.jointPlacements[index]
            joints = [joint.seen_from(at) for joint in joints_before]
            try:
                joints += joints_of(self._mechanism.model, self._tree, index)
            except DescriptionError as error:
                self.problems += error.problems
            parent_body = self._body_of[parent] if parent else self.base
            # Only hinges and slides can share a body.
            if self._is_empty(index) and all(joint.kind in SINGLE for joint in joints):
                self._body_of[index] = parent_body
                self._add_children(index, joints, start * at)
                self._body_of[index] = self._body_of[model.children[index][0]]
                continue
            name = {"name": self._names[index]}
            body = SubElement(parent_body, "body", name | pose_attributes(start * at))
            self._body_of[index] = body
            self.joints += joints
            for joint in joints:
                SubElement(body, "joint", self._joint_attributes(joint))
            self._add_inertia(index)
            self._add_children(index)

    def _is_empty(self, index: int) -> bool:
        """Whether the body of a joint only carries one other joint.

        Example: the body between the axes of a universal joint.
        """
        model = self.model
        frames = [frame for frame in model.frames if frame.parentJoint == index]
        has_only_joint_frames = all(
            frame.type == pin.FrameType.JOINT and frame.name not in self._end_frames
            for frame in frames
        )
        is_massless = bool(model.inertias[index] == pin.Inertia.Zero())
        has_one_child = len(model.children[index]) == 1
        return has_only_joint_frames and is_massless and has_one_child

    def _joint_attributes(self, joint: MjcfJoint) -> dict[str, str]:
        """Attributes of a joint."""
        attributes = {"name": joint.name, "type": joint.kind}
        is_single = joint.kind in SINGLE
        if is_single:
            attributes["axis"] = numbers(joint.axis)
            if joint.point.any():
                attributes["pos"] = numbers(joint.point)
        if not self._with_numbers or joint.mimics:
            return attributes
        attributes |= self._joint_numbers(joint)
        if "stiffness" in attributes:
            reference = joint.qpos(self._mechanism.springs.reference)
            if is_single:
                attributes["springref"] = numbers(reference)
            elif np.abs(reference - np.eye(4)[0]).max() > _REST_ROUNDING:
                text = "a spring of a ball can be relaxed at zero only"
                self.problems.append(f"joint {joint.name}: {text}")
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
                self.problems.append(text)
            if values.any():
                attributes[name] = numbers(values[:1])
        return attributes

    def _joint_limits(self, joint: MjcfJoint) -> dict[str, str]:
        """Limits of the position and of the force of a hinge or a slide."""
        model = self._mechanism.model
        limits = {}
        ends = np.array([model.lowerPositionLimit, model.upperPositionLimit])[:, joint.entries]
        # A continuous joint has two entries, cosine and sine, and no range.
        if ends.size == 2 and (np.abs(ends) < FAR).any():
            limits["range"] = numbers(ends.clip(-FAR, FAR).ravel())
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
        if motors[rate, acts_on_several].any() and 0 < limit < FAR:
            return limit
        return 0.0

    def _add_inertia(self, index: int) -> None:
        """Add mass and inertia of a body, with MuJoCo's smallest values where they are smaller."""
        inertia = self.model.inertias[index]
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
            self.problems.append(f"body {name}: {text}, which no body has")
        # MuJoCo refuses even rounding beyond the triangle inequality.
        moments[largest] = min(moments[largest], sum_of_others)
        attributes = {"pos": numbers(inertia.lever), "diaginertia": numbers(moments)}
        attributes["mass"] = numbers([max(inertia.mass, _LEAST_MASS)])
        pose = pose_attributes(pin.SE3(R, inertia.lever))
        SubElement(self._body_of[index], "inertial", pose | attributes)


def _is_free(joint: Any) -> bool:
    """Whether a joint is a free-flyer."""
    return bool(joint.shortname() == "JointModelFreeFlyer")


def _is_at_joint(frame: pin.Frame) -> bool:
    """Whether a frame other than that of a joint is at its joint."""
    return frame.type != pin.FrameType.JOINT and bool(frame.placement.isIdentity())


def site_name(frame: str) -> str:
    """The name of the site at a frame; `from_mjcf` refuses a site with the name of the base."""
    return "universe_site" if frame == "universe" else frame


def pose_attributes(at: pin.SE3, write: Callable[[Any], str] = numbers) -> dict[str, str]:
    """Attributes for position and orientation; zeros are left out."""
    from scipy.spatial.transform import Rotation

    pose = {}
    if at.translation.any():
        pose["pos"] = write(at.translation)
    if not np.array_equal(at.rotation, np.eye(3)):
        x, y, z, w = Rotation.from_matrix(at.rotation).as_quat(canonical=True)
        pose["quat"] = write(np.array([w, x, y, z]))
    return pose
