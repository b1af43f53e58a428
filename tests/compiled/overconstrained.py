# SPDX-License-Identifier: BSD-2-Clause
"""Single loops of revolute joints, most of them overconstrained, from Denavit-Hartenberg tables."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import sst_pin


def loop(
    lengths: Sequence[float],
    twists: Sequence[float],
    offsets: Sequence[float] = (),
    kind: str = "6d",
    seed: int = 0,
) -> sst_pin.ClosedChain:
    """All joints in one branch whose end is welded to the base; or all but the last, "hinge"."""
    random, n = np.random.default_rng(seed), len(lengths)
    model = pin.Model()
    model.name = f"loop_{n}"
    model.gravity.linear = 0.1 * random.normal(size=3)  # weak, so that all loops turn on
    where = pin.SE3(pin.Quaternion(random.normal(size=4)).normalized(), random.normal(size=3))
    bars = [
        pin.SE3(pin.rpy.rpyToMatrix(twist, 0, 0), np.array([a, 0, 0]))
        for a, twist in zip(lengths, twists, strict=True)
    ]
    joint, ground = 0, where.copy()
    for k, bar in enumerate(bars if kind == "6d" else bars[:-1]):
        joint = model.addJoint(joint, pin.JointModelRZ(), where, f"joint_{k + 1}")
        up = pin.SE3(np.eye(3), np.array([0, 0, offsets[k] if len(offsets) else 0.0]))
        points = 0.1 * random.normal(size=(3, 3)) @ random.normal(size=(3, 3))
        inertia = points @ points.T + 0.01 * np.eye(3)
        inertia = inertia.trace() * np.eye(3) - inertia
        body = pin.Inertia(random.uniform(0.5, 2), 0.2 * random.normal(size=3), inertia)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        where = up * bar
    if kind != "6d":
        ground = ground * bars[-1].inverse()
    model.addFrame(pin.Frame("end", joint, where, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("ground", 0, ground, pin.FrameType.OP_FRAME))
    return sst_pin.ClosedChain(model, [sst_pin.Closure("ground", "end", kind)], ["joint_1"])


def bennett(ratio: float, twist: float, other: float, kind: str, seed: int) -> sst_pin.ClosedChain:
    """Opposite bars are equal, their lengths in proportion to the sines of their twists."""
    a, b = ratio * np.sin(twist), ratio * np.sin(other)
    return loop([a, b, a, b], [twist, other, twist, other], kind=kind, seed=seed)


def goldberg(a: float, b: float, c: float, seed: int) -> sst_pin.ClosedChain:
    """Five revolutes: two linkages of Bennett with a common bar removed."""
    lengths = [0.5 * np.sin(x) for x in (a, b, a, c)]
    between = lengths[1] + lengths[3]
    return loop([*lengths, between], [a, b, a, c, b + c], seed=seed)


def threefold_bricard(twist: float, seed: int) -> sst_pin.ClosedChain:
    """Six equal bars with twists that alternate."""
    return loop([0.3] * 6, [twist, -twist] * 3, seed=seed)


def line_symmetric_bricard(seed: int) -> sst_pin.ClosedChain:
    """Six revolutes; each bar equals the one opposite to it."""
    random = np.random.default_rng(seed)
    lengths, twists = random.uniform(0.1, 0.5, 3), random.uniform(0.4, 1.4, 3)
    offsets = random.uniform(-0.1, 0.1, 3)
    return loop([*lengths] * 2, [*twists] * 2, [*offsets] * 2, seed=seed)


def sarrus(angle: float, seed: int) -> sst_pin.ClosedChain:
    """Two chains of three parallel revolutes hold a straight line."""
    # The axes of the first three joints are parallel, then those of the last three.
    return loop([0.3, 0.3, 0.1, 0.25, 0.25, 0.1], [0, 0, angle, 0, 0, -angle], seed=seed)


def spherical(arcs: Sequence[float], kind: str, seed: int) -> sst_pin.ClosedChain:
    """Four axes that meet in a point."""
    return loop([0.0] * 4, arcs, kind=kind, seed=seed)


def planar(lengths: Sequence[float], kind: str, seed: int) -> sst_pin.ClosedChain:
    """Four parallel axes, tilted in space."""
    return loop(lengths, [0.0] * 4, kind=kind, seed=seed)


#: Each has one degree of freedom.
LOOPS = {
    "Bennett": lambda: bennett(0.5, 0.6, 1.4, "hinge", 0),
    "Bennett, welded": lambda: bennett(0.5, 0.6, 1.4, "6d", 1),
    "long Bennett": lambda: bennett(0.8, 0.2, 1.2, "hinge", 2),
    "nearly square Bennett": lambda: bennett(0.4, 1.1, 1.3, "6d", 3),
    "Bennett with an obtuse twist": lambda: bennett(0.4, 0.5, 2.2, "hinge", 4),
    "small Bennett": lambda: bennett(0.005, 0.7, 1.5, "hinge", 5),
    "Goldberg": lambda: goldberg(1.3, 0.4, 0.5, 6),
    "another Goldberg": lambda: goldberg(1.2, 0.5, 0.3, 7),
    "threefold Bricard": lambda: threefold_bricard(1.2, 8),
    "another threefold Bricard": lambda: threefold_bricard(1.4, 9),
    "line-symmetric Bricard": lambda: line_symmetric_bricard(10),
    "another line-symmetric Bricard": lambda: line_symmetric_bricard(20),
    "spherical": lambda: spherical([0.4, 1.2, 1.0, 1.3], "hinge", 12),
    "spherical, welded": lambda: spherical([0.4, 1.2, 1.0, 1.3], "6d", 13),
    "right-angled spherical": lambda: spherical([0.5, np.pi / 2, np.pi / 2, np.pi / 2], "6d", 14),
    "planar": lambda: planar([0.1, 0.4, 0.3, 0.35], "hinge", 15),
    "planar, welded": lambda: planar([0.1, 0.4, 0.3, 0.35], "6d", 16),
    "planar drag link": lambda: planar([0.4, 0.35, 0.38, 0.1], "6d", 17),
    "Sarrus": lambda: sarrus(1.2, 18),
    "right-angled Sarrus": lambda: sarrus(np.pi / 2, 19),
}
