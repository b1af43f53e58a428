# SPDX-License-Identifier: BSD-2-Clause
"""The equations of motion of any closed chain, once, on CasADi's symbols.

Rows of closures are in the axes of the last link that both branches of their loop hang on, relative
to which the rates of the loop are counted. A body with the first moment c and the second moments J
(the integral of r r^T) about its origin needs the force m a + U c and the moment
c x a + 2 axial(U J). One factorisation of Phi_u, the columns of the dependent rates, serves rates,
accelerations and, transposed, forces, so that inverse dynamics forms no L. Numbers of the geometry
are folded in; `Parameters` lists what stays open.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from casadi import SX
from numpy.typing import NDArray

from ..chain.closures import Closure
from ..chain.loops import CLOSURE_TOLERANCE
from ..chain.mechanism import Mechanism
from .closure_rows import Row, closure_rows
from .elimination import Factors, pivot_order, total
from .kinematics import Kinematics, Motion
from .parameters import SIGN_WIDTH, Parameters
from .symbols import Sparse, add, is_zero, solve_symmetric, sx

Array = NDArray[np.float64]

#: Open loops up to this are closed to a kernel: half of the reference path's tolerance.
CLOSED = 0.5 * CLOSURE_TOLERANCE
#: How much smaller than in the samples a pivot may be.
_PIVOT = 1e-3
#: Residuals of a solution, in roundings of the matrix times it, up to which it counts as one.
_ROUNDINGS = 30
#: Solutions up to this are none, [rad/s], [N m] and the like.
_NOTHING = 1e-10


class Body(NamedTuple):
    """A rigid body, or several that are welded to each other, in the frame of a link.

    Attributes:
        mass: Of all.
        c: First moment.
        J: Second moments, the integral of r r^T.
        polar: Sum of mass times the square of the mass centre's distance from the origin.
    """

    mass: SX
    c: SX
    J: SX
    polar: SX

    def moved(self, R: SX, p: SX) -> Body:
        """In a frame in which the one before has the orientation R and the origin p."""
        c = R @ self.c
        J = R @ self.J @ R.T + c @ p.T + p @ c.T + self.mass * p @ p.T
        c += self.mass * p
        return Body(self.mass, c, J, ca.sumsqr(c) / self.mass)


class Equations:
    """Symbols of one mechanism.

    Args:
        mechanism: The robot.
        samples: Assembled configurations, by which pivots are chosen, shape (samples, nq).
        loaded: Whether external wrenches act on the bodies.
        smooth: Whether Coulomb friction is tanh(v / sign_width) for derivatives, not the sign,
            which kernels smooth by themselves where the width is not zero.
        parameters: Which numbers stay open; those of `Parameters` by default.
        closed: Open loops up to this are closed to the kernels.
        rounding: Relative, of the numbers that the kernels compute with.
        displaced: Whether the joints are displaced, as `Kinematics` has it.

    Attributes:
        kinematics: Of the tree.
        va, aa: Rates and accelerations of the coordinates.
        loads: [moment; force] on each body at its mass centre, base axes, body after body.
        p: Open numbers, in the order of `parameters`.

    Raises:
        DescriptionError: For a joint without compiled equations.
        SingularConfigurationError: When the coordinates do not fix the motion at the samples.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        samples: Array,
        loaded: bool = False,
        smooth: bool = False,
        parameters: Parameters | None = None,
        closed: float = CLOSED,
        rounding: float = float(np.finfo(float).eps),
        displaced: bool = False,
    ) -> None:
        self.mechanism, model = mechanism, mechanism.model
        self.parameters = parameters or Parameters(mechanism)
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
        self._samples, self._smooth = samples, smooth
        self._closed, self._rounding = closed, rounding

    @cached_property
    def displaced(self) -> Equations:
        """The same equations, on symbols of their own, with displaced joints."""
        loaded = self.loads.numel() > 0
        arguments = (self.mechanism, self._samples, loaded, self._smooth, self.parameters)
        return Equations(*arguments, displaced=True)

    # --- closures ---------------------------------------------------------------------------

    @cached_property
    def rows(self) -> list[Row]:
        """All rows of the closures."""
        closures, model = self.mechanism.closures, self.mechanism.model
        return [
            row for closure in closures for row in closure_rows(self.kinematics, model, closure)
        ]

    @cached_property
    def _pivots(self) -> tuple[list[tuple[int, int]], Array, float]:
        """Rows and columns of the pivots of Phi_u, their sizes in the samples, and its own."""
        places: list[tuple[int, int]] = []
        entries: list[SX] = []
        for i, row in enumerate(self.rows):
            for k, j in enumerate(self._dependent):
                if j in row.Phi:
                    places.append((i, k))
                    entries.append(row.Phi[j])
        where = np.array(places, dtype=int).reshape(-1, 2).T
        pattern = np.zeros((len(self.rows), len(self._dependent)), dtype=bool)
        pattern[where[0], where[1]] = True
        values = np.zeros((len(self._samples), *pattern.shape))
        values[:, where[0], where[1]] = self.at_samples(ca.vertcat(*entries))[..., 0]
        values *= self.mechanism.row_scale[:, None]
        order, sizes = pivot_order(pattern, values)
        rows = [i for i, _ in order]
        scaled = values[:, rows] * self.mechanism.rate_scale[self._dependent]
        size = float(np.linalg.norm(scaled, axis=(1, 2)).max(initial=0.0))
        # The sizes of pivots of the rows as they are, not as they are scaled.
        sizes = sizes / self.mechanism.row_scale[rows]
        return [(i, self._dependent[k]) for i, k in order], sizes, size

    @cached_property
    def factors(self) -> Factors:
        """Phi_u, factorised."""
        return Factors([row.Phi for row in self.rows], self._pivots[0])

    def at_samples(self, symbols: SX) -> Array:
        """Values of a function of q, shape (samples, rows, columns)."""
        p = self.parameters.pack(self.mechanism, self.mechanism.friction)
        numbers = ca.Function("numbers", [self.q, self.p], [ca.densify(symbols)])
        return np.array([numbers(q, p).full() for q in self._samples])

    def complete(self, of_coordinates: Sequence[Any], right: Sparse) -> Sparse:
        """Rates x of the whole tree with Phi x = right, from those of the coordinates."""
        pairs = zip(self._coordinates, of_coordinates, strict=True)
        x = {i: value for i, value in pairs if not is_zero(value)}
        return x | self.factors.solve(self._left(x, right))

    def _left(self, x: Sparse, right: Sparse) -> Sparse:
        """What is left of the right side for the dependent ones of rates x."""
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
        """Rates of the tree, L va."""
        return self.complete(ca.vertsplit(self.va), {})

    @cached_property
    def drift(self) -> Sparse:
        """-Phi_dot v, by row."""
        at_rest: Sparse = {}
        drift = {i: -self.rows[i].acceleration(self.v, at_rest) for i in self.factors.rows}
        return {i: x for i, x in drift.items() if not is_zero(x)}

    @cached_property
    def L(self) -> list[Sparse]:
        """Columns of the joint orthogonal complement."""
        n = len(self._coordinates)
        return [self.complete([float(i == k) for i in range(n)], {}) for k in range(n)]

    def project(self, tau: Sparse) -> SX:
        """L^T tau, with L."""
        columns = [[x * tau[i] for i, x in column.items() if i in tau] for column in self.L]
        return ca.vertcat(*(SX(total(terms)) for terms in columns))

    @cached_property
    def checks(self) -> list[Any]:
        """Open closures and small pivots: more than 1 where they are too much."""
        gaps = [s**2 * x.gap for s, x in zip(self.mechanism.row_scale, self.rows, strict=True)]
        gaps += [gap**2 for gap in self.kinematics.unit_gaps]
        open_by = total(gaps) / self._closed**2
        return [open_by, pivot_check(self._pivots[1], self.factors)]

    def unsolved(self, x: Sparse, right: Sparse) -> list[Any]:
        """More than 1 where rates x do not solve Phi x = right, small pivots having met.

        Judged is the sum of the scaled residuals, each with a sign of its own: it takes the sum of
        the rows, not a product with each. Nothing where elimination changes no elements: none can
        grow.
        """
        unit, signs, sums = self._row_sums
        terms = [entry * x[j] for j, entry in sums.items() if j in x]
        terms += [-(sign * right[i]) for i, sign in signs.items() if i in right]
        scale = self.mechanism.rate_scale
        return self._too_much(unit, terms, [x[j] / scale[j] for j in self._dependent if j in x])

    def unbalanced(self, tau: Sparse) -> list[Any]:
        """Likewise, where the multipliers do not balance tau along the dependent rates."""
        unit, signs, sums = self._column_sums
        x, scale = self.multipliers(tau), self.mechanism.row_scale
        terms = [entry * x[i] for i, entry in sums.items() if i in x]
        terms += [-(sign * tau[j]) for j, sign in signs.items() if j in tau]
        return self._too_much(unit, terms, [x[i] / scale[i] for i in x])

    @cached_property
    def _row_sums(self) -> tuple[float, dict[int, float], Sparse]:
        """A unit, factors of the rows that elimination changes, and the sum of these, by rate."""
        unit, signs = _signs(self.factors.changed[0], self.mechanism.row_scale)
        sums: Sparse = {}
        for i, sign in signs.items():
            sums = add(sums, {j: sign * x for j, x in self.rows[i].Phi.items()})
        return unit, signs, sums

    @cached_property
    def _column_sums(self) -> tuple[float, dict[int, float], Sparse]:
        """Likewise of the dependent rates whose columns elimination changes, by row."""
        unit, signs = _signs(self.factors.changed[1], self.mechanism.rate_scale)
        sums = {
            i: total(signs[j] * x for j, x in self.rows[i].Phi.items() if j in signs)
            for i in self.factors.rows
        }
        return unit, signs, {i: x for i, x in sums.items() if not is_zero(x)}

    def _too_much(self, unit: float, terms: list[Any], solution: list[Any]) -> list[Any]:
        """The square of a residual against a solution, without a division."""
        if not terms:
            return []
        most = _ROUNDINGS * self._rounding * self._pivots[2] / unit
        excess = (total(terms) / most) ** 2 - total(x**2 for x in solution)
        return [excess / _NOTHING**2]

    # --- forces -----------------------------------------------------------------------------

    @cached_property
    def _bodies(self) -> list[Body | None]:
        """By Pinocchio's joints; bodies that are welded to each other are one."""
        model, kinematics = self.mechanism.model, self.kinematics
        bodies: list[Body | None] = [None] * model.njoints
        for i in range(1, model.njoints):
            found = self.parameters.body(self.p, i)
            if found is not None:
                mass, c, J = found
                bodies[i] = Body(mass, c, J, ca.sumsqr(c) / mass)
        for closure in self.mechanism.closures:
            if isinstance(closure, Closure) and all(closure.held):
                ends = (closure.frame_a, closure.frame_b)
                a, b = (model.frames[model.getFrameId(name)] for name in ends)
                i, j = a.parentJoint, b.parentJoint
                moving = bodies[j]
                if i and moving is not None:
                    R = kinematics.rotation(a) @ kinematics.rotation(b).T
                    p = sx(a.placement.translation) - R @ sx(b.placement.translation)
                    moved, other = moving.moved(R, p), bodies[i]
                    bodies[i] = moved if other is None else Body(*map(operator.add, moved, other))
                    bodies[j] = None
        return bodies

    def tree_forces(
        self,
        v: Sparse,
        dv: Sparse,
        *,
        loads: bool = True,
        reactions: Mapping[int, SX] | None = None,
    ) -> Sparse:
        """tau of the tree by the recursion of Newton and Euler, without friction and springs.

        Args:
            v: Rates.
            dv: Accelerations.
            loads: Whether external wrenches act.
            reactions: Force and moment about the origin that closures take of links, by their
                index, axes of the link.
        """
        wrenches = []
        gravity = self.kinematics.base.T @ self.parameters.gravity(self.p)
        motions = self.kinematics.motions(v, dv, gravity)
        for link, x in zip(self.kinematics.tree.links, motions, strict=True):
            body = self._bodies[link.body]
            F, N = SX(3, 1), SX(3, 1)
            if body is not None:
                mass, c, J, _ = body
                F, N = mass * x.a + x.U @ c, _moment(x, J) + ca.cross(c, x.a)
            if loads and link.body and self.loads.numel():
                force, moment = self._load(link.body)
                F, N = F - force, N - moment
            wrenches.append((F, N))
        for i, own in (reactions or {}).items():
            wrenches[i] = wrenches[i][0] + own[:3], wrenches[i][1] + own[3:]
        return add(self.kinematics.transmitted(wrenches), self._rotors(dv))

    def _rotors(self, dv: Sparse) -> Sparse:
        armature = self.parameters.of_joints("armature", self.p)
        return {i: x * dv[i] for i, x in armature.items() if i in dv}

    def _load(self, body: int) -> tuple[SX, SX]:
        """External force and moment about the origin of a link, axes of the link."""
        moment, force = ca.vertsplit(self.loads[6 * body - 6 : 6 * body], 3)
        pose, _ = self.kinematics.pose(0, self.kinematics.tree.link_of[body])
        back = pose.T @ self.kinematics.base.T
        found = self.parameters.body(self.p, body)
        lever = sx(self.mechanism.model.inertias[body].lever)
        if found is not None:
            lever = found[1] / found[0]
        force = back @ force
        return force, back @ moment + ca.cross(lever, force)

    def friction(self, v: Sparse) -> Sparse:
        """What friction takes."""
        viscous = self.parameters.of_joints("viscous", self.p)
        coulomb = self.parameters.of_joints("coulomb", self.p)
        tau = {i: D * v[i] for i, D in viscous.items() if i in v}
        return add(tau, {i: F * self._direction(v[i]) for i, F in coulomb.items() if i in v})

    def _direction(self, rate: Any) -> Any:
        """The sign of a rate in Coulomb friction."""
        return ca.tanh(rate / self.p[SIGN_WIDTH]) if self._smooth else ca.sign(rate)

    @cached_property
    def springs(self) -> Sparse:
        """What springs take."""
        stiffness = self.parameters.of_joints("stiffness", self.p)
        rest = self.parameters.of_joints("spring_reference", self.p)
        way = self.kinematics.difference(rest)
        return {k: c * way[k] for k, c in stiffness.items()}

    def forces(self, dv: Sparse) -> Sparse:
        """All that a motion at v takes along the rates of the tree."""
        return add(self.tree_forces(self.v, dv), add(self.friction(self.v), self.springs))

    @cached_property
    def dv(self) -> Sparse:
        """Accelerations of the tree, L aa + L_dot va."""
        return self.complete(ca.vertsplit(self.aa), self.drift)

    @cached_property
    def _taken(self) -> Sparse:
        return self.forces(self.dv)

    @cached_property
    def generalized_forces(self) -> SX:
        """f of a motion."""
        return self.reduced(self._taken)

    @cached_property
    def force_checks(self) -> list[Any]:
        """Of what `generalized_forces` solves."""
        rates = self.unsolved(self.v, {}) + self.unsolved(self.dv, self.drift)
        return rates + self.unbalanced(self._taken)

    @cached_property
    def complement_checks(self) -> list[Any]:
        """Of L."""
        return [check for x in self.L for check in self.unsolved(x, {})]

    @cached_property
    def motor_matrix(self) -> SX:
        """L^T B, shape (n, motors)."""
        columns = [
            {i: float(b) for i, b in enumerate(column) if b} for column in self.mechanism.motors.T
        ]
        return ca.horzcat(*(self.reduced(column) for column in columns))

    # --- inertia ----------------------------------------------------------------------------

    def _inertia_of(self, body: int) -> tuple[SX, SX, SX]:
        """Mass, first moment and inertia about the origin of a body; zeros without mass."""
        found = self._bodies[body]
        if found is None:
            return SX(1, 1), SX(3, 1), SX(3, 3)
        mass, c, J, _ = found
        return mass, c, ca.trace(J) * SX.eye(3) - J

    @cached_property
    def tree_inertia(self) -> dict[tuple[int, int], Any]:
        """Upper triangle of the tree's mass matrix, by pairs of rates, from composite bodies."""
        links, placements = self.kinematics.tree.links, self.kinematics.placements
        composite = [self._inertia_of(link.body) for link in links]
        M: dict[tuple[int, int], Any] = {}
        for i in range(len(links) - 1, 0, -1):
            mass, c, inertia = composite[i]
            for k, S in zip(links[i].v, links[i].S.T, strict=True):
                u, turn = sx(S[:3]), sx(S[3:])
                F, N = mass * u + ca.cross(turn, c), inertia @ turn + ca.cross(c, u)
                j = i
                while j:
                    for other, S_j in zip(links[j].v, links[j].S.T, strict=True):
                        value = ca.dot(sx(S_j[:3]), F) + ca.dot(sx(S_j[3:]), N)
                        if not is_zero(value) and (j != i or other <= k):
                            pair = min(other, k), max(other, k)
                            value *= 1 + (j != i and other == k)  # a mimic joint behind its own
                            M[pair] = M.get(pair, 0) + value
                    R, p = placements[j]
                    F, N = R @ F, R @ N
                    N += ca.cross(p, F)
                    j = links[j].parent
            R, p = placements[i]
            c = R @ c
            cross, arm = ca.skew(p) @ ca.skew(c), ca.skew(p)
            moved = R @ inertia @ R.T - cross - cross.T - mass * arm @ arm
            mass_0, c_0, inertia_0 = composite[links[i].parent]
            composite[links[i].parent] = mass_0 + mass, c_0 + c + mass * p, inertia_0 + moved
        for k, armature in self.parameters.of_joints("armature", self.p).items():
            M[k, k] = M.get((k, k), 0) + armature
        return M

    @cached_property
    def inertia(self) -> SX:
        """L^T M L, shape (n, n)."""
        n = len(self.L)
        matrix = SX(n, n)
        for k, column in enumerate(self.L):
            force: Sparse = {}
            for (i, j), entry in self.tree_inertia.items():
                if j in column:
                    force = add(force, {i: entry * column[j]})
                if i != j and i in column:
                    force = add(force, {j: entry * column[i]})
            for other in range(k + 1):
                terms = [x * force[i] for i, x in self.L[other].items() if i in force]
                matrix[other, k] = matrix[k, other] = total(terms)
        return matrix

    @cached_property
    def coriolis(self) -> SX:
        """The matrix of Eq. (94), shape (n, n)."""
        places = [(i, j) for i in self.factors.rows for j in self.rows[i].Phi]
        entries = ca.vertcat(*(SX(self.rows[i].Phi[j]) for i, j in places))
        rates = ca.jtimes(entries, self.q, self.kinematics.q_rates(self.v))
        changing = [
            (i, j, rate)
            for (i, j), rate in zip(places, ca.vertsplit(rates), strict=True)
            if not is_zero(rate)
        ]
        columns = []
        for L in self.L:
            right: Sparse = {}
            for i, j, rate in changing:
                if j in L:
                    right = add(right, {i: -(rate * L[j])})
            L_dot = self.complete([0.0] * len(self.L), right)
            wrenches = []
            motions = self.kinematics.motions(self.v, L_dot, v_k=L)
            for link, x in zip(self.kinematics.tree.links, motions, strict=True):
                mass, c, inertia = self._inertia_of(link.body)
                inner, found = inertia, self._bodies[link.body]
                if found is not None:
                    # About the mass centre the paper's term is omega x (I omega_k).
                    inner = inertia - found.polar * SX.eye(3)
                moment = inertia @ x.alpha + ca.cross(x.omega, inner @ x.omega_k)
                wrenches.append((mass * x.a + x.U @ c, moment + ca.cross(c, x.a)))
            tau = add(self.kinematics.transmitted(wrenches), self._rotors(L_dot))
            columns.append(self.project(tau))
        return ca.horzcat(*columns)

    def motor_forces(self, tau: SX) -> Sparse:
        """B tau: what motors give along the rates of the tree."""
        return {
            i: total([float(b) * tau[k] for k, b in enumerate(shares) if b])
            for i, shares in enumerate(self.mechanism.motors)
            if shares.any()
        }

    @cached_property
    def at_rest(self) -> Sparse:
        """Accelerations of the tree without those of the coordinates, L_dot va."""
        return self.complete([0.0] * len(self._coordinates), self.drift)

    @cached_property
    def acceleration_checks(self) -> list[Any]:
        """Of what `accelerations` solves."""
        rates = self.unsolved(self.v, {}) + self.unsolved(self.at_rest, self.drift)
        return rates + self.complement_checks

    def accelerations(self, tau: SX) -> tuple[SX, list[Any]]:
        """aa under motor torques, and one over each pivot of the inertia matrix."""
        without = self.forces(self.at_rest)
        given = self.project(self.motor_forces(tau))
        return solve_symmetric(self.inertia, given - self.project(without))


def _moment(x: Motion, J: SX) -> SX:
    """About the origin of a link, of its motion but for the acceleration of the origin."""
    if sum(not component.is_zero() for component in ca.vertsplit(x.omega)) == 1:
        inertia = ca.trace(J) * SX.eye(3) - J
        return inertia @ x.alpha + ca.cross(x.omega, inertia @ x.omega)
    UJ = x.U @ J
    return ca.vertcat(UJ[2, 1] - UJ[1, 2], UJ[0, 2] - UJ[2, 0], UJ[1, 0] - UJ[0, 1])


def _signs(places: Sequence[int], scale: Array) -> tuple[float, dict[int, float]]:
    """A unit, and scales in it with signs that are random, but always the same."""
    unit = float(scale[places[0]]) if places else 1.0
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=len(places))
    return unit, {i: float(x * scale[i] / unit) for i, x in zip(places, signs, strict=True)}


def pivot_check(sizes: Array, factors: Factors) -> Any:
    """More than 1 where a pivot is small against its size in the samples."""
    inverses = factors.inverses
    if len(inverses) < len(sizes):
        sizes = np.append(sizes[:-2], sizes[-2] * sizes[-1])
    return total([(_PIVOT * float(s) * x) ** 2 for s, x in zip(sizes, inverses, strict=True)])
