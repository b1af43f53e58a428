# SPDX-License-Identifier: BSD-2-Clause
"""All kernels that can be compiled: functions of one sample, on CasADi's symbols.

A kernel has named inputs (such as q, va, aa), the symbolic parameters p, a column of results, and
checks, which are at most 1 if the results are right (`kernel_checks`). Matrices among the results
are written row by row.

`make` makes the kernel of a quantity. `KERNELS` and `OF_FRAMES` list the functions that write the
symbols of each quantity. For some quantities, `along_directions` writes a second kind of kernel,
which computes a matrix column by column, along a *direction* for each coordinate: the motion of the
joints for the unit rate of this coordinate.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
from casadi import SX

from ..dynamics.quantities import Quantity
from ..model.tree import frame_named
from . import along_directions, frame_velocities, symbolic_derivatives
from .along_directions import Directions, KernelParts
from .elimination import total
from .equations import Equations
from .joint_wrenches import reactions
from .kernel_checks import Checks
from .symbols import Sparse, add, column, row_by_row

#: The input of kernels on which external wrenches act.
WRENCHES = "external_wrenches"


@dataclass(frozen=True)
class SymbolicKernel:
    """A function of one sample."""

    #: The name of its quantity, with "_along" if it computes along directions, and with "_loaded"
    #: if external wrenches are an input.
    name: str
    #: Symbols of each input by its name, column vectors.
    inputs: dict[str, SX]
    #: The symbolic parameters p.
    parameters: SX
    #: All results in a column. With `along`, only the results that are computed once; the passes of
    #: `along` compute the others once for each direction.
    output: SX
    #: Numbers that are at most 1 if the results are right.
    checks: SX
    #: Factors that make the entries of q free of units: one over the robot's length for lengths.
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
    """The kernel of a quantity.

    Args:
        equations: The equations of the robot.
        quantity: A key of `KERNELS`, or of `OF_FRAMES` with a frame.
        checks: Checks of this robot; by default those for double precision.
        frame: Name of the frame, for a quantity of a frame.
        along: Whether results are computed along directions of the coordinates.
    """
    checks = checks or Checks(equations)
    name = quantity
    directions = None
    if along:
        parts, directions = along_directions.make(equations, checks, quantity, frame)
        name += "_along"
    elif frame is not None:
        parts = OF_FRAMES[quantity](equations, checks, frame)
    else:
        parts = KERNELS[quantity](equations, checks)

    inputs = dict(parts.inputs)
    if WRENCHES in inputs:
        if inputs[WRENCHES].numel():
            name += "_loaded"
        else:  # equations without external wrenches
            del inputs[WRENCHES]

    length = equations.mechanism.length
    units = []
    for unit in equations.mechanism.space.position_units:
        units.append(1 / length if unit == "m" else 1.0)
    output = ca.densify(parts.output)
    all_checks = ca.vertcat(*(SX(check) for check in [*checks.of_state, *parts.checks]))
    if quantity == "closing":
        output, all_checks = _at_unit_vectors(equations, checks, output, all_checks)
    return SymbolicKernel(
        name=name,
        inputs=inputs,
        parameters=equations.p,
        output=output,
        checks=all_checks,
        units=tuple(units),
        along=directions,
    )


def entry(
    equations: Equations, key: Quantity, checks: Checks | None = None
) -> list[SymbolicKernel]:
    """The kernels that compute the quantity `key`: one, or two for a rollout.

    Each `Quantity` is compiled to a library of its own, or to a module of Warp.
    """
    names: list[str] = [key.name]
    if key.name == "rollout":
        names = ["closing", "state_rate"]
    return [make(equations, name, checks, frame=key.frame, along=key.along) for name in names]


# --- inputs that several quantities share -------------------------------------------------------


def _moving(e: Equations) -> dict[str, SX]:
    return {"q": e.q, "va": e.va}


def _motion(e: Equations) -> dict[str, SX]:
    """Inputs of inverse dynamics."""
    return _moving(e) | {"aa": e.aa, WRENCHES: e.loads}


def _driven(e: Equations) -> dict[str, SX]:
    """Inputs of direct dynamics."""
    return _moving(e) | {"tau": e.tau, WRENCHES: e.loads}


# --- quantities ---------------------------------------------------------------------------------


def _forces(e: Equations, checks: Checks) -> KernelParts:
    return KernelParts(_motion(e), e.generalized_forces, checks.of_forces)


def _torques(e: Equations, checks: Checks) -> KernelParts:
    """The smallest torques that produce the motion."""
    forces = _forces(e, checks)
    if e.mechanism.driven_one_to_one:
        return forces
    f = forces.output
    tau = e.smallest_torques(f)
    return KernelParts(
        inputs=forces.inputs,
        output=column(tau, range(e.mechanism.motor_count)),
        checks=[*forces.checks, *checks.of_motors, *checks.unsupplied(tau, f)],
    )


def _accelerations(e: Equations, checks: Checks) -> KernelParts:
    return KernelParts(_driven(e), e.accelerations, checks.of_accelerations + checks.massless)


def _torque_derivatives(e: Equations, checks: Checks) -> KernelParts:
    """Derivatives of f by q, va and aa side by side."""
    derivatives, more_checks = symbolic_derivatives.of_torques(e, checks)
    return KernelParts(_motion(e), row_by_row(derivatives), checks.of_forces + more_checks)


def _acceleration_derivatives(e: Equations, checks: Checks) -> KernelParts:
    """Derivatives of aa by q, va and tau side by side."""
    # `more_checks` contain `massless`, because this function solves with the mass matrix.
    derivatives, more_checks = symbolic_derivatives.of_accelerations(e, checks)
    return KernelParts(_driven(e), row_by_row(derivatives), checks.of_accelerations + more_checks)


def _displacement_rates(e: Equations, checks: Checks) -> KernelParts:
    """D, shape (n, n), row by row, as `Engine.displacement_rates` defines it.

    Let x be the small displacement, in the coordinates, from the motion to a motion beside it, and
    dva the difference of their rates va. Then x_dot = dva + D x. D is zero unless a coordinate is a
    rate whose axis turns with its body, such as a rate of a ball.
    """
    columns = (symbolic_derivatives.displacement_rates_along(e, L) for L in e.L)
    return KernelParts(_moving(e), row_by_row(*columns), checks.of_rates + checks.of_steady_motion)


def _reduced_terms(e: Equations, checks: Checks) -> KernelParts:
    """Mass matrix, Coriolis matrix, forces of gravity with springs, forces of friction."""
    # Forces that the motors need against weights (without rates and accelerations), springs and
    # friction. The terms are the forces of weights, springs and friction, hence the signs below.
    # The springs depend on the rates, because these determine which cables are slack.
    gravity = e.projected_by_L(add(e.tree.forces({}, {}, loads=False), e.tree.springs(e.v)))
    friction = e.projected_by_L(e.tree.friction(e.v))
    terms = [row_by_row(e.inertia), row_by_row(e.coriolis), -gravity, -friction]
    return KernelParts(_moving(e), ca.vertcat(*terms), checks.of_accelerations)


def _torque_regressor(e: Equations, checks: Checks) -> KernelParts:
    """Y: derivatives of f by all dynamic parameters.

    Its columns belong to bodies and joints, offsets of joint forces, lines, and offsets of motors.
    """
    nv = e.mechanism.model.nv
    by_symbols = ca.jacobian(e.projected_by_L(e.tree_forces), e.p)
    # By the chain rule: the symbols p are linear functions of the dynamic parameters.
    blocks = [by_symbols @ ca.sparsify(ca.DM(x)) for x in e.parameters.by_parameters()]
    *bodies_and_joints, lines = blocks
    joint_offsets = [e.projected_by_L({i: 1.0}) for i in range(nv)]
    motor_offsets = [e.projected_by_L(forces) for forces in e.motor_columns]
    return KernelParts(
        inputs=_moving(e) | {"aa": e.aa},
        output=row_by_row(*bodies_and_joints, *joint_offsets, lines, *motor_offsets),
        checks=checks.of_rates + checks.of_joint_accelerations(e.dv) + checks.of_complement,
    )


def _reactions(e: Equations, checks: Checks) -> KernelParts:
    inputs, results, all_checks = reactions(e, checks)
    return KernelParts(inputs, results, all_checks)


def _rates(e: Equations, checks: Checks) -> KernelParts:
    return KernelParts(_moving(e), column(e.v, range(e.mechanism.model.nv)), checks.of_rates)


def _joint_accelerations(e: Equations, checks: Checks) -> KernelParts:
    return KernelParts(
        inputs=_moving(e) | {"aa": e.aa},
        output=column(e.dv, range(e.mechanism.model.nv)),
        checks=checks.of_rates + checks.of_joint_accelerations(e.dv),
    )


def _actuator_jacobian(e: Equations, checks: Checks) -> KernelParts:
    """J, shape (motors, n), row by row: the motor matrix L^T B column by column."""
    all_checks = [check for forces in e.motor_columns for check in checks.unbalanced(forces)]
    return KernelParts({"q": e.q}, ca.vec(e.motor_matrix), all_checks)


def _state_rate(e: Equations, checks: Checks) -> KernelParts:
    """Rates of q and va under motor torques."""
    direct = _accelerations(e, checks)
    rates = ca.vertcat(e.kinematics.q_rates(e.v), direct.output)
    return KernelParts(direct.inputs, rates, direct.checks)


def _closing(e: Equations, checks: Checks) -> KernelParts:
    """q after a step of Newton's method, det Phi_u, and the sum of squares of the entries of Phi_u.

    The step holds the coordinates: Phi_u v_u = -f, with the residuals f of the closures. Rows that
    constrain rates only have no residual and f = 0, so wheels roll during the step.

    Phi_u has all rows of the closures, and the sum is over all of them. The determinant is that of
    the rows with pivots; the other rows are redundant. Both numbers are free of units.
    """
    right = Sparse()
    for i in e.factors.rows:
        residual = e.rows[i].residual
        if residual is not None:
            right[i] = -residual
    step = e.kinematics.q_rates(e.factors.solve(right))

    row_scale = e.mechanism.row_scale
    rate_scale = e.mechanism.rate_scale
    squares = []
    for i, row in enumerate(e.rows):
        for j in e.mechanism.dependent:
            if j in row.Phi:
                squares.append((row_scale[i] * rate_scale[j] * row.Phi[j]) ** 2)
    return KernelParts(
        inputs={"q": e.q},
        output=ca.vertcat(
            e.kinematics.normalized(e.q + step), e.pivots.determinant, total(squares)
        ),
        checks=[],
    )


def _at_unit_vectors(e: Equations, checks: Checks, output: SX, values: SX) -> tuple[SX, SX]:
    """Output and check values of "closing" as functions of a q that is normalised first.

    An integration leaves cosine-sine pairs and quaternions whose length is not one. Such a length
    stretches the links, and their equations have another solution, which Newton's step would find.
    """
    if not e.kinematics.unit_gaps:
        return output, values
    q = e.kinematics.normalized(e.q)
    output, values = ca.substitute([output, values], [e.q], [q])
    # `make` puts the checks of `of_state` first, and the first of these is that of open loops.
    # After the substitution, its term for lengths of unit vectors is zero. `unit_lengths` is this
    # term for the lengths in q itself.
    values[0] += checks.unit_lengths
    return output, values


KERNELS: dict[str, Callable[..., KernelParts]] = {
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


# --- quantities of frames -----------------------------------------------------------------------


def _jacobian(e: Equations, checks: Checks, frame: str) -> KernelParts:
    columns = (frame_velocities.velocity(e, frame, L) for L in e.L)
    return KernelParts({"q": e.q}, row_by_row(*columns), checks.of_complement)


def _jacobian_rate(e: Equations, checks: Checks, frame: str) -> KernelParts:
    columns = []
    all_checks = checks.of_rates + checks.of_complement + checks.of_steady_motion
    for L in e.L:
        rate, more_checks = frame_velocities.rate_of_column(e, checks, frame, L)
        columns.append(rate)
        all_checks += more_checks
    return KernelParts(_moving(e), row_by_row(*columns), all_checks)


def _velocity_derivatives(e: Equations, checks: Checks, frame: str) -> KernelParts:
    """Derivatives of the velocity by q and va side by side."""
    by_q = []
    by_va = []
    all_checks = checks.of_rates + checks.of_complement + checks.of_steady_motion
    for L in e.L:
        change, more_checks = frame_velocities.derivative_along(e, checks, frame, L)
        by_q.append(change)
        by_va.append(frame_velocities.velocity(e, frame, L))
        all_checks += more_checks
    return KernelParts(_moving(e), row_by_row(*by_q, *by_va), all_checks)


def _drift(e: Equations, checks: Checks, frame: str) -> KernelParts:
    """Acceleration of a frame for aa = 0."""
    return KernelParts(
        _moving(e),
        frame_velocities.drift(e, frame),
        checks.of_rates + checks.of_joint_accelerations(e.dv_without_aa),
    )


def _placement(e: Equations, checks: Checks, frame: str) -> KernelParts:
    """Position and orientation of a frame."""
    point = e.kinematics.moving_frame(0, frame_named(e.mechanism.model, frame))
    return KernelParts({"q": e.q}, ca.vertcat(point.p, row_by_row(point.R)), [])


OF_FRAMES: dict[str, Callable[[Equations, Checks, str], KernelParts]] = {
    "frame_jacobian": _jacobian,
    "frame_jacobian_rate": _jacobian_rate,
    "frame_velocity_derivatives": _velocity_derivatives,
    "frame_drift": _drift,
    "frame_placement": _placement,
}
