# SPDX-License-Identifier: BSD-2-Clause
"""`SST`: the spherical star-triangle robot, a `ClosedChain` with closed-form kinematics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, batch_shape, finite_array, in_one_turn, of_samples, single_array
from ..closed_chain import ClosedChain
from ..description.folder import URDF_PATH, YAML_PATH
from ..description.frames import MOTOR_NAMES
from ..description.parameters import Parameters
from ..description.urdf_writer import urdf_of, yaml_of
from ..engine import Engine
from ..errors import DescriptionError, InputError, SingularConfigurationError, WorkspaceError
from ..former_names import former_arguments
from ..model.appearance import Appearance
from ..model.closures import Closure
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE
from ..model.tree import frame_named
from ..reading import RobotFile, Urdf, closed_robot, parse_cuts, read_urdf
from ..simulation.check import Finding
from . import arc_limits, direct_kinematics, kinematics, star_appearance
from .kinematics import Geometry
from .topology import CUTS, differences, geometry_of, parameters_of

#: The closures of an SST. A weld is a pair (two frames in any order, the six fixed directions).
_WELDS = {(frozenset(pair), Closure.KINDS["6d"]) for pair in CUTS}


class Singularities(NamedTuple):
    """Distance of a configuration from the singularities of both kinds.

    The angular velocity omega of the star and the rates gamma_dot of the motors satisfy
    A omega = B gamma_dot. The rows of A are the y axes of {2k}, and B = diag(sin(mu_k)).

    Attributes:
        first_kind: min |sin(mu_k)|, shape (...). At 0 a leg is in the plane of its arc, B is
            singular, and the star loses a degree of freedom.
        second_kind: Smallest singular value of A, shape (...). At 0 the star can move while the
            motors are fixed.
        condition_number: Condition number of A, shape (...); 1 at an isotropic pose.
    """

    first_kind: Array
    second_kind: Array
    condition_number: Array


#: The geometry of each engine. It is computed once, and forgotten with its engine.
_GEOMETRIES: WeakKeyDictionary[Engine, Geometry] = WeakKeyDictionary()


def _geometry_of_engine(engine: Engine) -> Geometry:
    """The geometry of the SST whose dynamics an engine computes."""
    if engine not in _GEOMETRIES:
        model = engine.mechanism.model
        _GEOMETRIES[engine] = geometry_of(model, f"model {model.name}")
    return _GEOMETRIES[engine]


def _description_of(parameters: Parameters) -> RobotFile:
    """The description of an SST with these parameters; its shapes are made when needed."""
    urdf = Urdf(urdf_of(parameters, shapes=False), "URDF of the parameters")
    cuts = parse_cuts(yaml_of(parameters), "cuts of the parameters")
    return closed_robot(urdf, cuts)._replace(shapes=partial(star_appearance.shapes_of, parameters))


def _require_sst(description: RobotFile) -> None:
    """Refuse closures and motors that an SST does not have."""
    problems = list[str]()
    closures = description.closures
    welds = set[tuple[frozenset[str], tuple[bool, ...]]]()
    for closure in closures:
        if isinstance(closure, Closure):
            welds.add((frozenset((closure.frame_a, closure.frame_b)), closure.held))
    if len(closures) != len(_WELDS) or welds != _WELDS:
        names = ", ".join(f"{c} ({getattr(c, 'kind', 'no weld')})" for c in closures)
        expected = " and ".join(f"{a} - {b}" for a, b in sorted(CUTS))
        names = f"closures or equalities {names or 'are missing'}"
        problems.append(f"{names}; an SST has the welds (6d) {expected}")
    if tuple(description.actuated) != MOTOR_NAMES:
        expected = ", ".join(MOTOR_NAMES)
        problems.append(f"motors {list(description.actuated)}; an SST has {expected}")
    if problems:
        raise DescriptionError(description.source, problems)


class SST(ClosedChain):
    """A 3-RRP spherical parallel manipulator.

    Joint vectors q, shape (..., 9), [rad], are gamma_1, mu_1, beta_1, gamma_2, ...; the motors are
    gamma_1..3. Orientations R of the star are those of {E} in the base, shape (..., 3, 3). The
    arguments `near` and `branch` select one of several solutions. If the description names no
    configuration home, `home` has s, the x axis of {E}, in the middle of the base triangle, and the
    passive axis of leg 1 in the middle of the side P_1 P_2.

    Args:
        parameters: Geometry, masses, friction, gravity; by default of the paper's robot.

    Example:
        >>> robot = sst_pin.SST(sst_pin.Parameters(viscous_friction=0.1))
        >>> robot.compute_torques(robot.home, [1, 0, 0], [0, 0, 0]).round(3)
        array([ 0.3  ,  4.475, -4.475])
    """

    #: The frame of the platform, the star.
    _platform = "beta_1"

    def __init__(self, parameters: Parameters | None = None) -> None:
        if parameters is None:
            description = read_urdf(URDF_PATH, YAML_PATH)
        elif not isinstance(parameters, Parameters):
            raise InputError(
                "parameters", f"{parameters!r} is not Parameters; to read a file use SST.from_urdf"
            )
        else:
            description = _description_of(parameters)
        self._load(description)

    @classmethod
    def from_urdf(  # type: ignore[override]  # an SST has its motors and nothing to lock
        cls, path: str | Path, cuts: str | Path | None = None
    ) -> SST:
        """An SST from an edited URDF; the dynamics uses the numbers of the file.

        Args:
            path: The URDF, with the joint and frame names of `sst_pin.URDF_PATH`.
            cuts: YAML of closures, motors and gravity; by default the file with the name of the
                URDF and the ending .yaml or, if there is none, `sst_pin.sst.YAML_PATH`.

        Raises:
            DescriptionError: If it is not a URDF of an SST; the message lists all problems.

        Warns:
            DescriptionWarning: When the inertia of a link is not physical.
        """
        return cls.from_description(read_urdf(path, cuts, default=YAML_PATH))

    @classmethod
    def from_description(cls, description: RobotFile) -> SST:
        """An SST from the content of its files; errors name the files."""
        robot = cls.__new__(cls)
        robot._load(description)
        return robot

    def _load(self, description: RobotFile) -> None:
        """Do the work of all constructors: check that a description is an SST, and make the robot.

        If the description has no home, one is added to its model.
        """
        model = description.model
        geometry = geometry_of(model, description.source)
        _require_sst(description)
        if "home" not in model.referenceConfigurations:
            with suppress(SingularConfigurationError):
                home = kinematics.home_configuration(geometry)
                model.referenceConfigurations["home"] = home
        super().__init__(**description.arguments, coordinates=MOTOR_NAMES)
        self._shapes = description.shapes

    @property
    def geometry(self) -> Geometry:
        """Orientations of the frames fixed to the base and to the star."""
        return _geometry_of_engine(self._engine)

    @property
    def parameters(self) -> Parameters:
        """The parameters of `model`; `SST(robot.parameters)` is the same robot.

        It raises a `DescriptionError` if the model contains what `Parameters` cannot describe.
        """
        engine = self._engine  # the same one throughout, also if another thread refreshes
        mechanism = engine.mechanism
        if mechanism.lines.forces or not mechanism.springs.none:
            problems = ["it has springs or lines, which Parameters do not describe"]
            raise DescriptionError(f"model {mechanism.model.name}", problems)
        if mechanism.weight_shares is not None:
            problems = ["it has weight_shares, which Parameters do not describe"]
            raise DescriptionError(f"model {mechanism.model.name}", problems)
        parameters = parameters_of(mechanism.model, _geometry_of_engine(engine), mechanism.friction)
        written = _description_of(parameters).model
        problems = list(differences(mechanism.model, written))
        if problems:
            source = f"model {mechanism.model.name} cannot be described by Parameters"
            raise DescriptionError(source, problems)
        return parameters

    @former_arguments(R="pose")
    def inverse_kinematics(self, pose: pin.SE3 | ArrayLike, branch: ArrayLike = (1, 1, 1)) -> Array:
        """Inverse kinematics: q in (-pi, pi], shape (..., 9), for poses of the star.

        Args:
            pose: {E} in the base: orientations, shape (..., 3, 3), or, as for the robots of the
                gallery, `pinocchio.SE3` or homogeneous matrices, shape (..., 4, 4).
            branch: Sign of sin(mu_k) for each leg, shape (..., 3), broadcast against the poses;
                with `R[..., None, :, :]`, `BRANCHES` gives all eight.

        Raises:
            InputError: If a rotation is none, or an entry of branch is not +1 or -1.
            SingularConfigurationError: When a leg is in the plane of its arc.
            WorkspaceError: If a joint would exceed its limits, or if a position is not where E is
                with this orientation.

        Example:
            >>> R = sst_pin.sst.orientation(theta=0.8, phi=0.9, psi=0.1)
            >>> robot.inverse_kinematics(R).round(3)
            array([0.862, 1.649, 0.673, 0.88 , 1.638, 0.579, 0.803, 1.691, 0.602])
        """
        return _inverse_pose(self._engine, "pose", self._orientations(pose), branch).q

    def _orientations(self, pose: pin.SE3 | ArrayLike) -> Array:
        """The rotations of poses; their positions, if given, must be the position of E."""
        poses = finite_array("pose", pose.homogeneous if isinstance(pose, pin.SE3) else pose, ())
        if poses.shape[-2:] != (4, 4):
            return poses
        R = poses[..., :3, :3]
        position = poses[..., :3, 3]
        radius = self.star_radius
        s = R[..., 0]
        gap = np.linalg.norm(position - radius * s, axis=-1)  # E is at radius * s
        is_elsewhere = gap > CLOSURE_TOLERANCE * radius
        if is_elsewhere.any():
            problem = f"with this orientation E is {gap.max():.3g} m away from this position"
            raise of_samples(WorkspaceError(problem), is_elsewhere)
        return R

    def joint_motion(
        self, R: ArrayLike, omega: ArrayLike, alpha: ArrayLike, branch: ArrayLike = (1, 1, 1)
    ) -> tuple[Array, Array, Array]:
        """Inverse kinematics of a motion: q, va, aa of shapes (..., 9), (..., 3), (..., 3).

        The leading axes of the arguments broadcast.

        Args:
            R: {E} in the base, shape (..., 3, 3).
            omega: Angular velocity of the star, base axes, shape (..., 3), [rad/s].
            alpha: Its angular acceleration, base axes, shape (..., 3), [rad/s^2].
            branch: As in `inverse_kinematics`, which raises the same errors.

        Example:
            >>> q, va, aa = robot.joint_motion(*sst_pin.paper_circle(np.linspace(0, 0.5, 100)))
            >>> q.shape, va.shape, aa.shape
            ((100, 9), (100, 3), (100, 3))
        """
        engine = self._engine  # the same one throughout, also if another thread refreshes
        R = finite_array("R", R, (3, 3))
        omega = finite_array("omega", omega, (3,))
        alpha = finite_array("alpha", alpha, (3,))
        signs = finite_array("branch", branch, (3,))
        batch = batch_shape([R, omega, alpha, signs], core_axes=[2, 1, 1, 1])
        legs, q = _inverse_pose(engine, "R", np.broadcast_to(R, (*batch, 3, 3)), branch)
        omega = np.broadcast_to(omega, (*batch, 3))
        alpha = np.broadcast_to(alpha, (*batch, 3))
        q_dot = kinematics.joint_rates(legs, omega)
        q_ddot = kinematics.joint_accelerations(_geometry_of_engine(engine), legs, q_dot, alpha)
        q_ddot = finite_array("alpha", q_ddot, (9,))  # omega may have been too large
        return q, q_dot[..., ::3], q_ddot[..., ::3]

    def forward_kinematics(self, gamma: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Direct kinematics: all assemblies q, shape (n, 9), n <= 8, in a reproducible order.

        Args:
            gamma: Motor angles, shape (3,), [rad].
            near: Previous joint angles, shape (9,), [rad]. The result is then the closest assembly,
                shape (9,), with mu and beta within pi of those of `near`.

        Raises:
            SingularConfigurationError: If the motor angles do not determine the star.
            WorkspaceError: With `near`, if there is no solution.

        Example:
            >>> near = robot.forward_kinematics([0.8, 0.8, 0.8], near=robot.home)
            >>> near.round(3)
            array([0.8  , 1.591, 0.616, 0.8  , 1.591, 0.616, 0.8  , 1.591, 0.616])
        """
        gamma = single_array("gamma", gamma, (3,))
        geometry = self.geometry
        u = kinematics.passive_axes(geometry, gamma)
        R = direct_kinematics.orientations(u, geometry.arc_normals)
        solutions = kinematics.joints_of_actuated(geometry, gamma, R)
        if near is None:
            # Sorted by the entries of the first two columns of R, which determine R. They are
            # rounded, so that the order is the same on each machine.
            entries = np.round(R[:, :, :2].reshape(-1, 6), 9)
            return solutions[np.lexsort(entries.T)]
        if not len(solutions):
            raise WorkspaceError(f"no assembly exists at gamma = {gamma.tolist()} rad")
        before = single_array("near", near, (9,))
        changes = in_one_turn(solutions - before)  # in (-pi, pi]
        closest = np.abs(changes).max(axis=1).argmin()
        q: Array = before + changes[closest]
        q[::3] = gamma
        return q

    def platform_orientation(self, q: ArrayLike) -> Array:
        """Orientation R of {E} in the base by leg 1, shape (..., 3, 3); its first column is s."""
        return kinematics.orientation_of_joints(self.geometry, finite_array("q", q, (9,)))

    def platform_velocity(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Angular velocity of the star, base axes, shape (..., 3), [rad/s], Eq. (62)."""
        J = self.frame_jacobian(q, "closedloop1_A")[..., 3:, :]
        return np.einsum("...ij,...j->...i", J, finite_array("va", va, (3,)))

    def branch(self, q: ArrayLike) -> NDArray[np.int_]:
        """Sign of sin(mu_k) for each leg, shape (..., 3)."""
        return np.where(np.sin(finite_array("q", q, (9,))[..., 1::3]) < 0, -1, 1)

    def singularities(self, q: ArrayLike) -> Singularities:
        """Distance to the singularities of both kinds."""
        legs = kinematics.legs_of_joints(self.geometry, finite_array("q", q, (9,)))
        values = np.asarray(np.linalg.svd(legs.y_2, compute_uv=False), dtype=float)
        largest = values[..., 0]
        smallest = values[..., -1]
        with np.errstate(divide="ignore"):
            return Singularities(np.abs(legs.sin_mu).min(axis=-1), smallest, largest / smallest)

    def singularity_measures(self, q: ArrayLike) -> dict[str, Array]:
        """Condition number of A (second kind) and 1 / min |sin(mu_k)| (first kind)."""
        sine, _, condition = self.singularities(q)
        with np.errstate(divide="ignore"):
            first = np.asarray(1 / sine)
        return {
            "singularity (second kind), cond A": condition,
            "singularity (first kind), 1 / min |sin mu_k|": first,
        }

    @property
    def star_radius(self) -> float:
        """Distance OE, [m]; the paper's value if the model has no frame E."""
        model = self.mechanism.model
        if not model.existFrame("E"):
            return Parameters().star_radius
        return float(np.linalg.norm(frame_named(model, "E").placement.translation))

    @property
    def appearance(self) -> Appearance:
        """Parts of pictures: axes e_1..9, frames {0k}..{3k} and {E}, the path of E."""
        return star_appearance.appearance_of(self.geometry, self.star_radius)

    # --- methods that `ClosedChain` calls -----------------------------------------------------

    def _fill(self, model: pin.Model, recipe: partial[Mechanism]) -> None:
        """Set the tree and the engine; an edited model that is no SST is refused."""
        geometry_of(model, f"model {model.name}")
        super()._fill(model, recipe)

    def _solutions(self, positions: Mapping[str, float]) -> Array | None:
        """All assembly modes with these positions; None if they are not those of all motors."""
        if set(positions) != set(MOTOR_NAMES):
            return None
        return self.forward_kinematics([positions[name] for name in MOTOR_NAMES])

    def _findings(self, engine: Engine, t: Array, q: Array) -> Iterable[Finding]:
        """The findings of `check_limits` at configurations of shape (N, 9) at times t."""
        return arc_limits.findings(engine.mechanism.model, _geometry_of_engine(engine), t, q)


class _InversePose(NamedTuple):
    """Inverse kinematics of orientations of the star."""

    legs: kinematics.Legs  #: Axes of the legs.
    q: Array  #: Joint angles, shape (..., 9).


def _inverse_pose(
    engine: Engine, name: str, rotation: ArrayLike, branch: ArrayLike
) -> _InversePose:
    """Inverse kinematics; angles beyond the limits are refused.

    `name` is the name of the argument `rotation`, for messages.
    """
    R = finite_array(name, rotation, (3, 3))
    kinematics.require_rotation(R, name)
    signs = finite_array("branch", branch, (3,))
    if not (np.abs(signs) == 1).all():
        problem = f"{np.asarray(branch).tolist()}: each entry must be +1 or -1"
        raise InputError("branch", problem)
    geometry = _geometry_of_engine(engine)
    legs = kinematics.legs_of_orientation(geometry, R, signs)
    q = kinematics.joints_of_legs(geometry, legs)
    _require_limits(engine.mechanism.model, q)
    return _InversePose(legs, q)


def _require_limits(model: pin.Model, q: Array) -> None:
    """Refuse configurations, shape (..., 9), beyond the limits of the joints."""
    lower = model.lowerPositionLimit
    upper = model.upperPositionLimit
    outside = (q < lower) | (q > upper)
    if outside.any():
        first = tuple(np.argwhere(outside)[0])
        joint = int(first[-1])
        problem = (
            f"the orientation is out of reach: {model.names[joint + 1]} would be "
            f"{q[first]:.4g} rad, its limits are {lower[joint]:.4g} and {upper[joint]:.4g} rad"
        )
        raise of_samples(WorkspaceError(problem), outside.any(axis=-1))
