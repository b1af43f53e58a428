# SPDX-License-Identifier: BSD-2-Clause
"""The reference path: single samples by Pinocchio and NumPy, in any number of threads.

`Reference` has a method for each quantity of an engine. It calls the functions of this room.
Methods with the decorator `_finite` check that their results are finite. The others check by
themselves, or compute what depends on q alone: closed loops and valid unit vectors make it finite.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import cached_property, wraps
from inspect import signature
from typing import Any, NoReturn, TypeVar

import numpy as np
import pinocchio as pin

from ..arrays import Array, finite_array
from ..errors import ActuationError, ClosureError, InputError
from ..loops.mobility import idle_rates, rotating_freely
from ..model.mechanism import Mechanism
from ..model.thresholds import MAX_CONDITION_NUMBER, UNSUPPLIED
from . import dynamics, reactions, regressor
from .derivatives import Derivatives
from .dynamics import Context
from .noc import mass_centers
from .torque_sharing import least_torques

_Method = TypeVar("_Method", bound=Callable[..., Array])


def _finite(method: _Method) -> _Method:
    """Decorator of a method of `Reference` that refuses results that are not finite.

    The error names the argument that is not finite.
    """
    names = list(signature(method).parameters)[1:]  # without self

    @wraps(method)
    def checked(self: Reference, *arguments: Any, **more: Any) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):  # the error says it better
            result = method(self, *arguments, **more)
        if not np.isfinite(result).all():
            _raise_not_finite(dict(zip(names, arguments, strict=False)) | more)
        return result

    return checked  # type: ignore[return-value]  # it has the parameters of `method`


def _raise_not_finite(arguments: Mapping[str, Any]) -> NoReturn:
    """Raise an error for a result that is not finite; it names the first argument that is not."""
    for name, array in arguments.items():
        if isinstance(array, np.ndarray):
            finite_array(name, array, array.shape)
    raise InputError("result", "not finite: arguments or numbers of the model are too large")


class Reference(threading.local):
    """All dynamics of one mechanism, sample by sample.

    Each thread has its own attributes, and so its own context: loops, L and data of Pinocchio are
    those of the last sample that this thread computed. Each method evaluates them at its sample.

    Arguments have the shapes of one sample: q (nq,), va, aa (n,), tau (motors,), and external
    wrenches [force; moment] at the mass centres, base axes, (r, 6), or None.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __reduce__(self) -> tuple[type[Reference], tuple[Mechanism]]:
        return Reference, (self.mechanism,)

    @cached_property
    def context(self) -> Context:
        """The context of this thread."""
        return Context(self.mechanism)

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives of this thread."""
        return Derivatives(self.context)

    @cached_property
    def designs(self) -> dict[str, Any]:
        """A cache of the function `design_derivatives`, which fills and reads it.

        It holds the last `Design` of this thread, by its parameters: a loop over samples asks for
        the same parameters again. No result depends on it.
        """
        return {}

    @_finite
    def generalized_forces(
        self, q: Array, va: Array, aa: Array, external_wrenches: Array | None
    ) -> Array:
        """f, shape (n,)."""
        return dynamics.inverse_dynamics(self.context, q, va, aa, external_wrenches)

    def torques(
        self,
        q: Array,
        va: Array,
        aa: Array,
        external_wrenches: Array | None,
        weights: Array | None = None,
    ) -> Array:
        """tau, shape (motors,): f if motor k drives coordinate k, else the least torques for f."""
        f = self.generalized_forces(q, va, aa, external_wrenches)  # checked: finite
        if self.mechanism.driven_one_to_one:
            return f
        A = self.context.complement.L.T.dot(self.context.actuation(q))  # f = A tau
        with np.errstate(over="ignore", invalid="ignore"):
            tau = least_torques(self.mechanism, A, f, weights)
            # A part of f that no motor supplies must be rounding: tiny beside the forces of the
            # motors, or beside all forces, which may cancel to f. The forces of the motors are
            # quicker to compute, so they are compared first. In most calls they suffice.
            unsupplied = f - A.dot(tau)
            motor_forces = np.abs(A).dot(np.abs(tau))
            is_supplied = (np.abs(unsupplied) <= UNSUPPLIED * motor_forces).all()
            if not is_supplied:  # also if tau is NaN: a comparison with NaN is False
                sizes = motor_forces + dynamics.force_sizes(
                    self.context, q, va, aa, external_wrenches
                )
                # f is finite, so no argument is at fault, but numbers may be too large together.
                if not np.isfinite([*tau, *sizes]).all():
                    _raise_not_finite({})
                self._require_supplied(unsupplied, sizes)
        return tau

    def _require_supplied(self, unsupplied: Array, sizes: Array) -> None:
        """Refuse unsupplied forces along the coordinates that are larger than rounding.

        `sizes` are the sums of the sizes of all forces along the coordinates, shape (n,).
        """
        missing_at = np.flatnonzero(np.abs(unsupplied) > UNSUPPLIED * sizes)
        if not len(missing_at):
            return
        names = self.mechanism.coordinate_rate_names
        missing = {names[k]: float(unsupplied[k]) for k in missing_at}
        listed = ", ".join(f"{name} {x:.4g}" for name, x in list(missing.items())[:6])
        loops = self.context.loops
        scale = self.mechanism.row_scale[:, None]
        Phi = loops.Phi * scale * self.mechanism.rate_scale
        idle = idle_rates(self.mechanism, loops, Phi)
        problem = (
            f"the motors cannot produce this motion: no motor supplies the forces {listed} "
            "(N m or N); generalized_forces computes the forces that a motion needs, "
            "compute_accelerations the motion for given torques"
        )
        if idle:
            problem += f"; {rotating_freely(idle)}"
        raise ActuationError(problem, missing)

    @_finite
    def accelerations(
        self, q: Array, va: Array, tau: Array, external_wrenches: Array | None
    ) -> Array:
        """aa, shape (n,)."""
        self.mechanism.require_mass()
        friction = self.mechanism.friction
        aa, _ = dynamics.direct_dynamics(self.context, friction, q, va, tau, external_wrenches)
        return aa

    @_finite
    def reduced_terms(self, q: Array, va: Array) -> Array:
        """Inertia, coriolis, gravity, friction in a row; `ReducedTerms.of_rows` splits it."""
        terms = dynamics.terms(self.context, q, va)
        inertia = terms.inertia.ravel()
        coriolis = terms.coriolis.ravel()
        gravity = terms.gravity + terms.springs
        return np.concatenate([inertia, coriolis, gravity, terms.friction])

    @_finite
    def torque_regressor(self, q: Array, va: Array, aa: Array) -> Array:
        """Y, shape (n, p): f = Y theta."""
        return regressor.torque_regressor(self.context, q, va, aa)

    @_finite
    def torque_derivatives(
        self, q: Array, va: Array, aa: Array, external_wrenches: Array | None, sign_width: float
    ) -> Array:
        """Derivatives of f by q, va, aa side by side, shape (n, 3 n)."""
        return self.derivatives.torques(sign_width, q, va, aa, external_wrenches)

    @_finite
    def acceleration_derivatives(
        self, q: Array, va: Array, tau: Array, external_wrenches: Array | None, sign_width: float
    ) -> Array:
        """Derivatives of aa by q, va, tau side by side, shape (n, 2 n + motors)."""
        self.mechanism.require_mass()
        return self.derivatives.accelerations(sign_width, q, va, tau, external_wrenches)

    def displacement_rates(self, q: Array, va: Array) -> Array:
        """Rates of displacements of the coordinates that are due to moving joint axes, (n, n).

        A joint such as a ball has axes that move with it, so that a displacement with constant
        components changes. Column k has the rates for the displacement along coordinate k. It is
        zero if no joint has such axes; see `Derivatives.displacement_rates`.
        """
        return self.derivatives.displacement_rates(q, va)

    def reactions(
        self,
        q: Array,
        va: Array,
        aa: Array,
        tau: Array | None,
        wrenches: Array | None,
        compliances: Array | None = None,
        axes: Array | None = None,
    ) -> Array:
        """Wrenches of joints, closures and ground, motor torques and codes, in one row.

        `reactions.parts_of` splits the row. The code of a joint or closure says which components of
        its wrench are not unique. `compliances`, shape (r + closures, 6), determine such components
        in an elastic robot. `axes`, shape (3, 3), are those in which wrenches are written; see
        `reactions.reactions`.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            row = reactions.reactions(self.context, q, va, aa, tau, wrenches, compliances, axes)
        parts = reactions.parts_of(self.mechanism, row)
        # Wrenches of joints and closures may be NaN on purpose; ground and torques may not.
        if not np.isfinite(np.append(parts.ground, parts.tau)).all():
            _raise_not_finite(
                {"q": q, "va": va, "aa": aa, "tau": tau, "external_wrenches": wrenches}
            )
        return row

    @_finite
    def unique_forces(
        self,
        q: Array,
        va: Array,
        aa: Array,
        tau: Array | None,
        wrenches: Array | None,
        compliances: Array | None = None,
    ) -> Array:
        """Unique parts of the forces in joints and closures, see `reactions.unique_forces`."""
        return reactions.unique_forces(self.context, q, va, aa, tau, wrenches, compliances)

    @_finite
    def rates(self, q: Array, va: Array) -> Array:
        """v = L va, shape (nv,)."""
        return self.L(q).dot(va)  # Eq. (16)

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode.

        `step` are displacements of the coordinates, shape (n,).
        """
        model = self.mechanism.model
        assembly = self.context.assembly

        def path(q_low: Array, low: float, high: float) -> Array:
            """The configuration at the fraction `high` of the step, from that at `low`."""
            part = (high - low) * step
            ahead = pin.integrate(model, q_low, self.rates(q_low, part))
            return assembly.closed(ahead)

        if not step.any():
            return q
        # `follow` divides the step into parts that stay in the assembly mode. It returns the
        # fraction of the step that it can reach, and the configuration there.
        reached, configuration = self.context.continuity.follow(q, path, MAX_CONDITION_NUMBER)
        if reached < 1:
            problem = (
                "the loops cannot be closed further along the motion: out of reach, or singular"
            )
            raise ClosureError(problem, residual=0.0)  # at `configuration` the loops are closed
        return configuration

    def L(self, q: Array) -> Array:
        """L where the loops are closed, shape (nv, n), Eq. (17)."""
        self.context.complement.evaluate(q)
        return self.context.complement.L

    @_finite
    def joint_accelerations(self, q: Array, va: Array, aa: Array) -> Array:
        """v_dot, shape (nv,), Eqs. (8), (20)."""
        return self.joint_motion(q, va, aa)[1]

    def joint_motion(self, q: Array, va: Array, aa: Array) -> tuple[Array, Array]:
        """v and v_dot, shapes (nv,), Eqs. (8), (16)."""
        return self.context.complement.motion(q, va, aa)

    def frame_jacobian(self, q: Array, frame: int) -> Array:
        """[linear; angular] of a frame, world axes at its origin, shape (6, n)."""
        L = self.L(q)
        return self.context.loops.frame_jacobian(frame).dot(L)

    @_finite
    def frame_jacobian_rate(self, q: Array, va: Array, frame: int) -> Array:
        """Rate of `frame_jacobian`, shape (6, n)."""
        L = self.L(q)
        loops = self.context.loops
        complement = self.context.complement
        v = L.dot(va)
        Phi_dot = loops.Phi_dot(v)
        L_dot = complement.L_dot(Phi_dot)
        # At some poses of a robot with redundant rows, it can have rates but no accelerations, and
        # L_dot has no meaning. So v_dot = L aa + L_dot va with aa = 0 must satisfy Eq. (8),
        # Phi v_dot + Phi_dot v = 0.
        v_dot = L_dot.dot(va)
        drift = Phi_dot.dot(v)
        complement.require_accelerations(v, v_dot, drift)
        return loops.frame_jacobian_rate(frame, v).dot(L) + loops.frame_jacobian(frame).dot(L_dot)

    @_finite
    def frame_velocity_derivatives(self, q: Array, va: Array, frame: int) -> Array:
        """Derivatives of a frame's velocity by q and va side by side, shape (6, 2 n)."""
        return self.derivatives.frame_velocity(q, va, frame)

    @_finite
    def frame_drift(self, q: Array, va: Array, frame: int) -> Array:
        """[linear; angular] acceleration of a frame with aa = 0, shape (6,)."""
        context = self.context
        tree = context.tree
        v, v_dot = context.complement.motion(q, va, context.zero_aa)
        # Pinocchio computes on the normal tree. Its configuration is `loops.q`, which `motion` has
        # set, and its rates are S v.
        q_of_tree = context.loops.q
        pin.forwardKinematics(tree.model, context.data, q_of_tree, tree.S.dot(v), tree.S.dot(v_dot))
        acceleration = pin.getFrameClassicalAcceleration(
            tree.model, context.data, frame, pin.LOCAL_WORLD_ALIGNED
        )
        return acceleration.vector

    @_finite
    def actuator_jacobian(self, q: Array) -> Array:
        """J, shape (motors, n): the rates of the motors are J va."""
        L = self.L(q)
        return self.context.actuation(q).T.dot(L)

    def line_lengths(self, q: Array) -> Array:
        """Lengths of the lines, shape (lines,)."""
        # Other methods compute L at q, or take rates v that were computed at q: L needs a valid q.
        self.mechanism.space.require_on_manifold(q)
        return self.context.lines.lengths(q)

    @_finite
    def line_rates(self, q: Array, v: Array) -> Array:
        """Rates of the lengths at rates v of the tree, shape (lines,)."""
        return self.context.lines.evaluate(q)[1].dot(v)

    @_finite
    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """Kinetic energy of all bodies and rotors at rates v of the tree, [J]."""
        self.context.loops.evaluate(q)
        return np.asarray(v.dot(self.context.tree_inertia()).dot(v) / 2)

    def potential_energy(self, q: Array) -> Array:
        """Potential energy of weights, springs and lines, [J].

        The energy of the weights is zero with all masses at the origin.
        """
        context = self.context
        springs = self.mechanism.springs
        self.mechanism.space.require_on_manifold(q)  # as in `line_lengths`
        context.loops.evaluate(q)
        model = self.mechanism.model
        masses = np.array([body.mass for body in list(model.inertias)[1:]])
        energy = -masses.dot(mass_centers(context.loops)).dot(model.gravity.linear)
        # This counts the whole weight of each body. On some bodies a part of the weight does not
        # act. `weightless_parts` has the mass and the first moment of this part, in the axes of the
        # body. Its energy is subtracted: minus its first moment about the origin of the base, times
        # gravity. Bodies count from 0, their joints from 1, because joint 0 is the base.
        for body, (mass, *first_moment) in self.mechanism.weightless_parts.items():
            joint = body + 1
            placement = context.data.oMi[context.tree.bodies[joint]]
            about_origin = mass * placement.translation + placement.rotation @ first_moment
            energy_of_part = -about_origin.dot(model.gravity.linear)
            energy -= energy_of_part
        energy += 0 if springs.none else springs.energy(model, q)
        return np.asarray(energy + self.mechanism.lines.energy(context.lines.lengths(q)))
