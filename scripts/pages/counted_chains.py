# SPDX-License-Identifier: BSD-2-Clause
"""Inverse dynamics of any closed chain, written once for any kind of number, for docs/cost.md.

The long form has K, T, M and Omega; the recursions apply the factors of K = N_l N_d one after the
other: N_d and N_l forward give motions, N_l^T and N_d^T backward give the forces of the tree. In
both the closures are solved by the sparse elimination of the compiled kernels.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from counted_methods import skew
from sst_pin import ClosedChain, Closure
from sst_pin.compiled.backend import sample_configurations
from sst_pin.compiled.elimination import Factors, pivot_order
from sst_pin.compiled.equations import Equations
from sst_pin.compiled.tree import Tree

Array = NDArray[Any]  # of numbers of any kind
Rates = Mapping[int, Any]  # by index, zeros left out


class Numbers(NamedTuple):
    """What the formulas calculate with: the geometry of n links, the masses of r bodies, a motion.

    Attributes:
        unit: The 3 x 3 unit matrix, source of structural zeros and ones.
        R: Orientation of each link's joint at rest in its parent, shape (n, 3, 3).
        p: Its origin, shape (n, 3).
        S: Unit twists [linear; angular] of all rates in the axes of their links, shape (6, nv).
        ends: Origins of the frames A and B of each closure in their links, shape (closures, 2, 3).
        mass: Shape (r, 1).
        center: Mass centres in the bodies, shape (r, 3).
        inertia: About the mass centres, shape (r, 3, 3).
        gravity: Shape (3,).
        q: Shape (nq,).
        va: Rates of the coordinates.
        aa: Their accelerations.
    """

    unit: Array
    R: Array
    p: Array
    S: Array
    ends: Array
    mass: Array
    center: Array
    inertia: Array
    gravity: Array
    q: Array
    va: Array
    aa: Array

    #: How many of them are geometry, folded into the generated expressions.
    GEOMETRY = 5

    def zeros(self, *shape: int) -> Array:
        """Structural zeros."""
        return np.full(shape, self.unit[0, 1])


class Placement(NamedTuple):
    """Of the links: orientation and origin in the parent, and in the base."""

    R_in_parent: list[Array]
    p_in_parent: list[Array]
    R: list[Array]
    o: list[Array]


class Motion(NamedTuple):
    """Of the links: angular velocities, angular accelerations, accelerations of the origins."""

    omega: list[Array]
    alpha: list[Array]
    a: list[Array]


class Chain:
    """A closed chain of turning, sliding and free joints, with closures in points or of all axes.

    Args:
        robot: Without friction, springs and rotors, each motor along its coordinate.

    Raises:
        ValueError: For another joint or closure.

    Attributes:
        equations: Those of its compiled kernels.
        samples: Assembled configurations, shape (samples, nq).
    """

    def __init__(self, robot: ClosedChain) -> None:
        mechanism = robot._current.mechanism()
        self._model, self._tree = mechanism.model, Tree.of(mechanism.model)
        self._links = self._tree.links
        self._bodies = [i for i, link in enumerate(self._links) if link.body]
        self._coordinates = [int(k) for k in mechanism.coordinates]
        self._dependent = [int(k) for k in mechanism.dependent]
        self._closures = []
        ends = []
        for closure in robot.closures:
            if not isinstance(closure, Closure) or closure.kind not in ("3d", "6d"):
                raise ValueError(f"the closure {closure} is not counted: points and 6d are")
            frames = [
                self._model.frames[self._model.getFrameId(name)]
                for name in (closure.frame_a, closure.frame_b)
            ]
            links = [self._tree.link_of[frame.parentJoint] for frame in frames]
            self._closures.append((*links, len(closure.rows) == 6))
            ends.append([frame.placement.translation for frame in frames])
        S = np.zeros((6, self._model.nv))
        for link in self._links:
            S[:, list(link.v)] = link.S
        self._geometry = [
            np.eye(3),
            np.array([link.R for link in self._links]),
            np.array([link.p for link in self._links]),
            S,
            np.array(ends),
        ]
        self.samples = sample_configurations(robot._current.reference)
        self.equations = Equations(mechanism, self.samples)
        rows = [
            self._closure_rows(n := self.numbers(q, *self.zero_motion), self._place(n))
            for q in self.samples
        ]
        pattern = np.array([[k in row for k in self._dependent] for row in rows[0]])
        values = [[[row.get(k, 0.0) for k in self._dependent] for row in Phi] for Phi in rows]
        order, _ = pivot_order(pattern, np.array(values, dtype=float))
        self._order = [(i, self._dependent[k]) for i, k in order]

    @property
    def zero_motion(self) -> tuple[Array, Array]:
        """No rates and no accelerations of the coordinates."""
        n = len(self._coordinates)
        return np.zeros(n), np.zeros(n)

    def numbers(self, q: Array, va: Array, aa: Array) -> Numbers:
        """The robot's own numbers in a motion."""
        bodies = [self._model.inertias[self._links[i].body] for i in self._bodies]
        return Numbers(
            *self._geometry,
            np.array([[body.mass] for body in bodies]),
            np.array([body.lever for body in bodies]),
            np.array([body.inertia for body in bodies]),
            self._model.gravity.linear,
            q,
            va,
            aa,
        )

    def masses(self) -> Array:
        """The open numbers of its compiled kernels."""
        mechanism = self.equations.mechanism
        return self.equations.parameters.pack(mechanism, mechanism.friction)

    # --- placements and closures ----------------------------------------------------------------

    def _place(self, n: Numbers) -> Placement:
        place = Placement([n.unit], [n.zeros(3)], [n.unit], [n.zeros(3)])
        for i, link in enumerate(self._links[1:], 1):
            R, p, q = n.R[i], n.p[i], n.q[link.q.start : link.q.stop]
            if link.kind == "slide":
                p = p + R @ (n.S[:3, link.v.start] * q)
            elif link.kind == "turn":
                R = R @ _turn(n, n.S[3:, link.v.start], np.cos(q), np.sin(q))
            elif link.kind == "free":
                W = skew(n.unit, q[3:6])
                p, R = p + R @ q[:3], R @ (n.unit + 2.0 * (q[6] * W + W @ W))
            else:
                raise ValueError(f"a joint of kind {link.kind} is not counted")
            before = place.R[link.parent], place.o[link.parent]
            place.R_in_parent.append(R)
            place.p_in_parent.append(p)
            place.R.append(before[0] @ R if link.parent else R)
            place.o.append(before[1] + before[0] @ p if link.parent else p)
        return place

    def _columns(
        self, n: Numbers, place: Placement, links: Iterable[int]
    ) -> dict[int, tuple[Array, Array, int]]:
        """Turn and slide of each rate of some links, base axes, and the link it belongs to."""
        return {
            k: (place.R[i] @ n.S[3:, k], place.R[i] @ n.S[:3, k], i)
            for i in links
            for k in self._links[i].v
        }

    def _branches(self, a: int, b: int) -> tuple[list[int], list[int]]:
        """Links that move one of two links and not the other."""
        first, second = self._tree.ancestors(a), self._tree.ancestors(b)
        return [i for i in first if i not in second], [i for i in second if i not in first]

    def _end(self, n: Numbers, place: Placement, closure: int, side: int) -> Array:
        """From the origin of its link to the frame of a closure, base axes."""
        return place.R[self._closures[closure][side]] @ n.ends[closure, side]

    def _closure_rows(self, n: Numbers, place: Placement) -> list[dict[int, Any]]:
        """Rows of Phi, base axes: B less A, by the rates that do not move both alike."""
        rows: list[dict[int, Any]] = []
        for c, (*links, turns) in enumerate(self._closures):
            own: list[dict[int, Any]] = [{} for _ in range(6 if turns else 3)]
            for side, branch in enumerate(self._branches(*links)):
                point = place.o[links[side]] + self._end(n, place, c, side)
                for k, (turn, slide, i) in self._columns(n, place, branch).items():
                    column = [*(slide + np.cross(turn, point - place.o[i])), *turn]
                    for row, entry in zip(own, column, strict=False):
                        row[k] = entry if side else -entry
            rows += own
        return rows

    def _complete(
        self, rows: Sequence[Mapping[int, Any]], factors: Factors, given: Any, right: Any
    ) -> dict[int, Any]:
        """x with Phi x = right, from its coordinates; zeros left out of both."""
        x = {
            k: value for k, value in zip(self._coordinates, given, strict=True) if value is not None
        }
        moved = dict(right)
        for i in factors.rows:
            for k, entry in rows[i].items():
                if k in x:
                    moved[i] = moved[i] - entry * x[k] if i in moved else -(entry * x[k])
        return x | factors.solve(moved)

    # --- forward: N_d, N_l ----------------------------------------------------------------------

    def _forward(
        self,
        n: Numbers,
        place: Placement,
        v: Rates,
        dv: Rates,
        base: bool,
        start: Array,
    ) -> Motion:
        """Motions of the links: N_d gives what the own joint adds, N_l carries it on."""
        motion = Motion([n.zeros(3)], [n.zeros(3)], [start])
        for i, link in enumerate(self._links[1:], 1):
            omega, alpha, a = (x[link.parent] for x in motion)
            lever = place.R[link.parent] @ place.p_in_parent[i] if base else place.p_in_parent[i]
            if link.parent:
                a = a + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
            if not base:
                back = place.R_in_parent[i].T
                a = back @ a
                if link.parent:
                    omega, alpha = back @ omega, back @ alpha
            axes = place.R[i] if base else None
            turn, slide = self._own(n, i, v, axes)
            turn_dot, slide_dot = self._own(n, i, dv, axes)
            before = omega
            if turn is not None:
                omega = omega + turn if link.parent else turn
                alpha = alpha + np.cross(before, turn) if link.parent else alpha
            if turn_dot is not None:
                alpha = alpha + turn_dot
            if slide is not None:
                a = a + np.cross(omega, slide)
                a = a + np.cross(before, slide) if link.parent else a
            if slide_dot is not None:
                a = a + slide_dot
            for values, value in zip(motion, (omega, alpha, a), strict=True):
                values.append(value)
        return motion

    def _own(
        self, n: Numbers, i: int, x: Rates, axes: Array | None
    ) -> tuple[Array | None, Array | None]:
        """Angular and linear part of N_d x for one link; None for a part that its joint lacks."""
        link, parts = self._links[i], []
        for part, S in ((link.S[3:], n.S[3:]), (link.S[:3], n.S[:3])):
            columns = [S[:, k] * x[k] for j, k in enumerate(link.v) if k in x and part[:, j].any()]
            total = None
            for column in columns:
                total = column if total is None else total + column
            parts.append(total if total is None or axes is None else axes @ total)
        return parts[0], parts[1]

    def _drift(self, n: Numbers, place: Placement, motion: Motion, base: bool) -> dict[int, Any]:
        """-Phi_dot v: B less A of accelerations without those of the joints, by row."""
        right: list[Array] = []
        for c, (*links, turns) in enumerate(self._closures):
            ends = []
            for side, link in enumerate(links):
                omega, alpha, a = (x[link] for x in motion)
                d = self._end(n, place, c, side) if base else n.ends[c, side]
                a = a + np.cross(alpha, d) + np.cross(omega, np.cross(omega, d))
                ends.append([x if base else place.R[link] @ x for x in (a, alpha)])
            right += [*(ends[0][0] - ends[1][0]), *((ends[0][1] - ends[1][1]) if turns else ())]
        return dict(enumerate(right))

    # --- backward: N_l^T, N_d^T -----------------------------------------------------------------

    def _backward(self, n: Numbers, place: Placement, motion: Motion, base: bool) -> dict[int, Any]:
        """Forces of the tree: N_l^T gathers the wrenches of the bodies, N_d^T takes the joint's."""
        wrenches: list[Array] = [None] * len(self._links)
        for b, i in enumerate(self._bodies):
            omega, alpha, a = (x[i] for x in motion)
            R, c = place.R[i], n.center[b]
            if base:
                c = R @ c
                turn, turn_dot = R.T @ omega, R.T @ alpha
                N = R @ (n.inertia[b] @ turn_dot + np.cross(turn, n.inertia[b] @ turn))
            else:
                N = n.inertia[b] @ alpha + np.cross(omega, n.inertia[b] @ omega)
            F = n.mass[b] * (a + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c)))
            wrenches[i] = F, N + np.cross(c, F)
        tau: dict[int, Any] = {}
        for i in range(len(self._links) - 1, 0, -1):
            link, (F, N) = self._links[i], wrenches[i]
            own = (place.R[i].T @ F, place.R[i].T @ N) if base else (F, N)
            for j, k in enumerate(link.v):
                parts = [
                    S[:, k] @ x
                    for S, x, of in zip(
                        (n.S[:3], n.S[3:]), own, (link.S[:3], link.S[3:]), strict=True
                    )
                    if of[:, j].any()
                ]
                tau[k] = parts[0] if len(parts) == 1 else parts[0] + parts[1]
            if link.parent:
                lever = place.p_in_parent[i]
                if base:
                    lever = place.R[link.parent] @ lever
                else:
                    F, N = place.R_in_parent[i] @ F, place.R_in_parent[i] @ N
                N = N + np.cross(lever, F)
                known = wrenches[link.parent]
                wrenches[link.parent] = (F, N) if known is None else (known[0] + F, known[1] + N)
        return tau

    # --- the methods ----------------------------------------------------------------------------

    def torques_recursive(self, n: Numbers, base: bool) -> Array:
        """The short form, the tree by recursions, in base axes or in the axes of each link."""
        place = self._place(n)
        rows = self._closure_rows(n, place)
        factors = Factors(rows, self._order)
        v = self._complete(rows, factors, n.va, {})
        drift = self._drift(n, place, self._forward(n, place, v, {}, base, n.zeros(3)), base)
        dv = self._complete(rows, factors, n.aa, {i: drift[i] for i in factors.rows})
        motion = self._forward(n, place, v, dv, base, -n.gravity)
        tau = self._backward(n, place, motion, base)
        multipliers = factors.solve_transposed({k: tau[k] for k in self._dependent})
        return np.array(
            [
                self._less(tau[k], [rows[i][k] * x for i, x in multipliers.items() if k in rows[i]])
                for k in self._coordinates
            ]
        )

    @staticmethod
    def _less(value: Any, terms: Sequence[Any]) -> Any:
        for term in terms:
            value = value - term
        return value

    def torques_long(self, n: Numbers) -> Array:
        """The long form, Eqs. (92)-(95), products from left to right."""
        place = self._place(n)
        rows = self._closure_rows(n, place)
        factors = Factors(rows, self._order)
        size, nv, r = len(self._coordinates), n.S.shape[1], len(self._bodies)
        L, L_dot = n.zeros(nv, size), n.zeros(nv, size)
        for j in range(size):
            unit = [n.unit[0, 0] if i == j else None for i in range(size)]
            for k, value in self._complete(rows, factors, unit, {}).items():
                L[k, j] = value
        v = L @ n.va
        omega, o_dot = self._velocities(n, place, v)
        K, K_dot = n.zeros(r, 6, nv), n.zeros(r, 6, nv)
        M, Omega, w_g = n.zeros(r, 6, r, 6), n.zeros(r, 6, r, 6), n.zeros(r, 6)
        for b, i in enumerate(self._bodies):
            arm = place.R[i] @ n.center[b]
            path = self._tree.ancestors(i)
            columns = self._rates_of_columns(n, place, i, path, arm, omega, o_dot)
            for k, (column, rate) in columns.items():
                K[b, :, k], K_dot[b, :, k] = column, rate
            M[b, :3, b, :3] = place.R[i] @ n.inertia[b] @ place.R[i].T
            M[b, range(3, 6), b, range(3, 6)] = n.mass[b, 0]
            Omega[b, :3, b, :3] = skew(n.unit, omega[i])
            w_g[b, 3:] = n.mass[b] * n.gravity
        Phi_dot = n.zeros(len(rows), nv)
        start = 0
        for c, (*links, turns) in enumerate(self._closures):
            for side, branch in enumerate(self._branches(*links)):
                arm = self._end(n, place, c, side)
                rates = self._rates_of_columns(n, place, links[side], branch, arm, omega, o_dot)
                for k, (_, rate) in rates.items():
                    whole = np.concatenate([rate[3:], rate[:3]])[: 6 if turns else 3]
                    Phi_dot[start : start + len(whole), k] = whole if side else -whole
            start += 6 if turns else 3
        right = -(Phi_dot[factors.rows] @ L)
        for j in range(size):
            changes = dict(zip(factors.rows, right[:, j], strict=True))
            for k, value in factors.solve(changes).items():
                L_dot[k, j] = value
        K, K_dot, w_g = K.reshape(6 * r, nv), K_dot.reshape(6 * r, nv), w_g.reshape(6 * r)
        M, Omega = M.reshape(6 * r, 6 * r), Omega.reshape(6 * r, 6 * r)
        T = K @ L  # Eq. (22)
        T_dot = K_dot @ L + K @ L_dot  # Eq. (25)
        inertia = T.T @ M @ T  # Eq. (93)
        coriolis = T.T @ M @ T_dot + T.T @ Omega @ M @ T  # Eq. (94)
        return inertia @ n.aa + coriolis @ n.va - T.T @ w_g

    def _velocities(self, n: Numbers, place: Placement, v: Any) -> tuple[list[Array], list[Array]]:
        """Angular velocities of the links and velocities of their origins, base axes."""
        omega, o_dot = [n.zeros(3)], [n.zeros(3)]
        own = dict(enumerate(v))
        for i, link in enumerate(self._links[1:], 1):
            turn, slide = self._own(n, i, own, place.R[i])
            turned, moved = omega[link.parent], o_dot[link.parent]
            if link.parent:
                moved = moved + np.cross(turned, place.o[i] - place.o[link.parent])
            omega.append(turned if turn is None else turned + turn)
            o_dot.append(moved if slide is None else moved + slide)
        return omega, o_dot

    def _rates_of_columns(
        self,
        n: Numbers,
        place: Placement,
        link: int,
        path: Iterable[int],
        arm: Array,
        omega: list[Array],
        o_dot: list[Array],
    ) -> dict[int, tuple[Any, Any]]:
        """[omega; v] of a point of a link per rate, and how it changes, base axes."""
        point = place.o[link] + arm
        velocity = o_dot[link] + np.cross(omega[link], arm)
        columns = {}
        for k, (turn, slide, i) in self._columns(n, place, path).items():
            turn_dot, slide_dot = np.cross(omega[i], turn), np.cross(omega[i], slide)
            lever, lever_dot = point - place.o[i], velocity - o_dot[i]
            linear = slide + np.cross(turn, lever)
            rate = slide_dot + np.cross(turn_dot, lever) + np.cross(turn, lever_dot)
            columns[k] = np.concatenate([turn, linear]), np.concatenate([turn_dot, rate])
        return columns


def _turn(n: Numbers, axis: Array, cosine: Any, sine: Any) -> Array:
    along = axis[:, None] * axis
    return along + cosine * (n.unit - along) + sine * skew(n.unit, axis)
