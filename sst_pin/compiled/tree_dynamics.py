# SPDX-License-Identifier: BSD-2-Clause
"""Forces and mass matrix of the tree, without its closures, on CasADi's symbols.

A body with the first moment c and the second moments J (the integral of r r^T) about its origin
needs the force m a + U c and the moment c x a + 2 axial(U J), Eqs. (63)-(68).
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from ..chain.closures import Closure
from ..chain.mechanism import Mechanism
from ..chain.tree import frame_named
from .closure_rows import line
from .elimination import total
from .link_kinematics import Kinematics, LinkMotion, Wrench
from .open_numbers import SIGN_WIDTH, OpenNumbers
from .symbols import Sparse, add, is_zero, sx


class Body(NamedTuple):
    """A rigid body, or several that are welded to each other, in the frame of a link.

    Attributes:
        mass: Mass of all.
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


class TreeDynamics:
    """Dynamics of a tree; p are the open numbers, in the order of `parameters`.

    `loads` are [moment; force] on each body at its mass centre, base axes, body after body, or
    empty. Bodies that are `welded` to each other are computed as one.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        kinematics: Kinematics,
        parameters: OpenNumbers,
        p: SX,
        loads: SX,
        smooth: bool,
        welded: bool,
    ) -> None:
        self._mechanism, self._kinematics, self._parameters = mechanism, kinematics, parameters
        self._p, self._loads, self._smooth, self._welded = p, loads, smooth, welded

    @cached_property
    def _bodies(self) -> list[Body | None]:
        """By Pinocchio's joints; where bodies are computed as one, the first has all of it."""
        model, kinematics = self._mechanism.model, self._kinematics
        bodies: list[Body | None] = [None] * model.njoints
        for i in range(1, model.njoints):
            found = self._parameters.body(self._p, i)
            if found is not None:
                mass, c, J = found
                bodies[i] = Body(mass, c, J, ca.sumsqr(c) / mass)
        for closure in self._mechanism.closures if self._welded else ():
            if isinstance(closure, Closure) and all(closure.held):
                ends = (closure.frame_a, closure.frame_b)
                a, b = (frame_named(model, name) for name in ends)
                i, j = a.parentJoint, b.parentJoint
                moving = bodies[j]
                if i and moving is not None:
                    R = kinematics.rotation(a) @ kinematics.rotation(b).T
                    p = sx(a.placement.translation) - R @ sx(b.placement.translation)
                    moved, other = moving.moved(R, p), bodies[i]
                    bodies[i] = moved if other is None else Body(*map(operator.add, moved, other))
                    bodies[j] = None
        return bodies

    def forces(
        self,
        v: Sparse,
        dv: Sparse,
        *,
        loads: bool = True,
        reactions: Mapping[int, SX] | None = None,
    ) -> Sparse:
        """tau of the tree by the recursion of Newton and Euler, without friction and springs.

        `reactions` are force and moment about the origin that closures take of links, by their
        index.
        """
        wrenches = self.wrenches(v, dv, loads=loads)
        for i, own in (reactions or {}).items():
            wrenches[i] = wrenches[i][0] + own[:3], wrenches[i][1] + own[3:]
        return add(self._kinematics.transmitted(wrenches), self._rotors(dv))

    def wrenches(self, v: Sparse, dv: Sparse, *, loads: bool = True) -> list[Wrench]:
        """Force and moment that each link needs, less its weight and its load."""
        wrenches: list[Wrench] = []
        gravity = self._kinematics.base.T @ self._parameters.gravity(self._p)
        motions = self._kinematics.motions(v, dv, gravity)
        for link, x in zip(self._kinematics.tree.links, motions, strict=True):
            body = self._bodies[link.body]
            F, N = SX(3, 1), SX(3, 1)
            if body is not None:
                mass, c, J, _ = body
                F, N = mass * x.a + x.U @ c, _moment(x, J) + ca.cross(c, x.a)
            if loads and link.body and self._loads.numel():
                force, moment = self._load(link.body)
                F, N = F - force, N - moment
            wrenches.append((F, N))
        return wrenches

    def _rotors(self, dv: Sparse) -> Sparse:
        armature = self._parameters.of_joints("armature", self._p)
        return {i: x * dv[i] for i, x in armature.items() if i in dv}

    def _load(self, body: int) -> tuple[SX, SX]:
        """External force and moment about the origin of a link, axes of the link."""
        moment, force = ca.vertsplit(self._loads[6 * body - 6 : 6 * body], 3)
        pose, _ = self._kinematics.pose(0, self._kinematics.tree.link_of[body])
        back = pose.T @ self._kinematics.base.T
        found = self._parameters.body(self._p, body)
        lever = sx(self._mechanism.model.inertias[body].lever)
        if found is not None:
            lever = found[1] / found[0]
        force = back @ force
        return force, back @ moment + ca.cross(lever, force)

    def friction(self, v: Sparse) -> Sparse:
        """Forces that friction and the dampers along lines need."""
        viscous = self._parameters.of_joints("viscous", self._p)
        coulomb = self._parameters.of_joints("coulomb", self._p)
        tau = {i: D * v[i] for i, D in viscous.items() if i in v}
        tau = add(tau, {i: F * self._direction(v[i]) for i, F in coulomb.items() if i in v})
        return add(tau, self._along_lines(self._damping(v)))

    def _direction(self, rate: Any) -> Any:
        """The sign of a rate in Coulomb friction."""
        return ca.tanh(rate / self._p[SIGN_WIDTH]) if self._smooth else ca.sign(rate)

    @cached_property
    def springs(self) -> Sparse:
        """Forces that springs need, those along lines among them."""
        stiffness = self._parameters.of_joints("stiffness", self._p)
        rest = self._parameters.of_joints("spring_reference", self._p)
        way = self._kinematics.difference(rest)
        tau = {k: c * way[k] for k, c in stiffness.items()}
        return add(tau, self._along_lines(self._tensions))

    def pulls(self, v: Sparse) -> list[Any]:
        """What pulls the ends of each line together, without motors."""
        return list(map(operator.add, self._tensions, self._damping(v)))

    @property
    def _tensions(self) -> list[Any]:
        """Pull of the spring and the preload along each line."""
        numbers = zip(self.lines, self._parameters.of_lines(self._p), strict=True)
        return [preload + c * (size - rest) for (size, _), (c, rest, _, preload) in numbers]

    def _damping(self, v: Sparse) -> list[Any]:
        """Pull of the damper along each line."""
        numbers = zip(self.lines, self._parameters.of_lines(self._p), strict=True)
        return [
            damping * total(x * v[i] for i, x in row.items() if i in v)
            for (_, row), (_, _, damping, _) in numbers
        ]

    def _along_lines(self, pulls: Sequence[Any]) -> Sparse:
        """Forces along the rates that pulls along the lines need."""
        tau: Sparse = {}
        for (_, row), pull in zip(self.lines, pulls, strict=True):
            tau = add(tau, {i: x * pull for i, x in row.items()})
        return tau

    @cached_property
    def lines(self) -> list[tuple[SX, Sparse]]:
        """Length and row of each line along which a force acts."""
        model, forces = self._mechanism.model, self._mechanism.lines.forces
        return [line(self._kinematics, model, x.frame_a, x.frame_b) for x in forces]

    def kinetic_energy(self, v: Sparse) -> Any:
        """Kinetic energy of all bodies and rotors."""
        pairs = [
            (x * v[i] * v[j], i == j) for (i, j), x in self.inertia.items() if {i, j} <= v.keys()
        ]
        return total(x / 2 if same else x for x, same in pairs)

    @property
    def potential_energy(self) -> Any:
        """Potential energy of the weights, the springs and the forces along lines."""
        gravity, energies = self._kinematics.base.T @ self._parameters.gravity(self._p), []
        for i, link in enumerate(self._kinematics.tree.links):
            mass, c, _ = self._inertia_of(link.body)
            R, p = self._kinematics.pose(0, i)
            energies.append(-ca.dot(gravity, mass * p + R @ c))
        way = self._kinematics.difference(self._parameters.of_joints("spring_reference", self._p))
        stiffness = self._parameters.of_joints("stiffness", self._p)
        energies += [c * way[k] ** 2 / 2 for k, c in stiffness.items()]
        numbers = zip(self.lines, self._parameters.of_lines(self._p), strict=True)
        for (length, _), (c, rest, _, preload) in numbers:
            energies.append(c * (length - rest) ** 2 / 2 + preload * (length - rest))
        return total(energies)

    @cached_property
    def whole_inertia(self) -> Any:
        """Inertia of all bodies and rotors, as `dynamics.whole_inertia`."""
        length, scale = self._mechanism.length, self._mechanism.rate_scale
        found = [self._parameters.body(self._p, i) for i in self._parameters.bodies]
        terms = [mass * length**2 + 2 * ca.trace(J) for mass, _, J in filter(None, found)]
        rotors = self._parameters.of_joints("armature", self._p)
        return total([*terms, *(x * float(scale[i] ** 2) for i, x in rotors.items())])

    def motors_on_lines(self, motor: int) -> Sparse:
        """Forces along the rates of a motor's unit torque, by the lines that it pushes apart."""
        tau: Sparse = {}
        for (_, row), share in zip(self.lines, self._mechanism.lines.motors[:, motor], strict=True):
            if share:
                tau = add(tau, {i: float(share) * x for i, x in row.items()})
        return tau

    def _inertia_of(self, body: int) -> tuple[SX, SX, SX]:
        """Mass, first moment and inertia about the origin of a body; zeros without mass."""
        found = self._bodies[body]
        if found is None:
            return SX(1, 1), SX(3, 1), SX(3, 3)
        mass, c, J, _ = found
        return mass, c, ca.trace(J) * SX.eye(3) - J

    @cached_property
    def inertia(self) -> dict[tuple[int, int], Any]:
        """Upper triangle of the tree's mass matrix, by pairs of rates."""
        return self.composed({})

    def composed(self, following: Mapping[int, Mapping[int, Sparse]]) -> dict[tuple[int, int], Any]:
        """A matrix M with the same L^T M L as the mass matrix, from composite bodies.

        `following` has, by link, rates behind it that follow from those of coordinates behind it:
        their rows of L. What their joints' forces do to the link and those before it is counted
        with these coordinates.
        """
        links, placements = self._kinematics.tree.links, self._kinematics.placements
        composite = [self._inertia_of(link.body) for link in links]
        forces: list[dict[int, tuple[SX, SX]]] = [{} for _ in links]  # by rate
        M: dict[tuple[int, int], Any] = {}
        for i in range(len(links) - 1, 0, -1):
            (mass, c, inertia), link, behind = composite[i], links[i], forces[i]
            for rate, row in following.get(i, {}).items():
                F, N = behind.pop(rate, (SX(3, 1), SX(3, 1)))
                for k, factor in row.items():
                    _push(behind, k, factor * F, factor * N)
            own = {}
            for k, S in zip(link.v, link.S.T, strict=True):
                u, turn = sx(S[:3]), sx(S[3:])
                own[k] = mass * u + ca.cross(turn, c), inertia @ turn + ca.cross(c, u)
            for j, S in zip(link.v, link.S.T, strict=True):
                # Twice: a mimic joint behind its own.
                pairs = [(k, force, 1 + (j == k)) for k, force in behind.items()]
                pairs += [(k, force, 1) for k, force in own.items() if j <= k]
                for k, (F, N), times in pairs:
                    value = times * (ca.dot(sx(S[:3]), F) + ca.dot(sx(S[3:]), N))
                    if not is_zero(value):
                        pair = min(j, k), max(j, k)
                        M[pair] = M.get(pair, 0) + value
            for k, (F, N) in own.items():
                _push(behind, k, F, N)
            R, p = placements[i]
            if link.parent:
                for k, (F, N) in behind.items():
                    turned = R @ F
                    _push(forces[link.parent], k, turned, R @ N + ca.cross(p, turned))
            mass_0, c_0, inertia_0 = composite[link.parent]
            c = R @ c
            middle = c + mass * p / 2
            moved = R @ inertia @ R.T - middle @ p.T - p @ middle.T
            moved += ca.dot(2 * p, middle) * SX.eye(3)
            moved = inertia_0 + ca.triu2symm(ca.triu(moved))
            composite[link.parent] = mass_0 + mass, c_0 + c + mass * p, moved
        for k, armature in self._parameters.of_joints("armature", self._p).items():
            M[k, k] = M.get((k, k), 0) + armature
        return M

    def coriolis_forces(self, v: Sparse, L: Sparse, L_dot: Sparse) -> Sparse:
        """What a column of T^T multiplies in Eq. (94): M t_dot + Omega M t, t and t_dot of L."""
        wrenches = []
        motions = self._kinematics.motions(v, L_dot, v_k=L)
        for link, x in zip(self._kinematics.tree.links, motions, strict=True):
            mass, c, inertia = self._inertia_of(link.body)
            inner, body = inertia, self._bodies[link.body]
            if body is not None:
                # About the mass centre the paper's term is omega x (I omega_k).
                inner = inertia - body.polar * SX.eye(3)
            moment = inertia @ x.alpha + ca.cross(x.omega, inner @ x.omega_k)
            wrenches.append((mass * x.a + x.U @ c, moment + ca.cross(c, x.a)))
        return add(self._kinematics.transmitted(wrenches), self._rotors(L_dot))


def _push(forces: dict[int, tuple[SX, SX]], rate: int, F: SX, N: SX) -> None:
    """Add a force and a moment to those of a rate."""
    if rate in forces:
        F, N = forces[rate][0] + F, forces[rate][1] + N
    forces[rate] = F, N


def _moment(x: LinkMotion, J: SX) -> SX:
    """Inertial moment about the origin of a link whose origin does not accelerate."""
    if sum(not component.is_zero() for component in ca.vertsplit(x.omega)) == 1:
        inertia = ca.trace(J) * SX.eye(3) - J
        return inertia @ x.alpha + ca.cross(x.omega, inertia @ x.omega)
    UJ = x.U @ J
    return ca.vertcat(UJ[2, 1] - UJ[1, 2], UJ[0, 2] - UJ[2, 0], UJ[1, 0] - UJ[0, 1])
