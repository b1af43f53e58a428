# SPDX-License-Identifier: BSD-2-Clause
"""Dynamic parameters that bodies can have, nearest to the measured ones.

A body can have ten parameters (mass, first moments, moments of inertia) if its pseudo-inertia, a
4 x 4 matrix, is positive definite (P. M. Wensing, S. Kim, J.-J. E. Slotine, IEEE RA-L 3(1), 2018).
The pseudo-inertia is linear in them, so that the nearest parameters are the solution of a
semi-definite programme.

The unknowns x are the parameters theta in units u: theta = U x with U = diag(u). The estimate gives
the combinations B theta = b with the covariance S S^T. The prior is the robot's own parameters x_0;
the diagonal matrix P has the square roots of its weights. So the function to minimise is

    |S^-1 (B U x - b)|^2 + |P (x - x_0)|^2 = |[S^-1 B U; P] (x - x_0) - [r; 0]|^2,

with r = S^-1 (b - B U x_0). `_objective` decomposes [S^-1 B U; P] = Q R. Then the minimum without
constraints is

    x_best = x_0 + R^-1 Q^T [r; 0],

and the function is |R (x - x_best)|^2 plus a constant. `_constraints` has the constraints: G x - g
lies in a product of cones. With y = R (x - x_best), the programme is to find the shortest y for
which G R^-1 y + (G x_best - g) lies in the cones (`_shortest`).
"""

from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Indices, positive_number
from ..closed_chain import ClosedChain
from ..dynamics.regressor import OF_BODY, DynamicParameters
from ..engine import require_robot
from ..errors import InputError, MissingExtraError
from .estimation import Estimate, require_estimate

#: Least eigenvalue of a pseudo-inertia in units of the body's mass and the robot's length. It is
#: above zero, as a body whose pseudo-inertia is singular has no volume.
_LEAST_EIGENVALUE = 1e-5
#: Entries of P for parameters that are not of bodies. These parameters are in units of their
#: standard deviations, so that a weight far below 1 makes the prior weak.
_WEAK = 1e-6
#: Ends of the names of parameters that are not negative.
_NOT_NEGATIVE = (".viscous", ".coulomb", ".armature", ".stiffness", ".damping")


def consistent_parameters(
    chain: ClosedChain, found: Estimate, *, prior: float = 1e-4, total_mass: float | None = None
) -> DynamicParameters:
    """The dynamic parameters that bodies can have and that explain an estimate best.

    All ten parameters of each body that the estimate considers are found, with a positive definite
    pseudo-inertia; friction, rotors and stiffnesses are not negative. Where the estimate says
    nothing, the parameters stay near the chain's. Bodies without mass stay as they are.
    `chain.with_parameters` takes the result where it has no offsets.

    Args:
        chain: The robot whose parameters are the prior, such as values of CAD.
        found: The estimate, of this robot.
        prior: Weight of the prior, above 0: the parameters of a body have standard deviations of
            1/sqrt(prior) times m, m l, m l^2, with the mass m of the body and the length l of the
            robot.
        total_mass: Sum of the masses of all bodies, [kg], if it is known.

    Raises:
        InputError: For an estimate of another robot; for a weight or a mass that is not positive,
            or less mass than the bodies have that are not estimated; if the estimate does not
            distinguish its combinations, or the solver finds no parameters.
        MissingExtraError: Without Clarabel, `sst-pin[identification]`.

    Example:
        >>> base = sst_pin.identification.base_parameters(chain)
        >>> q, va, aa = sst_pin.identification.random_states(chain, 50)
        >>> tau = 2 * chain.compute_torques(q, va, aa)  # all is twice as heavy
        >>> tau += 1e-6 * np.random.default_rng(0).normal(size=tau.shape)
        >>> result = sst_pin.identification.estimate(chain, base, q, va, aa, tau)
        >>> theta = sst_pin.identification.consistent_parameters(chain, result)
        >>> twice = chain.with_parameters(theta).compute_torques(q, va, aa)
        >>> bool(np.allclose(twice, tau, atol=1e-4))
        True
    """
    require_robot("chain", chain)
    try:
        import clarabel  # noqa: F401
    except ModuleNotFoundError:
        raise MissingExtraError("clarabel", "identification") from None
    from scipy.linalg import solve_triangular

    require_estimate(chain, found)
    weight = positive_number("prior", prior)
    unknowns = _unknowns(chain, found)
    objective = _objective(chain, found, unknowns, weight)
    R = objective.R
    x_best = objective.x_best
    constraints = _constraints(unknowns, total_mass)
    G_over_R = np.linalg.solve(R.T, constraints.G.T).T  # G R^-1
    y, status = _shortest(G_over_R, constraints.G @ x_best - constraints.g, constraints.cones)
    x = x_best + solve_triangular(R, y)
    _require_bodies(x[: 10 * unknowns.bodies.size].reshape(-1, 10), status)
    theta = np.array(chain.dynamic_parameters)
    theta[unknowns.columns] = x * objective.units
    # The solver may violate the constraints by its tolerance.
    theta[unknowns.not_negative] = np.maximum(theta[unknowns.not_negative], 0)
    return DynamicParameters(chain.dynamic_parameters.names, theta)


class _Unknowns(NamedTuple):
    """The parameters that may change: ten of each body that is considered, then others."""

    #: Indices of the bodies.
    bodies: Indices
    #: Masses in the prior, of all bodies of the robot, [kg].
    masses: Array
    #: Indices of the other unknowns in the dynamic parameters.
    others: Indices
    #: Indices of the others that must not be negative, in the dynamic parameters.
    not_negative: Indices
    #: Indices of all unknowns in the dynamic parameters, in the order of x.
    columns: Indices


def _unknowns(chain: ClosedChain, found: Estimate) -> _Unknowns:
    """The unknowns of an estimate; bodies without mass are left out."""
    parameters = np.asarray(chain.dynamic_parameters)
    names = chain.dynamic_parameters.names
    # The dynamic parameters are ten of each body, the mass first, then all others.
    end_of_bodies = 10 * (chain.mechanism.model.njoints - 1)
    masses = parameters[:end_of_bodies:10]
    is_considered = np.zeros(parameters.size, dtype=bool)
    is_considered[found.base.considered] = True
    body_is_considered = is_considered[:end_of_bodies].reshape(-1, 10).any(axis=1)
    bodies = np.flatnonzero(body_is_considered & (masses > 0))
    others = np.flatnonzero(is_considered[end_of_bodies:]) + end_of_bodies
    not_negative = [k for k in others if names[k].endswith(_NOT_NEGATIVE)]
    parameters_of_bodies = 10 * bodies[:, None] + np.arange(10)
    return _Unknowns(
        bodies=bodies,
        masses=masses,
        others=others,
        not_negative=np.array(not_negative, dtype=np.intp),
        columns=np.concatenate([parameters_of_bodies.ravel(), others]),
    )


class _Objective(NamedTuple):
    """The function |R (x - x_best)|^2 of the k unknowns x that is minimised."""

    #: Units u of the unknowns, shape (k,).
    units: Array
    #: Upper triangular, shape (k, k).
    R: Array
    #: Shape (k,).
    x_best: Array


def _objective(
    chain: ClosedChain, found: Estimate, unknowns: _Unknowns, weight: float
) -> _Objective:
    """The function to minimise; see the module. `weight` is that of the prior of bodies."""
    from scipy.linalg import solve_triangular

    try:
        S = np.linalg.cholesky(found.covariance)
    except np.linalg.LinAlgError:
        problem = "its combinations cannot be distinguished; base_parameters(motion=) finds others"
        raise InputError("found", problem) from None
    S_inverse_B = solve_triangular(S, found.base.matrix, lower=True)
    theta_0 = np.asarray(chain.dynamic_parameters)
    # The solution is computed as a change from the prior. So values that are known poorly keep
    # their digits beside values that are known a million times better.
    r = solve_triangular(S, found.values - found.base.matrix @ theta_0, lower=True)

    # Units of a body: its mass m times powers of the robot's length l. Units of other parameters:
    # their standard deviations if all other parameters were known. If the estimate says nothing
    # about a parameter, only the weak prior acts on it, and its unit does not matter.
    powers_of_length = chain.mechanism.length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    units_of_bodies = np.outer(unknowns.masses[unknowns.bodies], powers_of_length).ravel()
    inverse_deviations = np.linalg.norm(S_inverse_B[:, unknowns.others], axis=0)
    units_of_others = 1 / np.maximum(inverse_deviations, 1e-9)
    units = np.concatenate([units_of_bodies, units_of_others])

    diagonal_of_P = np.full(units.size, _WEAK)
    diagonal_of_P[: units_of_bodies.size] = np.sqrt(weight)
    S_inverse_B_U = S_inverse_B[:, unknowns.columns] * units
    Q, R = np.linalg.qr(np.vstack([S_inverse_B_U, np.diag(diagonal_of_P)]))
    Q_T_r = Q[: r.size].T @ r  # Q^T [r; 0]
    x_0 = theta_0[unknowns.columns] / units
    return _Objective(units, R, x_best=x_0 + solve_triangular(R, Q_T_r))


class _Constraints(NamedTuple):
    """G x - g lies in the product of some cones of the solver, which take the rows in order."""

    G: Array
    g: Array
    cones: list[Any]


def _constraints(unknowns: _Unknowns, total_mass: float | None) -> _Constraints:
    """All constraints on the unknowns."""
    parts = [_pseudo_inertia_constraints(unknowns), _sign_constraints(unknowns)]
    if total_mass is not None:
        parts.insert(0, _mass_constraint(unknowns, positive_number("total_mass", total_mass)))
    cones = []
    for part in parts:
        cones += part.cones
    return _Constraints(
        G=np.vstack([part.G for part in parts]),
        g=np.concatenate([part.g for part in parts]),
        cones=cones,
    )


def _mass_constraint(unknowns: _Unknowns, total_mass: float) -> _Constraints:
    """The sum of the masses of all bodies is known, [kg]."""
    import clarabel

    fixed = np.delete(unknowns.masses, unknowns.bodies).sum()
    mass_of_unknowns = total_mass - fixed
    if mass_of_unknowns <= 0 or not unknowns.bodies.size:
        raise InputError("total_mass", f"{total_mass:g} kg; fixed masses have {fixed:g} kg")
    row = np.zeros(unknowns.columns.size)
    # The unknown mass of a body is in units of the mass in the prior.
    for k, body in enumerate(unknowns.bodies):
        row[10 * k + OF_BODY.index("mass")] = unknowns.masses[body]
    return _Constraints(row[None], np.array([mass_of_unknowns]), [clarabel.ZeroConeT(1)])


def _pseudo_inertia_constraints(unknowns: _Unknowns) -> _Constraints:
    """The pseudo-inertia of each body, minus `_LEAST_EIGENVALUE`, is positive semidefinite.

    The solver expects the ten entries of the upper triangle of a symmetric 4 x 4 matrix, column by
    column. Entries beside the diagonal are multiplied by sqrt(2), so that the norm of this vector
    is the norm of the matrix.
    """
    import clarabel

    # `tril_indices` lists the lower triangle row by row. With rows and columns exchanged, this is
    # the upper triangle column by column.
    column, row = np.tril_indices(4)
    is_diagonal = row == column
    factors = np.where(is_diagonal, 1.0, np.sqrt(2.0))
    # The pseudo-inertia is linear in the ten parameters. Column k of this matrix is the triangle if
    # the parameters are the unit vector k.
    triangle_by_parameters = (pseudo_inertias(np.eye(10))[:, row, column] * factors).T
    least_triangle = np.where(is_diagonal, _LEAST_EIGENVALUE, 0.0)

    bodies = unknowns.bodies.size
    G = np.zeros((10 * bodies, unknowns.columns.size))
    for k in range(bodies):
        ten = slice(10 * k, 10 * k + 10)
        G[ten, ten] = triangle_by_parameters
    cones = [clarabel.PSDTriangleConeT(4) for _ in range(bodies)]
    return _Constraints(G, np.tile(least_triangle, bodies), cones)


def _sign_constraints(unknowns: _Unknowns) -> _Constraints:
    """Parameters of friction, rotors and springs are not negative."""
    import clarabel

    # A row of the identity for each of these parameters.
    identity = np.eye(unknowns.columns.size)
    G = identity[np.isin(unknowns.columns, unknowns.not_negative)]
    return _Constraints(G, np.zeros(len(G)), [clarabel.NonnegativeConeT(len(G))])


def _require_bodies(ten: Array, status: str) -> None:
    """Check that the solver found bodies, by ten parameters of each, shape (bodies, 10)."""
    least = np.linalg.eigvalsh(pseudo_inertias(ten)).min(initial=1.0)
    if status not in ("Solved", "AlmostSolved") or not least > 0:
        raise InputError("found", f"no bodies were found near it: {status}; a larger prior helps")


def _shortest(matrix: Array, offset: Array, cones: list[Any]) -> tuple[Array, str]:
    """The shortest y with `matrix` y + `offset` in the cones, and the status of the solver."""
    import clarabel
    from scipy.sparse import csc_matrix, eye

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_feas = 1e-9
    # Where the prior alone decides, its small weight needs a small gap.
    settings.tol_gap_abs = 1e-12
    settings.tol_gap_rel = 1e-12
    # The solver minimises y^T identity y / 2 + zero^T y. Its constraint is that a vector minus a
    # matrix times y lies in the cones, so the matrix gets a minus sign.
    identity = eye(matrix.shape[1], format="csc")
    zero = np.zeros(matrix.shape[1])
    for scaled in (True, False):  # scaling can spoil well-known values beside poorly known ones
        settings.equilibrate_enable = scaled
        solver = clarabel.DefaultSolver(
            identity, zero, csc_matrix(-matrix), offset, cones, settings
        )
        solution = solver.solve()
        if str(solution.status) == "Solved":
            break
    return np.array(solution.x), str(solution.status)


def pseudo_inertias(ten: Array) -> Array:
    """Pseudo-inertias [[S, h], [h^T, m]], S = tr(I)/2 - I, shape (..., 4, 4).

    The ten parameters of a body, shape (..., 10), are its mass m, the first moments h, and the
    moments of inertia I about the origin.
    """
    m, x, y, z, ixx, ixy, iyy, ixz, iyz, izz = np.moveaxis(ten, -1, 0)
    half_trace = (ixx + iyy + izz) / 2
    rows = [
        [half_trace - ixx, -ixy, -ixz, x],
        [-ixy, half_trace - iyy, -iyz, y],
        [-ixz, -iyz, half_trace - izz, z],
        [x, y, z, m],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
