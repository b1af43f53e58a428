# SPDX-License-Identifier: BSD-2-Clause
"""Dynamic parameters that bodies can have, nearest to the measured ones.

A body can have ten parameters if its pseudo-inertia is positive definite (P. M. Wensing, S. Kim,
J.-J. E. Slotine, IEEE RA-L 3(1), 2018). The parameters are linear in it, so that the nearest ones
are the solution of a semi-definite programme.
"""

from typing import Any

import numpy as np

from ..arrays import Array, Indices, positive_number
from ..closed_chain import ClosedChain
from ..dynamics.regressor import DynamicParameters
from ..errors import InputError, MissingExtraError
from .estimation import Estimate

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
    try:
        import clarabel
    except ModuleNotFoundError:
        raise MissingExtraError("clarabel", "identification") from None
    from scipy.linalg import block_diag, solve_triangular

    found.base.require_for(chain)
    cad = np.asarray(chain.dynamic_parameters)
    weight = positive_number("prior", prior)
    # The unknowns: ten parameters of each body that is considered, then all others considered.
    end_of_bodies = 10 * (chain.mechanism.model.njoints - 1)
    masses = cad[:end_of_bodies:10]
    varied = np.zeros(cad.size, dtype=bool)
    varied[found.base.considered] = True
    body_varies = varied[:end_of_bodies].reshape(-1, 10).any(axis=1)
    varied_bodies = np.flatnonzero(body_varies & (masses > 0))
    others = np.flatnonzero(varied[end_of_bodies:]) + end_of_bodies
    parameters_of_bodies = 10 * varied_bodies[:, None] + np.arange(10)
    columns = np.concatenate([parameters_of_bodies.ravel(), others])
    # Units: masses of bodies and length of the robot; for other unknowns, their deviations alone.
    powers_of_length = chain.mechanism.length ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    units_of_bodies = np.outer(masses[varied_bodies], powers_of_length).ravel()
    units, R, best = _least_squares(found, cad, columns, units_of_bodies, float(np.sqrt(weight)))

    # Constraints: rows x - floor lies in a product of cones.
    names = chain.dynamic_parameters.names
    positive = [k for k, i in enumerate(others) if names[i].endswith(_POSITIVE)]
    body_rows = (pseudo_inertias(np.eye(10))[:, _ROWS, _COLUMNS] * _FACTORS).T
    rows = [block_diag(*[body_rows] * varied_bodies.size, np.eye(others.size)[positive])]
    least = np.where(_ROWS == _COLUMNS, _LEAST, 0.0)
    floor = [np.tile(least, varied_bodies.size), np.zeros(len(positive))]
    cones = [clarabel.PSDTriangleConeT(4)] * varied_bodies.size + [
        clarabel.NonnegativeConeT(len(positive))
    ]
    if total_mass is not None:
        fixed = np.delete(masses, varied_bodies).sum()
        mass_of_varied = positive_number("total_mass", total_mass) - fixed
        if mass_of_varied <= 0 or not varied_bodies.size:
            raise InputError("total_mass", f"{total_mass:g} kg; fixed masses have {fixed:g} kg")
        mass_of_bodies = np.kron(masses[varied_bodies], np.eye(10)[0])
        rows.insert(0, np.append(mass_of_bodies, np.zeros(others.size))[None])
        floor.insert(0, np.array([mass_of_varied]))
        cones.insert(0, clarabel.ZeroConeT(1))
    A = np.vstack(rows)

    # With x = best + R^-1 y, the shortest y is the nearest solution.
    y, status = _nearest(np.linalg.solve(R.T, A.T).T, A @ best - np.concatenate(floor), cones)
    best += solve_triangular(R, y)
    _require_bodies(best[: 10 * varied_bodies.size].reshape(-1, 10), status)
    theta = cad.copy()
    theta[columns] = best * units
    # The solver may violate the constraints by its tolerance.
    theta[others[positive]] = np.maximum(theta[others[positive]], 0)
    return DynamicParameters(names, theta)


def _least_squares(
    found: Estimate, cad: Array, columns: Indices, units_of_bodies: Array, weight: float
) -> tuple[Array, Array, Array]:
    """Units of the unknowns, R of their least squares with the prior, and their solution."""
    from scipy.linalg import solve_triangular

    try:
        root = np.linalg.cholesky(found.covariance)
    except np.linalg.LinAlgError:
        problem = "its combinations cannot be distinguished; base_parameters(motion=) finds others"
        raise InputError("found", problem) from None
    rows = solve_triangular(root, found.base.matrix, lower=True)
    # Deviations from the prior keep their digits beside values that are known a million times
    # better.
    deviations = solve_triangular(root, found.values - found.base.matrix @ cad, lower=True)
    bodies = units_of_bodies.size
    sizes = np.linalg.norm(rows[:, columns[bodies:]], axis=0)
    units = np.concatenate([units_of_bodies, 1 / np.maximum(sizes, 1e-9)])
    weights = np.full(units.size, _WEAK)
    weights[:bodies] = weight
    Q, R = np.linalg.qr(np.vstack([rows[:, columns] * units, np.diag(weights)]))
    best = cad[columns] / units + solve_triangular(R, Q[: deviations.size].T @ deviations)
    return units, R, best


def _require_bodies(ten: Array, status: str) -> None:
    least = np.linalg.eigvalsh(pseudo_inertias(ten)).min(initial=1.0)
    if status not in ("Solved", "AlmostSolved") or not least > 0:
        raise InputError("found", f"no bodies were found near it: {status}; a larger prior helps")


def _nearest(reach: Array, room: Array, cones: list[Any]) -> tuple[Array, str]:
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
    """Pseudo-inertias [[S, h], [h^T, m]], S = tr(I)/2 - I, of ten parameters, shape (..., 4, 4)."""
    m, x, y, z, ixx, ixy, iyy, ixz, iyz, izz = np.moveaxis(ten, -1, 0)
    half = (ixx + iyy + izz) / 2
    rows = [[half - ixx, -ixy, -ixz, x], [-ixy, half - iyy, -iyz, y], [-ixz, -iyz, half - izz, z]]
    return np.moveaxis(np.array([*rows, [x, y, z, m]]), (0, 1), (-2, -1))
