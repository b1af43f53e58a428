# SPDX-License-Identifier: BSD-2-Clause
"""The problems of docs/standard_problems.md."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from sst_pin import ClosedChain, Closure, robots
from sst_pin.robots.building_blocks import Tree, rod, shift
from tests.data import PUBLISHED
from tests.gallery import andrews, governor, n_four_bar
from tests.gallery import standard_referees as referees

ANDREWS = PUBLISHED["andrews"]
ANGLES = tuple(ANDREWS["q"])  # in the order of the problem's statement


class Problem(NamedTuple):
    """A standard problem, which starts at `home`."""

    chain: Any
    va: tuple[float, ...]  # at the start
    end: float  # [s]
    columns: tuple[str, ...]  # what is compared, as the library calls it
    of: Callable[[Any, Any], np.ndarray]  # these columns of a motion of the chain, (N, columns)
    independent: Callable[[np.ndarray], np.ndarray] | None = None  # at given times, other equations
    published: tuple[tuple[float, str, str], ...] = ()  # times and values of columns
    tau: float = 0.0  # of the first motor
    options: Mapping[str, Any] = {}  # of `simulate`

    @property
    def t(self) -> np.ndarray:
        """Times of the result, [s]."""
        return np.linspace(0, self.end, 201)

    def simulate(self, t: np.ndarray) -> Any:
        """The motion at some times."""
        tau = [self.tau] * len(self.chain.motor_names)
        return self.chain.simulate(tau, self.chain.home, self.va, t, **self.options)


def modelica_four_bar() -> ClosedChain:
    """Fourbar1 of the Modelica Standard Library."""
    tree = Tree("modelica_four_bar")
    tree.model.gravity.linear = np.array([0, -9.80665, 0])
    first, second, third = referees.BARS
    x, y, z = (getattr(pin, f"JointModelR{axis}")() for axis in "XYZ")
    bars = []
    for bar in referees.BARS:
        mass, _ = referees.cylinder(bar)
        bars.append(rod(mass, bar, referees.RADIUS))
    tree.add_joint("crank", x, bars[0])
    tree.add_joint("slider", pin.JointModelPX(), bars[1], at=shift((1.2, 0)))
    tree.add_joint("hinge_y", y, [], "slider", shift(second))
    tree.add_joint("hinge_z", z, bars[2], "hinge_y")
    tree.add_frame("tip", "crank", first)
    tree.add_frame("end", "hinge_z", third)
    tree.model.referenceConfigurations["home"] = np.array([0, -0.2, 0, 0.0])
    chain = ClosedChain(tree.model, [Closure("tip", "end", "3d")], ["crank"])
    chain._shapes = tree.visual_model
    return chain


def _ends(_: Any, motion: Any) -> np.ndarray:
    return np.stack([np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])], axis=1)


def _andrews_angles(chain: Any, motion: Any) -> np.ndarray:
    return motion.q[:, [chain.position_names.index(name) for name in ANGLES]]


def problems() -> dict[str, Problem]:
    """All of them, by the name of their section."""
    B0, through = ("B0_x_m", "B0_y_m"), {"through_singularities": True}
    return {
        "n_four_bar_2": Problem(
            n_four_bar(2), (-1.0,), 20, B0, _ends, lambda t: referees.n_four_bar(2, t),
            ((10, "B0_x_m", "0.3284574"), (10, "B0_y_m", "0.9445188")), options=through,
        ),
        "n_four_bar_40": Problem(
            n_four_bar(40), (-1.0,), 20, B0, _ends, lambda t: referees.n_four_bar(40, t),
            (
                (19.4, "B0_x_m", "-0.284004"), (19.4, "B0_y_m", "0.958823"),
                (20, "B0_x_m", "0.410902"), (20, "B0_y_m", "0.911679"),
            ), options=through,
        ),
        "andrews": Problem(
            andrews(), (0.0,), 0.03, tuple(f"{name}_rad" for name in ANGLES),
            _andrews_angles, tau=0.033,
            published=tuple((0.03, f"{n}_rad", f"{x:.12g}") for n, x in ANDREWS["q"].items()),
        ),
        "bricard": Problem(
            robots.bricard(), (0.0,), 10, ("P3_x_m", "P3_y_m", "P3_z_m"),
            lambda chain, motion: chain.platform_pose(motion.q)[:, :3, 3], referees.bricard,
        ),
        "governor": Problem(
            governor(), (2 * np.pi, 0.0, 0.0, 0.0), 10,
            ("shaft_rad", "arm_rad", "slider_m"), lambda _, motion: motion.q[:, [0, 1, 3]],
            referees.governor, options={"method": "Radau"},
        ),
        "slider_crank": Problem(
            robots.slider_crank(), (6.0,), 5, ("crank_rad", "slider_m"),
            lambda _, motion: motion.q[:, :2],
            lambda t: np.stack(referees.slider_crank(t), axis=1),
            ((5, "slider_m", "0.24076, 0.26101"),),
        ),
        "modelica_four_bar": Problem(
            modelica_four_bar(), (referees.RATE,), 5, ("angle_rad",),
            lambda _, motion: motion.q[:, :1],
            lambda t: referees.modelica_four_bar(t)[:, None],
            (
                (0.1, "angle_rad", "0.573724169"), (0.25, "angle_rad", "1.803753622"),
                (4.75, "angle_rad", "38.11562345"), (5, "angle_rad", "40.328236222"),
            ),
        ),
    }  # fmt: skip
