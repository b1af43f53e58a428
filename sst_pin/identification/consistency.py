# SPDX-License-Identifier: BSD-2-Clause
"""Dynamic parameters that bodies can have, nearest to the measured ones.

A body can have ten parameters if its pseudo-inertia is positive definite (P. M. Wensing, S. Kim,
J.-J. E. Slotine, IEEE RA-L 3(1), 2018). The pseudo-inertia is linear in them, so that the nearest
parameters are the solution of a semi-definite programme:

    minimise |R (x - best)|^2    so that    G x - g lies in a product of cones.

x are the unknown parameters in suitable units. The first term is the estimate, with the weights of
its covariance, and the prior, both as one triangular R with the solution `best` if there were no
constraints.
"""

from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Indices, positive_number
from ..closed_chain import ClosedChain
from ..dynamics.regressor import DynamicParameters
from ..engine import require_robot
from ..errors import InputError, MissingExtraError
from .estimation import Estimate, require_estimate

#: Least eigenvalue of a pseudo-inertia in units of the body's mass and the robot's length.
_LEAST = 1e-5
#: Root of the prior's weight for parameters that are not of bodies, in their deviations.
_WEAK = 1e-6
#: Parameters that are not negative.
_POSITIVE = (".viscous", ".coulomb", ".armature", ".stiffness", ".damping")
#: Upper triangle of a 4 x 4 matrix, column by column, as the solver expects it: the lower one, row
#: by row, with rows and columns exchanged.
_COLUMNS, _ROWS = np.tril_indices(4)
#: Factors of the entries with which the triangle has the same norm as the symmetric matrix.
_FACTORS = np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0))


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
    weight = float(np.sqrt(positive_number("prior", prior)))
    unknowns = _unknowns(chain, found)
    fit = _least_squares(chain, found, unknowns, weight)
    constraints = _constraints(chain, unknowns, total_mass)

    # With x = best + R^-1 y, the shortest y is the nearest solution.
    reach = np.linalg.solve(fit.R.T, constraints.G.T).T
    y, status = _shortest(reach, constraints.G @ fit.best - constraints.g, constraints.cones)
    x = fit.best + solve_triangular(fit.R, y)
    _require_bodies(x[: 10 * unknowns.bodies.size].reshape(-1, 10), status)
    theta = np.array(chain.dynamic_parameters)
    theta[unknowns.columns] = x * fit.units
    # The solver may violate the constraints by its tolerance.
    theta[unknowns.positive] = np.maximum(theta[unknowns.positive], 0)
    return DynamicParameters(chain.dynamic_parameters.names, theta)


class _Unknowns(NamedTuple):
    """The parameters that may change: ten of each body that is considered, then others."""

    #: Indices of the bodies.
    bodies: Indices
    #: Masses of all bodies of the robot, [kg].
    masses: Array
    #: Indices of the other unknowns in the dynamic parameters.
    others: Indices
    #: Those of the others that must not be negative.
    positive: Indices
    #: Indices of all unknowns in the dynamic parameters.
    columns: Indices


def _unknowns(chain: ClosedChain, found: Estimate) -> _Unknowns:
    """The unknowns of an estimate; bodies without mass are left out."""
    parameters = np.asarray(chain.dynamic_parameters)
    names = chain.dynamic_parameters.names
    end_of_bodies = 10 * (chain.mechanism.model.njoints - 1)
    masses = parameters[:end_of_bodies:10]
    is_considered = np.zeros(parameters.size, dtype=bool)
    is_considered[found.base.considered] = True
    body_is_considered = is_considered[:end_of_bodies].reshape(-1, 10).any(axis=1)
    bodies = np.flatnonzero(body_is_considered & (masses > 0))
    others = np.flatnonzero(is_considered[end_of_bodies:]) + end_of_bodies
    positive = [k for k in others if names[k].endswith(_POSITIVE)]
    parameters_of_bodies = 10 * bodies[:, None] + np.arange(10)
    return _Unknowns(
        bodies=bodies,
        masses=masses,
        others=others,
        positive=np.array(positive, dtype=np.intp),
        columns=np.concatenate([parameters_of_bodies.ravel(), others]),
    )


class _LeastSquares(NamedTuple):
    """The term |R (x - best)|^2 that is minimised."""

    #: Units of the unknowns x, shape (k,).
    units: Array
    #: Upper triangular, shape (k, k).
    R: Array
    #: Shape (k,).
    best: Array


def _least_squares(
    chain: ClosedChain, found: Estimate, unknowns: _Unknowns, weight: float
) -> _LeastSquares:
    """The estimate and the prior as one triangular system.

    `weight` is the root of the prior's weight for parameters of bodies.
    """
    from scipy.linalg import solve_triangular

    # The estimate: rows theta = values, in units of their standard deviations.
    try:
        root = np.linalg.cholesky(found.covariance)
    except np.linalg.LinAlgError:
        problem = "its combinations cannot be distinguished; base_parameters(motion=) finds others"
        raise InputError("found", problem) from None
    rows = solve_triangular(root, found.base.matrix, lower=True)
    # Deviations from the prior keep their digits beside values that are known a million times
    # better.
    prior = np.asarray(chain.dynamic_parameters)
    deviations = solve_triangular(root, found.values - found.base.matrix @ prior, lower=True)

    # Units: masses of bodies and the length of the robot; for others, their deviations alone.
    powers_of_length = chain.mechanism.length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    units_of_bodies = np.outer(unknowns.masses[unknowns.bodies], powers_of_length).ravel()
    sizes = np.linalg.norm(rows[:, unknowns.others], axis=0)
    units = np.concatenate([units_of_bodies, 1 / np.maximum(sizes, 1e-9)])

    # The prior: x is the chain's parameters, with the weights of bodies or a weak one.
    weights = np.full(units.size, _WEAK)
    weights[: units_of_bodies.size] = weight
    Q, R = np.linalg.qr(np.vstack([rows[:, unknowns.columns] * units, np.diag(weights)]))
    change = solve_triangular(R, Q[: deviations.size].T @ deviations)
    return _LeastSquares(units, R, prior[unknowns.columns] / units + change)


class _Constraints(NamedTuple):
    """G x - g lies in the product of some cones of the solver."""

    G: Array
    g: Array
    cones: list[Any]


def _constraints(chain: ClosedChain, unknowns: _Unknowns, total_mass: float | None) -> _Constraints:
    """Total mass, positive definite pseudo-inertias, and parameters that are not negative."""
    import clarabel
    from scipy.linalg import block_diag

    count = unknowns.bodies.size
    masses = unknowns.masses
    G = list[Array]()
    g = list[Array]()
    cones = list[Any]()

    # The sum of the masses is known.
    if total_mass is not None:
        fixed = np.delete(masses, unknowns.bodies).sum()
        mass_of_bodies = positive_number("total_mass", total_mass) - fixed
        if mass_of_bodies <= 0 or not count:
            raise InputError("total_mass", f"{total_mass:g} kg; fixed masses have {fixed:g} kg")
        # The mass is the first of ten parameters, in units of the body's mass.
        row = np.kron(masses[unknowns.bodies], np.eye(10)[0])
        G.append(np.append(row, np.zeros(unknowns.others.size))[None])
        g.append(np.array([mass_of_bodies]))
        cones.append(clarabel.ZeroConeT(1))

    # Each pseudo-inertia, minus the least one, is positive semidefinite. The solver expects the
    # upper triangle.
    triangle_by_parameters = (pseudo_inertias(np.eye(10))[:, _ROWS, _COLUMNS] * _FACTORS).T
    least = np.where(_ROWS == _COLUMNS, _LEAST, 0.0)
    # Parameters of friction, rotors and springs are not negative.
    is_positive = np.isin(unknowns.others, unknowns.positive)
    rows_of_positive = np.eye(unknowns.others.size)[is_positive]
    G.append(block_diag(*[triangle_by_parameters] * count, rows_of_positive))
    g.append(np.append(np.tile(least, count), np.zeros(unknowns.positive.size)))
    cones += [clarabel.PSDTriangleConeT(4) for _ in range(count)]
    cones.append(clarabel.NonnegativeConeT(unknowns.positive.size))
    return _Constraints(np.vstack(G), np.concatenate(g), cones)


def _require_bodies(ten: Array, status: str) -> None:
    """Check that the solver found bodies, by ten parameters of each, shape (bodies, 10)."""
    least = np.linalg.eigvalsh(pseudo_inertias(ten)).min(initial=1.0)
    if status not in ("Solved", "AlmostSolved") or not least > 0:
        raise InputError("found", f"no bodies were found near it: {status}; a larger prior helps")


def _shortest(reach: Array, room: Array, cones: list[Any]) -> tuple[Array, str]:
    """The shortest y with `reach` y + `room` in the cones, and the status of the solver."""
    import clarabel
    from scipy.sparse import csc_matrix, eye

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_feas = 1e-9
    # Where the prior alone decides, its small weight needs a small gap.
    settings.tol_gap_abs = 1e-12
    settings.tol_gap_rel = 1e-12
    n = reach.shape[1]
    problem = (eye(n, format="csc"), np.zeros(n), csc_matrix(-reach), room)
    for scaled in (True, False):  # scaling can spoil well-known values beside poorly known ones
        settings.equilibrate_enable = scaled
        solution = clarabel.DefaultSolver(*problem, cones, settings).solve()
        if str(solution.status) == "Solved":
            break
    return np.array(solution.x), str(solution.status)


def pseudo_inertias(ten: Array) -> Array:
    """Pseudo-inertias [[S, h], [h^T, m]], S = tr(I)/2 - I, shape (..., 4, 4).

    The ten parameters of a body, shape (..., 10), are its mass m, the first moments h, and the
    moments of inertia I about the origin.
    """
    m, x, y, z, ixx, ixy, iyy, ixz, iyz, izz = np.moveaxis(ten, -1, 0)
    half = (ixx + iyy + izz) / 2
    rows = [[half - ixx, -ixy, -ixz, x], [-ixy, half - iyy, -iyz, y], [-ixz, -iyz, half - izz, z]]
    return np.moveaxis(np.array([*rows, [x, y, z, m]]), (0, 1), (-2, -1))
