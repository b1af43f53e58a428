# SPDX-License-Identifier: BSD-2-Clause
"""Base parameters: the combinations of dynamic parameters that forces depend on.

`base_parameters` takes the columns of the regressor at random states one after the other
(M. Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic Systems 8,
1991). `independent` finds the columns that do not depend on the columns before them, and
`_combinations` writes all columns as combinations of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import arrays
from ..arrays import Array, Indices, in_order, names_matching_any
from ..closed_chain import ClosedChain
from ..dynamics.regressor import OF_BODY
from ..engine import require_robot
from ..errors import InputError
from ..summaries import Summary, listed
from .random_states import random_states

#: A column depends on others if its part outside their span is below this part of its size.
_DEPENDENT = 1e-9
#: Number of equations for each parameter: enough that no column depends on others by chance.
_ROWS = 2.5


@dataclass(frozen=True, repr=False, eq=False)
class BaseParameters(Summary):
    """The b combinations of p dynamic parameters that can be identified.

    The forces due to the parameters considered are Y theta = Y[..., columns] @ (matrix @ theta),
    with the regressor Y, shape (..., n, p), and the dynamic parameters theta.

    Attributes:
        names: Each combination, such as "crank.ixx + 0.25 coupler.mass".
        matrix: Their coefficients, shape (b, p); zero for parameters that are not considered.
        columns: Indices of independent columns of the regressor, one for each combination, (b,).
        considered: Indices of the parameters considered; other parameters are taken as known.
        unseen: Names of the parameters considered that change no force.
        parameters: Names of all p parameters of the robot.
    """

    names: tuple[str, ...]
    matrix: Array
    columns: Indices
    considered: Indices
    unseen: tuple[str, ...]
    parameters: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [(str(k), name) for k, name in enumerate(self.names, 1)]
        rows += [("unseen", listed(self.unseen, 12))] if self.unseen else []
        return f"{len(self)} base parameters of {len(self.considered)} parameters", rows


def require_base(chain: ClosedChain, base: object) -> None:
    """Raise an `InputError` if `base` is not the base parameters of this robot."""
    if not isinstance(base, BaseParameters):
        problem = f"a {type(base).__name__}; give base_parameters(chain)"
        raise InputError("base", problem)
    names = chain.dynamic_parameters.names
    if base.parameters != names:
        alien = [name for name in base.parameters if name not in names]
        what = f"it has {listed(alien, 3)}" if alien else "their order differs"
        robot = chain.mechanism.model.name
        problem = f"its parameters are not those of {robot}: {what}"
        raise InputError("base", f"{problem}; give base_parameters of this robot")


def base_parameters(
    chain: ClosedChain,
    which: Sequence[str] | None = None,
    *,
    motion: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    seed: int = 0,
) -> BaseParameters:
    """The combinations of dynamic parameters that the forces of a chain depend on.

    They are in the order of the parameters. A parameter whose column of the regressor depends on
    the columns before it is combined with the parameters of these columns.

    Args:
        chain: The robot.
        which: The parameters considered: names, or patterns such as "*.viscous" and "crank.*". By
            default the parameters of all bodies, and all others that are not zero.
        motion: q, va, aa of many samples; the result has the combinations that this motion shows.
            By default random assembled states: what any motion can show.
        seed: Seed of the random states.

    Raises:
        UnknownNameError: For a name or pattern that fits no parameter.
        InputError: If no names are given, or if the motion has fewer equations than there are
            parameters considered.
        ClosureError: If no configurations can be assembled.

    Example:
        >>> base = sst_pin.identification.base_parameters(sst_pin.robots.five_bar())
        >>> len(base), base.names[3]
        (7, 'elbow_1.izz + elbow_2.izz')
        >>> bool(np.allclose(base.matrix[:, base.columns], np.eye(7)))
        True
    """
    require_robot("chain", chain)
    chain.mechanism.require_freedom()
    theta = chain.dynamic_parameters
    considered = _considered_parameters(theta.names, np.asarray(theta), which)
    if motion is None:
        count = int(_ROWS * len(considered) / chain.degrees_of_freedom) + 10
        motion = random_states(chain, count, seed)
    q, va, aa = _arrays_of(motion)
    Y = chain.torque_regressor(q, va, aa)[..., considered]
    # Each row is an equation, divided by its size: large forces must not hide small ones.
    equations = Y.reshape(-1, len(considered))
    sizes = np.linalg.norm(equations, axis=1, keepdims=True)
    equations = equations / np.where(sizes, sizes, 1)
    if len(equations) < len(considered):
        problem = f"{len(equations)} equations for {len(considered)} parameters; give more samples"
        raise InputError("motion", problem)
    combinations = _combinations(equations)
    independent_columns = considered[combinations.independent]
    matrix = np.zeros((len(independent_columns), len(theta)))
    matrix[:, considered[combinations.nonzero]] = combinations.factors
    return BaseParameters(
        names=tuple(_combination_name(row, theta.names) for row in matrix),
        matrix=matrix,
        columns=independent_columns,
        considered=considered,
        unseen=tuple(theta.names[k] for k in np.delete(considered, combinations.nonzero)),
        parameters=theta.names,
    )


class _Combinations(NamedTuple):
    """The columns of a matrix A as combinations: A[:, nonzero] = A[:, independent] F.

    Attributes:
        nonzero: Numbers of the columns that are not zero.
        independent: Numbers of b columns that do not depend on columns before them.
        factors: F, shape (b, nonzero).
    """

    nonzero: Indices
    independent: Indices
    factors: Array


def _combinations(A: Array) -> _Combinations:
    """The columns of A as combinations of independent ones."""
    # The scaled columns, of size 1, are compared: parameters have different units.
    sizes = np.linalg.norm(A, axis=0)
    nonzero = np.flatnonzero(sizes > _DEPENDENT * sizes.max(initial=0.0))
    is_independent = np.isin(nonzero, independent(A, _DEPENDENT))
    scaled = A[:, nonzero] / sizes[nonzero]
    factors = np.linalg.lstsq(scaled[:, is_independent], scaled, rcond=None)[0]
    factors[np.abs(factors) <= _DEPENDENT] = 0.0  # rounding
    # A column of A is its size times the scaled column. So factor i of column j of A is the scaled
    # one times size j / size i.
    ratios = sizes[nonzero] / sizes[nonzero[is_independent], None]
    return _Combinations(nonzero, nonzero[is_independent], factors * ratios)


def _arrays_of(motion: tuple[ArrayLike, ArrayLike, ArrayLike]) -> tuple[ArrayLike, ...]:
    """q, va, aa of a motion."""
    arrays = in_order("motion", motion, "the arrays q, va, aa")
    if len(arrays) != 3:
        raise InputError("motion", f"{len(arrays)} arrays; three are needed: (q, va, aa)")
    return arrays


def _considered_parameters(
    names: Sequence[str], values: Array, which: Sequence[str] | None
) -> Indices:
    """Indices of the parameters considered."""
    if which is None:
        of_bodies = np.array([name.rpartition(".")[2] in OF_BODY for name in names])
        return np.flatnonzero(of_bodies | (values != 0))
    patterns = (which,) if isinstance(which, str) else arrays.names("which", which)
    if not patterns:
        raise InputError("which", "no names; None considers all parameters of bodies")
    considered = names_matching_any("parameter", patterns, names)
    return np.flatnonzero(np.isin(names, considered))


def _combination_name(row: Array, names: Sequence[str]) -> str:
    """A sum of parameters with their factors as text."""
    text = ""
    for k in np.flatnonzero(row).tolist():
        term = names[k]
        if abs(abs(row[k]) - 1) >= _DEPENDENT:
            term = f"{abs(row[k]):.4g} {term}"
        if not text:
            text = f"-{term}" if row[k] < 0 else term
        else:
            text += f" - {term}" if row[k] < 0 else f" + {term}"
    return text


def independent(A: Array, tolerance: float) -> Indices:
    """Numbers of the columns of A that do not depend on the columns before them.

    A column depends on others if its part outside their span is below the tolerance, relative to
    its size. A column is zero, and left out, if its size is below the tolerance, relative to the
    size of the largest column.

    The method is the Gram-Schmidt process. QR without pivots is not suited: a dependent column also
    takes a row of R there, and the next independent column may find no row.
    """
    sizes = np.linalg.norm(A, axis=0)
    nonzero = np.flatnonzero(sizes > tolerance * sizes.max(initial=0.0))
    basis = np.zeros((len(A), min(A.shape)))  # orthonormal columns
    chosen = list[int]()
    for k in nonzero:
        residual = A[:, k] / sizes[k]
        before = basis[:, : len(chosen)]
        for _ in range(2):  # the second time removes the rounding of the first
            residual = residual - before @ (before.T @ residual)
        size = float(np.linalg.norm(residual))
        is_full = len(chosen) == basis.shape[1]
        if size > tolerance and not is_full:
            basis[:, len(chosen)] = residual / size
            chosen.append(int(k))
    return np.array(chosen, dtype=np.intp)
