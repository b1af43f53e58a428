# SPDX-License-Identifier: BSD-2-Clause
"""`MjcfDocument`: an MJCF under construction.

Its constructor writes the bodies and joints (`mjcf_bodies`). Its methods add shapes, sites, tendons
and keyframes; `mjcf_forces` and `mjcf_equalities` use them for forces and closures.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping
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
from .mjcf_attributes import SINGLE, pose_attributes
from .mjcf_bodies import LINK, POINTS, MjcfBodies
from .urdf_writer import numbers, rounded

#: Integrator: on the paper's circle Runge-Kutta has an error of 1e-5 rad, Euler of 1e-2 rad.
#: Jacobian: for large robots MuJoCo uses sparse Jacobians by default, and version 4.0.0 factorises
#: them wrongly.
_OPTION = {"timestep": "0.0005", "integrator": "RK4", "jacobian": "dense"}
#: Closures are critically damped with a time constant of two steps. MuJoCo lengthens it for longer
#: steps.
_EQUALITY = {"solref": "0.001 1", "solimp": "0.9999 0.9999 0.001"}
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
        model: The normal tree of the robot.
        joints: MuJoCo's joints, in its order.
        bodies: The element of each body of the robot's own model, the base first.
        base: The element for what is fixed to the base: the body of the base, or the world.
        notes: What is left out or written with other numbers.
        problems: What MJCF cannot express.
    """

    def __init__(self, mechanism: Mechanism, *, with_numbers: bool = True) -> None:
        """Write the bodies and joints of a robot.

        Args:
            mechanism: The robot.
            with_numbers: Whether joints have friction, rotors, springs and limits.
        """
        tree = NormalTree(mechanism.model)
        self._name = mechanism.model.name
        self._end_frames = _end_frames(mechanism)
        self.model = tree.model
        self.root = ET.Element("mujoco", model=self.model.name)
        SubElement(self.root, "compiler", angle="radian", autolimits="true")
        SubElement(self.root, "option", _OPTION, gravity=numbers(self.model.gravity.linear))
        SubElement(SubElement(self.root, "default"), "equality", _EQUALITY)
        world = SubElement(self.root, "worldbody")
        bodies = MjcfBodies(mechanism, tree, world, self._end_frames, with_numbers)
        self.joints = bodies.joints
        self.base = bodies.base
        self.bodies = [bodies.elements[joint] for joint in tree.bodies]
        self._bodies_of_tree = bodies.elements  # by the index of the joint in the normal tree
        self._body_names = set(bodies.names.values())
        self.notes = bodies.notes
        self.problems = bodies.problems

    def text(self) -> str:
        """The file as text.

        Raises:
            DescriptionError: If MJCF cannot express a part of the robot.
        """
        if self.problems:
            raise DescriptionError(f"model {self._name}", self.problems)
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def qpos(self, q: Array) -> Array:
        """MuJoCo's coordinates for a configuration, shape (nq,)."""
        return np.concatenate([joint.qpos(q) for joint in self.joints])

    def names_by_rate(self) -> dict[int, str]:
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

    def add_shapes(self, shapes: pin.GeometryModel, **attributes_of_all: str) -> None:
        """Add shapes, each with these attributes; by default they have no mass and no contacts."""
        for k, shape in enumerate(shapes.geometryObjects):
            geometry = shape.geometry
            common = attributes_of_all or {**_VISUAL, "rgba": rounded(shape.meshColor)}
            attributes = common | pose_attributes(shape.placement, rounded)
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
        """Add sites at the ends of closures, lines and ropes, and at other points and links.

        A link or a point needs no site if a body or another site has its name.
        """
        sites = set[str]()
        for i, frame in enumerate(self.model.frames):
            name = frame.name
            # Several frames may have one name; the name of an end means the frame of `frame_id`.
            is_end = name in self._end_frames and frame_id(self.model, name) == i
            is_world = frame.parentJoint == 0 and frame.placement.isIdentity()
            is_point_or_link = frame.type in POINTS or (frame.type == LINK and not is_world)
            has_name_already = name in self._body_names or name in sites
            if is_end or (is_point_or_link and not has_name_already):
                self.add_site(name, frame.parentJoint, frame.placement)
                sites.add(name)

    def add_site(self, name: str, joint: int, at: pin.SE3) -> None:
        """Add a site on the body of a joint of the normal tree."""
        SubElement(
            self._bodies_of_tree[joint], "site", {"name": site_name(name)} | pose_attributes(at)
        )

    def add_geom(self, joint: int, attributes: dict[str, str]) -> None:
        """Add a geom to the body of a joint of the normal tree."""
        SubElement(self._bodies_of_tree[joint], "geom", attributes)

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


def _end_frames(mechanism: Mechanism) -> set[str]:
    """Names of the frames at the ends of closures, lines and ropes."""
    names = set[str]()
    for closure in mechanism.closures:
        names.update(frames_of(closure))
    for line in mechanism.lines.forces:
        names.update((line.frame_a, line.frame_b))
    for rope in mechanism.contacts.ropes:
        names.update((rope.frame_a, rope.frame_b))
    return names


def site_name(frame: str) -> str:
    """The name of the site at a frame: the same name, but `from_mjcf` refuses "universe"."""
    return "universe_site" if frame == "universe" else frame
