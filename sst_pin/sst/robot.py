# SPDX-License-Identifier: BSD-2-Clause
"""`SST`: the spherical star-triangle robot, a `ClosedChain` with closed-form kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from .. import description
from ..arrays import Array, finite_array, in_one_turn, of_samples, single_array
from ..chain.appearance import Appearance
from ..chain.backend import Backend
from ..chain.closed_chain import ClosedChain
from ..chain.closures import Coupling
from ..chain.current import Current
from ..chain.mechanism import Friction
from ..chain.reference import Reference
from ..chain.tree import frame_named
from ..description import MOTOR_NAMES
from ..description.parameters import Parameters
from ..errors import DescriptionError, InputError, WorkspaceError
from ..files import Table
from ..motion.limits import Finding, findings, samples_of
from ..motion.trajectories import Trajectory
from ..reading import Described, Urdf, closed, parse_cuts, read_urdf
from . import check, direct_kinematics, kinematics, star_appearance, star_motions
from .geometry_models import ParameterShapes
from .kinematics import Geometry
from .read_back import parameters_of
from .topology import CUTS, geometry_of

#: As closures print.
_WELDS = {f"{a} - {b}" for a, b in CUTS}


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
_GEOMETRIES: WeakKeyDictionary[Current, Geometry] = WeakKeyDictionary()


def _geometry(model: pin.Model) -> Geometry:
    return geometry_of(model, f"model {model.name}")


def _kernels(reference: Reference, off: str) -> Backend:
    from . import kernels  # at their first use: they import much

    return kernels.backend(reference, off)


class SST(ClosedChain):
    """A 3-RRP spherical parallel manipulator.

    Joint vectors q, shape (..., 9), [rad], are gamma_1, mu_1, beta_1, gamma_2, ...; the motors are
    gamma_1..3. Orientations R of the star are those of {E} in the base, shape (..., 3, 3).

    Args:
        parameters: Geometry, masses, friction, gravity; by default those of the paper's robot.
        kernels: Whether compiled kernels compute the dynamics, if they are available. Otherwise
            the reference path computes it with Pinocchio and NumPy.

    Example:
        >>> robot = sst_pin.SST(sst_pin.Parameters(viscous_friction=0.1))
        >>> robot.compute_torques(robot.home, [1, 0, 0], [0, 0, 0]).round(3)
        array([ 0.3  ,  4.475, -4.475])
    """

    def __init__(self, parameters: Parameters | None = None, *, kernels: bool = True) -> None:
        if parameters is None:
            self._load(read_urdf(description.URDF_PATH, description.YAML_PATH), kernels)
        elif not isinstance(parameters, Parameters):
            raise InputError(
                "parameters", f"{parameters!r} is not Parameters; to read a file use SST.from_urdf"
            )
        else:
            urdf = Urdf(description.urdf_of(parameters), "URDF of the parameters")
            cuts = parse_cuts(description.yaml_of(parameters), "cuts of the parameters")
            shapes = ParameterShapes(urdf.root, parameters)
            self._load(closed(urdf, cuts)._replace(shapes=shapes), kernels)

    @classmethod
    def from_urdf(  # type: ignore[override]  # an SST has its motors and nothing to lock
        cls, path: str | Path, cuts: str | Path | None = None, *, kernels: bool = True
    ) -> SST:
        """An SST from an edited URDF; the dynamics uses the numbers of the file.

        Args:
            path: The URDF, with the joint and frame names of `sst_pin.URDF_PATH`.
            cuts: YAML of closures, motors and gravity; by default the file with the name of the
                URDF and the ending .yaml or, if there is none, `sst_pin.YAML_PATH`.
            kernels: See the constructor.

        Raises:
            DescriptionError: If it is not a URDF of an SST; the message lists all problems.

        Warns:
            DescriptionWarning: When the inertia of a link is one that no body has.

        Example:
            >>> robot = sst_pin.SST.from_urdf(sst_pin.URDF_PATH)
            >>> robot.motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        found = read_urdf(path, cuts, default=description.YAML_PATH)
        return cls._of_file(found, kernels)

    @classmethod
    def from_mjcf(  # type: ignore[override]  # an SST has its motors
        cls, path: str | Path, *, locked: Sequence[str] = (), kernels: bool = True
    ) -> SST:
        """An SST from an edited MJCF: its parameters are read and a new SST is made from them.

        Args:
            path: The MJCF, with the joints, sites and welds of the shipped one.
            locked: As in `ClosedChain.from_mjcf`; an SST has nothing to lock.
            kernels: See the constructor.

        Raises:
            MissingExtraError: Without MuJoCo, `sst-pin[mjcf]`.
            DescriptionError: When it is no MJCF, of another topology, or holds what parameters do
                not, with every problem.

        Example:
            >>> sst_pin.SST.from_mjcf(sst_pin.MJCF_PATH).motor_names
            ('gamma_1', 'gamma_2', 'gamma_3')
        """
        from ..reading.mjcf import read_mjcf

        found, source = read_mjcf(path, locked), str(path)
        geometry = geometry_of(found.model, source)
        motors = found.actuated
        ends = {str(closure) for closure in found.closures}
        if motors != MOTOR_NAMES or ends != _WELDS:
            wanted = f"an SST has motors {', '.join(MOTOR_NAMES)} and welds {sorted(_WELDS)}"
            raise DescriptionError(
                source, [f"motors {motors}, equalities {sorted(ends)}; {wanted}"]
            )
        if found.forces or (found.stiffness is not None and found.stiffness.any()):
            raise DescriptionError(source, ["parameters have no springs and no tendons"])
        friction = Friction(found.model.damping, found.model.friction)
        return cls(parameters_of(found.model, geometry, friction), kernels=kernels)

    @classmethod
    def _of_file(cls, found: Described, kernels: bool = True) -> SST:
        robot = cls.__new__(cls)
        robot._load(found, kernels)
        return robot

    def _load(self, found: Described, kernels: bool) -> None:
        geometry_of(found.model, found.source)  # its complaints come first
        if mimics := [each for each in found.closures if isinstance(each, Coupling)]:
            raise DescriptionError(found.source, [f"{mimics[0]}: an SST has no mimic joints"])
        if found.actuated != MOTOR_NAMES:
            wanted = ", ".join(MOTOR_NAMES)
            raise DescriptionError(
                found.source, [f"name_mot: {list(found.actuated)}, an SST has {wanted}"]
            )
        what = found.model, found.closures, MOTOR_NAMES
        super().__init__(*what, coordinates=MOTOR_NAMES, forces=found.forces)
        off = "" if kernels else "switched off by kernels=False"
        self._current = Current(self._current.mechanism, partial(_kernels, off=off))
        self._shapes = found.shapes

    _examine = staticmethod(_geometry)
    _platform = "beta_1"  # the star

    @property
    def geometry(self) -> Geometry:
        """Geometry of the tree.

        Example:
            >>> robot.geometry.e[0]
            array([0., 0., 1.])
        """
        current = self._current
        if current not in _GEOMETRIES:
            _GEOMETRIES[current] = _geometry(current.mechanism.model)
        return _GEOMETRIES[current]

    @property
    def parameters(self) -> Parameters:
        """The parameters of `model`; `SST(robot.parameters)` is the same robot.

        Raises:
            DescriptionError: If an edited URDF cannot be described by `Parameters`.

        Example:
            >>> robot.parameters.star.mass
            2.6
        """
        return parameters_of(self._current.mechanism.model, self.geometry, self.friction)

    # --- kinematics -------------------------------------------------------------------------

    @property
    def home(self) -> Array:
        """The home pose, shape (9,): s in the middle of the base triangle, R_1 in that of P1P2.

        For the paper's robot it is the isotropic pose.

        Example:
            >>> np.degrees(robot.home).round(2)
            array([45.  , 90.  , 35.26, 45.  , 90.  , 35.26, 45.  , 90.  , 35.26])
        """
        return self.inverse_kinematics(kinematics.home_orientation(self.geometry))

    def inverse_kinematics(self, R: ArrayLike, branch: ArrayLike = (1, 1, 1)) -> Array:
        """Inverse kinematics: the joint angles for an orientation of the star.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            branch: Sign of sin(mu_k) for each leg, shape (..., 3), broadcast against R. By default
                the working branch; `R[..., None, :, :]` and `BRANCHES` give all eight.

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
        _, q = self._inverse_kinematics(R, branch)
        return q

    def _inverse_kinematics(self, R: ArrayLike, branch: ArrayLike) -> tuple[kinematics.Legs, Array]:
        R = finite_array("R", R, (3, 3))
        kinematics.require_rotation(R)
        signs = finite_array("branch", branch, (3,))
        if not (np.abs(signs) == 1).all():
            raise InputError(
                "branch", f"{np.asarray(branch).tolist()}: each entry must be +1 or -1"
            )
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
        legs, q = self._inverse_kinematics(R, branch)
        omega, alpha = finite_array("omega", omega, (3,)), finite_array("alpha", alpha, (3,))
        q_dot = kinematics.joint_rates(legs, np.broadcast_to(omega, (*q.shape[:-1], 3)))
        q_ddot = kinematics.joint_accelerations(
            self.geometry, legs, q_dot, np.broadcast_to(alpha, (*q.shape[:-1], 3))
        )
        q_ddot = finite_array("alpha", q_ddot, (9,))  # omega may have been too large
        return q, q_dot[..., ::3], q_ddot[..., ::3]

    def forward_kinematics(self, gamma: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Direct kinematics: all assemblies for given motor angles, or the one closest to `near`.

        Args:
            gamma: Motor angles, shape (3,), [rad].
            near: Previous joint angles, shape (9,); the solution closest to them is selected.

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
        gamma = single_array("gamma", gamma, (3,))
        x_0, y_0 = self.geometry.R_0[:, :, 0], self.geometry.R_0[:, :, 1]
        u = np.cos(gamma)[:, None] * x_0 + np.sin(gamma)[:, None] * y_0
        R = direct_kinematics.orientations(u, self.geometry.arc_normals)
        solutions = kinematics.joints_of_actuated(self.geometry, gamma, R)
        if near is None:
            return solutions[np.lexsort(np.round(R[:, :, :2].reshape(-1, 6), 9).T)]
        if not len(solutions):
            raise WorkspaceError(f"no assembly exists at gamma = {gamma.tolist()} rad")
        before = single_array("near", near, (9,))
        turns = in_one_turn(solutions - before)
        best = int(np.abs(turns).max(axis=1).argmin())
        q: Array = before + turns[best]
        q[::3] = gamma
        return q

    def platform_orientation(self, q: ArrayLike) -> Array:
        """Orientation of {E} in the base, computed from leg 1.

        Returns:
            R, shape (..., 3, 3); its first column is s, the direction OE.

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
        legs = kinematics.legs_of_joints(self.geometry, finite_array("q", q, (9,)))
        rates = self.joint_rates(q, va)
        axes = np.stack(
            np.broadcast_arrays(self.geometry.e[0], legs.u[..., 0, :], legs.n[..., 0, :]), axis=-2
        )
        return np.einsum("...j,...ji->...i", rates[..., :3], axes)  # Eq. (62) with plus signs

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
        with np.errstate(divide="ignore"):
            condition = values[..., 0] / values[..., -1]
        return Singularities(np.abs(legs.sin_mu).min(axis=-1), values[..., -1], condition)

    def check(self, motion: Trajectory | ArrayLike) -> tuple[Finding, ...]:
        """Check a motion: joints that leave their arcs or limits, and nearby singularities.

        Args:
            motion: A motion of this robot, or one configuration, shape (9,).

        Returns:
            One finding for each joint or singularity, with its times; empty if there are none.

        Raises:
            InputError: For the motion of another robot.

        Example:
            >>> motion = robot.simulate([0, 0, 0], robot.home, [0, 0, 0], np.linspace(0, 0.3, 31))
            >>> for finding in robot.check(motion):
            ...     print(finding.joints, finding.times[0].round(2))
            ('beta_1',) 0.26
        """
        t, q = samples_of(self, motion)
        return findings(t, check.verdicts(self.model, self.geometry, q))

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

    # --- pictures ---------------------------------------------------------------------------

    @property
    def star_radius(self) -> float:
        """Distance OE, [m]; of a URDF without a frame E, that of the paper's robot.

        Example:
            >>> robot.star_radius
            0.4
        """
        model = self._current.mechanism.model
        if not model.existFrame("E"):
            return Parameters().star_radius
        E = frame_named(model, "E")
        return float(np.linalg.norm(E.placement.translation))

    @property
    def appearance(self) -> Appearance:
        """What pictures show: axes e_1..9, frames {0k}..{3k} and {E}, the path of E.

        Example:
            >>> len(robot.appearance.frames)
            13
        """
        return star_appearance.appearance_of(self.geometry, self.star_radius)

    def _motion_in(self, table: Table) -> tuple[Array, Array, Array]:
        return star_motions.motion_in(self, table)

    # --- inside -----------------------------------------------------------------------------

    def _page_functions(self, q: Array) -> tuple[str, Array]:
        from . import kernels

        return kernels.page_functions(self.mechanism) or super()._page_functions(q)

    def _require_limits(self, q: Array) -> None:
        model = self._current.mechanism.model
        lower, upper = model.lowerPositionLimit, model.upperPositionLimit
        outside = (q < lower) | (q > upper)
        if outside.any():
            *sample, joint = (int(i) for i in np.argwhere(outside)[0])
            problem = (
                f"the orientation is out of reach: {self.joint_names[joint]} would be "
                f"{q[tuple(sample)][joint]:.4g} rad, its limits are "
                f"{lower[joint]:.4g} and {upper[joint]:.4g} rad"
            )
            raise of_samples(WorkspaceError(problem), outside.any(axis=-1))
