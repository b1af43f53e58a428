# SPDX-License-Identifier: BSD-2-Clause
"""The equations of motion of any closed chain, once, on CasADi's symbols.

Rows of closures are in the axes of the last link that both branches of their loop hang on, relative
to which the rates of the loop are counted. One factorisation of Phi_u, the columns of the dependent
rates, serves rates, accelerations and, transposed, forces, so that inverse dynamics forms no L.
The geometry is numbers; `OpenNumbers` lists the numbers that stay symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin
from casadi import SX

from ..arrays import Array, Indices
from ..chain.loops import connected
from ..chain.mechanism import Mechanism
from ..chain.mobility import independent_rows
from ..chain.thresholds import MAX_CONDITION_NUMBER
from ..errors import ActuationError
from .closure_rows import Row, closure_rows
from .elimination import Blocks, Factors, Orthogonal, pivot_order, total
from .link_kinematics import Kinematics
from .open_numbers import OpenNumbers
from .symbols import Sparse, add, is_zero, solve_symmetric
from .tree_dynamics import TreeDynamics

#: Entries of a matrix: row, column, value.
Entries = list[tuple[int, int, Any]]


class Pivots(NamedTuple):
    """Phi_u, factorised.

    Attributes:
        factors: Its parts.
        sizes: The largest sizes of the pivots of each part in the samples.
        determinant: That of the rows with pivots, free of units; of parts where all rows count, the
            product of the singular values.
        norm: The largest norm of Phi_u in the samples, scaled.
    """

    factors: Blocks
    sizes: list[Array]
    determinant: Any
    norm: float


class Equations:
    """Symbols of one mechanism.

    Pivots are chosen by assembled configurations, the samples. `loaded` tells whether external
    wrenches act; `smooth` whether Coulomb friction is tanh(v / sign_width) for derivatives, not the
    sign, which kernels smooth by themselves where the width is not zero. With `displaced` joints
    derivatives by q along the rates can be taken, as `Kinematics` says. `welded` bodies are
    computed as one.

    Attributes:
        va, aa: Rates and accelerations of the coordinates.
        loads: [moment; force] on each body at its mass centre, base axes, body after body.
        p: Open numbers, in the order of `parameters`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        samples: Array,
        loaded: bool = False,
        smooth: bool = False,
        parameters: OpenNumbers | None = None,
        displaced: bool = False,
        welded: bool = True,
    ) -> None:
        self.mechanism, model = mechanism, mechanism.model
        self.parameters = parameters or OpenNumbers(mechanism)
        self.p = SX.sym("p", self.parameters.size)
        rotations = self.parameters.rotations(self.p)
        self.kinematics = Kinematics(model, rotations, displaced=displaced)
        if displaced:
            self.kinematics.lift = -(self.kinematics.base.T @ self.parameters.gravity(self.p))
        self.q = self.kinematics.q
        self._coordinates = [int(i) for i in mechanism.coordinates]
        self._dependent = [int(i) for i in mechanism.dependent]
        self.va, self.aa = (SX.sym(name, len(self._coordinates)) for name in ("va", "aa"))
        self.loads = SX.sym("loads", 6 * (model.njoints - 1) if loaded else 0)
        self.tree = TreeDynamics(
            mechanism, self.kinematics, self.parameters, self.p, self.loads, smooth, welded
        )
        self._samples, self._smooth = samples, smooth

    @cached_property
    def displaced(self) -> Equations:
        """These equations on symbols of their own, with displaced joints."""
        loaded = self.loads.numel() > 0
        arguments = (self.mechanism, self._samples, loaded, self._smooth, self.parameters)
        return Equations(*arguments, displaced=True)

    # --- closures ---------------------------------------------------------------------------

    @cached_property
    def rows(self) -> list[Row]:
        """All rows of the closures, Eqs. (2)-(5)."""
        closures, model = self.mechanism.closures, self.mechanism.model
        return [
            row for closure in closures for row in closure_rows(self.kinematics, model, closure)
        ]

    @cached_property
    def pivots(self) -> Pivots:
        """Phi_u in parts that share no row and no rate."""
        places = [
            (i, k)
            for i, row in enumerate(self.rows)
            for k, j in enumerate(self._dependent)
            if j in row.Phi
        ]
        entries = [self.rows[i].Phi[self._dependent[k]] for i, k in places]
        where = np.array(places, dtype=int).reshape(-1, 2).T
        pattern = np.zeros((len(self.rows), len(self._dependent)), dtype=bool)
        pattern[where[0], where[1]] = True
        values = np.zeros((len(self._samples), *pattern.shape))
        values[:, where[0], where[1]] = self.at_samples(ca.vertcat(*entries))[..., 0]
        values *= self.mechanism.row_scale[:, None]
        parts: list[tuple[Factors | Orthogonal, Array]] = []
        part_of = np.empty(len(self._dependent), dtype=int)
        eliminated = np.ones(len(self._dependent), dtype=bool)
        for k, (rows, columns) in enumerate(connected(pattern)):
            part_of[columns] = k
            if numbers := self._all_of(values, rows, columns):
                eliminated[columns] = False
                parts.append(self._orthogonal(numbers, columns))
        kept = np.flatnonzero(eliminated)
        order, sizes = pivot_order(pattern[:, kept], values[:, :, kept])
        of_parts: dict[int, list[tuple[int, int, float]]] = {}
        for (i, k), size in zip(order, sizes.tolist(), strict=True):
            # The sizes of pivots of the rows as they are, not as they are scaled.
            pivot = i, self._dependent[kept[k]], size / self.mechanism.row_scale[i]
            of_parts.setdefault(part_of[kept[k]], []).append(pivot)
        Phi = [row.Phi for row in self.rows]
        for chosen in of_parts.values():
            own = np.array([size for _, _, size in chosen])
            parts.append((Factors(Phi, [(i, j) for i, j, _ in chosen]), own))
        blocks = Blocks([factors for factors, _ in parts])
        units = self.mechanism.rate_scale[self._dependent]
        norm = np.linalg.norm(values[:, blocks.rows] * units, axis=(1, 2)).max(initial=0.0)
        eliminated_rows = [i for i, _ in order]
        det: Any = float(np.prod(self.mechanism.row_scale[eliminated_rows]) * np.prod(units))
        for factors, _ in parts:
            for pivot in factors.pivots:
                det *= pivot
        return Pivots(blocks, [sizes for _, sizes in parts], det, float(norm))

    def _all_of(self, values: Array, rows: Indices, columns: Indices) -> dict[int, float]:
        """Rows of a part of Phi_u that all count, with their scales; none where a choice suffices.

        Where as many rows as columns are independent over all samples together, the other rows
        follow from these at every configuration. Else any choice is singular somewhere.
        """
        units = self.mechanism.rate_scale[self.mechanism.dependent[columns]]
        side_by_side = np.hstack(list(values[:, rows][:, :, columns] * units))
        free = independent_rows(side_by_side)
        if len(free) <= len(columns):
            return {}
        return {int(i): float(self.mechanism.row_scale[i]) for i in rows[free]}

    def _orthogonal(self, numbers: dict[int, float], columns: Indices) -> tuple[Orthogonal, Array]:
        """Factors of a part of Phi_u with all of its rows, and its squares in the samples."""
        Phi = [row.Phi for row in self.rows]
        orthogonal = Orthogonal(Phi, numbers, [self._dependent[k] for k in columns])
        squares = self.at_samples(ca.vertcat(*orthogonal.squares))
        return orthogonal, squares[..., 0].max(axis=0)

    @property
    def factors(self) -> Blocks:
        """Phi_u, factorised."""
        return self.pivots.factors

    def at_samples(self, symbols: SX) -> Array:
        """Values of a function of q at the samples, shape (samples, rows, columns)."""
        return self.values(symbols, self._samples)

    def values(self, symbols: SX, configurations: Array) -> Array:
        """Values of a function of q, shape (configurations, rows, columns)."""
        p = self.parameters.pack(self.mechanism, self.mechanism.friction)
        numbers = ca.Function("numbers", [self.q, self.p], [ca.densify(symbols)])
        return np.array([numbers(q, p).full() for q in configurations])

    def complete(self, of_coordinates: Sequence[Any], right: Sparse) -> Sparse:
        """Rates x of the whole tree with Phi x = right, from those of the coordinates."""
        pairs = zip(self._coordinates, of_coordinates, strict=True)
        x = {i: value for i, value in pairs if not is_zero(value)}
        return x | self.factors.solve(self._left(x, right))

    def _left(self, x: Sparse, right: Sparse) -> Sparse:
        """The right side for the dependent rates, when those of the coordinates are x."""
        moved: Sparse = {}
        for i in self.factors.rows:
            row = self.rows[i].Phi
            terms = [-(row[j] * x[j]) for j in self._coordinates if j in x and j in row]
            if terms:
                moved[i] = total(terms)
        return add(right, moved)

    def multipliers(self, tau: Sparse) -> Sparse:
        """Forces of the closures, row by row, that hold the dependent rates against tau."""
        on_dependent = {j: tau[j] for j in self._dependent if j in tau}
        return self.factors.solve_transposed(on_dependent)

    def reduced(self, tau: Sparse) -> SX:
        """L^T tau, without L: by the multipliers."""
        multipliers = self.multipliers(tau)
        result = []
        for j in self._coordinates:
            terms = [tau[j]] if j in tau else []
            for i, x in multipliers.items():
                if j in self.rows[i].Phi:
                    terms.append(-(self.rows[i].Phi[j] * x))
            result.append(SX(total(terms)))
        return ca.vertcat(*result)

    @cached_property
    def v(self) -> Sparse:
        """Rates of the tree, L va, Eq. (16)."""
        return self.complete(ca.vertsplit(self.va), {})

    @cached_property
    def drift(self) -> Sparse:
        """-Phi_dot v, by row, Eq. (8)."""
        at_rest: Sparse = {}
        drift = {i: -self.rows[i].acceleration(self.v, at_rest) for i in self.factors.rows}
        return {i: x for i, x in drift.items() if not is_zero(x)}

    @cached_property
    def L(self) -> list[Sparse]:
        """Columns of the joint orthogonal complement, Eq. (17)."""
        n = len(self._coordinates)
        return [self.complete([float(i == k) for i in range(n)], {}) for k in range(n)]

    def Phi_change(self, along: Sparse) -> Entries:
        """How Phi changes along rates of the tree, where it does."""
        places = [(i, j) for i in self.factors.rows for j in self.rows[i].Phi]
        entries = ca.vertcat(*(SX(self.rows[i].Phi[j]) for i, j in places))
        rates = ca.jtimes(entries, self.q, self.kinematics.q_rates(along))
        changes = zip(places, ca.vertsplit(rates), strict=True)
        return [(i, j, rate) for (i, j), rate in changes if not is_zero(rate)]

    def held(self, x: Sparse, Phi_change: Entries) -> tuple[Sparse, Sparse]:
        """How rates x with Phi x = 0 change with Phi, those of the coordinates held, Eq. (20).

        The second result is Phi times the change.
        """
        right: Sparse = {}
        for i, j, rate in Phi_change:
            if j in x:
                right = add(right, {i: -(rate * x[j])})
        return self.complete([0.0] * len(self._coordinates), right), right

    def project(self, tau: Sparse) -> SX:
        """L^T tau, with L."""
        columns = [[x * tau[i] for i, x in column.items() if i in tau] for column in self.L]
        return ca.vertcat(*(SX(total(terms)) for terms in columns))

    @cached_property
    def dv(self) -> Sparse:
        """Accelerations of the tree, L aa + L_dot va, Eqs. (8), (20)."""
        return self.complete(ca.vertsplit(self.aa), self.drift)

    @cached_property
    def at_rest(self) -> Sparse:
        """Accelerations of the tree without those of the coordinates, L_dot va."""
        return self.complete([0.0] * len(self._coordinates), self.drift)

    # --- dynamics ---------------------------------------------------------------------------

    def forces(self, dv: Sparse) -> Sparse:
        """All forces along the rates of the tree that a motion at v needs."""
        friction = self.tree.friction(self.v)
        return add(self.tree.forces(self.v, dv), add(friction, self.tree.springs))

    @cached_property
    def tree_forces(self) -> Sparse:
        """Forces that the motion needs along the rates of the tree."""
        return self.forces(self.dv)

    @cached_property
    def generalized_forces(self) -> SX:
        """f of a motion, Eqs. (91), (92)."""
        return self.reduced(self.tree_forces)

    @cached_property
    def motor_matrix(self) -> SX:
        """L^T B, shape (n, motors)."""
        none = SX(len(self._coordinates), 0)
        return ca.horzcat(none, *(self.reduced(column) for column in self.motor_columns))

    @cached_property
    def motor_columns(self) -> list[Sparse]:
        """Columns of B, motors on lines included."""
        motors = enumerate(self.mechanism.motors.T)
        return [
            add({i: float(b) for i, b in enumerate(column) if b}, self.tree.motors_on_lines(k))
            for k, column in motors
        ]

    @cached_property
    def motor_rows(self) -> list[dict[int, Any]]:
        """Rows of L^T B without entries that are rounding at any q; n motors must act.

        What is zero in one assembly mode may not be in another, so loops that are open count too.
        """
        mechanism, A = self.mechanism, self.motor_matrix
        scale, n = mechanism.rate_scale, len(self._coordinates)
        units = scale[mechanism.coordinates, None]
        model, random = mechanism.model, np.random.default_rng(0)
        ways = random.normal(size=(len(self._samples), model.nv)) * scale
        anywhere = [
            pin.integrate(model, q, way) for q, way in zip(self._samples, ways, strict=True)
        ]
        everywhere = np.concatenate([self._samples, anywhere])
        L = np.zeros((len(everywhere), n, 1))
        for k, column in enumerate(self.L):
            scaled = ca.vertcat(*(SX(x) / scale[j] * units[k, 0] for j, x in column.items()))
            L[:, k] = np.abs(self.values(scaled, everywhere)).max(axis=1)
        B: Array = np.zeros((len(everywhere), 1, len(mechanism.motor_names)))
        for k, forces in enumerate(self.motor_columns):
            scaled = [SX(x) * scale[j] for j, x in forces.items()]
            if scaled:  # not of a motor between two frames of one body
                B[..., k] = np.abs(self.values(ca.vertcat(*scaled), everywhere)).max(axis=1)
        values = self.values(A, everywhere) * units
        acts = np.abs(values) * MAX_CONDITION_NUMBER >= L * B
        assembled = np.where(acts, values, 0.0)[: len(self._samples)]
        sizes = np.linalg.svd(assembled, compute_uv=False)
        rank = int((sizes * MAX_CONDITION_NUMBER > sizes[:, :1]).sum(axis=1).max())
        if rank < n:
            raise ActuationError(
                f"the motors supply {rank} of {n} forces along the coordinates; "
                "generalized_forces computes all of them"
            )
        acting = np.any(acts, axis=0)
        return [{k: A[i, k] for k in np.flatnonzero(acting[i]).tolist()} for i in range(n)]

    @property
    def driven(self) -> bool:
        """Whether the motors act on all coordinates."""
        try:
            return self.mechanism.driven_one_to_one or bool(self.motor_rows)
        except ActuationError:
            return False

    @cached_property
    def motor_factors(self) -> tuple[Orthogonal, Array]:
        """(L^T B)^T, factorised, and the squares of its pivots in the samples."""
        by_motor: list[dict[int, Any]] = [{} for _ in self.mechanism.motor_names]
        for i, row in enumerate(self.motor_rows):
            for k, x in row.items():
                by_motor[k][i] = x
        columns = range(len(self._coordinates))
        factors = Orthogonal(by_motor, dict.fromkeys(range(len(by_motor)), 1.0), columns)
        squares = self.at_samples(ca.vertcat(*(SX(x) for x in factors.squares)))
        return factors, squares[..., 0].max(axis=0)

    def smallest_torques(self, f: SX) -> Sparse:
        """The least torques that bring f about, refined once, by motor."""
        factors, _ = self.motor_factors
        tau = factors.solve_transposed(dict(enumerate(ca.vertsplit(f))))
        rows = zip(self.motor_rows, ca.vertsplit(f), strict=True)
        left = [
            force - total(x * tau[k] for k, x in row.items() if k in tau) for row, force in rows
        ]
        return add(tau, factors.solve_transposed(dict(enumerate(left))))

    @cached_property
    def inertia(self) -> SX:
        """L^T M L, shape (n, n), Eq. (93)."""
        n = len(self.L)
        matrix, M = SX(n, n), self.tree.composed(self._following)
        for k, column in enumerate(self.L):
            force: Sparse = {}
            for (i, j), entry in M.items():
                if j in column:
                    force = add(force, {i: entry * column[j]})
                if i != j and i in column:
                    force = add(force, {j: entry * column[i]})
            for other in range(k + 1):
                terms = [x * force[i] for i, x in self.L[other].items() if i in force]
                matrix[other, k] = matrix[k, other] = total(terms)
        return matrix

    @cached_property
    def _following(self) -> dict[int, dict[int, Sparse]]:
        """Rows of L of the dependent rates, by the link that their loops hang on."""
        tree = self.kinematics.tree
        following: dict[int, dict[int, Sparse]] = {}
        for rate in self._dependent:
            columns = zip(self._coordinates, self.L, strict=True)
            row = {k: column[rate] for k, column in columns if rate in column}
            moved = [i for i, x in enumerate(tree.links) if {rate, *row}.intersection(x.v)]
            before = [set(tree.ancestors(tree.links[i].parent)) for i in moved]
            if base := max(set.intersection(*before)):  # parents come first
                following.setdefault(base, {})[rate] = row
        return following

    @cached_property
    def coriolis(self) -> SX:
        """The Coriolis matrix, shape (n, n), Eq. (94)."""
        Phi_dot = self.Phi_change(self.v)
        columns = []
        for L in self.L:
            L_dot, _ = self.held(L, Phi_dot)
            columns.append(self.project(self.tree.coriolis_forces(self.v, L, L_dot)))
        return ca.horzcat(*columns)

    def motor_forces(self, tau: SX) -> Sparse:
        """B tau: what motors give along the rates of the tree."""
        on_joints = {
            i: total([float(b) * tau[k] for k, b in enumerate(shares) if b])
            for i, shares in enumerate(self.mechanism.motors)
            if shares.any()
        }
        return add(on_joints, self.pushed(tau))

    def pushed(self, tau: SX) -> Sparse:
        """What motors on lines give along the rates of the tree."""
        forces: Sparse = {}
        for k in map(int, np.flatnonzero(self.mechanism.lines.motors.any(axis=0))):
            forces = add(forces, {i: x * tau[k] for i, x in self.tree.motors_on_lines(k).items()})
        return forces

    def accelerations(self, tau: SX) -> tuple[SX, list[Any]]:
        """aa under motor torques from Eq. (92), and one over each pivot of the inertia matrix."""
        without = self.forces(self.at_rest)
        given = self.project(self.motor_forces(tau))
        return solve_symmetric(self.inertia, given - self.project(without))
