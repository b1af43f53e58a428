# SPDX-License-Identifier: BSD-2-Clause
"""Closed-chain robots other than the SST, with their dynamics from first principles.

A robot is a table of links. The table makes the `pin.Model` under test; it also makes, with the
inverse kinematics in closed form written here, the placement of each body as an analytic function
of independent coordinates x. The motor torques then follow from d'Alembert's principle of virtual
work: no constraint Jacobian, no orthogonal complement, no recursive Newton-Euler algorithm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, Closure
from tests.support.by_hand import add, mark

X, Y, Z = np.eye(3)
GRAVITY = np.array([0.7, -1.1, -9.6])


class Link(NamedTuple):
    """A joint of one coordinate and the body that it carries."""

    name: str
    parent: str
    origin: np.ndarray
    axis: np.ndarray
    prismatic: bool = False
    turned: np.ndarray = np.eye(3)


class Frame(NamedTuple):
    """A frame on a link, or on the base "universe", where a loop closes."""

    name: str
    link: str
    origin: np.ndarray
    turned: np.ndarray = np.eye(3)


class Motion(NamedTuple):
    """A state of motion and the motor torques that it takes."""

    q: np.ndarray
    q_dot: np.ndarray
    va: np.ndarray
    aa: np.ndarray
    tau: np.ndarray


@dataclass
class Robot:
    """A mechanism with random masses, inertias, rotors and joint friction."""

    links: Sequence[Link]
    frames: Sequence[Frame]
    closures: Sequence[Closure]
    actuated: Sequence[str]
    joints: Callable[[np.ndarray], np.ndarray]
    x: np.ndarray
    redundant_rows: int

    def __post_init__(self):
        random, m = np.random.default_rng(0), len(self.links)
        names = [link.name for link in self.links]
        self.motors = [names.index(name) for name in self.actuated]
        self.parents = [names.index(link.parent) if link.parent else -1 for link in self.links]
        self.masses = random.uniform(0.3, 2, m)
        self.levers = 0.1 * random.normal(size=(m, 3))
        # The inertia of mass points is one that a body can have.
        points = 0.1 * random.normal(size=(m, 3, 3))
        second_moments = points @ points.swapaxes(1, 2)
        traces = second_moments.trace(axis1=1, axis2=2)
        self.inertias = traces[:, None, None] * np.eye(3) - second_moments
        self.armature = random.uniform(0, 0.1, m)
        self.viscous, self.coulomb = random.uniform(0, 2, (2, m))

    def model(self) -> pin.Model:
        """The tree, with the frames where it is cut."""
        model = pin.Model()
        model.gravity.linear = GRAVITY
        for i, link in enumerate(self.links):
            parent = model.getJointId(link.parent) if link.parent else 0
            body = pin.Inertia(self.masses[i], self.levers[i], self.inertias[i])
            place = pin.SE3(link.turned, link.origin)
            add(model, parent, _joint_model(link), link.name, place, body)
        for frame in self.frames:
            joint = model.getJointId(frame.link)
            mark(model, joint, frame.name, pin.SE3(frame.turned, frame.origin))
        model.armature, model.damping, model.friction = self.armature, self.viscous, self.coulomb
        return model

    def chain(self, actuated: Sequence[str] | None = None, **options) -> ClosedChain:
        """The robot as the package sees it."""
        motors = self.actuated if actuated is None else actuated
        return ClosedChain(self.model(), self.closures, motors, **options)

    def bodies(self, x: np.ndarray) -> np.ndarray:
        """Orientation and mass centre of each body as columns, shape (..., m, 3, 4)."""
        q = self.joints(x)
        base = np.broadcast_to(np.eye(3), (*x.shape[:-1], 3, 3)), np.zeros((*x.shape[:-1], 3))
        placements = []
        for i, link in enumerate(self.links):
            R, p = placements[self.parents[i]] if link.parent else base
            p = p + R @ link.origin
            R = R @ link.turned
            if link.prismatic:
                p = p + q[..., i, None] * (R @ link.axis)
            else:
                R = R @ rotation(link.axis, q[..., i])
            placements.append((R, p))
        return np.stack(
            [
                np.concatenate([R, (p + R @ lever)[..., None]], axis=-1)
                for (R, p), lever in zip(placements, self.levers, strict=True)
            ],
            axis=-3,
        )

    def motion(
        self, x: np.ndarray, x_dot: np.ndarray, x_ddot: np.ndarray, wrenches: np.ndarray
    ) -> Motion:
        """Motor torques by the principle of virtual work."""
        (q, q_dot, q_ddot) = derivatives(self.joints, x, x_dot, x_ddot)
        (B, B_dot, B_ddot) = derivatives(self.bodies, x, x_dot, x_ddot)
        R_t = B[..., :3].swapaxes(1, 2)
        omega, alpha = axial(B_dot[..., :3] @ R_t), axial(B_ddot[..., :3] @ R_t)
        inertias = B[..., :3] @ self.inertias @ R_t
        forces = self.masses[:, None] * (B_ddot[..., 3] - GRAVITY) - wrenches[:, :3]
        momenta = np.einsum("bij,bj->bi", inertias, omega)
        moments = np.einsum("bij,bj->bi", inertias, alpha) + np.cross(omega, momenta)
        moments -= wrenches[:, 3:]
        efforts = self.armature * q_ddot + self.viscous * q_dot + self.coulomb * np.sign(q_dot)

        powers, motor_rates = [], []
        for unit in np.eye(len(x)):
            q_rate = derivatives(self.joints, x, unit)[1]
            B_rate = derivatives(self.bodies, x, unit)[1]
            turning = axial(B_rate[..., :3] @ R_t)
            powers.append(
                (forces * B_rate[..., 3]).sum() + (moments * turning).sum() + efforts @ q_rate
            )
            motor_rates.append(q_rate[self.motors])
        tau = np.linalg.solve(np.array(motor_rates), np.array(powers))
        return Motion(q, q_dot, q_dot[self.motors], q_ddot[self.motors], tau)


def _joint_model(link: Link) -> pin.JointModel:
    revolute = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
    prismatic = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
    if np.count_nonzero(link.axis) == 1:
        return (prismatic if link.prismatic else revolute)[np.argmax(link.axis)]()
    if link.prismatic:
        return pin.JointModelPrismaticUnaligned(link.axis)
    return pin.JointModelRevoluteUnaligned(link.axis)


def derivatives(function, x, x_dot, x_ddot=0.0):
    """Value, first and second rate of an analytic function along x + x_dot t + x_ddot t^2 / 2.

    Cauchy's integrals around t = 0 by the trapezoidal rule, which converges geometrically: with the
    nearest singularity at |t| > 0.2, 64 points on |t| = 0.1 leave less than 2^-62 of truncation,
    and rounding is 1e-16 / 0.1^2.
    """
    radius, points = 0.1, 64
    t = radius * np.exp(2j * np.pi * np.arange(points) / points)[:, None]
    taylor = np.fft.fft(function(x + x_dot * t + x_ddot * t**2 / 2), axis=0)[:3].real / points
    return taylor[0], taylor[1] / radius, 2 * taylor[2] / radius**2


def dot(u, v):
    return (u * v).sum(axis=-1)


def angle(cosine, sine):
    """atan2(sine, cosine), of any common length."""
    return -1j * np.log((cosine + 1j * sine) / np.sqrt(cosine**2 + sine**2 + 0j))


def rotation(axis, angle):
    """Rodrigues' formula."""
    S, angle = pin.skew(axis), np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * S + (1 - np.cos(angle)) * S @ S


def axial(W):
    """Vector of the antisymmetric part."""
    A = (W - W.swapaxes(-1, -2)) / 2
    return np.stack([A[..., 2, 1], A[..., 0, 2], A[..., 1, 0]], axis=-1)


def turn(axis, u, v):
    """Angle about an axis from the half-plane of u to that of v."""
    return angle(dot(u, v) - dot(axis, u) * dot(axis, v), dot(axis, np.cross(u, v)))


def pointing_angles(axes, h):
    """Angles of two revolutes that turn the third of their axes to the unit vector h."""
    a, b, c = axes
    A, B, C = a @ c - (a @ b) * (b @ c), a @ np.cross(b, c), dot(a, h) - (a @ b) * (b @ c)
    S = -np.sqrt(A**2 + B**2 - C**2 + 0j)
    second = angle(A * C - B * S, B * C + A * S)
    return turn(a, rotation(b, second) @ c, h), second


def rotation_angles(axes, R):
    """Angles of three revolutes with given axes that together turn by R."""
    a, b, c = axes
    first, second = pointing_angles(axes, R @ c)
    before = rotation(a, first) @ rotation(b, second)
    return first, second, turn(c, a, (before.swapaxes(-1, -2) @ R) @ a)


def two_link_angles(target, lengths, elbow):
    """Angles of a planar arm of two links whose tip is at the target: circles intersect."""
    x, y = target
    first, second = lengths
    cosine = (x**2 + y**2 - first**2 - second**2) / (2 * first * second)
    sine = elbow * np.sqrt(1 - cosine**2 + 0j)
    shoulder = angle(x, y) - angle(first + second * cosine, second * sine)
    return shoulder, angle(cosine, sine)


def orientation(angles):
    """Orientation by three turns about the moving x, y, z axes."""
    x, y, z = np.moveaxis(angles, -1, 0)
    return rotation(X, x) @ rotation(Y, y) @ rotation(Z, z)


SKEW = orientation(np.array([0.4, -0.7, 0.9]))
#: Planes of motion: two axes and the normal.
PLANE_XZ, PLANE_YZ, SKEW_PLANE = np.array([Z, X, Y]), np.array([Y, Z, X]), SKEW.T

CRANK, COUPLER, ROCKER, GROUND = 0.4, 1.1, 0.9, 1.2


def four_bar(plane=PLANE_XZ) -> Robot:
    """A crank-rocker, closed at the pin of coupler and rocker."""
    u, _, normal = plane

    def joints(x):
        crank = x[..., 0]
        rest = (GROUND - CRANK * np.cos(crank), -CRANK * np.sin(crank))
        coupler, knee = two_link_angles(rest, (COUPLER, ROCKER), -1)
        return np.stack([crank, coupler - crank, coupler + knee + np.pi], axis=-1)

    return Robot(
        links=[
            Link("crank", "", 0 * u, normal),
            Link("coupler", "crank", CRANK * u, normal),
            Link("rocker", "", GROUND * u, normal),
        ],
        frames=[Frame("A", "coupler", COUPLER * u), Frame("B", "rocker", ROCKER * u)],
        closures=[Closure("A", "B", "3d")],
        actuated=["crank"],
        joints=joints,
        x=np.array([0.8]),
        redundant_rows=1,
    )


def four_bar_with_cut_coupler() -> Robot:
    """The crank-rocker in a skew plane, its coupler cut in the middle, aligned and pinned there."""
    u, v, normal = SKEW_PLANE
    pinned = four_bar(SKEW_PLANE)

    def joints(x):
        q = pinned.joints(x)
        half = q[..., 0] + q[..., 1] - q[..., 2]
        return np.concatenate([q, half[..., None]], axis=-1)

    return Robot(
        links=[*pinned.links, Link("half", "rocker", ROCKER * u, normal)],
        frames=[
            Frame("A", "coupler", 0.5 * u + 0.2 * v, SKEW),
            Frame("B", "half", (0.5 - COUPLER) * u + 0.2 * v, SKEW),
        ],
        closures=[Closure("A", "B", "orientation"), Closure("A", "B", "3d")],
        actuated=["crank"],
        joints=joints,
        x=pinned.x,
        redundant_rows=3,
    )


BASE_TRIANGLE = np.array([[0, 0], [1.5, 0.1], [0.6, 1.4]])
PLATFORM_TRIANGLE = np.array([[-0.2, -0.15], [0.25, -0.1], [0.05, 0.2]])
LEG_LENGTHS = np.array([[0.7, 0.6], [0.6, 0.75], [0.65, 0.7]])


def _legs_of_planar_platform(x):
    """Shoulder, elbow and wrist angle of each leg; x is the platform's position and angle."""
    position, phi = x[..., :2], x[..., 2]
    cos, sin = np.cos(phi), np.sin(phi)
    for base, (b, c), lengths in zip(BASE_TRIANGLE, PLATFORM_TRIANGLE, LEG_LENGTHS, strict=True):
        vertex = (
            position[..., 0] + cos * b - sin * c - base[0],
            position[..., 1] + sin * b + cos * c - base[1],
        )
        shoulder, elbow = two_link_angles(vertex, lengths, 1)
        yield shoulder, elbow, phi - shoulder - elbow


def _planar_legs(plane) -> list[Link]:
    links = []
    for k, (base, lengths) in enumerate(zip(BASE_TRIANGLE, LEG_LENGTHS, strict=True), 1):
        links += [
            Link(f"shoulder_{k}", "", base @ plane[:2], plane[2]),
            Link(f"elbow_{k}", f"shoulder_{k}", lengths[0] * plane[0], plane[2]),
        ]
        if k == 1:
            links += [Link(f"wrist_{k}", f"elbow_{k}", lengths[1] * plane[0], plane[2])]
    return links


def planar_3rrr() -> Robot:
    """Three planar legs; leg 1 carries the platform, legs 2 and 3 are pinned to it."""
    plane = PLANE_YZ
    arms = (PLATFORM_TRIANGLE - PLATFORM_TRIANGLE[0]) @ plane[:2]
    return Robot(
        links=_planar_legs(plane),
        frames=[
            frame
            for k in (2, 3)
            for frame in (
                Frame(f"A_{k}", "wrist_1", arms[k - 1]),
                Frame(f"B_{k}", f"elbow_{k}", LEG_LENGTHS[k - 1, 1] * plane[0]),
            )
        ],
        closures=[Closure(f"A_{k}", f"B_{k}", "3d") for k in (2, 3)],
        actuated=["shoulder_1", "shoulder_2", "shoulder_3"],
        joints=lambda x: np.stack(
            [q for k, leg in enumerate(_legs_of_planar_platform(x)) for q in leg[: 2 + (k == 0)]],
            axis=-1,
        ),
        x=np.array([0.7, 0.5, 0.2]),
        redundant_rows=2,
    )


HEXAPOD = np.random.default_rng(1)
_SIXTHS, _PAIRS = np.arange(6) * np.pi / 3, 0.35 * (-1.0) ** np.arange(6)
BASE_POINTS = rotation(Z, _SIXTHS + _PAIRS) @ X + HEXAPOD.uniform(-0.1, 0.1, (6, 3))
PLATFORM_POINTS = rotation(Z, _SIXTHS - _PAIRS) @ X / 2 + HEXAPOD.uniform(-0.05, 0.05, (6, 3))
BASE_FRAMES = orientation(HEXAPOD.uniform(-0.3, 0.3, (6, 3)))
#: Axes of the universal joint and of the leg: aligned in odd legs, skew in even ones.
LEG_AXES = [np.eye(3) if k % 2 else SKEW.T for k in range(6)]
SPHERICAL_AXES = SKEW[[1, 0, 2]] * [[1], [-1], [1]]
SHORTEST = 0.8


def _hexapod_leg(x, k):
    """Universal joint's angles and stroke of leg k; x is the platform's position and turns."""
    reach = x[..., :3] + orientation(x[..., 3:]) @ PLATFORM_POINTS[k] - BASE_POINTS[k]
    length = np.sqrt(dot(reach, reach))
    direction = (reach / length[..., None]) @ BASE_FRAMES[k]
    return *pointing_angles(LEG_AXES[k], direction), length - SHORTEST


def _universal_prismatic_leg(k) -> list[Link]:
    a, b, c = LEG_AXES[k]
    return [
        Link(f"yaw_{k}", "", BASE_POINTS[k], a, turned=BASE_FRAMES[k]),
        Link(f"pitch_{k}", f"yaw_{k}", np.zeros(3), b),
        Link(f"stroke_{k}", f"pitch_{k}", np.zeros(3), c, prismatic=True),
    ]


def hexapod() -> Robot:
    """A Gough-Stewart platform 6-UPS carried by leg 0 through three revolutes."""

    def joints(x):
        yaw, pitch, stroke = _hexapod_leg(x, 0)
        a, b, _ = LEG_AXES[0]
        leg = BASE_FRAMES[0] @ rotation(a, yaw) @ rotation(b, pitch)
        wrist = rotation_angles(SPHERICAL_AXES, leg.swapaxes(-1, -2) @ orientation(x[..., 3:]))
        others = [q for k in range(1, 6) for q in _hexapod_leg(x, k)]
        return np.stack([yaw, pitch, stroke, *wrist, *others], axis=-1)

    a, b, c = SPHERICAL_AXES
    return Robot(
        links=[
            *_universal_prismatic_leg(0),
            Link("wrist_a", "stroke_0", SHORTEST * LEG_AXES[0][2], a),
            Link("wrist_b", "wrist_a", np.zeros(3), b),
            Link("platform", "wrist_b", np.zeros(3), c),
            *(link for k in range(1, 6) for link in _universal_prismatic_leg(k)),
        ],
        frames=[
            frame
            for k in range(1, 6)
            for frame in (
                Frame(f"A_{k}", "platform", PLATFORM_POINTS[k] - PLATFORM_POINTS[0]),
                Frame(f"B_{k}", f"stroke_{k}", SHORTEST * LEG_AXES[k][2]),
            )
        ],
        closures=[Closure(f"A_{k}", f"B_{k}", "3d") for k in range(1, 6)],
        actuated=[f"stroke_{k}" for k in range(6)],
        joints=joints,
        x=np.array([0.1, -0.05, 1.1, 0.15, -0.1, 0.2]),
        redundant_rows=0,
    )


_NEARLY_NORMAL = np.eye(3) + np.random.default_rng(2).uniform(-0.35, 0.35, (3, 3, 3))
#: Three axes for each leg, all through the centre.
SPHERICAL_LEGS = _NEARLY_NORMAL / np.linalg.norm(_NEARLY_NORMAL, axis=-1, keepdims=True)
CENTER = np.array([0.2, -0.3, 0.5])


def spherical_3rrr() -> Robot:
    """A spherical platform cut into its three legs' parts and closed again."""
    return Robot(
        links=[
            link
            for k, (a, b, c) in enumerate(SPHERICAL_LEGS)
            for link in (
                Link(f"first_{k}", "", CENTER, a),
                Link(f"second_{k}", f"first_{k}", np.zeros(3), b),
                Link(f"third_{k}", f"second_{k}", np.zeros(3), c),
            )
        ],
        frames=[Frame(f"E_{k}", f"third_{k}", np.array([0.1, 0.3, -0.2]), SKEW) for k in range(3)],
        closures=[Closure("E_0", f"E_{k}") for k in (1, 2)],
        actuated=["first_0", "second_1", "third_2"],
        joints=lambda x: np.stack(
            [q for axes in SPHERICAL_LEGS for q in rotation_angles(axes, orientation(x))], axis=-1
        ),
        x=np.array([0.2, -0.3, 0.25]),
        redundant_rows=6,
    )


ROBOTS = {
    "four-bar": four_bar(),
    "four-bar, coupler aligned and pinned": four_bar_with_cut_coupler(),
    "planar 3-RRR": planar_3rrr(),
    "6-UPS": hexapod(),
    "spherical 3-RRR": spherical_3rrr(),
}
