# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedChain`, the class of all robots: it checks arguments and calls the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import pinocchio as pin
from numpy.typing import ArrayLike

from .arrays import RAISE, Array, positive_number, require_flags, single_array
from .arrays import names as names_of
from .dynamics import derivatives as slopes
from .dynamics import design_derivatives as design
from .dynamics import dynamics, reactions, regressor, torque_sharing
from .engine import DerivativeOptions, Engine, LoadOptions, Options
from .engine_arguments import Wrenches
from .errors import DescriptionError, InputError, MissingExtraError
from .former_names import FormerName, former_arguments
from .loops.assembly_modes import AssemblyModes, modes_of
from .loops.coordinates import with_chosen_coordinates
from .loops.frame_guide import frame_configurations
from .loops.geometry_correction import correct_geometry
from .loops.mobility import Mobility
from .loops.start import assemble, start_of
from .model.checks import Motor, coordinates_of, copied, recipe_of
from .model.closures import Constraint
from .model.contacts import Contact, Rope
from .model.geometry import lengthened, take_placements
from .model.lines import LineForce
from .model.locked_joints import without_locked
from .model.mechanism import Mechanism
from .model.robot_properties import RobotProperties
from .model.weight_shares import Share, checked_shares
from .simulation import energy
from .summaries import Summary, listed

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .compiled.casadi_functions import CasadiFunctions
    from .compiled.warp_batch import WarpBatch
    from .reading import RobotFile
    from .simulation.bearing_loads import Loads
    from .simulation.check import Finding
    from .simulation.crossings import Crossing
    from .simulation.inputs import ExternalLoad, Torque, WrenchLoad
    from .simulation.nonsmooth_rollout import NonsmoothRollout
    from .simulation.rollouts import Rollout
    from .simulation.trajectories import Trajectory
    from .viewer import Viewer

_Chain = TypeVar("_Chain", bound="ClosedChain")


class ClosedChain(RobotProperties, Summary):
    """A robot with closed loops.

    Results depend on the robot and on the arguments, never on the calls before. Edits to `model`
    take effect after `refresh()`. Methods can be called from several threads. Many methods share
    these arguments, whose leading axes broadcast:

    - `q`: configurations with closed loops in the format of Pinocchio, shape (..., nq).
    - `va`, `aa`: rates and accelerations of the `coordinates`, shape (..., n).
    - `tau`: motor torques in the order of `motor_names`, shape (..., motors), [N m] or [N].
    - `frame`: name of a frame of the tree.
    - `platform_moment`: external moment on the platform, in base axes, shape (..., 3), [N m]. The
      platform is the body of the frame "platform"; of an SST it is the star.
    - `external_wrenches`: [force; moment] on each body at its mass centre, in base axes, bodies in
      the order of the joints, shape (..., r, 6). Or a mapping from names of frames to [force;
      moment] at the origin of the frame, in base axes, shapes (..., 6).
    - `sign_width`: derivatives replace the sign of a rate v in Coulomb friction by
      tanh(v / sign_width); positive, 1e-3 by default, [rad/s] or [m/s].
    - `out`: float64 array for the result, of its shape.
    - `threads`: number of threads for a batch in compiled kernels, 1 by default; the reference path
      uses one.
    - `on_error`: "raise" (default), or "nan" to set the results of bad samples to NaN.

    Methods raise `InputError` (wrong shape, a number that is not finite), `ClosureError` (the loops
    are open at q), `SingularConfigurationError` (the coordinates do not determine the motion at q),
    `ActuationError` (the motors cannot produce it) and `UnknownNameError`, on both paths. In a
    batch the error names the samples.

    Args:
        model: The tree, which is copied; the property `model` is the robot's own tree.
        closures: `Closure`, `Distance`, `Coupling`, `Rolling`, or pairs of names of frames that
            must coincide; none for an open tree.
        actuated: The motors: names of joints and of `lines`. A motor that drives several of them,
            such as a tendon, is a mapping from their names to factors, or {motor name: mapping}.
        coordinates: Names of the independent joints; a joint with several rates counts with all
            of them. By default as many of the actuated joints as are independent at `home` or,
            without one, at an assembled configuration, and other joints if these are too few.
        locked: Names of joints, or of single rates (see `rate_names`), that are fixed at
            `pin.neutral`, or a mapping from them to their positions. If only some rates of a joint
            are locked, each other rate becomes a joint of its own, named as in `rate_names`: first
            slides, then turns.
        viscous_friction: D of each rate, shape (nv,); that of the model by default.
        coulomb_friction: F_c of each rate, shape (nv,); that of the model by default.
        stiffness: Stiffness of joint springs, shape (nv,), [N m/rad] or [N/m]; zero by default.
        spring_reference: Positions without spring force, shape (nq,); `pin.neutral` by default.
        lines: Springs, dampers and cylinders between two frames, each a `LineForce`.
        brakes: Names of joints, single rates or lines that are held where they are, at any
            position. Braked joints stay in q, and `reactions` has the forces of brakes. A robot
            with all its motors braked has no degrees of freedom; pass [] for va and aa.
        contacts: Each a `Contact` or a `Rope`; they act in `rollout(..., nonsmooth=True)` only.
        weight_shares: Share of its weight that acts on a body, by the name of its joint; 0 for none
            and 1, the default, for the whole weight. It can also be [share, x, y, z]: then the
            first moment of the weight about the mass centre is the mass times [x, y, z], in the
            axes of the joint, [m]. Shares stay as masses and mass centres change.

    Raises:
        DescriptionError: If the model cannot be used, as with two joints of one name.

    Example:
        >>> sst_pin.ClosedChain(chain.model, chain.closures, ["crank"]).degrees_of_freedom
        1
    """

    #: For `visual_model`: shapes, or a function that loads them.
    _shapes: pin.GeometryModel | Callable[[pin.Model], pin.GeometryModel] = pin.GeometryModel()
    #: Name of the frame whose body is the platform.
    _platform = "platform"
    _engine: Engine

    path = FormerName("backend")
    check = FormerName("check_limits")

    @former_arguments(forces="lines")
    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Constraint | tuple[str, str]],
        actuated: Sequence[Motor],
        *,
        coordinates: Sequence[str] | None = None,
        locked: Sequence[str] | Mapping[str, float] = (),
        viscous_friction: ArrayLike | None = None,
        coulomb_friction: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        spring_reference: ArrayLike | None = None,
        lines: Sequence[LineForce] = (),
        brakes: Sequence[str] = (),
        contacts: Sequence[Contact | Rope] = (),
        weight_shares: Mapping[str, Share] = MappingProxyType({}),
    ) -> None:
        _require_model(model)
        tree = copied(model)
        shares = checked_shares(weight_shares)
        if locked:
            tree, shares = without_locked(tree, locked, shares)
        recipe = recipe_of(
            closures,
            actuated,
            coordinates,
            lines,
            brakes,
            contacts,
            shares,
            viscous_friction=viscous_friction,
            coulomb_friction=coulomb_friction,
            stiffness=stiffness,
            spring_reference=spring_reference,
        )
        self._fill(tree, recipe)

    def _fill(self, model: pin.Model, recipe: partial[Mechanism]) -> None:
        """Set the tree `model` and all that follows from it: corrected placements and the engine.

        `recipe` is a function that makes a mechanism of a tree; see `recipe_of`. The engine
        computes with a copy of the tree, so that edits of `model` take effect after `refresh` only.
        If this robot had kernels, they are made again at their first use.
        """
        make_kernels = self._engine.make_kernels if hasattr(self, "_engine") else None
        self._model = model
        self._recipe = recipe
        corrected = correct_geometry(recipe(copied(model)))
        take_placements(model, corrected.model)
        self._engine = Engine(
            with_chosen_coordinates(corrected), make_kernels, platform=self._platform
        )

    def refresh(self) -> None:
        """Apply all edits of `model` and choose the coordinates again, as the constructor does.

        Calls that run in other threads finish with the robot as it was.
        """
        self._fill(self._model, self._recipe)

    def with_coordinates(self, coordinates: Sequence[str] | None) -> ClosedChain:
        """This robot with other coordinates, on the reference path; None for the default choice."""
        names = None if coordinates is None else coordinates_of(coordinates)
        return self._rebuilt(pin.Model(self.engine.mechanism.model), coordinates=names)

    def with_brakes(self, names: Sequence[str]) -> ClosedChain:
        """This robot with brakes at these joints, rates or lines only, on the reference path.

        Its coordinates are chosen again; `brakes` of the constructor says what brakes do.

        Example:
            >>> held = chain.with_brakes(["crank"])
            >>> held.degrees_of_freedom, held.reactions(held.home).brakes["crank"].round(3)
            (0, np.float64(0.16))
        """
        brakes = names_of("brakes", names)
        model = pin.Model(self.engine.mechanism.model)
        return self._rebuilt(model, brakes=brakes, coordinates=None)

    def with_model(self, model: pin.Model) -> ClosedChain:
        """This robot with another tree of the same joints and frames, on the reference path."""
        _require_model(model)
        return self._rebuilt(copied(model))

    def _rebuilt(self, model: pin.Model, **changes: object) -> ClosedChain:
        """A robot with this model, and with these arguments of the recipe changed."""
        chain = ClosedChain.__new__(ClosedChain)
        chain._shapes = self._shapes
        chain._platform = self._platform
        chain._fill(model, partial(self._recipe, **changes))
        return chain

    def with_parameters(self: _Chain, theta: ArrayLike | Mapping[str, float]) -> _Chain:
        """A new robot with other dynamic parameters, of the same class and on the same path.

        `theta` are all `dynamic_parameters`, shape (p,), or some by name. Values that a chain
        cannot store raise an `InputError`; negative masses are allowed. A change of the mass alone
        is a `DescriptionWarning`; see `dynamic_parameters.scale_mass`.
        """
        chain = copy(self)
        # `numbers` are viscous_friction, coulomb_friction, stiffness and spring_reference.
        model, numbers, lines = regressor.changed(chain.engine.mechanism, theta)
        chain._fill(model, partial(chain._recipe, numbers=numbers, lines=lines))
        return chain

    def __copy__(self: _Chain) -> _Chain:
        """A robot with the same model and engine; `refresh` or `compile` changes only one."""
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Pinocchio ends the process when an unpickled model with mimic joints is used; a copy of
        # the model works.
        self.__dict__.update(state, _model=pin.Model(state["_model"]))

    # --- what it is -------------------------------------------------------------------------

    @property
    def model(self) -> pin.Model:
        """The robot's own tree, with corrected placements; edits take effect after `refresh()`.

        The constructor copies the tree that it is given, and corrects rounded placements in
        overconstrained loops, so that Pinocchio computes the same frames with this tree.
        """
        return self._model

    @property
    def engine(self) -> Engine:
        """The immutable object that computes; `refresh` and `compile` replace it."""
        return self._engine

    @property
    def mechanism(self) -> Mechanism:
        """A copy of the tree, with closures, coordinates, motors and forces."""
        return self._engine.mechanism

    @property
    def dynamic_parameters(self) -> regressor.DynamicParameters:
        """Parameters of bodies, joints, lines and motors; the regressor has a column for each."""
        return regressor.parameters_of(self.mechanism)

    @property
    def backend(self) -> str:
        """Whether compiled kernels or the reference path compute the dynamics, and why."""
        return self._engine.backend

    @property
    def home(self) -> Array:
        """`model.referenceConfigurations["home"]`, shape (nq,), with closed loops.

        It comes from the SRDF beside a URDF, from the keyframe `home` of an MJCF, or from you. Open
        loops are closed with fixed coordinates. Without a home it raises a `DescriptionError`.
        """
        q = self._engine.loops.home
        if q is None:
            cure = "write group_state home in an SRDF beside the URDF, the keyframe home in an "
            cure += "MJCF, or assemble(guess) q, set "
            cure += 'model.referenceConfigurations["home"] = q and call refresh()'
            problems = [f"no configuration is named home; {cure}"]
            raise DescriptionError(f"model {self.mechanism.model.name}", problems)
        return q.copy()

    # --- closing the loops ------------------------------------------------------------------

    def residual(self, q: ArrayLike) -> Array:
        """f(q) of Eq. (2), zero if the loops are closed, shape (..., rows), [m] and [rad]."""
        return self._engine.loops.residuals(self._engine.loops.configurations(q))

    def Phi(self, q: ArrayLike) -> Array:
        """Constraint Jacobian with all rows, also redundant ones, Eqs. (3), (4); (rows, nv)."""
        return self._engine.loops.at(q).Phi

    def Phi_dot(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """Rate of `Phi` for rates of all joints that keep the loops closed, shape (rows, nv)."""
        v = single_array("q_dot", q_dot, (self.mechanism.model.nv,))
        return self._engine.loops.at(q).Phi_dot(v)

    def condition_number(self, q: ArrayLike) -> Array:
        """Condition number of the columns of Phi for the dependent joints, shape (...).

        It is free of units, and infinite if the coordinates do not determine the motion. The result
        is the largest over all loops. A loop with one dependent rate has one singular value; it is
        compared with that at a generic configuration.
        """
        return self._engine.loops.condition_numbers(self._engine.loops.configurations(q))

    def singularity_measures(self, q: ArrayLike) -> dict[str, Array]:
        """Numbers that grow without bound towards a singularity, by name; shapes (...)."""
        return {"dependent joints": self.condition_number(q)}

    def assemble(
        self,
        q: ArrayLike | Mapping[str, float],
        fixed: Sequence[str] | None = None,
        *,
        tries: int = 1,
        seed: int = 0,
        limits: bool = False,
    ) -> Array:
        """Close the loops of a guess by Newton's method: configurations near it, shape (..., nq).

        Args:
            q: Guesses, shape (..., nq); with quaternions also the displacement from `pin.neutral`,
                shape (..., nv). Or positions by the names of joints, [rad] or [m]; the other joints
                start from home, else from zero. If only coordinates are named, they are moved from
                home, in its assembly mode. Without a home, a `DescriptionWarning` says if the mode
                had to be chosen.
            fixed: Names of joints that keep their position, () for none. By default the
                coordinates; if q names joints that are no coordinates, the joints named.
            tries: Number of starts: the guess, then random configurations around it, by `seed`.
            limits: Whether joints with one coordinate must stay within the limits of the model.

        Example:
            >>> chain.assemble({"crank": 0.3})[0].round(3)
            np.float64(0.3)
        """
        return assemble(self._engine, q, fixed, tries, seed, limits)

    def assembly_modes(
        self, positions: Mapping[str, float], frame: str | None = None
    ) -> AssemblyModes:
        """Closed configurations with joints at these positions, one for each assembly mode.

        The positions must leave no degree of freedom. Planar dyads and the SST have
        closed forms. Other robots are searched from many starts, which can miss modes.

        Args:
            positions: Positions by the names of joints, [rad] or [m].
            frame: Configurations with one pose of this frame count as one mode. Without it, a
                universal joint that flips makes another mode.

        Example:
            >>> modes = chain.assembly_modes({"crank": 0.3})
            >>> modes.q.shape, modes.branches.tolist(), modes.complete
            ((2, 3), [[-1], [1]], True)
        """
        if not isinstance(positions, Mapping):
            raise InputError(
                "positions", f"{positions!r}: a mapping of names to positions is needed"
            )
        solutions = self._solutions(positions)
        return modes_of(self._engine.loops.assembly, positions, frame, solutions)

    def _solutions(self, positions: Mapping[str, float]) -> Array | None:
        """All modes, shape (modes, nq), by a closed form for the whole robot; None without one."""
        return None

    def generic_configuration(self) -> Array:
        """A closed configuration without symmetry, near `home` if there is one, shape (nq,)."""
        return self._engine.loops.example()

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """Degrees of freedom, redundant closure constraints, and whether the motors suffice.

        The report is about q, shape (nq,), or `generic_configuration()`; `print` shows it as text.
        """
        return self._engine.loops.mobility(q)

    # --- kinematics -------------------------------------------------------------------------

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints, v = L va, Eq. (16), shape (..., nv)."""
        return self._engine.joint_rates(q, va)

    def joint_accelerations(self, q: ArrayLike, va: ArrayLike, aa: ArrayLike) -> Array:
        """Accelerations of all joints, L aa + L_dot va, Eqs. (8), (20), shape (..., nv)."""
        return self._engine.joint_accelerations(q, va, aa)

    def frame_placement(self, q: ArrayLike, frame: str) -> tuple[Array, Array]:
        """Position, shape (..., 3), [m], and orientation, (..., 3, 3), of a frame in the base."""
        poses = self._engine.loops.placements(q, frame)
        return poses[..., :3, 3], poses[..., :3, :3]

    def frame_configuration(
        self,
        frame: str,
        position: ArrayLike | None,
        rotation: ArrayLike | None = None,
        start: ArrayLike | None = None,
    ) -> Array:
        """Inverse kinematics: configurations q that put a frame there, shape (..., nq).

        The frame moves straight to the pose, in the assembly and working mode of the start. With
        more degrees of freedom than the pose needs, the joints move least. Joint limits are
        ignored; `check_limits(q)` names joints beyond them.

        Args:
            position: Of the frame's origin in the base, shape (..., 3), [m]; None for any.
            rotation: Orientation in the base, shape (..., 3, 3); None for any.
            start: Shape (..., nq); open loops are closed first. By default `home`, else a
                configuration near zero.

        Raises:
            WorkspaceError: If the pose is out of reach; the message says how far, [m] and [rad].

        Example:
            >>> lift = sst_pin.robots.five_bar()
            >>> q = lift.frame_configuration("platform", [0.02, 0.1, 0.0])
            >>> lift.frame_placement(q, "platform")[0].round(3)
            array([0.02, 0.1 , 0.  ])
        """
        loops = self._engine.loops
        if start is None:
            start = start_of(self._engine)
        return frame_configurations(
            loops.assembly, loops.example(), frame, position, rotation, start
        )

    def frame_jacobian(self, q: ArrayLike, frame: str, **options: Unpack[Options]) -> Array:
        """J, shape (..., 6, n): a frame's [linear; angular] velocity J va, in base axes."""
        return self._engine.frame_jacobian(q, frame, **options)

    def frame_jacobian_rate(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> Array:
        """Rate of `frame_jacobian` along a motion, shape (..., 6, n)."""
        return self._engine.frame_jacobian_rate(q, va, frame, **options)

    def frame_drift(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> Array:
        """[linear; angular] acceleration of a frame for aa = 0, J_dot va, shape (..., 6)."""
        return self._engine.frame_drift(q, va, frame, **options)

    def frame_velocity_derivatives(
        self, q: ArrayLike, va: ArrayLike, frame: str, **options: Unpack[Options]
    ) -> slopes.FrameVelocityDerivatives:
        """Derivatives of a frame's velocity J va: `.dq` and `.dva`, shapes (..., 6, n).

        They are taken as in `torque_derivatives`; `out` has both side by side, (..., 6, 2 n).
        """
        return self._engine.frame_velocity_derivatives(q, va, frame, **options)

    def motor_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of the motors, shape (..., motors)."""
        return energy.motor_rates(self._engine, q, va)

    def actuator_jacobian(self, q: ArrayLike) -> Array:
        """J, shape (..., motors, n): the motors' rates are J va, and f = J^T tau."""
        return self._engine.actuator_jacobian(q)

    def line_lengths(self, q: ArrayLike) -> Array:
        """Lengths of the `lines`, shape (..., lines), [m]; q may have open loops."""
        return self._engine.line_lengths(q)

    # --- dynamics ---------------------------------------------------------------------------

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: Wrenches | None = None,
        weights: ArrayLike | None = None,
        preload: ArrayLike | None = None,
        limits: ArrayLike | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics, Eq. (92): the motor torques tau of a motion, shape (..., motors).

        With more motors than degrees of freedom these are the smallest torques for the motion,
        unless a preload is given; where they exceed limits, the nearest ones within.

        Args:
            weights: Weights of the squared torques, positive, shape (motors,); one by default, so
                that 1 N in a slide counts as 1 N m in a hinge.
            preload: Torques along `preload_directions`, shape (..., k), which are added.
            limits: Largest sizes of the torques, shape (motors,), or least and largest ones, shape
                (motors, 2); infinite for none. Motions that need more raise an `ActuationError`.

        Example:
            >>> chain.compute_torques(chain.home, [1], [0]).round(3)
            array([0.166])
        """
        engine = self._engine
        # The kernel is called with unchecked arguments, because checks would take longer than the
        # kernel. For wrong arguments it returns None, and the checks of `engine.torques` find the
        # reason. `is` is faster than `==`; where it fails, only time is lost.
        is_plain = weights is None and preload is None and limits is None
        kernel = None
        if is_plain and external_wrenches is None and on_error is RAISE:
            kernel = engine.torque_kernel
        if kernel is not None:
            tau = kernel(q, va, aa, platform_moment, out, threads)
            if tau is not None:
                return tau
        is_shared = preload is not None or limits is not None  # `out` then gets the final torques
        tau = engine.torques(
            q,
            va,
            aa,
            platform_moment=platform_moment,
            external_wrenches=external_wrenches,
            weights=weights,
            out=None if is_shared else out,
            threads=threads,
            on_error=on_error,
            ask_kernel=kernel is None,
        )
        if not is_shared:
            return tau
        directions = engine.preload_directions(q, on_error)
        return torque_sharing.shared_torques(
            engine.mechanism, tau, directions, preload, limits, weights, on_error=on_error, out=out
        )

    def generalized_forces(
        self, q: ArrayLike, va: ArrayLike, aa: ArrayLike, **options: Unpack[LoadOptions]
    ) -> Array:
        """f, shape (..., n): L^T times the joint forces that a motion needs, [N m] or [N]."""
        engine = self._engine
        kernel = None if options else engine.force_kernel
        if kernel is not None:  # as in `compute_torques`
            f = kernel(q, va, aa, None, None, 1)
            if f is not None:
                return f
        return engine.generalized_forces(q, va, aa, ask_kernel=kernel is None, **options)

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: Wrenches | None = None,
        out: Array | None = None,
        threads: int = 1,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics, Eq. (92): accelerations aa of the coordinates, shape (..., n)."""
        engine = self._engine
        kernel = None
        if external_wrenches is None and on_error is RAISE:
            kernel = engine.acceleration_kernel
        if kernel is not None:  # as in `compute_torques`
            aa = kernel(q, va, tau, platform_moment, out, threads)
            if aa is not None:
                return aa
        return engine.accelerations(
            q,
            va,
            tau,
            platform_moment=platform_moment,
            external_wrenches=external_wrenches,
            out=out,
            threads=threads,
            on_error=on_error,
            ask_kernel=kernel is None,
        )

    def noc(self, q: ArrayLike, va: ArrayLike) -> dynamics.Terms:
        """All matrices of the paper at one state: f = I aa + C va - tau^g - tau^f - springs."""
        engine = self._engine
        rates = single_array("va", va, (len(engine.mechanism.coordinates),))
        return dynamics.terms(engine.reference.context, engine.loops.single(q), rates)

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, **options: Unpack[Options]
    ) -> dynamics.ReducedTerms:
        """Mass matrix, Coriolis matrix, gravity and friction in the coordinates, Eqs. (93)-(96)."""
        return self._engine.reduced_terms(q, va, **options)

    def reactions(
        self,
        q: ArrayLike,
        va: ArrayLike | None = None,
        aa: ArrayLike | None = None,
        *,
        tau: ArrayLike | None = None,
        stiffness: Mapping[str, ArrayLike] | None = None,
        axes: ArrayLike | None = None,
        **options: Unpack[LoadOptions],
    ) -> reactions.Reactions:
        """Wrenches in all joints and closures; components that are not unique are NaN.

        `reactions(q)` is about the robot at rest.

        Args:
            va: Zero by default.
            aa: If absent, the accelerations follow from tau; zero if va and tau are absent too.
            tau: If absent, the torques are the smallest for the motion.
            stiffness: Makes reactions of an overconstrained robot unique: by the name of a joint or
                closure, stiffnesses along x, y, z [N/m] and about x, y, z [N m/rad] in the axes of
                its wrench, infinite where it is rigid. Joints without one are rigid.
            axes: Axes in the base in which all wrenches are written, in columns, shape (3, 3); by
                default those of each joint. Forces in the plane of a planar robot are unique in
                axes along the plane; an oblique axis mixes them with forces across it.
            options: Loads, and `out` of shape (..., r + closures, 6) for the wrenches in joints,
                then in closures, in the order of `names`.
        """
        at_rest = [0.0] * len(self.mechanism.coordinates)
        if va is None and aa is None and tau is None:
            aa = at_rest
        return self._engine.reactions(
            q, at_rest if va is None else va, aa, tau, stiffness, axes, **options
        )

    def preload_directions(self, q: ArrayLike) -> Array:
        """Orthonormal motor torques that stress the robot without moving it, (..., motors, k).

        They vary continuously along the last axis of a batch; `mobility().inner_stresses` is k.
        """
        return self._engine.preload_directions(q)

    def torque_regressor(
        self, q: ArrayLike, va: ArrayLike, aa: ArrayLike, **options: Unpack[Options]
    ) -> Array:
        """Y, shape (..., n, p): `generalized_forces` are Y times the `dynamic_parameters`.

        References of springs and rest lengths of lines are those of this robot.
        """
        return self._engine.torque_regressor(q, va, aa, **options)

    def kinetic_energy(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Kinetic energy, shape (...), [J]."""
        return energy.kinetic_energy(self._engine, q, va)

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy of weights, springs and lines, shape (...), [J].

        It is zero with all masses at the origin, springs at their reference, lines at rest length.
        """
        return energy.potential_energy(self._engine, q)

    def friction_power(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Power of friction in all joints, Eq. (87), and of dampers, shape (...), [W]."""
        return energy.friction_power(self._engine, q, va)

    # --- derivatives ------------------------------------------------------------------------

    def torque_derivatives(
        self, q: ArrayLike, va: ArrayLike, aa: ArrayLike, **options: Unpack[DerivativeOptions]
    ) -> slopes.TorqueDerivatives:
        """Derivatives of `generalized_forces`; of the torques if motor k is coordinate k.

        They are taken along the motions that keep the loops closed, with friction smoothed by
        `sign_width`; docs/derivatives.md. `.dq`, `.dva`, `.daa` have shapes (..., n, n); column k
        of dq: q moves by L e_k. `out` has them side by side, shape (..., n, 3 n).
        """
        return self._engine.torque_derivatives(q, va, aa, **options)

    def acceleration_derivatives(
        self, q: ArrayLike, va: ArrayLike, tau: ArrayLike, **options: Unpack[DerivativeOptions]
    ) -> slopes.AccelerationDerivatives:
        """Derivatives of `compute_accelerations`, taken as `torque_derivatives`.

        `.dq`, `.dva` have shapes (..., n, n), `.dtau` has (..., n, motors); `out` has them side by
        side, shape (..., n, 2 n + motors).
        """
        return self._engine.acceleration_derivatives(q, va, tau, **options)

    def linearize(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        dt: float | None = None,
        **options: Unpack[DerivativeOptions],
    ) -> tuple[Array, Array]:
        """A, shape (..., 2 n, 2 n), and B, shape (..., 2 n, motors), of x' = A x + B u at a state.

        x is the deviation of the coordinates and of va, u is the deviation of the torques.

        Args:
            dt: Step of the discrete system x_next = A x + B u with constant u, [s]: the matrix
                exponential, exact for the linear system. None for the continuous system.
        """
        engine = self._engine
        d = engine.acceleration_derivatives(q, va, tau, **options)
        # Deviations of the coordinates are displacements along their axes. Where axes move, as
        # those of balls, the rates of the displacements have a further term.
        rates = None
        if engine.reference.derivatives.axes_move:
            rates = engine.displacement_rates(q, va, on_error="nan")
        A, B = slopes.linear_system(d, rates)
        return (A, B) if dt is None else slopes.discrete(A, B, positive_number("dt", dt))

    # --- design -----------------------------------------------------------------------------

    @property
    def design_parameters(self) -> tuple[str, ...]:
        """Names of lengths, placements, masses and mass centres that a designer can change.

        - `<joint>.length`: the length of the link behind this joint, if it ends at one point.
        - `<frame> - <frame>.length`: the length of the rod of a `Distance` closure.
        - `<place>.x`, `.y`, `.z`, `.rx`, `.ry`, `.rz`: displacements of a joint with all behind
          it, or of a frame of a closure or line: along the axes of its link, [m], and about its
          own axes, [rad].
        - `dynamic_parameters`, such as `<joint>.mass`.
        """
        return design.names_of(self.mechanism)

    def with_design(self, changes: Mapping[str, float]) -> ClosedChain:
        """This robot with changes added to `design_parameters`, by names or patterns of these."""
        model, extensions, theta = design.changed(self.mechanism, changes)
        # The recipe has the closures of the constructor, without those that it makes for brakes.
        closures = lengthened(self._recipe.keywords["closures"], extensions)
        chain = self._rebuilt(model, coordinates=self.coordinates, closures=closures)
        return chain.with_parameters(theta) if theta else chain

    def design_derivatives(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        names: Iterable[design.Parameter],
        *,
        frame: str | None = None,
        external_wrenches: Wrenches | None = None,
        sign_width: float = 1e-3,
    ) -> design.DesignDerivatives:
        """Derivatives of q, torques, L and a frame's pose by `design_parameters`.

        The loops stay closed; each parameter alone must allow this. The coordinates, va, aa and
        the places of external wrenches on the bodies are constant. Wrenches at frames stay there.

        Args:
            names: Parameters, or patterns of names that change together, such as "rod*.length".
                Several names in a list, or a mapping to factors, are one parameter.

        Example:
            >>> d = chain.design_derivatives(chain.home, [1], [0], ["coupler.length"])
            >>> d.q.shape, d.torques.shape, d.L.shape
            ((3, 1), (1, 1), (3, 1, 1))
        """
        engine = self._engine
        width = positive_number("sign_width", sign_width)
        load = engine.arguments.wrenches(None, external_wrenches, "raise", q)
        at_frames = engine.arguments.frame_wrenches(external_wrenches)
        arrays = [*engine.arguments.state(q, va=va, aa=aa), load]
        return design.design_derivatives(engine.reference, names, arrays, at_frames, frame, width)

    # --- compiled kernels -------------------------------------------------------------------

    def compile(
        self,
        q: ArrayLike | None = None,
        *,
        derivatives: bool = False,
        all: bool = False,  # noqa: A002
    ) -> None:
        """Generate and compile kernels that compute this robot's dynamics from then on.

        The C compiler of the system (or of the package ziglang) compiles them, and the user's cache
        folder keeps them. Masses, friction and springs that are not zero can change without a new
        compilation. The reference path computes samples that fail a kernel's check.

        Args:
            q: Configuration on the closures, shape (nq,), around which the order of elimination is
                chosen; by default `generic_configuration()`.
            derivatives: Whether to compile the derivatives too. By default this is done at their
                first use, as for all other methods that have kernels; docs/batches.md lists these.
            all: Whether to compile all kernels except those of frames.

        Raises:
            CompilationError: Without a compiler, or if it fails.
            MissingExtraError: Without CasADi, `sst-pin[compile]`.
            DescriptionError: For a joint without compiled equations.
        """
        from .compiled.compiled_backend import compiled_engine

        engine = self._engine
        require_flags(derivatives=derivatives, all=all)
        compiled = compiled_engine(engine, q, derivatives=derivatives, every=all)
        if self._engine is not engine:  # another thread has refreshed the robot meanwhile
            return self.compile(q, derivatives=derivatives, all=all)
        self._engine = compiled
        return None

    def casadi(
        self,
        q: ArrayLike | None = None,
        *,
        external_wrenches: bool = False,
        sign_width: float = 1e-3,
        compiled: bool = False,
    ) -> CasadiFunctions:
        """The dynamics as CasADi functions, `.torques` and more; they do not check their input.

        Friction is smooth, as in derivatives. It needs the extra `sst-pin[compile]`.

        Args:
            q: As in `compile`.
            external_wrenches: Whether the dynamics have them as their last input, shape (r, 6).
            compiled: Whether the functions are compiled C code with derivatives of first order,
                cached as by `compile`; else they have derivatives of every order.
        """
        try:
            from .compiled.casadi_functions import CasadiFunctions
        except ModuleNotFoundError:
            raise MissingExtraError("casadi", "compile") from None
        engine = self._engine
        require_flags(external_wrenches=external_wrenches, compiled=compiled)
        width = positive_number("sign_width", sign_width)
        near = None if q is None else engine.loops.single(q)
        return CasadiFunctions(engine.reference, near, width, external_wrenches, compiled)

    def warp(
        self, device: Any = None, dtype: str = "float64", *, q: ArrayLike | None = None
    ) -> WarpBatch:
        """The dynamics of many samples on a GPU, by kernels of NVIDIA Warp; docs/gpu.md.

        The kernels check each sample, but hand none to the reference path: bad samples are NaN.

        Args:
            device: A device of Warp, such as "cuda:0" or "cpu"; its preferred one by default.
            dtype: "float64", or "float32" for five digits.
            q: As in `compile`.

        Raises:
            MissingExtraError: Without Warp and CasADi, `sst-pin[gpu]`.
        """
        try:
            from .compiled.warp_batch import WarpBatch
        except ModuleNotFoundError as error:
            raise MissingExtraError(str(error.name).partition(".")[0], "gpu") from None
        near = None if q is None else self._engine.loops.single(q)
        return WarpBatch(self._engine.reference, near, device, dtype)

    # --- motions ----------------------------------------------------------------------------

    def trajectory(
        self,
        t: ArrayLike,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        stopped: str = "",
        crossings: Sequence[Crossing] = (),
    ) -> Trajectory:
        """A `Trajectory` of this robot at increasing times t, shape (N,), [s].

        `tau` is computed by default. `stopped` says why the motion ended early, `crossings` which
        singular configurations it went through.
        """
        from .simulation.trajectories import trajectory_of

        if tau is None:
            tau = self.compute_torques(q, va, aa)
        return trajectory_of(self.mechanism, t, q, va, aa, tau, stopped, crossings)

    def simulate(
        self,
        torque: Torque,
        q0: ArrayLike,
        va0: ArrayLike,
        t: ArrayLike,
        *,
        platform_moment: ExternalLoad = None,
        external_wrenches: WrenchLoad = None,
        method: str = "DOP853",
        rtol: float = 1e-12,
        atol: float = 1e-12,
        max_condition_number: float = 1e4,
        through_singularities: bool = False,
        sign_width: float = 1e-3,
        progress: Callable[[float], None] | None = None,
        max_step: float | None = None,
    ) -> Trajectory:
        """Simulate the motion for given torques, with closed loops at all times.

        The motion ends early before a singularity of the mechanism, with a `SingularityWarning`;
        `stopped` says why. Where the coordinates do not determine it, other joints are integrated.

        Args:
            torque: A function (t, q, va) -> (motors,); a constant, shape (motors,); samples at t,
                shape (N, motors), or a `Trajectory` with its own times, both interpolated by a
                smooth spline; a controller; or a `SampledTorque`. Pass jumps as a function.
            q0: Configuration at t[0], on the closures, shape (nq,).
            va0: Rates of the coordinates at t[0], shape (n,). Where the coordinates are dependent,
                a motion can start from rest only.
            t: Times of the output, increasing, shape (N,), N >= 2, [s].
            platform_moment: A function (t, q, va) -> (3,), or a constant.
            external_wrenches: A function (t, q, va) -> (r, 6), a mapping from frames to wrenches, a
                function that returns one, or a constant.
            method: Integrator of SciPy: RK23, RK45, DOP853, Radau or BDF; the last two are for
                stiff motions.
            rtol: Relative tolerance of the integrator.
            atol: Absolute tolerance of the integrator, [rad], [rad/s].
            max_condition_number: The motion stops where the condition number of the dependent
                columns of Phi reaches this value, whichever joints are independent.
            through_singularities: Whether the motion continues smoothly through singular
                configurations, which `crossings` of the result lists. It stops where no branch is
                determined, as where it comes to rest.
            sign_width: Coulomb friction uses tanh(x / sign_width) instead of sign(x), [rad/s];
                joints that should stick move slowly.
            progress: Function that is called with the time reached.
            max_step: Longest step of the integrator, [s]. By default, where torques or loads are
                functions, a step is at most the spacing of `t`. These functions are evaluated
                eight times within each spacing. A push that is shorter than that can be missed.

        Raises:
            SimulationError: If the integrator fails.
        """
        from .simulation.settings import Settings
        from .simulation.simulation import simulate

        settings = Settings(
            method=method,
            rtol=rtol,
            atol=atol,
            max_condition_number=max_condition_number,
            through_singularities=through_singularities,
            progress=progress,
            max_step=max_step,
        )
        return simulate(
            self._engine,
            torque,
            q0,
            va0,
            t,
            platform_moment=platform_moment,
            external_wrenches=external_wrenches,
            sign_width=sign_width,
            settings=settings,
        )

    def rollout(
        self,
        tau: ArrayLike,
        q0: ArrayLike,
        va0: ArrayLike,
        dt: float,
        *,
        platform_moment: ArrayLike | None = None,
        external_wrenches: Wrenches | None = None,
        steps: int | None = None,
        sign_width: float = 1e-3,
        threads: int = 1,
        on_error: str = "raise",
        nonsmooth: bool = False,
        motor_stiffness: ArrayLike | None = None,
        motor_damping: ArrayLike | None = None,
        motor_positions: ArrayLike | None = None,
    ) -> Rollout | NonsmoothRollout:
        """Simulate many motions with a fixed step; the error is of fourth order in dt.

        It returns q, shape (..., N + 1, nq), and va, shape (..., N + 1, n). The loops stay closed,
        also through dead points of the coordinates. A motion that reaches a singularity of the
        mechanism, diverges or opens its loops (dt is too long) raises a `SimulationError`, or is
        NaN from there on. Loads are constant for each motion, in base axes; with wrenches at
        frames, the reference path computes.

        Args:
            tau: Motor torques, shape (..., N, motors), constant in each step. For torques that
                change with time, give `steps` = N and shape (..., 2 N + 1, motors): torques at the
                ends and in the middle of each step.
            q0: Initial configurations, on the closures, shape (..., nq).
            va0: Initial rates of the coordinates, shape (..., n).
            dt: Step, [s]; a negative step goes back in time.
            steps: Number of steps N; by default the number of torques.
            sign_width: As in `simulate`.
            nonsmooth: Whether joints stop at their limits (planar, ball and free joints have no
                stops), dry friction sticks, and `contacts` and `pulls_only` act; the result is a
                `NonsmoothRollout`. The error is then of first order in dt; torques are constant in
                each step; `sign_width` is not used.
            motor_stiffness: Gains of position control in the motors, shape (motors,), [N m/rad] or
                [N/m], for `nonsmooth`. They are implicit, stable for any step: the motors give tau
                + motor_stiffness (motor_positions - positions) - motor_damping times their rates.
            motor_damping: Gains of the rates, shape (motors,), [N m s/rad] or [N s/m].
            motor_positions: Positions to hold, shape (..., N, motors) or (motors,); by default
                those at q0. Positions are displacements of joints from `pin.neutral`, and lengths
                of lines, each times its factor.
        """
        from .simulation.nonsmooth_rollout import nonsmooth_rollout
        from .simulation.rollout_arguments import rollout_arguments
        from .simulation.rollouts import require_smooth, rollout

        arguments = rollout_arguments(
            self._engine,
            tau,
            q0,
            va0,
            dt,
            platform_moment=platform_moment,
            external_wrenches=external_wrenches,
            steps=steps,
            threads=threads,
            on_error=on_error,
        )
        require_flags(nonsmooth=nonsmooth)
        if nonsmooth:
            return nonsmooth_rollout(
                self._engine,
                arguments,
                motor_stiffness=motor_stiffness,
                motor_damping=motor_damping,
                motor_positions=motor_positions,
            )
        require_smooth(self._engine.mechanism)
        if any(x is not None for x in (motor_stiffness, motor_damping, motor_positions)):
            raise InputError("motor_stiffness, motor_damping", "only with nonsmooth=True")
        return rollout(self._engine, arguments, sign_width)

    def check_limits(self, motion: Trajectory | ArrayLike) -> tuple[Finding, ...]:
        """What leaves its limits along a motion, and nearby singularities, with times.

        Limits are those of joint positions and rates, of motor forces on joints, and of lines; an
        effort or velocity of 0 is none. The motion may be one configuration, shape (nq,), for
        which positions and lengths are judged. An SST has arcs as limits too.
        """
        from .simulation.check import findings_of_motion, samples_of
        from .simulation.trajectories import Trajectory

        engine = self._engine
        findings = [*self._findings(engine, *samples_of(engine.mechanism, motion))]
        if isinstance(motion, Trajectory):
            findings += findings_of_motion(engine, motion)
        return tuple(findings)

    def _findings(self, engine: Engine, t: Array, q: Array) -> Iterable[Finding]:
        """The findings of `check_limits` at configurations of shape (N, nq) at times t."""
        from .simulation.check import findings

        return findings(engine, t, q)

    def loads(
        self,
        motion: Trajectory,
        *,
        stiffness: Mapping[str, ArrayLike] | None = None,
        axes: ArrayLike | None = None,
    ) -> Loads:
        """Peaks, their times and means of the forces and moments in joints and closures.

        The motion is one under weights and its own torques; `stiffness` and `axes` as in
        `reactions`. Sizes that are not unique are NaN.
        """
        from .simulation.bearing_loads import loads

        return loads(self._engine, motion, stiffness, axes)

    # --- files and pictures -----------------------------------------------------------------

    @classmethod
    def from_urdf(
        cls: type[_Chain],
        path: str | Path,
        cuts: str | Path | None = None,
        *,
        actuated: Sequence[Motor] | None = None,
        locked: Sequence[str] = (),
        model: str | None = None,
    ) -> _Chain:
        """A robot from a URDF or SDF and a YAML file, the "extended URDF" of LAAS.

        The YAML lists closures, motors, forces, springs and more; docs/own_robot.md. Without
        closures there, frames `closing_NAME_1` and `closing_NAME_2` of the URDF close loops;
        without any the robot is an open tree. Without a YAML the motors are the joints of
        transmissions, or in an open tree all joints of one axis. An SRDF beside the file defines
        named configurations, such as `home`. The name of a link or a frame of the file is a frame
        of the chain.

        Args:
            path: The URDF, or an SDF, whose loops are closed; meshes are not needed.
            cuts: The YAML; by default the file beside the URDF with the ending .yaml.
            actuated: The motors, as in the constructor; those of the YAML by default.
            locked: Names of joints or rates that are fixed at zero. A locked motor is removed.
            model: The model of an SDF, by name; needed if several models move.

        Raises:
            DescriptionError: If a file cannot be read; the message lists all problems.

        Warns:
            DescriptionWarning: When an inertia is not physical or missing, a pose moves a locked
                joint, an element that acts is not read, limits are lost, or the YAML of an open
                tree may be missing.
        """
        from .reading import read_urdf

        return cls.from_description(read_urdf(path, cuts, locked, actuated, model=model))

    @classmethod
    def from_mjcf(
        cls: type[_Chain],
        path: str | Path,
        *,
        actuated: Sequence[Motor] | None = None,
        locked: Sequence[str] = (),
        contacts: bool = False,
    ) -> _Chain:
        """A robot from a MuJoCo file; its equalities close the loops; docs/existing_robots.md.

        The motors are the joints and tendons with an actuator; tau is the force in the joint or the
        tendon. In q the scalar of a quaternion is last, and linear rates of free joints are in body
        axes. Keyframes become `referenceConfigurations`, such as `home`.

        Args:
            path: The MJCF.
            actuated: The motors, as in the constructor; those of the file by default.
            locked: Joints or rates that are fixed at their reference. A joint without a name has
                the name of its body.
            contacts: Whether to read `contacts` too: spheres and corners of boxes against planes,
                and tendons with a largest length only as ropes. A `DescriptionWarning` names other
                pairs of shapes.

        Raises:
            MissingExtraError: Without MuJoCo, `sst-pin[mjcf]`.
            DescriptionError: If the file cannot be used; the message lists all problems.
        """
        from .reading.mjcf import read_mjcf

        return cls.from_description(read_mjcf(path, locked, actuated, contacts))

    @classmethod
    def from_description(cls: type[_Chain], description: RobotFile) -> _Chain:
        """A robot from the content of its files; errors name the files."""
        from .reading.robot_file import naming

        with naming(description.source):
            chain = cls(**description.arguments)
        chain._shapes = description.shapes
        return chain

    @property
    def visual_model(self) -> pin.GeometryModel:
        """Shapes of the bodies, loaded at each call; assign your own to replace them."""
        shapes = self._shapes
        return shapes(self.mechanism.model) if callable(shapes) else shapes

    @visual_model.setter
    def visual_model(self, shapes: pin.GeometryModel) -> None:
        if not isinstance(shapes, pin.GeometryModel):
            kind = type(shapes).__name__
            raise InputError("visual_model", f"a pinocchio.GeometryModel is needed, not {kind}")
        self._shapes = shapes

    def show(
        self,
        what: Trajectory | NonsmoothRollout | ArrayLike | None = None,
        *,
        speed: float = 1.0,
        open_browser: bool = True,
        reactions: bool | Mapping[str, ArrayLike] = False,
        live: bool = False,
        ghost: Trajectory | None = None,
        axes: bool = False,
        frames: bool = False,
        frame: str | None = None,
    ) -> Viewer:
        """Show a motion or a configuration in the browser, or in a Jupyter notebook.

        The viewer's `save` writes a page, a picture or an animation; `close` stops its server.

        Args:
            what: A motion, or a configuration, shape (nq,); by default the home pose. A motion of
                `rollout(..., nonsmooth=True)` is drawn with its contacts and their forces.
            speed: Speed of the animation; 1 is real time.
            open_browser: Whether to serve the page and open the browser; never from Jupyter.
            reactions: Whether arrows show the forces in joints and closures; or stiffnesses, as in
                `reactions`, where these are not unique.
            live: Whether the page also computes: the robot can be dragged, released and pushed,
                without a server, in one file.
            ghost: A second motion, which a translucent robot plays at the same times.
            axes: Whether the axes of the joints are shown at first.
            frames: Whether the frames of the closures are shown at first.
            frame: Name of the frame whose path is drawn; by default `platform`.

        Raises:
            UnknownNameError: For an unknown frame.
            MissingExtraError: Without the extra `sst-pin[viz]`.
            DescriptionError: If a mesh cannot be loaded, or a live page cannot be compiled.
        """
        from .viewer import Viewer, show

        viewer = Viewer(self, axes=axes, frames=frames, frame=frame, reactions=reactions, live=live)
        show(viewer, self, what, speed, open_browser, ghost)
        return viewer

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Rows of the printed robot."""
        model = self.mechanism.model
        names = [line.name for line in self.lines]
        lines = [("lines", f"{len(names)} ({listed(names)})")] if names else []
        with_shares = list(self.weight_shares)
        shares = [("weight_shares", listed(with_shares))] if with_shares else []
        return f"{type(self).__name__} {model.name}", [
            ("joints", f"{len(self.joint_names)} ({listed(self.joint_names)})"),
            ("closures", f"{len(self.closures)} ({listed([str(c) for c in self.closures], 3)})"),
            ("motors", f"{len(self.motor_names)} ({listed(self.motor_names)})"),
            *lines,
            *shares,
            ("sizes", f"nq = {model.nq}, nv = {model.nv}"),
            ("computed by", self.backend),
        ]


def _require_model(model: object) -> None:
    """Refuse an argument `model` that is not a tree."""
    if not isinstance(model, pin.Model):
        raise InputError("model", f"a pinocchio.Model is needed, not {type(model).__name__}")
