# SPDX-License-Identifier: BSD-2-Clause
"""All kernels that can be compiled: inputs, a column of results, and checks."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from ..dynamics.quantities import Quantity
from ..model.tree import frame_named
from . import along_directions, frame_velocities, symbolic_derivatives
from .along_directions import Directions
from .elimination import total
from .equations import Equations
from .joint_wrenches import reactions
from .kernel_checks import Checks
from .symbols import add, column, row_by_row

#: The input of kernels on which external wrenches act.
WRENCHES = "external_wrenches"


class Parts(NamedTuple):
    """What makes a kernel of one quantity."""

    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: All results in a column.
    output: SX
    #: Checks beside those of the state.
    checks: list[Any]


@dataclass(frozen=True)
class SymbolicKernel:
    """A function of rows of numbers."""

    #: The quantity that it computes.
    name: str
    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: Symbols of the symbolic parameters.
    parameters: SX
    #: All results in a column.
    output: SX
    #: Checks: numbers that are at most 1 if the results are right.
    checks: SX
    #: Factors that make the numbers of q free of units.
    units: tuple[float, ...] = ()
    #: How it computes along directions; None if `output` is the whole result.
    along: Directions | None = None


def make(
    equations: Equations,
    quantity: str,
    checks: Checks | None = None,
    *,
    frame: str | None = None,
    along: bool = False,
) -> SymbolicKernel:
    """The kernel of a quantity, by default with the checks for double precision.

    With `along` its results are computed along directions of the coordinates.
    """
    checks = checks or Checks(equations)
    name = quantity
    directions = None
    if along:
        parts, directions = along_directions.make(equations, checks, quantity, frame)
        inputs, output, more = parts
        name += "_along"
    elif frame is not None:
        inputs, output, more = OF_FRAMES[quantity](equations, checks, frame)
    else:
        inputs, output, more = KERNELS[quantity](equations, checks)
    if WRENCHES in inputs:
        if inputs[WRENCHES].numel():
            name += "_loaded"
        else:  # equations without loads
            inputs = {input_name: x for input_name, x in inputs.items() if input_name != WRENCHES}
    length = equations.mechanism.length
    units = []
    for unit in equations.mechanism.space.position_units:
        units.append(1 / length if unit == "m" else 1.0)
    return SymbolicKernel(
        name,
        inputs,
        equations.p,
        ca.densify(output),
        ca.vertcat(*(SX(check) for check in [*checks.of_state, *more])),
        tuple(units),
        directions,
    )


def entry(
    equations: Equations, key: Quantity, checks: Checks | None = None
) -> list[SymbolicKernel]:
    """The kernels in the library of a key: one, or those of a rollout."""
    parts = ["closing", "state_rate"] if key.name == "rollout" else [key.name]
    return [make(equations, part, checks, frame=key.frame, along=key.along) for part in parts]


def _moving(e: Equations) -> dict[str, SX]:
    return {"q": e.q, "va": e.va}


def _motion(e: Equations) -> dict[str, SX]:
    return _moving(e) | {"aa": e.aa, WRENCHES: e.loads}


def _driven(e: Equations) -> dict[str, SX]:
    return _moving(e) | {"tau": e.tau, WRENCHES: e.loads}


def _forces(e: Equations, checks: Checks) -> Parts:
    return Parts(_motion(e), e.generalized_forces, checks.of_forces)


def _torques(e: Equations, checks: Checks) -> Parts:
    """The smallest torques that produce the motion."""
    inputs, f, more = _forces(e, checks)
    if e.mechanism.driven_one_to_one:
        return Parts(inputs, f, more)
    tau = e.smallest_torques(f)
    more = [*more, *checks.of_motors, *checks.unsupplied(tau, f)]
    return Parts(inputs, column(tau, range(len(e.mechanism.motor_names))), more)


def _accelerations(e: Equations, checks: Checks) -> Parts:
    return Parts(_driven(e), e.accelerations, checks.of_accelerations + checks.massless)


def _torque_derivatives(e: Equations, checks: Checks) -> Parts:
    """Derivatives of f by q, va and aa side by side, row by row."""
    derivatives, more = symbolic_derivatives.of_torques(e, checks)
    return Parts(_motion(e), row_by_row(derivatives), checks.of_forces + more)


def _acceleration_derivatives(e: Equations, checks: Checks) -> Parts:
    """Derivatives of aa by q, va and tau side by side, row by row."""
    derivatives, more = symbolic_derivatives.of_accelerations(e, checks)
    return Parts(_driven(e), row_by_row(derivatives), checks.of_accelerations + more)


def _displacement_rates(e: Equations, checks: Checks) -> Parts:
    columns = (symbolic_derivatives.of_displacement(e, L) for L in e.L)
    return Parts(_moving(e), row_by_row(*columns), checks.of_rates + checks.of_steady_motion)


def _reduced_terms(e: Equations, checks: Checks) -> Parts:
    gravity = e.project(add(e.tree.forces({}, {}, loads=False), e.tree.springs(e.v)))
    friction = e.project(e.tree.friction(e.v))
    terms = [row_by_row(e.inertia), row_by_row(e.coriolis), -gravity, -friction]
    return Parts(_moving(e), ca.vertcat(*terms), checks.of_accelerations)


def _torque_regressor(e: Equations, checks: Checks) -> Parts:
    """Y row by row: derivatives of f by all symbolic parameters, those of springs too."""
    nv = e.mechanism.model.nv
    by_numbers = ca.jacobian(e.project(e.tree_forces), e.p)
    *blocks, lines = (by_numbers @ ca.sparsify(ca.DM(x)) for x in e.parameters.by_parameters())
    offsets = (e.project({i: 1.0}) for i in range(nv))
    more = checks.of_rates + checks.solved(e.dv) + checks.of_complement
    Y = row_by_row(*blocks, *offsets, lines, *map(e.project, e.motor_columns))
    return Parts(_moving(e) | {"aa": e.aa}, Y, more)


def _reactions(e: Equations, checks: Checks) -> Parts:
    return Parts(*reactions(e, checks))


def _rates(e: Equations, checks: Checks) -> Parts:
    return Parts(_moving(e), column(e.v, range(e.mechanism.model.nv)), checks.of_rates)


def _joint_accelerations(e: Equations, checks: Checks) -> Parts:
    more = checks.of_rates + checks.solved(e.dv)
    return Parts(_moving(e) | {"aa": e.aa}, column(e.dv, range(e.mechanism.model.nv)), more)


def _actuator_jacobian(e: Equations, checks: Checks) -> Parts:
    more = [check for forces in e.motor_columns for check in checks.unbalanced(forces)]
    return Parts({"q": e.q}, ca.vec(e.motor_matrix), more)


def _state_rate(e: Equations, checks: Checks) -> Parts:
    """Rates of q and va under motor torques."""
    inputs, aa, more = _accelerations(e, checks)
    return Parts(inputs, ca.vertcat(e.kinematics.q_rates(e.v), aa), more)


def _closing(e: Equations, checks: Checks) -> Parts:
    """A step of Newton's method, coordinates held; det Phi_u; the sum of squares of all its rows.

    Wheels roll during the step. The determinant and the sum are without units.
    """
    residuals = {i: e.rows[i].residual for i in e.factors.rows}
    right = {i: -x for i, x in residuals.items() if x is not None}
    step = e.kinematics.q_rates(e.factors.solve(right))
    rows = e.mechanism.row_scale
    columns = e.mechanism.rate_scale
    squares = total(
        (rows[i] * columns[j] * row.Phi[j]) ** 2
        for i, row in enumerate(e.rows)
        for j in e.mechanism.dependent
        if j in row.Phi
    )
    result = ca.vertcat(e.kinematics.normalized(e.q + step), e.pivots.determinant, squares)
    return Parts({"q": e.q}, result, [])


KERNELS: dict[str, Callable[..., Parts]] = {
    "generalized_forces": _forces,
    "torques": _torques,
    "accelerations": _accelerations,
    "torque_derivatives": _torque_derivatives,
    "acceleration_derivatives": _acceleration_derivatives,
    "displacement_rates": _displacement_rates,
    "reduced_terms": _reduced_terms,
    "torque_regressor": _torque_regressor,
    "rates": _rates,
    "reactions": _reactions,
    "actuator_jacobian": _actuator_jacobian,
    "joint_accelerations": _joint_accelerations,
    "state_rate": _state_rate,
    "closing": _closing,
}


def _jacobian(e: Equations, checks: Checks, frame: str) -> Parts:
    columns = (frame_velocities.velocity(e, frame, L) for L in e.L)
    return Parts({"q": e.q}, row_by_row(*columns), checks.of_complement)


def _jacobian_rate(e: Equations, checks: Checks, frame: str) -> Parts:
    made = (frame_velocities.rate_of_column(e, checks, frame, L) for L in e.L)
    changes, more = zip(*made, strict=True)
    of_motion = checks.of_rates + checks.of_complement + checks.of_steady_motion
    return Parts(_moving(e), row_by_row(*changes), [*of_motion, *chain.from_iterable(more)])


def _velocity_derivatives(e: Equations, checks: Checks, frame: str) -> Parts:
    """Derivatives of the velocity by q and va side by side."""
    made = (frame_velocities.derivative_along(e, checks, frame, L) for L in e.L)
    changes, more = zip(*made, strict=True)
    velocities = (frame_velocities.velocity(e, frame, L) for L in e.L)
    of_motion = checks.of_rates + checks.of_complement + checks.of_steady_motion
    return Parts(
        _moving(e),
        row_by_row(*changes, *velocities),
        [*of_motion, *chain.from_iterable(more)],
    )


def _drift(e: Equations, checks: Checks, frame: str) -> Parts:
    return Parts(
        _moving(e), frame_velocities.drift(e, frame), checks.of_rates + checks.solved(e.at_rest)
    )


def _placement(e: Equations, checks: Checks, frame: str) -> Parts:
    """Position and orientation, row by row."""
    point = e.kinematics.point(0, frame_named(e.mechanism.model, frame))
    return Parts({"q": e.q}, ca.vertcat(point.p, row_by_row(point.R)), [])


OF_FRAMES: dict[str, Callable[[Equations, Checks, str], Parts]] = {
    "frame_jacobian": _jacobian,
    "frame_jacobian_rate": _jacobian_rate,
    "frame_velocity_derivatives": _velocity_derivatives,
    "frame_drift": _drift,
    "frame_placement": _placement,
}
