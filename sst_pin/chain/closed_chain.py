# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedChain`: the dynamics of any closed and driven Pinocchio tree."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from .. import reading
from ..arrays import as_array, finite_array, for_each_sample, single_array
from ..motion.mechanics import Mechanics
from . import dynamics
from .closed_tree import ClosedTree
from .closures import Closure

if TYPE_CHECKING:
    from ..motion.simulation import Load, Torque
    from ..motion.trajectories import Trajectory

Array = NDArray[np.float64]
_Chain = TypeVar("_Chain", bound="ClosedChain")


class ClosedChain(ClosedTree):
    """A robot with closed loops: its dynamics and its motion on top of its kinematics.

    Joint vectors `q` are in the order of `joint_names`, actuated ones (`va`, `aa`, `tau`) in the
    order given. Methods are safe to call from several threads.

    Args:
        model: A tree whose joints have one coordinate each; used as it is, not copied.
        closures: `Closure` objects, or pairs of frame names for frames that must coincide.
        actuated: Names of the motors' joints.
        viscous_friction: D of each joint, shape (m,); those of the model by default.
        coulomb_friction: F_c of each joint, shape (m,); those of the model by default.

    Raises:
        DescriptionError: For a joint with several coordinates, or without closures.
        UnknownNameError: For a joint or frame that is not in the model.
        ActuationError: When the joints outnumber motors and closure equations together.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: Sequence[Closure | tuple[str, str]],
        actuated: Sequence[str],
        *,
        viscous_friction: ArrayLike | None = None,
        coulomb_friction: ArrayLike | None = None,
    ) -> None:
        super().__init__(model, closures, actuated)
        viscous = model.damping if viscous_friction is None else viscous_friction
        coulomb = model.friction if coulomb_friction is None else coulomb_friction
        self.friction = dynamics.Friction(
            finite_array("viscous_friction", viscous, (model.nv,)).copy(),
            finite_array("coulomb_friction", coulomb, (model.nv,)).copy(),
        )

    @classmethod
    def from_urdf(cls: type[_Chain], path: str | Path, cuts: str | Path | None = None) -> _Chain:
        """A robot from a URDF and, beside it, what a URDF cannot say: the "extended URDF" of LAAS.

        A YAML file lists closures (`closed_loop`, pairs of frames, each with its `type`), motors
        (`name_mot`) and, where needed, `gravity` and joints that are in truth "FIXED", "SPHERICAL"
        or "UJOINT_XY" (`joint_name`, `joint_type`). A continuous joint becomes a revolute one, a
        spherical joint three, named `_X`, `_Y`, `_Z`, which lose a motion when `_Y` is at a right
        angle.

        Args:
            path: The URDF; its meshes are not needed.
            cuts: The YAML; by default the file beside the URDF that ends in .yaml.

        Raises:
            DescriptionError: When a file cannot be read, with every problem found; mimic joints,
                whose coupling Pinocchio would drop in silence, are refused.
            UnknownNameError: For a joint or frame that is not in the URDF.
            ActuationError: As the constructor.
        """
        text = reading.read_text(path, "URDF")
        cuts = Path(path).with_suffix(".yaml") if cuts is None else cuts
        closures, actuated, gravity, joints = reading.parse_cuts(
            reading.read_text(cuts, "YAML of the cuts"), str(cuts)
        )
        model = reading.parse_urdf(text, str(path), joints)
        model.gravity.linear = gravity
        return cls(model, closures, actuated)

    @classmethod
    def from_mjcf(cls: type[_Chain], path: str | Path, *, locked: Sequence[str] = ()) -> _Chain:
        """A robot from a MuJoCo file, its loops closed by `connect` and `weld` equalities.

        MuJoCo compiles the file. The motors are the joints that have an actuator; tau is the
        torque in the joint, gear times control for a `motor`. Joints carry MuJoCo's armature,
        damping and friction loss; hinges and slides count as in `qpos`. A ball becomes three
        joints, named `_X`, `_Y`, `_Z`, which lose a motion when `_Y` is at a right angle.

        Args:
            path: The MJCF.
            locked: Joints held at their reference: the free joint of a robot that stands on
                nothing, springs that count as stiff, the spin of a rod between two balls
                (`rod_X`). A joint without a name is called like its body. A locked motor is none.

        Raises:
            MissingExtraError: Without MuJoCo, `sst-pin[mjcf]`.
            DescriptionError: With every problem found: what MuJoCo does not read, free joints,
                springs, equalities of other kinds, actuators on anything but joints.
            UnknownNameError: For a name in `locked` that no joint has.
            ActuationError: As the constructor.

        Warns:
            DescriptionWarning: When a ball has damping, friction or armature: it is left out.
        """
        from ..reading.mjcf import read_mjcf

        return cls(*read_mjcf(path, locked))

    def compute_torques(
        self,
        q: ArrayLike,
        va: ArrayLike,
        aa: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """Inverse dynamics: the motor torques of a motion, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., m), [rad] or [m].
            va: Rates of the actuated joints, shape (..., n).
            aa: Accelerations of the actuated joints, shape (..., n).
            external_wrenches: [moment; force] that the surroundings exert on each body at its mass
                centre, base axes, bodies in the order of the joints, shape (..., r, 6).
            out: Array for the result.
            on_error: "raise", or "nan" for NaN in the place of samples at fault.

        Returns:
            tau, shape (..., n), [N m] or [N].

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: When q is open.
            SingularConfigurationError: When the motors do not hold the robot at q.
            ActuationError: When there are fewer or more motors than degrees of freedom.
        """
        m, n = self._m, self._n
        q, va, aa = as_array("q", q, (m,)), as_array("va", va, (n,)), as_array("aa", aa, (n,))
        wrenches = self._wrenches(external_wrenches)
        if q.ndim == va.ndim == aa.ndim == 1 and wrenches is out is None and on_error == "raise":
            return self._torques(q, va, aa, None)
        return for_each_sample(
            self._torques, (q, va, aa, wrenches), (1, 1, 1, 2), (n,), on_error=on_error, out=out
        )

    def _torques(self, q: Array, va: Array, aa: Array, wrenches: Array | None) -> Array:
        tau = dynamics.inverse_dynamics(*self.workspace_at(q), self.friction, q, va, aa, wrenches)
        if not isfinite(tau.dot(tau)):  # cheaper than looking at each input
            _require_finite(q=q, va=va, aa=aa, tau=tau)
        return tau

    def compute_accelerations(
        self,
        q: ArrayLike,
        va: ArrayLike,
        tau: ArrayLike,
        *,
        external_wrenches: ArrayLike | None = None,
        out: Array | None = None,
        on_error: str = "raise",
    ) -> Array:
        """Direct dynamics: the accelerations of the actuated joints under given torques, Eq. (92).

        Args:
            q: Joint coordinates on the closures, shape (..., m), [rad] or [m].
            va: Rates of the actuated joints, shape (..., n).
            tau: Motor torques, shape (..., n), [N m] or [N].
            external_wrenches: As in `compute_torques`.
            out: As in `compute_torques`.
            on_error: As in `compute_torques`.

        Returns:
            aa, shape (..., n).

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            ClosureError: When q is open.
            SingularConfigurationError: When the motors do not hold the robot at q.
            ActuationError: When there are fewer or more motors than degrees of freedom.
        """
        m, n = self._m, self._n
        q, va, tau = as_array("q", q, (m,)), as_array("va", va, (n,)), as_array("tau", tau, (n,))
        wrenches = self._wrenches(external_wrenches)
        if q.ndim == va.ndim == tau.ndim == 1 and wrenches is out is None and on_error == "raise":
            return self._accelerations(q, va, tau, None)
        arrays = (q, va, tau, wrenches)
        return for_each_sample(
            self._accelerations, arrays, (1, 1, 1, 2), (n,), on_error=on_error, out=out
        )

    def _accelerations(self, q: Array, va: Array, tau: Array, wrenches: Array | None) -> Array:
        aa, _ = dynamics.direct_dynamics(*self.workspace_at(q), self.friction, q, va, tau, wrenches)
        if not isfinite(aa.dot(aa)):
            _require_finite(q=q, va=va, tau=tau, aa=aa)
        return aa

    def noc(self, q: ArrayLike, va: ArrayLike) -> dynamics.Terms:
        """All matrices of the paper at one configuration: tau = I aa + C va - tau^g - tau^f.

        Args:
            q: Joint coordinates on the closures, shape (m,).
            va: Rates of the actuated joints, shape (n,).

        Raises:
            InputError, ClosureError, SingularConfigurationError, ActuationError: As
                `compute_torques`.
        """
        va = single_array("va", va, (self._n,))
        q = single_array("q", q, (self._m,))
        return dynamics.terms(*self.workspace_at(q), self.friction, q, va)

    def reduced_terms(
        self, q: ArrayLike, va: ArrayLike, *, on_error: str = "raise"
    ) -> dynamics.ReducedTerms:
        """The equations of motion in the actuated coordinates, for batches, Eqs. (93)-(96).

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).
            on_error: As in `compute_torques`.

        Raises:
            InputError, ClosureError, SingularConfigurationError, ActuationError: As
                `compute_torques`.
        """
        n = self._n
        arrays = as_array("q", q, (self._m,)), as_array("va", va, (n,))
        return dynamics.ReducedTerms.of_rows(
            for_each_sample(
                self._reduced_terms, arrays, (1, 1), (2 * n * (n + 1),), on_error=on_error
            ),
            n,
        )

    def _reduced_terms(self, q: Array, va: Array) -> Array:
        terms = dynamics.terms(*self.workspace_at(q), self.friction, q, va)
        row = np.concatenate(
            [terms.inertia.ravel(), terms.coriolis.ravel(), terms.gravity, terms.friction]
        )
        if not isfinite(row.dot(row)):
            _require_finite(q=q, va=va, terms=row)
        return row

    def kinetic_energy(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Kinetic energy, shape (...), [J]; arguments as `joint_rates`."""

        def energy(q: Array, q_dot: Array) -> Array:
            # Not computeKineticEnergy, which forgets the rotors of unaligned revolute joints.
            M = pin.crba(self.model, self._kinematics.data, q)
            return np.asarray(q_dot @ M @ q_dot / 2)

        q = finite_array("q", q, (self._m,))
        return for_each_sample(energy, (q, self.joint_rates(q, va)), (1, 1), ())

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy of the weights, zero with all masses at the origin, shape (...), [J].

        Args:
            q: Joint coordinates, shape (..., m).
        """

        def energy(q: Array) -> Array:
            return np.asarray(pin.computePotentialEnergy(self.model, self._kinematics.data, q))

        return for_each_sample(energy, (finite_array("q", q, (self._m,)),), (1,), ())

    def friction_power(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Power of friction in all joints, Eq. (87), negative or zero, shape (...), [W].

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).
        """
        q_dot = self.joint_rates(q, va)
        return (self.friction.forces(q_dot) * q_dot).sum(axis=-1)

    def simulate(
        self,
        torque: Torque,
        q0: ArrayLike,
        va0: ArrayLike,
        t: ArrayLike,
        *,
        external_wrenches: Load = None,
        **options: Any,
    ) -> Trajectory:
        """Integrate the motion under given torques; see `sst_pin.simulation.simulate`."""
        from ..motion.simulation import simulate

        return simulate(self, torque, q0, va0, t, external_wrenches=external_wrenches, **options)

    def mechanics(self, friction: dynamics.Friction) -> Mechanics:
        """What `simulate` asks of the robot, with a friction in the place of its own."""
        return Mechanics(self, friction)

    def _wrenches(self, wrenches: ArrayLike | None) -> Array | None:
        if wrenches is None:
            return None
        return finite_array("external_wrenches", wrenches, (self.model.njoints - 1, 6))


def _require_finite(**arrays: Array) -> None:
    for name, array in arrays.items():
        finite_array(name, array, array.shape)
