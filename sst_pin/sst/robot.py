# SPDX-License-Identifier: BSD-2-Clause
"""`SST`: the spherical star-triangle robot, a `ClosedChain` with closed-form kinematics."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from functools import partial
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, finite_array, in_one_turn, of_samples, single_array
from ..closed_chain import ClosedChain
from ..description.folder import URDF_PATH, YAML_PATH, yaml_of
from ..description.frames import MOTOR_NAMES
from ..description.parameters import Parameters
from ..description.urdf_writer import urdf_of
from ..engine import Engine
from ..errors import DescriptionError, FileFormatError, InputError, SSTError, WorkspaceError
from ..files import Table
from ..model.appearance import Appearance
from ..model.closures import Closure
from ..model.mechanism import Mechanism
from ..model.tree import frame_named
from ..reading import Described, Urdf, closed, parse_cuts, read_urdf
from ..simulation.check import Verdict
from ..simulation.samples import spline
from . import arc_limits, direct_kinematics, kinematics, star_appearance
from .kinematics import Geometry
from .platform_motion import PlatformMotion, motion_in
from .topology import CUTS, geometry_of, parameters_of

#: Two frames in any order, and all that a weld holds.
_WELDS = {(frozenset(pair), Closure.KINDS["6d"]) for pair in CUTS}


class Singularities(NamedTuple):
    """Distance of a configuration from the singularities of both kinds.

    With A omega = B gamma_dot, rows of A the axes y_2k of {2k} and B = diag(sin(mu_k)).

    Attributes:
        first_kind: min |sin(mu_k)|, shape (...): at 0 a leg is in the plane of its arc and the
            star loses a degree of freedom (inverse kinematics).
        second_kind: Smallest singular value of A, shape (...): at 0 the star can move while the
            motors are fixed (direct kinematics).
        condition_number: Condition number of A, shape (...): 1 at an isotropic pose.
    """

    first_kind: Array
    second_kind: Array
    condition_number: Array


#: Read once from what each robot computes, which never changes.
_GEOMETRIES: WeakKeyDictionary[Engine, Geometry] = WeakKeyDictionary()


def _geometry(model: pin.Model) -> Geometry:
    return geometry_of(model, f"model {model.name}")


def _described(parameters: Parameters) -> Described:
    """What the files of parameters say."""
    urdf = Urdf(urdf_of(parameters), "URDF of the parameters")
    cuts = parse_cuts(yaml_of(parameters), "cuts of the parameters")
    shapes = partial(star_appearance.shapes_of, urdf.root, parameters)
    return closed(urdf, cuts)._replace(shapes=shapes)


def _require_sst(found: Described) -> None:
    """Refuse closures and motors that are not an SST's."""
    problems, closures = list[str](), found.closures
    welds = [c for c in closures if isinstance(c, Closure)]
    ends = {(frozenset((c.frame_a, c.frame_b)), c.held) for c in welds}
    if len(closures) != len(_WELDS) or ends != _WELDS:
        told = ", ".join(f"{c} ({getattr(c, 'kind', 'no weld')})" for c in closures)
        wanted = " and ".join(f"{a} - {b}" for a, b in sorted(CUTS))
        told = f"closures or equalities {told or 'are missing'}"
        problems.append(f"{told}; an SST has the welds (6d) {wanted}")
    if tuple(found.actuated) != MOTOR_NAMES:
        wanted = ", ".join(MOTOR_NAMES)
        problems.append(f"motors {list(found.actuated)}; an SST has {wanted}")
    if problems:
        raise DescriptionError(found.source, problems)


class SST(ClosedChain):
    """A 3-RRP spherical parallel manipulator.

    Joint vectors q, shape (..., 9), [rad], are gamma_1, mu_1, beta_1, gamma_2, ...; the motors are
    gamma_1..3. Orientations R of the star are those of {E} in the base, shape (..., 3, 3).

    Args:
        parameters: Geometry, masses, friction, gravity; by default those of the paper's robot.

    Example:
        >>> robot = sst_pin.SST(sst_pin.Parameters(viscous_friction=0.1))
        >>> robot.compute_torques(robot.home, [1, 0, 0], [0, 0, 0]).round(3)
        array([ 0.3  ,  4.475, -4.475])
    """

    def __init__(self, parameters: Parameters | None = None) -> None:
        if parameters is None:
            self._load(read_urdf(URDF_PATH, YAML_PATH))
        elif not isinstance(parameters, Parameters):
            raise InputError(
                "parameters", f"{parameters!r} is not Parameters; to read a file use SST.from_urdf"
            )
        else:
            self._load(_described(parameters))

    @classmethod
    def from_urdf(  # type: ignore[override]  # an SST has its motors and nothing to lock
        cls, path: str | Path, cuts: str | Path | None = None
    ) -> SST:
        """An SST from an edited URDF; the dynamics uses the numbers of the file.

        Args:
            path: The URDF, with the joint and frame names of `sst_pin.URDF_PATH`.
            cuts: YAML of closures, motors and gravity; by default the file with the name of the
                URDF and the ending .yaml or, if there is none, `sst_pin.YAML_PATH`.

        Raises:
            DescriptionError: If it is not a URDF of an SST; the message lists all problems.

        Warns:
            DescriptionWarning: When the inertia of a link is one that no body has.

        Example:
            >>> robot = sst_pin.SST.from_urdf(sst_pin.URDF_PATH)
            >>> robot.motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        found = read_urdf(path, cuts, default=YAML_PATH)
        return cls.from_description(found)

    @classmethod
    def from_description(cls, found: Described) -> SST:
        """As `ClosedChain.from_description`."""
        robot = cls.__new__(cls)
        robot._load(found)
        return robot

    def _load(self, found: Described) -> None:
        geometry_of(found.model, found.source)  # its complaints come first
        _require_sst(found)
        super().__init__(**found.arguments, coordinates=MOTOR_NAMES)
        self._shapes = found.shapes

    def _fill(self, model: pin.Model, recipe: partial[Mechanism]) -> None:
        _geometry(model)  # refuses what is no SST
        super()._fill(model, recipe)

    _platform = "beta_1"  # the star

    @property
    def geometry(self) -> Geometry:
        """Geometry of the tree.

        Example:
            >>> robot.geometry.e[0]
            array([0., 0., 1.])
        """
        engine = self._engine
        if engine not in _GEOMETRIES:
            _GEOMETRIES[engine] = _geometry(engine.mechanism.model)
        return _GEOMETRIES[engine]

    @property
    def parameters(self) -> Parameters:
        """The parameters of `model`; `SST(robot.parameters)` is the same robot.

        Raises:
            DescriptionError: If an edited file has contents that `Parameters` do not describe.

        Example:
            >>> robot.parameters.star.mass
            2.6
        """
        mechanism, geometry = self.mechanism, self.geometry
        if self.forces or not mechanism.springs.none:
            problems = ["it has springs or lines, which Parameters do not describe"]
            raise DescriptionError(f"model {mechanism.model.name}", problems)
        return parameters_of(mechanism.model, geometry, mechanism.friction)

    @property
    def home(self) -> Array:
        """The home pose, shape (9,): s in the middle of the base triangle, R_1 in that of P1P2.

        That of the paper's robot is isotropic.

        Example:
            >>> np.degrees(robot.home).round(2)
            array([45.  , 90.  , 35.26, 45.  , 90.  , 35.26, 45.  , 90.  , 35.26])
        """
        now = copy(self)
        return now.inverse_kinematics(kinematics.home_orientation(now.geometry))

    def inverse_kinematics(self, R: ArrayLike, branch: ArrayLike = (1, 1, 1)) -> Array:
        """Inverse kinematics: the joint angles for an orientation of the star.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            branch: Sign of sin(mu_k) for each leg, shape (..., 3), broadcast against R; with
                `R[..., None, :, :]`, `BRANCHES` gives all eight.

        Returns:
            q in (-pi, pi], shape (..., 9), [rad].

        Raises:
            InputError: If R is not a rotation matrix, or an entry of branch not +1 or -1.
            SingularConfigurationError: When a leg is in the plane of its arc.
            WorkspaceError: If a joint would exceed its limits.

        Example:
            >>> R = sst_pin.orientation(theta=0.8, phi=0.9, psi=0.1)
            >>> robot.inverse_kinematics(R).round(3)
            array([0.862, 1.649, 0.673, 0.88 , 1.638, 0.579, 0.803, 1.691, 0.602])
        """
        return copy(self)._inverse_kinematics(R, branch)[1]

    def _inverse_kinematics(self, R: ArrayLike, branch: ArrayLike) -> tuple[kinematics.Legs, Array]:
        R = finite_array("R", R, (3, 3))
        kinematics.require_rotation(R)
        signs = finite_array("branch", branch, (3,))
        if not (np.abs(signs) == 1).all():
            words = f"{np.asarray(branch).tolist()}: each entry must be +1 or -1"
            raise InputError("branch", words)
        legs = kinematics.legs_of_orientation(self.geometry, R, signs)
        q = kinematics.joints_of_legs(self.geometry, legs)
        self._require_limits(q)
        return legs, q

    def joint_motion(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, branch: ArrayLike = (1, 1, 1)
    ) -> tuple[Array, Array, Array]:
        """Inverse kinematics of a motion: joint angles, motor rates and motor accelerations.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            omega: Angular velocity of the star, base axes, shape (..., 3), [rad/s].
            alpha: Its angular acceleration, base axes, shape (..., 3), [rad/s^2].
            branch: As in `inverse_kinematics`.

        Returns:
            q, va, aa of shapes (..., 9), (..., 3), (..., 3).

        Raises:
            InputError, SingularConfigurationError, WorkspaceError: As `inverse_kinematics`.

        Example:
            >>> q, va, aa = robot.joint_motion(*sst_pin.paper_circle(np.linspace(0, 0.5, 100)))
            >>> q.shape, va.shape, aa.shape
            ((100, 9), (100, 3), (100, 3))
        """
        now = copy(self)
        legs, q = now._inverse_kinematics(R, branch)
        omega, alpha = (
            np.broadcast_to(finite_array(name, value, (3,)), (*q.shape[:-1], 3))
            for name, value in (("omega", omega), ("alpha", alpha))
        )
        q_dot = kinematics.joint_rates(legs, omega)
        q_ddot = kinematics.joint_accelerations(now.geometry, legs, q_dot, alpha)
        q_ddot = finite_array("alpha", q_ddot, (9,))  # omega may have been too large
        return q, q_dot[..., ::3], q_ddot[..., ::3]

    def forward_kinematics(self, gamma: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Direct kinematics: all assemblies for given motor angles, or the one closest to `near`.

        Args:
            gamma: Motor angles, shape (3,), [rad].
            near: Previous joint angles, shape (9,), [rad].

        Returns:
            All solutions, shape (n, 9), n <= 8, sorted by the components of s. With `near` one
            solution, shape (9,), where mu and beta differ by at most pi from those of `near`.

        Raises:
            SingularConfigurationError: If the motor angles do not determine the star.
            WorkspaceError: With `near`, if there is no solution.

        Example:
            >>> robot.forward_kinematics([np.pi / 4] * 3).shape  # all eight assemblies
            (8, 9)
            >>> near = robot.forward_kinematics([0.8, 0.8, 0.8], near=robot.home)
            >>> near.round(3)
            array([0.8  , 1.591, 0.616, 0.8  , 1.591, 0.616, 0.8  , 1.591, 0.616])
        """
        gamma, geometry = single_array("gamma", gamma, (3,)), self.geometry
        u = kinematics.passive_axes(geometry, gamma)
        R = direct_kinematics.orientations(u, geometry.arc_normals)
        solutions = kinematics.joints_of_actuated(geometry, gamma, R)
        if near is None:
            return solutions[np.lexsort(np.round(R[:, :, :2].reshape(-1, 6), 9).T)]
        if not len(solutions):
            raise WorkspaceError(f"no assembly exists at gamma = {gamma.tolist()} rad")
        before = single_array("near", near, (9,))
        turns = in_one_turn(solutions - before)
        q: Array = before + turns[np.abs(turns).max(axis=1).argmin()]
        q[::3] = gamma
        return q

    def platform_orientation(self, q: ArrayLike) -> Array:
        """Orientation R of {E} in the base by leg 1, shape (..., 3, 3); its first column is s.

        Example:
            >>> robot.platform_orientation(robot.home)[:, 0].round(4)  # s
            array([0.5774, 0.5774, 0.5774])
        """
        return kinematics.orientation_of_joints(self.geometry, finite_array("q", q, (9,)))

    def platform_velocity(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Angular velocity of the star, base axes, shape (..., 3), [rad/s].

        Example:
            >>> robot.platform_velocity(robot.home, [1, 1, 1]).round(4)
            array([1., 1., 1.])
        """
        now = copy(self)
        legs = kinematics.legs_of_joints(now.geometry, finite_array("q", q, (9,)))
        axes = now.geometry.e[0], legs.u[..., 0, :], legs.n[..., 0, :]
        rates = now.joint_rates(q, va)[..., None]
        # Eq. (62) with plus signs
        return np.asarray(sum(rates[..., i, :] * axis for i, axis in enumerate(axes)))

    def branch(self, q: ArrayLike) -> NDArray[np.int_]:
        """Sign of sin(mu_k) for each leg, shape (..., 3).

        Example:
            >>> robot.branch(robot.home)
            array([1, 1, 1])
        """
        return np.where(np.sin(finite_array("q", q, (9,))[..., 1::3]) < 0, -1, 1)

    def singularities(self, q: ArrayLike) -> Singularities:
        """Distance to the singularities of both kinds.

        Example:
            >>> print(round(float(robot.singularities(robot.home).condition_number), 6))
            1.0
        """
        legs = kinematics.legs_of_joints(self.geometry, finite_array("q", q, (9,)))
        values = np.asarray(np.linalg.svd(legs.y_2, compute_uv=False), dtype=float)
        largest, smallest = values[..., 0], values[..., -1]
        with np.errstate(divide="ignore"):
            return Singularities(np.abs(legs.sin_mu).min(axis=-1), smallest, largest / smallest)

    def singularity_measures(self, q: ArrayLike) -> dict[str, Array]:
        """Condition number of A (second kind) and 1 / min |sin(mu_k)| (first kind).

        Example:
            >>> [value.round(2).item() for value in robot.singularity_measures(robot.home).values()]
            [1.0, 1.0]
        """
        found = self.singularities(q)
        with np.errstate(divide="ignore"):
            return {
                "singularity (second kind), cond A": found.condition_number,
                "singularity (first kind), 1 / min |sin mu_k|": np.asarray(1 / found.first_kind),
            }

    @property
    def star_radius(self) -> float:
        """Distance OE, [m]; of a URDF without a frame E, that of the paper's robot.

        Example:
            >>> robot.star_radius
            0.4
        """
        model = self._engine.mechanism.model
        if not model.existFrame("E"):
            return Parameters().star_radius
        return float(np.linalg.norm(frame_named(model, "E").placement.translation))

    @property
    def appearance(self) -> Appearance:
        """What pictures show: axes e_1..9, frames {0k}..{3k} and {E}, the path of E.

        Example:
            >>> len(robot.appearance.frames)
            13
        """
        now = copy(self)
        return star_appearance.appearance_of(now.geometry, now.star_radius)

    def _verdicts(self, q: Array) -> Iterable[Verdict]:
        return arc_limits.verdicts(self.mechanism.model, self.geometry, q)

    def _motion_in(self, table: Table) -> tuple[Array, Array, Array]:
        given = motion_in(table)
        if isinstance(given, PlatformMotion):
            q, va, aa = self.joint_motion(*given)
            return np.unwrap(q, axis=0), va, aa
        assembled = [self.home]
        for gamma, line in zip(given, table.lines, strict=True):
            try:
                assembled.append(self.forward_kinematics(gamma, near=assembled[-1]))
            except SSTError as error:
                raise FileFormatError(table.path, str(error), line) from None
        t = table.column("t_s")
        curve = spline(t, given)
        q = np.unwrap(assembled[1:], axis=0)
        return q, curve.derivative(1)(t), curve.derivative(2)(t)

    def _require_limits(self, q: Array) -> None:
        model = self._engine.mechanism.model
        lower, upper = model.lowerPositionLimit, model.upperPositionLimit
        outside = (q < lower) | (q > upper)
        if outside.any():
            first = tuple(np.argwhere(outside)[0])
            joint = first[-1]
            problem = (
                f"the orientation is out of reach: {self.joint_names[joint]} would be "
                f"{q[first]:.4g} rad, its limits are {lower[joint]:.4g} and {upper[joint]:.4g} rad"
            )
            raise of_samples(WorkspaceError(problem), outside.any(axis=-1))
