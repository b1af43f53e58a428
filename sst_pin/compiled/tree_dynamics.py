# SPDX-License-Identifier: BSD-2-Clause
"""Forces and mass matrix of the tree without closures, on CasADi's symbols.

A body with the first moment c and the second moments J (the integral of r r^T) about its origin
needs the force m a + U c and the moment c x a + 2 axial(U J), Eqs. (63)-(68).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
from casadi import SX

from ..model.closures import Closure
from ..model.mechanism import Mechanism
from ..model.tree import frame_named
from .closure_rows import Row, length_and_row
from .elimination import total
from .link_kinematics import Kinematics, LinkMotion
from .symbolic_parameters import GRAVITY, SIGN_WIDTH, SymbolicParameters
from .symbols import Sparse, add, is_zero, sx


class Body(NamedTuple):
    """A rigid body, or several bodies welded together, in the frame of a link."""

    mass: SX = SX(1, 1)
    #: First moment.
    c: SX = SX(3, 1)
    #: Second moments, the integral of r r^T.
    J: SX = SX(3, 3)
    #: Sum of m r^2 of the bodies that are welded together, with the distance r of a body's mass
    #: centre from the origin.
    polar: SX = SX(1, 1)

    @property
    def inertia(self) -> SX:
        """Inertia about the origin."""
        return ca.trace(self.J) * SX.eye(3) - self.J

    def moved(self, R: SX, p: SX) -> "Body":
        """In a frame in which the one before has the orientation R and the origin p."""
        c = R @ self.c
        J = R @ self.J @ R.T + c @ p.T + p @ c.T + self.mass * p @ p.T
        c += self.mass * p
        return Body(self.mass, c, J, ca.sumsqr(c) / self.mass)

    def welded_to(self, other: "Body") -> "Body":
        """Both bodies together, in the same frame."""
        return Body(
            mass=self.mass + other.mass,
            c=self.c + other.c,
            J=self.J + other.J,
            polar=self.polar + other.polar,
        )


class RigidBody(NamedTuple):
    """Inertia of a link with all that is rigidly joined to it, in the frame of the link."""

    mass: SX
    #: First moment.
    c: SX
    #: Inertia about the origin.
    inertia: SX

    def momentum(self, twist: SX) -> SX:
        """The inertia times a twist [linear; angular]: [force; moment]."""
        u, turn = twist[:3], twist[3:]
        return ca.vertcat(
            self.mass * u + ca.cross(turn, self.c), self.inertia @ turn + ca.cross(self.c, u)
        )

    def joined_to(self, parent: "RigidBody", R: SX, p: SX) -> "RigidBody":
        """The parent with this body, in whose frame this one has the orientation R and origin p."""
        c = R @ self.c
        middle = c + self.mass * p / 2
        inertia = R @ self.inertia @ R.T - middle @ p.T - p @ middle.T
        inertia += ca.dot(2 * p, middle) * SX.eye(3)
        return RigidBody(
            parent.mass + self.mass,
            parent.c + c + self.mass * p,
            parent.inertia + ca.triu2symm(ca.triu(inertia)),
        )


class Line(NamedTuple):
    """A line along which a force acts."""

    length: SX
    #: Its rate per rate of the tree, with its second derivative.
    motion: Row
    stiffness: SX
    rest: SX
    damping: SX
    preload: SX

    @property
    def row(self) -> Sparse:
        """Its rate per rate of the tree."""
        return self.motion.Phi


@dataclass(eq=False)
class TreeDynamics:
    """Dynamics of a tree, the arguments as in `Equations`."""

    _mechanism: Mechanism
    _kinematics: Kinematics
    _parameters: SymbolicParameters
    _p: SX
    _loads: SX
    _smooth: bool
    _welded: bool

    @cached_property
    def _bodies(self) -> list[Body]:
        """Bodies of Pinocchio's joints; the first of several welded ones has all their inertia."""
        bodies = self._single_bodies()
        if self._welded:
            self._weld(bodies)
        return bodies

    def _single_bodies(self) -> list[Body]:
        """The body of each of Pinocchio's joints by itself."""
        model = self._mechanism.model
        bodies = [Body()] * model.njoints
        for i in range(1, model.njoints):
            numbers = self._parameters.body(self._p, i)
            if numbers is not None:
                mass, c, J = numbers
                bodies[i] = Body(mass, c, J, ca.sumsqr(c) / mass)
        return bodies

    def _weld(self, bodies: list[Body]) -> None:
        """Move the inertia of bodies that closures weld to others to these, in place."""
        model = self._mechanism.model
        for closure in self._mechanism.closures:
            if not (isinstance(closure, Closure) and all(closure.held)):
                continue
            a = frame_named(model, closure.frame_a)
            b = frame_named(model, closure.frame_b)
            i = a.parentJoint
            j = b.parentJoint
            if i and not is_zero(bodies[j].mass):
                # Body j in the frame of body i: both closure frames are the same.
                R = sx(a.placement.rotation @ b.placement.rotation.T)
                p = sx(a.placement.translation) - R @ sx(b.placement.translation)
                bodies[i] = bodies[j].moved(R, p).welded_to(bodies[i])
                bodies[j] = Body()

    def forces(
        self,
        v: Sparse,
        dv: Sparse,
        *,
        loads: bool = True,
        weight: bool = True,
        reactions: Mapping[int, SX] | None = None,
    ) -> Sparse:
        """tau by Newton and Euler without friction and springs; closures take `reactions`."""
        wrenches = self.wrenches(v, dv, loads=loads, weight=weight)
        for i, wrench in (reactions or {}).items():
            wrenches[i] = wrenches[i] + wrench
        forces = add(self._kinematics.joint_forces(wrenches), self._rotors(dv))
        return add(forces, self.along_lines(self.inertial_pulls(v, dv)))

    def wrenches(
        self, v: Sparse, dv: Sparse, *, loads: bool = True, weight: bool = True
    ) -> list[SX]:
        """Force and moment that each link needs, less its weight and its load."""
        gravity = self._p[GRAVITY] if weight else None
        wrenches = list[SX]()
        motions = self._kinematics.motions(v, dv, gravity)
        for link, x in zip(self._kinematics.tree.links, motions, strict=True):
            mass, c, J, _ = self._bodies[link.body]
            wrench = ca.vertcat(mass * x.a + x.U @ c, _moment(x, J) + ca.cross(c, x.a))
            if weight and link.body in self._lifted:
                wrench = wrench - self._lift(link.body)
            if loads and link.body and self._loads.numel():
                wrench = wrench - self._load(link.body)
            wrenches.append(wrench)
        return wrenches

    def _rotors(self, dv: Sparse) -> Sparse:
        """Forces that the inertia of rotors needs."""
        armature = self._parameters.of_joints("armature", self._p)
        return {i: x * dv[i] for i, x in armature.items() if i in dv}

    def _load(self, body: int) -> SX:
        """External force and moment about the origin of a link, axes of the link."""
        force, moment = ca.vertsplit(self._loads[6 * body - 6 : 6 * body], 3)
        R, _ = self._kinematics.pose(0, self._kinematics.tree.link_of[body])
        numbers = self._parameters.body(self._p, body)
        force = R.T @ force
        lever = sx(self._mechanism.model.inertias[body].lever)
        if numbers is not None:
            lever = numbers[1] / numbers[0]
        return ca.vertcat(force, R.T @ moment + ca.cross(lever, force))

    @cached_property
    def _lifted(self) -> dict[int, tuple[SX, SX]]:
        """Mass and first moment without weight, by the numbers of Pinocchio's joints."""
        lifted = dict[int, tuple[SX, SX]]()
        weight_shares = self._mechanism.weight_shares
        if weight_shares is not None:
            for body in weight_shares.bodies:
                numbers = self._parameters.body(self._p, body + 1)
                if numbers is not None:
                    mass, c, _ = numbers
                    W = sx(weight_shares.weightless_factor(body))
                    without_weight = W @ ca.vertcat(mass, c)
                    lifted[body + 1] = without_weight[0], without_weight[1:]
        return lifted

    def _lift(self, body: int) -> SX:
        """Force and moment that carry what a link does not have of its weight, axes of the link."""
        mass, c = self._lifted[body]
        R, _ = self._kinematics.pose(0, self._kinematics.tree.link_of[body])
        g = R.T @ self._p[GRAVITY]
        return -ca.vertcat(mass * g, ca.cross(c, g))

    def friction(self, v: Sparse) -> Sparse:
        """Forces that friction of joints and along lines needs."""
        viscous = self._parameters.of_joints("viscous", self._p)
        coulomb = self._parameters.of_joints("coulomb", self._p)
        signs = {i: self._sign(x) for i, x in v.items()}
        tau = {i: D * v[i] for i, D in viscous.items() if i in v}
        tau = add(tau, {i: F * signs[i] for i, F in coulomb.items() if i in v})
        of_dampers = self._where_taut(self._damping(v), v)
        of_lines = _sums(of_dampers, self._rubbing(v))
        return add(tau, self.along_lines(of_lines))

    def _sign(self, rate: Any) -> Any:
        """The sign of a rate in Coulomb friction."""
        return ca.tanh(rate / self._p[SIGN_WIDTH]) if self._smooth else ca.sign(rate)

    def springs(self, v: Sparse) -> Sparse:
        """Forces that springs need, those along lines among them; cables may be slack at v."""
        stiffness = self._parameters.of_joints("stiffness", self._p)
        rest = self._parameters.of_joints("spring_reference", self._p)
        moves = self._kinematics.difference(rest)
        tau = {k: c * moves[k] for k, c in stiffness.items()}
        return add(tau, self.along_lines(self._where_taut(self._tensions, v)))

    def pulls(self, v: Sparse) -> list[Any]:
        """Tension of each line, without motors."""
        of_springs_and_dampers = _sums(self._tensions, self._damping(v))
        return _sums(self._where_taut(of_springs_and_dampers, v), self._rubbing(v))

    def _where_taut(self, pulls: list[Any], v: Sparse) -> list[Any]:
        """Pulls along the lines, but zero along slack cables."""
        forces = self._mechanism.lines.forces
        tensions = self._tensions
        damping = self._damping(v)
        result = []
        for k, pull in enumerate(pulls):
            if forces[k].pulls_only:
                is_slack = tensions[k] + damping[k] <= 0  # 1 or 0
                result.append((1 - is_slack) * pull)
            else:
                result.append(pull)
        return result

    @property
    def _tensions(self) -> list[Any]:
        """Pull of the spring and the preload along each line."""
        return [x.preload + x.stiffness * (x.length - x.rest) for x in self.lines]

    def _damping(self, v: Sparse) -> list[Any]:
        """Pull of the damper along each line."""
        rates = self._line_rates(v)
        return [x.damping * rate for x, rate in zip(self.lines, rates, strict=True)]

    def _rubbing(self, v: Sparse) -> list[Any]:
        """Pull of dry friction along each line."""
        pulls: list[Any] = [SX(0)] * len(self.lines)
        rates = self._line_rates(v)
        for k, force in self._parameters.line_coulomb(self._p).items():
            pulls[k] = force * self._sign(SX(rates[k]))
        return pulls

    def _line_rates(self, v: Sparse) -> list[Any]:
        """Rate of the length of each line."""
        return [total(entry * v[i] for i, entry in x.row.items() if i in v) for x in self.lines]

    def inertial_pulls(self, v: Sparse, dv: Sparse) -> list[Any]:
        """Pull along each line that its mass needs."""
        pulls: list[Any] = [SX(0)] * len(self.lines)
        for k, mass in self._parameters.line_masses(self._p).items():
            pulls[k] = mass * self.lines[k].motion.acceleration(v, dv)
        return pulls

    def along_lines(self, pulls: Iterable[Any]) -> Sparse:
        """Forces along the rates that pulls along the lines need."""
        tau: Sparse = {}
        for x, pull in zip(self.lines, pulls, strict=True):
            if not is_zero(pull):
                tau = add(tau, {i: entry * pull for i, entry in x.row.items()})
        return tau

    @cached_property
    def lines(self) -> list[Line]:
        """All lines along which forces act."""
        model = self._mechanism.model
        forces = self._mechanism.lines.forces
        places = (length_and_row(self._kinematics, model, x.frame_a, x.frame_b) for x in forces)
        numbers = self._parameters.of_lines(self._p)
        return [Line(*place, *of_line) for place, of_line in zip(places, numbers, strict=True)]

    def kinetic_energy(self, v: Sparse) -> Any:
        """Kinetic energy of all bodies and rotors."""
        terms = []
        for (i, j), x in self.inertia.items():
            if i in v and j in v:
                # Entries beside the diagonal count twice in v^T M v / 2.
                divisor = 2 if i == j else 1
                terms.append(x * v[i] * v[j] / divisor)
        return total(terms)

    @property
    def potential_energy(self) -> Any:
        """Potential energy of gravity, the springs and the forces along lines."""
        gravity = self._p[GRAVITY]
        energies = []
        for i, link in enumerate(self._kinematics.tree.links):
            body = self._bodies[link.body]
            R, p = self._kinematics.pose(0, i)
            energies.append(-ca.dot(gravity, body.mass * p + R @ body.c))
            if link.body in self._lifted:
                mass, c = self._lifted[link.body]
                energies.append(ca.dot(gravity, mass * p + R @ c))
        rest = self._parameters.of_joints("spring_reference", self._p)
        moves = self._kinematics.difference(rest)
        stiffness = self._parameters.of_joints("stiffness", self._p)
        energies += [c * moves[k] ** 2 / 2 for k, c in stiffness.items()]
        for x, force in zip(self.lines, self._mechanism.lines.forces, strict=True):
            stretch = x.length - x.rest
            if force.pulls_only and force.stiffness:
                slack = x.preload + x.stiffness * stretch <= 0
                stretch = stretch - slack * (stretch + x.preload / x.stiffness)
            energies.append(x.stiffness * stretch**2 / 2 + x.preload * stretch)
        return total(energies)

    @cached_property
    def whole_inertia(self) -> Any:
        """Inertia of all bodies and rotors, as `dynamics.whole_inertia`."""
        length = self._mechanism.length
        scale = self._mechanism.rate_scale
        bodies = [self._parameters.body(self._p, i) for i in self._parameters.bodies]
        terms = [mass * length**2 + 2 * ca.trace(J) for mass, _, J in filter(None, bodies)]
        rotors = self._parameters.of_joints("armature", self._p)
        on_lines = [x * length**2 for x in self._parameters.line_masses(self._p).values()]
        return total([*terms, *(x * float(scale[i] ** 2) for i, x in rotors.items()), *on_lines])

    @cached_property
    def inertia(self) -> dict[tuple[int, int], Any]:
        """Upper triangle of the tree's mass matrix, by pairs of rates."""
        return self.composed({})

    def composed(self, following: Mapping[int, Mapping[int, Sparse]]) -> dict[tuple[int, int], Any]:
        """A matrix M with the same L^T M L as the mass matrix, from composite bodies.

        From the tips to the ground, each link collects for each rate behind it the wrench that
        accelerates all moved bodies for a unit of this rate. Its part along the axes of the link is
        an entry of M.

        Args:
            following: {i: {d: {k: L_dk}}}, rows of L of dependent rates d, by the link i that
                their loops hang on. All of such a loop is behind link i. So from there to the
                ground a unit of the coordinate k moves what d moves by L_dk: the wrench of k takes
                L_dk times that of d, which is left out. Entries M_dj within the loop stay.
        """
        links = self._kinematics.tree.links
        placements = self._kinematics.placements
        composite = self.rigid_bodies
        forces: list[Sparse] = [{} for _ in links]  # wrenches by rate
        M: dict[tuple[int, int], Any] = {}
        for i in range(len(links) - 1, 0, -1):
            link = links[i]
            behind = dict(forces[i])
            of_link = Sparse()
            for rate, row in following.get(i, {}).items():
                wrench = behind.pop(rate, SX(6, 1))
                behind = add(behind, {k: factor * wrench for k, factor in row.items()})

            # Wrenches that accelerate all that this link carries, by its own rates.
            for k, S in zip(link.v, link.S.T, strict=True):
                of_link[k] = composite[i].momentum(sx(S))

            # Entries of M: the parts of all these wrenches along the axes of this link.
            for j, S in zip(link.v, link.S.T, strict=True):
                pairs = []
                for k, wrench in behind.items():
                    # j = k if a mimic joint is behind the joint that it follows. Then M_kk gets the
                    # entries of both orders; otherwise the lower triangle has the other one.
                    times = 2 if j == k else 1
                    pairs.append((k, wrench, times))
                pairs += [(k, wrench, 1) for k, wrench in of_link.items() if j <= k]
                for k, wrench, times in pairs:
                    value = times * ca.dot(sx(S), wrench)
                    if not is_zero(value):
                        pair = min(j, k), max(j, k)
                        M[pair] = M.get(pair, 0) + value

            # The parent carries this link: its wrenches, if it moves, and its inertia.
            R, p = placements[i]
            if link.parent:
                for k, wrench in add(behind, of_link).items():
                    force = R @ wrench[:3]
                    moment = R @ wrench[3:] + ca.cross(p, force)
                    at_parent = ca.vertcat(force, moment)
                    forces[link.parent] = add(forces[link.parent], {k: at_parent})
            composite[link.parent] = composite[i].joined_to(composite[link.parent], R, p)

        # Rotors and masses of lines.
        for k, armature in self._parameters.of_joints("armature", self._p).items():
            M[k, k] = M.get((k, k), 0) + armature
        for k, mass in self._parameters.line_masses(self._p).items():
            row = self.lines[k].row
            for i in row:
                for j in row:
                    if i <= j:
                        M[i, j] = M.get((i, j), 0) + row[i] * mass * row[j]
        return M

    @property
    def rigid_bodies(self) -> list[RigidBody]:
        """Inertia of each link alone."""
        bodies = (self._bodies[link.body] for link in self._kinematics.tree.links)
        return [RigidBody(body.mass, body.c, body.inertia) for body in bodies]

    def inertia_of_joints(self, columns: Sequence[Sparse]) -> SX:
        """L^T M L of the rotors and of the masses of lines alone, for some columns of L."""
        # Masses, and the rows of their rates in the rates of the tree.
        masses_and_rows: list[tuple[SX, Sparse]] = []
        for i, armature in self._parameters.of_joints("armature", self._p).items():
            masses_and_rows.append((armature, {i: SX(1)}))
        for k, mass in self._parameters.line_masses(self._p).items():
            masses_and_rows.append((mass, self.lines[k].row))
        inertia = SX(len(columns), len(columns))
        for mass, row in masses_and_rows:
            speeds = [SX(total(x * L[i] for i, x in row.items() if i in L)) for L in columns]
            row_L = ca.sparsify(ca.vertcat(*speeds))
            inertia += mass * (row_L @ row_L.T)
        return inertia

    def coriolis_forces(self, v: Sparse, L: Sparse, L_dot: Sparse) -> Sparse:
        """The term of Eq. (94) that T^T multiplies: M t_dot + Omega M t, t and t_dot of L."""
        wrenches = list[SX]()
        motions = self._kinematics.motions(v, L_dot, v_k=L)
        for link, x in zip(self._kinematics.tree.links, motions, strict=True):
            body = self._bodies[link.body]
            # The paper's term is omega x (I_c omega_k), about the mass centre at r. About the
            # origin m r x (omega_k x (omega x r)) = m (r . omega_k) (r x omega) is added. With the
            # inertia I = I_c + m (r^2 E - r r^T), the sum of both is omega x ((I - m r^2 E)
            # omega_k).
            inner = body.inertia - body.polar * SX.eye(3)
            moment = body.inertia @ x.alpha + ca.cross(x.omega, inner @ x.omega_k)
            force = body.mass * x.a + x.U @ body.c
            wrenches.append(ca.vertcat(force, moment + ca.cross(body.c, x.a)))
        forces = add(self._kinematics.joint_forces(wrenches), self._rotors(L_dot))
        return add(forces, self.along_lines(self._coriolis_pulls(v, L, L_dot)))

    def _coriolis_pulls(self, v: Sparse, L: Sparse, L_dot: Sparse) -> list[Any]:
        """Masses of lines times J L_dot + J_dot L, with the rates J v of the lengths."""
        pulls: list[Any] = [SX(0)] * len(self.lines)
        for k, mass in self._parameters.line_masses(self._p).items():
            row = self.lines[k].row
            entries = ca.vertcat(*(SX(x) for x in row.values()))
            rates = ca.jtimes(entries, self._kinematics.q, self._kinematics.q_rates(v))
            row_dot = dict(zip(row, ca.vertsplit(rates), strict=True))
            terms = [row[i] * L_dot[i] for i in row if i in L_dot]
            terms += [row_dot[i] * L[i] for i in row if i in L]
            pulls[k] = mass * total(terms)
        return pulls


def _moment(x: LinkMotion, J: SX) -> SX:
    """Inertial moment about the origin of a link whose origin does not accelerate.

    It is I alpha + omega x (I omega) = 2 axial(U J).
    """
    components = [component for component in ca.vertsplit(x.omega) if not component.is_zero()]
    if len(components) == 1:  # then the first form takes fewer operations
        inertia = ca.trace(J) * SX.eye(3) - J
        return inertia @ x.alpha + ca.cross(x.omega, inertia @ x.omega)
    UJ = x.U @ J
    return ca.vertcat(UJ[2, 1] - UJ[1, 2], UJ[0, 2] - UJ[2, 0], UJ[1, 0] - UJ[0, 1])


def _sums(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Sums of numbers of lines, line by line."""
    return [x + y for x, y in zip(a, b, strict=True)]
