# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedTree`: a Pinocchio tree of one-coordinate joints with what closes and drives it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import finite_array, for_each_sample, single_array
from ..errors import ActuationError, ClosureError, DescriptionError, InputError, UnknownNameError
from . import assembly, mobility
from .closures import CLOSURE_TOLERANCE, Closure, LoopKinematics
from .noc import Actuation, JointComplement

Array = NDArray[np.float64]
_Value = TypeVar("_Value")


class ClosedTree:
    """The kinematics of a robot with closed loops: closures, assembly, mobility, joint rates.

    Joint vectors `q` are in the order of `joint_names`, actuated ones in the order given. Methods
    are safe to call from several threads.

    Args:
        model: A tree whose joints have one coordinate each; used as it is, not copied.
        closures: `Closure` objects, or pairs of frame names for frames that must coincide.
        actuated: Names of the motors' joints.

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
    ) -> None:
        self.model = model
        self.closures = tuple(c if isinstance(c, Closure) else Closure(*c) for c in closures)
        self.joint_names: tuple[str, ...] = tuple(list(model.names)[1:])
        _require_simple(model, self.joint_names, self.closures)
        self._actuation = Actuation.of([self._joint_index(name) for name in actuated], model.nv)
        if len(set(actuated)) != len(actuated):
            raise InputError("actuated", f"a joint stands twice in {list(actuated)}")
        self._m, self._n = model.nv, len(actuated)
        self._per_thread = threading.local()
        self._motors_match = False
        rows = self._kinematics.rows  # finds the frames, or says which is unknown
        if rows < len(self._actuation.unactuated):
            raise ActuationError(
                f"{model.nv} joints, {len(actuated)} motors and {rows} closure equations: "
                f"at least {len(self._actuation.unactuated) - rows} more motors are needed"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_per_thread"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._per_thread = threading.local()

    @property
    def actuated(self) -> tuple[int, ...]:
        """Indices of the motors' joints in q."""
        return tuple(int(i) for i in self._actuation.actuated)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint, "rad" or "m"."""
        kinds = [joint.shortname() for joint in list(self.model.joints)[1:]]
        return tuple("m" if kind.startswith("JointModelP") else "rad" for kind in kinds)

    # --- closures ---------------------------------------------------------------------------

    def residual(self, q: ArrayLike) -> Array:
        """How far the loops are open.

        Args:
            q: Joint coordinates, shape (m,), [rad] or [m].

        Returns:
            f(q) of Eq. (2), shape (rows,): [m] and [rad], base axes, closure after closure.
        """
        return self._at(q, lambda kinematics, _: kinematics.residual())

    def Phi(self, q: ArrayLike) -> Array:
        """Jacobian of the closures with all rows, redundant ones too, Eqs. (3), (4).

        Args:
            q: Joint coordinates on the closures, shape (m,).

        Returns:
            Shape (rows, m).
        """
        return self._at(q, lambda kinematics, _: kinematics.Phi())

    def Phi_dot(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """Rate of `Phi` at joint rates that keep the loops closed.

        Args:
            q: Joint coordinates on the closures, shape (m,).
            q_dot: Rates of all joints, shape (m,).

        Returns:
            Shape (rows, m).
        """
        v = single_array("q_dot", q_dot, (self._m,))

        def rate(kinematics: LoopKinematics, q: Array) -> Array:
            kinematics.set_velocity(q, v)
            return kinematics.Phi_dot(v)

        return self._at(q, rate)

    def condition_number(self, q: ArrayLike) -> float:
        """Condition number of Phi^u: infinite where the motors lose hold of the robot.

        Args:
            q: Joint coordinates on the closures, shape (m,).
        """
        return float(np.linalg.cond(self.Phi(q)[:, self._actuation.unactuated]))

    def assemble(self, q: ArrayLike, fixed: Sequence[str] | None = None) -> Array:
        """Project a configuration onto the closures by Newton's method.

        Args:
            q: A guess, shape (m,).
            fixed: Names of joints to be held; the actuated ones by default, () for none.

        Returns:
            A configuration near q with closed loops, shape (m,).

        Raises:
            ClosureError: When there is none within reach, with the residual that was left.
            UnknownNameError: For an unknown joint.
        """
        guess = single_array("q", q, (self._m,))
        if fixed is None:
            free = self._actuation.unactuated
        else:
            free = np.setdiff1d(np.arange(self._m), [self._joint_index(name) for name in fixed])
        return assembly.assemble(self._kinematics, guess, free)

    def generic_configuration(self) -> Array:
        """Some assembled configuration away from the symmetric ones, the same at each call.

        Returns:
            Shape (m,).

        Raises:
            ClosureError: When none is found.
        """
        return assembly.generic_configuration(self._kinematics)

    def mobility(self, q: ArrayLike | None = None) -> mobility.Mobility:
        """Count degrees of freedom, redundant closures and motors.

        Args:
            q: Joint coordinates on the closures, shape (m,); a generic configuration by default.

        Returns:
            A report that prints readably.

        Raises:
            ClosureError: When q is open, or when no configuration can be assembled.
        """
        if q is None:
            q = self.generic_configuration()
        q = single_array("q", q, (self._m,))
        labels = [f"{c.frame_a} - {c.frame_b}: {row}" for c in self.closures for row in c.rows]
        kinematics = self._kinematics
        kinematics.set_position(q)
        kinematics.require_closed(CLOSURE_TOLERANCE)
        Phi = kinematics.Phi()
        return mobility.analyse(
            Phi, self.joint_names, self.actuated, list(self._actuation.unactuated), labels
        )

    def joint_rates(self, q: ArrayLike, va: ArrayLike) -> Array:
        """Rates of all joints, q_dot = L va, Eq. (16).

        Args:
            q: Joint coordinates on the closures, shape (..., m).
            va: Rates of the actuated joints, shape (..., n).

        Returns:
            Shape (..., m).
        """
        m, n = self._m, self._n

        def rates(q: Array, va: Array) -> Array:
            kinematics, complement = self.workspace_at(q)
            return complement.factorise(kinematics.Phi()) @ va

        arrays = (finite_array("q", q, (m,)), finite_array("va", va, (n,)))
        return for_each_sample(rates, arrays, (1, 1), (m,))

    # --- inside -----------------------------------------------------------------------------

    @property
    def _workspace(self) -> tuple[LoopKinematics, JointComplement]:
        """This thread's scratch memory."""
        try:
            return self._per_thread.workspace
        except AttributeError:
            kinematics = LoopKinematics(self.model, self.closures)
            complement = JointComplement(kinematics.rows, self._actuation)
            self._per_thread.workspace = kinematics, complement
            return kinematics, complement

    @property
    def _kinematics(self) -> LoopKinematics:
        return self._workspace[0]

    def workspace_at(
        self, q: Array, tolerance: float = CLOSURE_TOLERANCE
    ) -> tuple[LoopKinematics, JointComplement]:
        """This thread's workspace at one configuration, found to be closed."""
        kinematics, complement = self._workspace
        self.require_motors_to_match(q)
        kinematics.set_position(q)
        kinematics.require_closed(tolerance)
        return kinematics, complement

    def require_motors_to_match(self, q: Array | None = None) -> None:
        """Check once, where nothing special is to be expected, that motors and freedoms agree.

        Args:
            q: Where to look when no such place is found, shape (m,).

        Raises:
            ActuationError: When they do not.
            ClosureError: When there is no such place, and q is open or not given.
        """
        if self._motors_match:
            return
        try:
            report = self.mobility()
            self._motors_match = True
        except ClosureError:  # no such place found: ask at each configuration in use
            report = self.mobility(q)
        if not report.sufficient or report.redundantly_actuated:
            self._motors_match = False
            raise ActuationError(f"the motors do not match the degrees of freedom:\n{report}")

    def _at(self, q: ArrayLike, compute: Callable[[LoopKinematics, Array], _Value]) -> _Value:
        array = single_array("q", q, (self._m,))
        kinematics = self._kinematics
        kinematics.set_position(array)
        return compute(kinematics, array)

    def _joint_index(self, name: str) -> int:
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, self.joint_names)
        return int(self.model.joints[self.model.getJointId(name)].idx_v)


def _require_simple(model: pin.Model, names: Sequence[str], closures: Sequence[Closure]) -> None:
    problems = [
        f"joint {name}: {joint.nq} coordinates and {joint.nv} rates, one of each is needed"
        + (" (a continuous joint? make it revolute with wide limits)" if joint.nq == 2 else "")
        for name, joint in zip(names, list(model.joints)[1:], strict=True)
        if (joint.nq, joint.nv) != (1, 1)
    ]
    if not closures:
        problems.append("no closures; an open tree needs pinocchio.rnea and nothing else")
    if problems:
        raise DescriptionError(f"model {model.name}", problems)
