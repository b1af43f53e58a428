# SPDX-License-Identifier: BSD-2-Clause
"""The equations of motion of any closed chain on CasADi's symbols.

The rates v of the tree are the rates va of the coordinates and the dependent rates v_u. Phi_a and
Phi_u are the columns of Phi for va and v_u. The closures Phi v = 0 determine the dependent rates:

    Phi_u v_u = -Phi_a va.

Phi_u is factorised once (`loop_factors`). The factors solve for rates, for accelerations and, with
the transposed matrix, for the multipliers Lambda of the closures. Let tau be forces along v. Lambda
is chosen so that tau - Phi^T Lambda is zero along the dependent rates. Because L^T Phi^T is zero,
L^T tau is what is left of this difference along the coordinates:

    Phi_u^T Lambda = tau_u,   L^T tau = tau_a - Phi_a^T Lambda.

So inverse dynamics needs no L.

The geometry is fixed numbers; `SymbolicParameters` lists the numbers that stay symbols. Vectors
along the rates or the rows are sparse: entries by index, zeros left out (`symbols.Sparse`).
"""

from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from casadi import SX

from ..arrays import Array
from ..errors import ActuationError
from ..model.mechanism import Mechanism
from ..model.thresholds import RANK_TOLERANCE
from .articulated import ArticulatedBodies, groups
from .closure_rows import Row, closure_rows
from .elimination import Blocks, Orthogonal, total
from .link_kinematics import Kinematics
from .loop_factors import LoopFactors, Pivots, orthogonal_factors
from .symbolic_parameters import GRAVITY, SymbolicParameters
from .symbols import Sparse, SymmetricFactors, add, column, is_zero, sparse, symmetric
from .tree_dynamics import TreeDynamics

# A product of a matrix of the tree with L can be computed in two ways: with the whole matrix, or
# column by column of L by a pass over all links. The whole matrix takes more operations if it has
# many entries for each link and column of L: `Equations._entries_per_link_and_column`.
#: Above this number, columns of M L take fewer operations than the mass matrix M of the tree.
_MASS_BY_COLUMNS = 2.5
#: Above this number, derivatives along columns of L take fewer operations than Jacobians of the
#: forces of the tree.
_DERIVATIVES_BY_COLUMNS = 1.5

# L^T M L is factorised as a whole or by articulated bodies. Between these two numbers of
# coordinates the operations of both are counted. Outside them, the count would have a known result
# or would take long.
#: Below this number of coordinates the whole matrix takes fewer operations.
_LEAST_FOR_ARTICULATED = 8
#: Above this number of coordinates articulated bodies take fewer operations.
_MOST_FOR_WHOLE = 40

#: Entries of a matrix: row, column, value.
Entries = list[tuple[int, int, Any]]


class RatesOfChange(NamedTuple):
    """How rates x with Phi x = 0 change as Phi changes, with the system Phi x_dot = right."""

    x_dot: Sparse
    #: -Phi_dot x, by row.
    right: Sparse


class Equations:
    """Symbols of one mechanism.

    Args:
        mechanism: The mechanism.
        samples: Assembled configurations by which pivots are chosen, shape (samples, nq).
        loaded: Whether external wrenches act.
        smooth: Whether Coulomb friction is tanh(v / sign_width) in the symbols, for derivatives.
            Otherwise it is the sign; kernels of C smooth it themselves.
        welded: Whether bodies that closures weld together are computed as one.
        parameters: The symbolic parameters, by default those of the mechanism.
        displaced: Whether joints have small displacements. Derivatives by the displacements are the
            derivatives by q along the rates; see `Kinematics`.

    Attributes:
        p: Symbols of the `parameters`, in their order.
        q, va, aa, tau: Symbols of the configuration, of rates and accelerations of the coordinates,
            and of motor torques.
        loads: Symbols of external wrenches, [force; moment] on each body at its mass centre, base
            axes; empty if not `loaded`.
        kinematics, tree: Motions of the links, and the dynamics of the tree without closures.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        samples: Array,
        loaded: bool = False,
        smooth: bool = False,
        welded: bool = True,
        parameters: SymbolicParameters | None = None,
        displaced: bool = False,
    ) -> None:
        self.mechanism = mechanism
        model = mechanism.model
        self.parameters = parameters or SymbolicParameters(mechanism)
        self.p = SX.sym("p", self.parameters.size)
        # The acceleration of link 0 in the rows of closures; None for zero. Each value gives the
        # same rows, because a row subtracts the accelerations of two frames, and both contain that
        # of link 0. In the forces of the tree, the acceleration of link 0 is minus gravity, which
        # adds the weights. Derivatives by displacements need rows and forces together. With the
        # same acceleration, both have expressions in common, which are computed once.
        acceleration = None
        if displaced:
            acceleration = -self.p[GRAVITY]
        self.kinematics = Kinematics(model, displaced, acceleration)
        self.q = self.kinematics.q
        self._coordinates = [int(i) for i in mechanism.coordinates]
        self._dependent = [int(i) for i in mechanism.dependent]
        self._rates = range(model.nv)
        self.va = SX.sym("va", len(self._coordinates))
        self.aa = SX.sym("aa", len(self._coordinates))
        self.tau = SX.sym("tau", mechanism.motor_count)
        self.loads = SX.sym("loads", 6 * (model.njoints - 1) if loaded else 0)
        self.tree = TreeDynamics(
            mechanism, self.kinematics, self.parameters, self.p, self.loads, smooth, welded
        )
        self._samples = samples
        self._smooth = smooth

    @cached_property
    def displaced(self) -> "Equations":
        """Equations of the same mechanism with displaced joints, on symbols of their own.

        `welded` is always true here: only reactions need each body by itself, and they need no
        derivatives.
        """
        return Equations(
            self.mechanism,
            self._samples,
            loaded=self.loads.numel() > 0,
            smooth=self._smooth,
            parameters=self.parameters,
            displaced=True,
        )

    # --- closures ---------------------------------------------------------------------------

    @cached_property
    def rows(self) -> list[Row]:
        """All rows of the closures, Eqs. (2)-(5)."""
        rows_of = partial(closure_rows, self.kinematics, self.mechanism.model)
        return [row for closure in self.mechanism.closures for row in rows_of(closure)]

    @cached_property
    def pivots(self) -> Pivots:
        """Phi_u, factorised, and what the samples say about its pivots."""
        loops = LoopFactors(self.mechanism, self.kinematics, self.rows, self.at_samples)
        return loops.pivots()

    @property
    def factors(self) -> Blocks:
        """Phi_u, factorised."""
        return self.pivots.factors

    def at_samples(self, symbols: SX) -> Array:
        """Values of a function of q at the samples, shape (samples, rows, columns)."""
        p = self.parameters.pack(self.mechanism, self.mechanism.friction)
        numbers = ca.Function("numbers", [self.q, self.p], [ca.densify(symbols)])
        return np.array([numbers(q, p).full() for q in self._samples])

    def complete(self, of_coordinates: Sequence[Any], right: Sparse) -> Sparse:
        """Rates x of the whole tree with Phi x = right, from the rates x_a of the coordinates.

        The dependent rates follow from Phi_u x_u = right - Phi_a x_a.
        """
        pairs = zip(self._coordinates, of_coordinates, strict=True)
        x_a = {i: value for i, value in pairs if not is_zero(value)}
        by_coordinates: Sparse = {}  # -Phi_a x_a
        for i in self.factors.rows:
            row = self.rows[i].Phi
            terms = [-(row[j] * x_a[j]) for j in self._coordinates if j in x_a and j in row]
            if terms:
                by_coordinates[i] = total(terms)
        return x_a | self.factors.solve(add(right, by_coordinates))

    def multipliers(self, tau: Sparse) -> Sparse:
        """Multipliers Lambda by row, with Phi_u^T Lambda = tau_u."""
        on_dependent = {j: tau[j] for j in self._dependent if j in tau}
        return self.factors.solve_transposed(on_dependent)

    def projected(self, tau: Sparse) -> SX:
        """L^T tau = tau_a - Phi_a^T Lambda, without L.

        It takes fewer operations than `projected_by_L` if nothing else needs L.
        """
        Lambda = self.multipliers(tau)
        result = []
        for j in self._coordinates:
            terms = [tau[j]] if j in tau else []
            for i, x in Lambda.items():
                if j in self.rows[i].Phi:
                    terms.append(-(self.rows[i].Phi[j] * x))
            result.append(SX(total(terms)))
        return ca.vertcat(*result)

    def projected_by_L(self, tau: Sparse) -> SX:
        """L^T tau as a product with L.

        It takes fewer operations than `projected` for several tau, or if L is needed anyway.
        """
        return self.L_matrix.T @ column(tau, self._rates)

    @cached_property
    def v(self) -> Sparse:
        """Rates of the tree, L va, Eq. (16)."""
        return self.complete(ca.vertsplit(self.va), {})

    @cached_property
    def drift(self) -> Sparse:
        """-Phi_dot v, by row, Eq. (8): the right side of Phi v_dot = -Phi_dot v."""
        zero: Sparse = {}
        # The acceleration of a row is Phi v_dot + Phi_dot v.
        drift = {i: -self.rows[i].acceleration(self.v, zero) for i in self.factors.rows}
        return {i: x for i, x in drift.items() if not is_zero(x)}

    @cached_property
    def L(self) -> list[Sparse]:
        """Columns of the joint orthogonal complement L, Eq. (17), one for each coordinate."""
        n = len(self._coordinates)
        return [self.complete([float(i == k) for i in range(n)], {}) for k in range(n)]

    @cached_property
    def L_matrix(self) -> SX:
        """The joint orthogonal complement L, shape (nv, n)."""
        return ca.horzcat(*(column(x, self._rates) for x in self.L))

    def Phi_dot_along(self, along: Sparse) -> Entries:
        """Rates of the entries of Phi along a motion of the tree, zeros left out.

        Args:
            along: Rates of the tree.
        """
        places = [(i, j) for i in self.factors.rows for j in self.rows[i].Phi]
        entries = ca.vertcat(*(SX(self.rows[i].Phi[j]) for i, j in places))
        rates = ca.jtimes(entries, self.q, self.kinematics.q_rates(along))
        changes = zip(places, ca.vertsplit(rates), strict=True)
        return [(i, j, rate) for (i, j), rate in changes if not is_zero(rate)]

    @cached_property
    def Phi_dot(self) -> Entries:
        """Rates of the entries of Phi along v, zeros left out."""
        return self.Phi_dot_along(self.v)

    def rates_of_change(self, x: Sparse, Phi_dot: Entries) -> RatesOfChange:
        """How rates x with Phi x = 0 change as Phi changes: Phi x_dot = -Phi_dot x, Eq. (20).

        The rates of the coordinates in x stay constant.

        Args:
            x: Rates of the tree.
            Phi_dot: Rates of the entries of Phi.
        """
        right: Sparse = {}
        for i, j, rate in Phi_dot:
            if j in x:
                right = add(right, {i: -(rate * x[j])})
        x_dot = self.complete([0.0] * len(self._coordinates), right)
        return RatesOfChange(x_dot, right)

    @cached_property
    def dv(self) -> Sparse:
        """Accelerations of the tree, L aa + L_dot va, Eqs. (8), (20)."""
        return self.complete(ca.vertsplit(self.aa), self.drift)

    @cached_property
    def dv_without_aa(self) -> Sparse:
        """Accelerations of the tree for aa = 0: L_dot va."""
        return self.complete([0.0] * len(self._coordinates), self.drift)

    # --- dynamics ---------------------------------------------------------------------------

    def forces(self, dv: Sparse) -> Sparse:
        """Forces along the rates of the tree that the motion with v and accelerations dv needs.

        They include friction and springs. The springs depend on v, because v determines which
        cables are slack.
        """
        friction = self.tree.friction(self.v)
        return add(self.tree.forces(self.v, dv), add(friction, self.tree.springs(self.v)))

    @cached_property
    def tree_forces(self) -> Sparse:
        """`forces` of the motion with v and dv."""
        return self.forces(self.dv)

    @cached_property
    def generalized_forces(self) -> SX:
        """Generalized forces f of the motion, Eqs. (91), (92), shape (n,)."""
        return self.projected(self.tree_forces)

    @cached_property
    def motor_matrix(self) -> SX:
        """L^T B, shape (n, motors)."""
        return ca.horzcat(SX(len(self._coordinates), 0), *map(self.projected, self.motor_columns))

    @cached_property
    def motor_columns(self) -> list[Sparse]:
        """Columns of B: forces along the rates of the tree by a unit torque of each motor.

        A motor on a line pushes its ends apart. `TreeDynamics.along_lines` returns the forces that
        pulls *need*: those with which the joints balance the pulls, that is, minus the forces that
        the pulls exert. A push is a negative pull. So it exerts what an equal pull needs.
        """
        pairs = zip(self.mechanism.actuation.T, self.mechanism.lines.actuation.T, strict=True)
        columns = []
        for on_rates, on_lines in pairs:
            of_rates: Sparse = {i: float(b) for i, b in enumerate(on_rates) if b}
            columns.append(add(of_rates, self.tree.along_lines(on_lines)))
        return columns

    @cached_property
    def B(self) -> SX:
        """The matrix with the columns `motor_columns`, shape (nv, motors)."""
        columns = (column(forces, self._rates) for forces in self.motor_columns)
        return ca.horzcat(SX(len(self._rates), 0), *columns)

    @cached_property
    def motor_rows(self) -> list[dict[int, Any]]:
        """Rows of L^T B without zeros.

        Raises:
            ActuationError: There is no sample at which the motors drive all coordinates.
        """
        mechanism = self.mechanism
        A = self.motor_matrix
        n = len(self._coordinates)
        # Free of units, the matrix has singular values of the order 1.
        row_scale = mechanism.rate_scale[mechanism.coordinates, None]
        samples = self.at_samples(A) * row_scale / mechanism.motor_scale
        sizes = np.linalg.svd(samples, compute_uv=False)
        # The tolerance is relative to the largest one, but at least to 1: if no motor drives
        # anything, the largest one is rounding.
        least = RANK_TOLERANCE * np.maximum(sizes[:, :1], 1)
        rank = int((sizes > least).sum(axis=1).max())
        if rank < n:
            raise ActuationError(
                f"the motors supply {rank} of {n} forces along the coordinates; "
                "generalized_forces computes all of them"
            )
        motors = range(A.shape[1])
        return [{k: A[i, k] for k in motors if not is_zero(A[i, k])} for i in range(n)]

    @property
    def driven(self) -> bool:
        """Whether the motors act on all coordinates."""
        try:
            return self.mechanism.driven_one_to_one or bool(self.motor_rows)
        except ActuationError:
            return False

    @cached_property
    def motor_factors(self) -> tuple[Orthogonal, Array]:
        """Factors of (L^T B)^T, and the largest squared lengths of the columns of their Q.

        The matrix has a row for each motor and a column for each coordinate. Each number of the
        second result is the largest value of one entry of `Orthogonal.squares` in the samples.
        """
        motors = range(len(self.mechanism.motor_names))
        rows_of_transpose: list[dict[int, Any]] = [{} for _ in motors]
        for i, row in enumerate(self.motor_rows):
            for k, entry in row.items():
                rows_of_transpose[k][i] = entry
        scale = dict.fromkeys(motors, 1.0)  # no scales: the sum of tau^2 is the least
        columns = range(len(self._coordinates))
        return orthogonal_factors(rows_of_transpose, scale, columns, self.at_samples)

    def smallest_torques(self, f: SX) -> Sparse:
        """The smallest torques tau with L^T B tau = f, by motor.

        One step of iterative refinement makes up for rounding.
        """
        factors, _ = self.motor_factors
        tau = factors.solve_transposed(dict(enumerate(ca.vertsplit(f))))
        supplied = self.motor_matrix @ column(tau, range(len(self.motor_columns)))
        residual = dict(enumerate(ca.vertsplit(f - supplied)))
        return add(tau, factors.solve_transposed(residual))

    @cached_property
    def inertia(self) -> SX:
        """L^T M L, shape (n, n), Eq. (93)."""
        L = self.L_matrix
        if self._entries_per_link_and_column > _MASS_BY_COLUMNS:
            forces = (self.tree.forces({}, x, loads=False, weight=False) for x in self.L)
            ML = ca.horzcat(*(column(x, self._rates) for x in forces))
        else:
            ML = symmetric(self.tree.composite_inertia(self._hanging_loops), len(self._rates)) @ L
        return ca.triu2symm(ca.triu(L.T @ ML))  # computes no entry twice

    @property
    def derivatives_by_columns(self) -> bool:
        """Whether derivatives along single coordinates take fewer operations than matrices do."""
        return len(self.L) == 1 or self._entries_per_link_and_column > _DERIVATIVES_BY_COLUMNS

    @cached_property
    def _entries_per_link_and_column(self) -> float:
        """Number of entries of a matrix of the tree for each link and column of L.

        Such a matrix, for instance the mass matrix, has an entry for two rates if one of them moves
        the joint of the other. In a long tree with few coordinates most of the entries are for
        dependent rates.
        """
        links = self.kinematics.tree.links
        behind = [set[int]() for _ in links]  # rates of each link and of all links behind it
        entries = 0
        for i in range(len(links) - 1, 0, -1):
            link = links[i]
            behind[i].update(link.v)
            entries += len(link.v) * len(behind[i])
            behind[link.parent] |= behind[i]
        return entries / (len(links) * len(self._coordinates))

    @cached_property
    def _hanging_loops(self) -> dict[int, dict[int, Sparse]]:
        """Rows of L of the dependent rates, by the link on which their loops hang.

        A loop hangs on the last link that carries all of its links. A motion of this link, or of a
        link that carries it, moves the loop as a whole. `TreeDynamics.composite_inertia` has this
        argument: with it, the mass matrix of the tree gets fewer entries.
        """
        links = self.kinematics.tree.links
        loops: dict[int, dict[int, Sparse]] = {}
        for rate in self._dependent:
            columns = zip(self._coordinates, self.L, strict=True)
            row = {k: column[rate] for k, column in columns if rate in column}
            # The loop of a dependent rate: the links whose joints have this rate or a coordinate
            # that moves it.
            loop = [link for link in links if {rate, *row}.intersection(link.v)]
            # `ancestors` returns the parent itself too. The last common ancestor of the parents has
            # the largest number, because a link has a larger number than its parent.
            before = [set(self.kinematics.tree.ancestors(link.parent)) for link in loop]
            hangs_on = max(set.intersection(*before))
            # `composite_inertia` stops before link 0, so loops on the ground are left out.
            if hangs_on != 0:
                loops.setdefault(hangs_on, {})[rate] = row
        return loops

    @cached_property
    def coriolis(self) -> SX:
        """The Coriolis matrix, shape (n, n), Eq. (94)."""
        columns = []
        for L in self.L:
            L_dot, _ = self.rates_of_change(L, self.Phi_dot)
            columns.append(self.projected_by_L(self.tree.coriolis_forces(self.v, L, L_dot)))
        return ca.horzcat(*columns)

    def motor_forces(self, tau: SX) -> Sparse:
        """B tau: the motors' forces along the rates of the tree."""
        return sparse(self._rates, self.B @ tau)

    @cached_property
    def accelerations(self) -> SX:
        """aa under motor torques, Eq. (92)."""
        needed_without_aa = self.projected_by_L(self.forces(self.dv_without_aa))
        supplied = self.projected_by_L(self.motor_forces(self.tau))
        return self.inertia_factors.solve(supplied - needed_without_aa)

    @cached_property
    def inertia_factors(self) -> SymmetricFactors | ArticulatedBodies:
        """L^T M L, factorised in the way that takes fewer operations."""
        # Coordinates that move the same loops form a group. The mass of a line couples all rates
        # that change its length.
        lines = self.tree.lines
        coupled = (lines[k].row for k in self.parameters.line_masses(self.p))
        all_groups = groups(self.kinematics.tree, self.L, coupled)
        n = len(self._coordinates)
        if len(all_groups) == 1 or n < _LEAST_FOR_ARTICULATED:
            return SymmetricFactors(self.inertia)
        articulated = ArticulatedBodies(self.kinematics, self.tree, self.L, all_groups)
        if n > _MOST_FOR_WHOLE:
            return articulated
        whole = SymmetricFactors(self.inertia)
        b = SX.sym("b", n)
        if self._operations(articulated, b) < self._operations(whole, b):
            return articulated
        return whole

    def _operations(self, factors: SymmetricFactors | ArticulatedBodies, b: SX) -> int:
        """Number of operations of one solution and of the numbers that check the pivots."""
        results = ca.vertcat(factors.solve(b), *factors.inverses, *factors.diagonal)
        # Equal expressions are merged (cse), because kernels merge them too.
        return ca.Function("count", [self.q, self.p, b], [results], {"cse": True}).n_instructions()
