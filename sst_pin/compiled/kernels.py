# SPDX-License-Identifier: BSD-2-Clause
"""What can be compiled: each kernel as inputs, one row of results, and checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
from casadi import SX

from ..chain.backend import Key
from . import symbolic_derivatives
from .elimination import total
from .equations import Equations
from .frame_kernels import OF_FRAMES
from .joint_wrenches import reactions
from .kernel_checks import Checks
from .regressor_columns import torque_regressor
from .symbols import Sparse, add


@dataclass(frozen=True)
class SymbolicKernel:
    """A function of rows of numbers.

    Attributes:
        name: What it computes.
        inputs: Symbols of each input, column vectors.
        parameters: Symbols of the open numbers.
        output: All results in a column.
        checks: Numbers that are at most 1 if the results are right.
        directions: Where the last input is a direction and the output is along it, how many there
            are: a sample's results are those of all, side by side in rows. Else 0.
    """

    name: str
    inputs: tuple[SX, ...]
    parameters: SX
    output: SX
    checks: SX
    directions: int = 0


def make(
    equations: Equations,
    quantity: str,
    checks: Checks | None = None,
    *,
    frame: str | None = None,
    along: bool = False,
) -> SymbolicKernel:
    """The kernel of a quantity, one of `KERNELS`, or with a frame of `OF_FRAMES`.

    `checks` are those for double precision by default; `along` takes derivatives along directions.
    """
    checks = checks or Checks(equations)
    directions = len(equations.mechanism.coordinates) if along else 0
    if frame is not None:
        inputs, output, own = OF_FRAMES[quantity](equations, checks, frame)
    elif along:
        inputs, output, own = _along(equations, checks, quantity, directions)
    else:
        inputs, output, own = KERNELS[quantity](equations, checks)
    loads = equations.loads
    given = tuple(x for x in inputs if x is not loads or x.numel())
    loaded = any(x is loads for x in given)
    return SymbolicKernel(
        Key(quantity, loaded=loaded, along=along).entry,
        given,
        equations.p,
        ca.densify(output),
        ca.vertcat(*(SX(check) for check in [*checks.of_state, *own])),
        directions,
    )


def entry(equations: Equations, key: Key) -> list[SymbolicKernel]:
    """The kernels in the library of a key: one, or those of a rollout."""
    parts = ["closing", "state_rate"] if key.quantity == "rollout" else [key.quantity]
    return [make(equations, part, frame=key.frame, along=key.along) for part in parts]


_Made = tuple[list[SX], SX, list[Any]]


def _forces(e: Equations, checks: Checks) -> _Made:
    return [e.q, e.va, e.aa, e.loads], e.generalized_forces, checks.of_forces


def _torques(e: Equations, checks: Checks) -> _Made:
    """The smallest torques that produce the motion."""
    inputs, f, own = _forces(e, checks)
    if e.mechanism.driven_one_to_one:
        return inputs, f, own
    tau = e.smallest_torques(f)
    own = [*own, *checks.of_motors, *checks.unsupplied(tau, f)]
    return (
        inputs,
        ca.vertcat(*(SX(tau.get(k, 0)) for k in range(len(e.mechanism.motor_names)))),
        own,
    )


def _accelerations(e: Equations, checks: Checks) -> _Made:
    tau = _motor_torques(e)
    aa, inverses = e.accelerations(tau)
    return [e.q, e.va, tau, e.loads], aa, checks.of_accelerations + checks.massless(inverses)


def _torque_derivatives(e: Equations, checks: Checks) -> _Made:
    """Derivatives of f by q, va and aa side by side, row by row."""
    *parts, own = symbolic_derivatives.of_torques(e, checks)
    return [e.q, e.va, e.aa, e.loads], _rows(parts), checks.of_forces + own


def _acceleration_derivatives(e: Equations, checks: Checks) -> _Made:
    """Derivatives of aa by q, va and tau side by side, row by row."""
    tau = _motor_torques(e)
    *parts, own = symbolic_derivatives.of_accelerations(e, checks, tau)
    return [e.q, e.va, tau, e.loads], _rows(parts), checks.of_accelerations + own


def _along(e: Equations, checks: Checks, name: str, directions: int) -> _Made:
    """Derivatives along a direction, the last input; with all directions they are as above."""
    way = SX.sym("direction", directions)
    if name == "torque_derivatives":
        x, own = e.aa, checks.of_forces
        *parts, more = symbolic_derivatives.of_torques_along(e, checks, way)
    else:
        x, own = _motor_torques(e), checks.of_accelerations
        *parts, more = symbolic_derivatives.of_accelerations_along(e, checks, x, way)
    return [e.q, e.va, x, e.loads, way], _rows(parts), own + more


def _motor_torques(e: Equations) -> SX:
    return SX.sym("tau", e.mechanism.motors.shape[1])


def _rows(parts: list[SX]) -> SX:
    """Matrices side by side, row by row."""
    return ca.vec(ca.horzcat(*parts).T)


def _displacement_rates(e: Equations, checks: Checks) -> _Made:
    return [e.q, e.va], ca.vec(symbolic_derivatives.of_displacements(e).T), checks.of_rates


def _reduced_terms(e: Equations, checks: Checks) -> _Made:
    gravity = e.project(add(e.tree.forces({}, {}, loads=False), e.tree.springs))
    friction = e.project(e.tree.friction(e.v))
    terms = [ca.vec(e.inertia.T), ca.vec(e.coriolis.T), -gravity, -friction]
    return [e.q, e.va], ca.vertcat(*terms), checks.of_rates + checks.of_complement


def _rates(e: Equations, checks: Checks) -> _Made:
    return [e.q, e.va], _of_tree(e, e.v), checks.of_rates


def _actuator_jacobian(e: Equations, checks: Checks) -> _Made:
    own = [check for column in e.motor_columns for check in checks.unbalanced(column)]
    return [e.q], ca.vec(e.motor_matrix), own


def _joint_accelerations(e: Equations, checks: Checks) -> _Made:
    own = checks.of_rates + checks.unsolved(e.dv, e.drift)
    return [e.q, e.va, e.aa], _of_tree(e, e.dv), own


def _of_tree(e: Equations, x: Sparse) -> SX:
    """All rates of the tree in a column."""
    return ca.vertcat(*(SX(x.get(i, 0)) for i in range(e.mechanism.model.nv)))


def _state_rate(e: Equations, checks: Checks) -> _Made:
    """Rates of q and va under motor torques."""
    inputs, aa, own = _accelerations(e, checks)
    return inputs, ca.vertcat(e.kinematics.q_rates(e.v), aa), own


def _closing(e: Equations, checks: Checks) -> _Made:
    """One step of Newton's method with the coordinates held; det Phi_u; the sum of its squares.

    Wheels roll during the step: rows on rates only constrain the step. The determinant is that of
    the rows with pivots, or where all rows count the product of the singular values; the sum is
    over all rows. Both are without units, as the condition number.
    """
    residuals = {i: e.rows[i].residual for i in e.factors.rows}
    right = {i: -x for i, x in residuals.items() if x is not None}
    step = e.kinematics.q_rates(e.factors.solve(right))
    rows, columns = e.mechanism.row_scale, e.mechanism.rate_scale
    squares = total(
        (rows[i] * columns[j] * row.Phi[j]) ** 2
        for i, row in enumerate(e.rows)
        for j in e.mechanism.dependent
        if j in row.Phi
    )
    result = ca.vertcat(e.kinematics.normalized(e.q + step), e.pivots.determinant, squares)
    return [e.q], result, []


KERNELS: dict[str, Callable[[Equations, Checks], _Made]] = {
    "forces": _forces,
    "torques": _torques,
    "accelerations": _accelerations,
    "torque_derivatives": _torque_derivatives,
    "acceleration_derivatives": _acceleration_derivatives,
    "displacement_rates": _displacement_rates,
    "reduced_terms": _reduced_terms,
    "torque_regressor": torque_regressor,
    "rates": _rates,
    "reactions": reactions,
    "actuator_jacobian": _actuator_jacobian,
    "joint_accelerations": _joint_accelerations,
    "state_rate": _state_rate,
    "closing": _closing,
}
