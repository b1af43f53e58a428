# SPDX-License-Identifier: BSD-2-Clause
"""Forces and mass matrix of the tree without closures, on CasADi's symbols.

`TreeDynamics` computes the forces along the rates of the tree that a motion *needs*: what motors
and closures have to supply. So a spring, for instance, contributes the opposite of the force that
it exerts.

A link has the angular velocity omega, the angular acceleration alpha, and the acceleration a of its
origin. A point at r from the origin has the acceleration a + U r with
U = skew(alpha) + skew(omega) skew(omega); see `link_kinematics`. Let a body have the mass m, the
first moment c (the integral of r dm) and the second moments J (the integral of r r^T dm). The force
and the moment about the origin that it needs are the integrals of a + U r and of r x (a + U r),

    m a + U c,   c x a + 2 axial(U J),

Eqs. (63)-(68). The axial vector w of a matrix A belongs to its skew part: skew(w) = (A - A^T) / 2.
"""

from collections.abc import Iterable, Mapping, Sequence
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
    """A rigid body, or several bodies welded together, in the frame of a link.

    The defaults are those of a link without a body.
    """

    mass: SX = SX(1, 1)
    #: First moment, the integral of r dm.
    c: SX = SX(3, 1)
    #: Second moments, the integral of r r^T dm.
    J: SX = SX(3, 3)
    #: Mass and first moment of each of the bodies that are welded together.
    parts: tuple[tuple[SX, SX], ...] = ()

    @classmethod
    def single(cls, mass: SX, c: SX, J: SX) -> "Body":
        """A body that is welded to no other."""
        return cls(mass, c, J, ((mass, c),))

    @property
    def inertia(self) -> SX:
        """Inertia about the origin."""
        return ca.trace(self.J) * SX.eye(3) - self.J

    @property
    def polar(self) -> SX:
        """The sum of m r^2 over the parts, with the distance r of the mass centre from the origin.

        `TreeDynamics.coriolis_forces` needs it. As c = m r, each term is c^2 / m.
        """
        polar = SX(1, 1)
        for mass, c in self.parts:
            polar = ca.sumsqr(c) / mass + polar
        return polar

    def transformed(self, R: SX, p: SX) -> "Body":
        """The body in another frame, in which its frame has the orientation R and the origin p.

        A point r of the body is at R r + p there.
        """
        Rc = R @ self.c
        J = R @ self.J @ R.T + Rc @ p.T + p @ Rc.T + self.mass * p @ p.T
        return Body(
            mass=self.mass,
            c=Rc + self.mass * p,
            J=J,
            parts=tuple((mass, R @ c + mass * p) for mass, c in self.parts),
        )

    def welded_to(self, other: "Body") -> "Body":
        """Both bodies together, in the same frame."""
        return Body(
            mass=self.mass + other.mass,
            c=self.c + other.c,
            J=self.J + other.J,
            parts=other.parts + self.parts,
        )


class SpatialInertia(NamedTuple):
    """Spatial inertia, a symmetric 6 x 6 matrix, of one or more bodies in the frame of a link."""

    mass: SX
    #: First moment, the integral of r dm.
    c: SX
    #: Inertia about the origin.
    inertia: SX

    def momentum(self, twist: SX) -> SX:
        """The spatial inertia times a twist [u; omega], in the form [force; moment]."""
        u, omega = twist[:3], twist[3:]
        return ca.vertcat(
            self.mass * u + ca.cross(omega, self.c), self.inertia @ omega + ca.cross(self.c, u)
        )

    def joined_to(self, parent: "SpatialInertia", R: SX, p: SX) -> "SpatialInertia":
        """The sum of the parent's inertia and this one, in the frame of the parent.

        The frame of this inertia has the orientation R and the origin p in the parent's frame. A
        point r is at R r + p there. With c = R times the first moment, the inertia about the
        parent's origin gets the term

            (2 c + m p) . p E - (c p^T + p c^T + m p p^T),

        which is 2 (h . p) E - (h p^T + p h^T) with h = c + m p / 2.
        """
        c = R @ self.c
        h = c + self.mass * p / 2
        inertia = R @ self.inertia @ R.T - h @ p.T - p @ h.T
        inertia += ca.dot(2 * p, h) * SX.eye(3)
        inertia = ca.triu2symm(ca.triu(inertia))  # computes no entry twice
        return SpatialInertia(
            mass=parent.mass + self.mass,
            c=parent.c + c + self.mass * p,
            inertia=parent.inertia + inertia,
        )


class Line(NamedTuple):
    """A line between two frames along which a force acts."""

    length: SX
    #: A row of `closure_rows` for the length; its Phi v is the rate of the length.
    row_of_length: Row
    stiffness: SX
    #: Rest length.
    rest: SX
    damping: SX
    preload: SX

    @property
    def row(self) -> Sparse:
        """Phi of `row_of_length`: the rate of the length at a unit of each rate of the tree."""
        return self.row_of_length.Phi


class TreeDynamics:
    """Dynamics of a tree.

    A *pull* is a force along a line that draws its ends together. Lists of pulls have an entry for
    each line.

    Args:
        mechanism: The mechanism.
        kinematics: The motion of its links.
        parameters: The order of the symbolic parameters.
        p: Symbols of the parameters.
        loads: Symbols of external wrenches, as in `Equations`; empty without loads.
        smooth: Whether Coulomb friction is tanh(v / sign_width) instead of the sign.
        welded: Whether bodies that closures weld together are computed as one.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        kinematics: Kinematics,
        parameters: SymbolicParameters,
        p: SX,
        loads: SX,
        smooth: bool,
        welded: bool,
    ) -> None:
        self._mechanism = mechanism
        self._kinematics = kinematics
        self._parameters = parameters
        self._p = p
        self._loads = loads
        self._smooth = smooth
        self._welded = welded

    # --- bodies -----------------------------------------------------------------------------------

    @cached_property
    def _bodies(self) -> list[Body]:
        """Bodies by Pinocchio's joints. Of bodies that are welded together one has all inertia."""
        bodies = self._single_bodies()
        if self._welded:
            self._weld(bodies)
        return bodies

    def _single_bodies(self) -> list[Body]:
        """The body of each of Pinocchio's joints by itself; index 0 is the ground, without mass."""
        model = self._mechanism.model
        bodies = [Body()] * model.njoints
        for i in range(1, model.njoints):
            numbers = self._parameters.body(self._p, i)
            if numbers is not None:
                bodies[i] = Body.single(*numbers)
        return bodies

    def _weld(self, bodies: list[Body]) -> None:
        """Change `bodies`: for each closure that welds a body j to a body i, body i gets both.

        A body that is welded to the ground, i = 0, stays by itself.
        """
        model = self._mechanism.model
        for closure in self._mechanism.closures:
            if not (isinstance(closure, Closure) and all(closure.held)):
                continue
            a = frame_named(model, closure.frame_a)
            b = frame_named(model, closure.frame_b)
            i = a.parentJoint
            j = b.parentJoint
            if i and not is_zero(bodies[j].mass):
                # Body j in the frame of body i, because both closure frames coincide.
                R = sx(a.placement.rotation @ b.placement.rotation.T)
                p = sx(a.placement.translation) - R @ sx(b.placement.translation)
                bodies[i] = bodies[j].transformed(R, p).welded_to(bodies[i])
                bodies[j] = Body()

    # --- Newton and Euler -------------------------------------------------------------------------

    def forces(
        self,
        v: Sparse,
        dv: Sparse,
        *,
        loads: bool = True,
        weight: bool = True,
        additional: Mapping[int, SX] | None = None,
    ) -> Sparse:
        """Forces along the rates by Newton and Euler, without friction and springs.

        Args:
            v: Rates of the tree.
            dv: Accelerations of the tree.
            loads: Whether the external wrenches act.
            weight: Whether gravity acts.
            additional: Wrenches that links need besides, by link.
        """
        wrenches = self.wrenches(v, dv, loads=loads, weight=weight)
        for i, wrench in (additional or {}).items():
            wrenches[i] = wrenches[i] + wrench
        forces = add(self._kinematics.joint_forces(wrenches), self._rotors(dv))
        return add(forces, self.along_lines(self.inertial_pulls(v, dv)))

    def wrenches(
        self, v: Sparse, dv: Sparse, *, loads: bool = True, weight: bool = True
    ) -> list[SX]:
        """The wrench that each link needs from joints and closures.

        It is [force; moment] about the origin of the link, in its axes: what the acceleration of
        the link needs, less the weight and the external wrench, which act on the link anyway.
        """
        gravity = self._p[GRAVITY] if weight else None
        wrenches = list[SX]()
        # With gravity, the accelerations a contain -g, so that m a contains the opposite weight.
        motions = self._kinematics.motions(v, dv, gravity)
        for link, motion in zip(self._kinematics.tree.links, motions, strict=True):
            body = self._bodies[link.body]
            force = body.mass * motion.a + motion.U @ body.c
            moment = _moment(motion, body.J) + ca.cross(body.c, motion.a)
            wrench = ca.vertcat(force, moment)
            if weight and link.body in self._weightless:
                # No gravity acts on the weightless part of the body, so nothing has to carry it.
                wrench = wrench + self._weight_of_weightless(link.body)
            if loads and link.body and self._loads.numel():
                wrench = wrench - self._load(link.body)
            wrenches.append(wrench)
        return wrenches

    def _rotors(self, dv: Sparse) -> Sparse:
        """Forces that the inertia of rotors needs."""
        armature = self._parameters.of_joints("armature", self._p)
        return {i: x * dv[i] for i, x in armature.items() if i in dv}

    def _load(self, body: int) -> SX:
        """External force and moment about the origin of a link, axes of the link.

        The symbols are about the mass centre of the body, in base axes.
        """
        first = 6 * (body - 1)  # the ground has no load
        force, moment = ca.vertsplit(self._loads[first : first + 6], 3)
        R, _ = self._kinematics.pose(0, self._kinematics.tree.link_of[body])
        force = R.T @ force
        numbers = self._parameters.body(self._p, body)
        if numbers is not None:
            mass, c, _ = numbers
            center = c / mass
        else:
            # A body without mass has no symbols. Pinocchio stores a mass centre for it too.
            center = sx(self._mechanism.model.inertias[body].lever)
        return ca.vertcat(force, R.T @ moment + ca.cross(center, force))

    @cached_property
    def _weightless(self) -> dict[int, tuple[SX, SX]]:
        """Mass and first moment of the weightless part of bodies, by Pinocchio's joints.

        Gravity acts only on a share of some bodies (`weight_shares`); the rest is weightless. Other
        bodies are left out.
        """
        weightless = dict[int, tuple[SX, SX]]()
        weight_shares = self._mechanism.weight_shares
        if weight_shares is not None:
            for k in weight_shares.bodies:
                body = k + 1  # Pinocchio's joint 0 is the universe, which has no body
                numbers = self._parameters.body(self._p, body)
                if numbers is not None:
                    mass, c, _ = numbers
                    W = sx(weight_shares.weightless_factor(k))  # (4, 4), for [mass; c]
                    part = W @ ca.vertcat(mass, c)
                    weightless[body] = part[0], part[1:]
        return weightless

    def _weight_of_weightless(self, body: int) -> SX:
        """The weight that the weightless part of a body would have.

        It is [force; moment] about the origin of the link, in its axes.
        """
        mass, c = self._weightless[body]
        R, _ = self._kinematics.pose(0, self._kinematics.tree.link_of[body])
        g = R.T @ self._p[GRAVITY]
        return ca.vertcat(mass * g, ca.cross(c, g))

    # --- friction, springs and lines --------------------------------------------------------------

    def friction(self, v: Sparse) -> Sparse:
        """Forces that friction of joints, and friction and dampers of lines need.

        A slack cable loses the pull of its damper, but not its dry friction.
        """
        viscous = self._parameters.of_joints("viscous", self._p)
        coulomb = self._parameters.of_joints("coulomb", self._p)
        signs = {i: self._sign(x) for i, x in v.items()}
        tau = {i: D * v[i] for i, D in viscous.items() if i in v}
        tau = add(tau, {i: F * signs[i] for i, F in coulomb.items() if i in v})
        of_dampers = self._where_taut(self._damper_pulls(v), v)
        of_lines = _sums(of_dampers, self._friction_pulls(v))
        return add(tau, self.along_lines(of_lines))

    def _sign(self, rate: Any) -> Any:
        """The sign of a rate, or its smooth approximation, for Coulomb friction."""
        return ca.tanh(rate / self._p[SIGN_WIDTH]) if self._smooth else ca.sign(rate)

    def springs(self, v: Sparse) -> Sparse:
        """Forces that springs of joints and of lines need.

        The rates v determine which cables are slack.
        """
        stiffness = self._parameters.of_joints("stiffness", self._p)
        rest = self._parameters.of_joints("spring_reference", self._p)
        deflections = self._kinematics.difference(rest)
        tau = {k: factor * deflections[k] for k, factor in stiffness.items()}
        return add(tau, self.along_lines(self._where_taut(self._spring_pulls, v)))

    def pulls(self, v: Sparse) -> list[Any]:
        """Pull along each line by its spring, damper and dry friction, without motors."""
        of_springs_and_dampers = _sums(self._spring_pulls, self._damper_pulls(v))
        return _sums(self._where_taut(of_springs_and_dampers, v), self._friction_pulls(v))

    def _where_taut(self, pulls: list[Any], v: Sparse) -> list[Any]:
        """The pulls, with zero for slack cables.

        A cable is a line that only pulls. It is slack if its spring and its damper would push.
        """
        forces = self._mechanism.lines.forces
        spring_pulls = self._spring_pulls
        damper_pulls = self._damper_pulls(v)
        result = []
        for k, pull in enumerate(pulls):
            if forces[k].pulls_only:
                is_slack = spring_pulls[k] + damper_pulls[k] <= 0  # 1 or 0
                result.append((1 - is_slack) * pull)
            else:
                result.append(pull)
        return result

    @property
    def _spring_pulls(self) -> list[Any]:
        """Pull of the spring and the preload along each line."""
        return [line.preload + line.stiffness * (line.length - line.rest) for line in self.lines]

    def _damper_pulls(self, v: Sparse) -> list[Any]:
        """Pull of the damper along each line."""
        rates = self._line_rates(v)
        return [line.damping * rate for line, rate in zip(self.lines, rates, strict=True)]

    def _friction_pulls(self, v: Sparse) -> list[Any]:
        """Pull of dry friction along each line."""
        pulls: list[Any] = [SX(0)] * len(self.lines)
        rates = self._line_rates(v)
        for k, force in self._parameters.line_coulomb(self._p).items():
            pulls[k] = force * self._sign(SX(rates[k]))
        return pulls

    def _line_rates(self, v: Sparse) -> list[Any]:
        """Rate of the length of each line."""
        return [
            total(entry * v[i] for i, entry in line.row.items() if i in v) for line in self.lines
        ]

    def inertial_pulls(self, v: Sparse, dv: Sparse) -> list[Any]:
        """Mass times second derivative of the length, for each line that has a mass.

        Such a mass moves with the length of the line, as the oil of a cylinder does.
        """
        pulls: list[Any] = [SX(0)] * len(self.lines)
        for k, mass in self._parameters.line_masses(self._p).items():
            pulls[k] = mass * self.lines[k].row_of_length.acceleration(v, dv)
        return pulls

    def along_lines(self, pulls: Iterable[Any]) -> Sparse:
        """Forces along the rates that the pulls need: the sum of each line's row times its pull."""
        tau: Sparse = {}
        for line, pull in zip(self.lines, pulls, strict=True):
            if not is_zero(pull):
                tau = add(tau, {i: entry * pull for i, entry in line.row.items()})
        return tau

    @cached_property
    def lines(self) -> list[Line]:
        """All lines along which forces act."""
        model = self._mechanism.model
        forces = self._mechanism.lines.forces
        numbers = self._parameters.of_lines(self._p)
        lines = []
        for force, (stiffness, rest, damping, preload) in zip(forces, numbers, strict=True):
            length, row = length_and_row(self._kinematics, model, force.frame_a, force.frame_b)
            lines.append(Line(length, row, stiffness, rest, damping, preload))
        return lines

    # --- energy -----------------------------------------------------------------------------------

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
            if link.body in self._weightless:
                mass, c = self._weightless[link.body]
                energies.append(ca.dot(gravity, mass * p + R @ c))
        rest = self._parameters.of_joints("spring_reference", self._p)
        deflections = self._kinematics.difference(rest)
        stiffness = self._parameters.of_joints("stiffness", self._p)
        energies += [factor * deflections[k] ** 2 / 2 for k, factor in stiffness.items()]
        for line, force in zip(self.lines, self._mechanism.lines.forces, strict=True):
            stretch = line.length - line.rest
            if force.pulls_only and force.stiffness:
                # A slack cable has the energy of the stretch -preload / stiffness, at which its
                # pull becomes zero.
                is_slack = line.preload + line.stiffness * stretch <= 0  # 1 or 0
                stretch = stretch - is_slack * (stretch + line.preload / line.stiffness)
            energies.append(line.stiffness * stretch**2 / 2 + line.preload * stretch)
        return total(energies)

    # --- inertia ----------------------------------------------------------------------------------

    @cached_property
    def whole_inertia(self) -> Any:
        """The size of the whole robot's inertia, [kg m^2]: `dynamics.whole_inertia` on symbols."""
        length = self._mechanism.length
        scale = self._mechanism.rate_scale
        terms: list[Any] = []
        for i in self._parameters.bodies:
            numbers = self._parameters.body(self._p, i)
            if numbers is not None:
                mass, _, J = numbers
                # The trace of a body's inertia about the origin is 2 trace(J).
                terms.append(mass * length**2 + 2 * ca.trace(J))
        for i, armature in self._parameters.of_joints("armature", self._p).items():
            terms.append(armature * float(scale[i] ** 2))
        for mass in self._parameters.line_masses(self._p).values():
            terms.append(mass * length**2)
        return total(terms)

    @cached_property
    def inertia(self) -> dict[tuple[int, int], Any]:
        """Upper triangle of the tree's mass matrix, by pairs of rates."""
        return self.composite_inertia({})

    def composite_inertia(
        self, loops: Mapping[int, Mapping[int, Sparse]]
    ) -> dict[tuple[int, int], Any]:
        """Upper triangle of a matrix M with the same L^T M L as the tree's mass matrix.

        This is the composite-rigid-body algorithm. From the tips to the ground, each link collects
        two things: the inertia of all that it carries; and for each rate k of these links the
        wrench that they need for a unit acceleration of k. The entry M_jk for a rate j of the link
        is the component of this wrench along the axis of j.

        Without `loops`, M is the mass matrix itself. With `loops`, M has fewer entries. Let a loop
        hang on link i, with the dependent rates d, and let j be the rate of a joint between the
        ground and link i. The entry M_jd enters L^T M L only by the products M_jd L_dk, one for
        each coordinate k. They can be added to M_jk, because row k of L has the single entry
        L_kk = 1. This is done for all j at once: at link i the wrench of k gets L_dk times the
        wrench of d, and the wrench of d is dropped.

        Args:
            loops: {i: {d: {k: L_dk}}}: the rows of L of the dependent rates d, by the link i on
                which their loops hang.
        """
        links = self._kinematics.tree.links
        placements = self._kinematics.placements
        composites = self.link_inertias
        wrenches: list[Sparse] = [{} for _ in links]  # by link, then by the rates behind it
        M: dict[tuple[int, int], Any] = {}
        for i in range(len(links) - 1, 0, -1):
            link = links[i]
            behind = dict(wrenches[i])
            for d, row in loops.get(i, {}).items():
                wrench = behind.pop(d, SX(6, 1))
                behind = add(behind, {k: factor * wrench for k, factor in row.items()})
            of_link = Sparse()  # by the rates of the link itself
            for k, S in zip(link.v, link.S.T, strict=True):
                of_link[k] = composites[i].momentum(sx(S))

            for j, S in zip(link.v, link.S.T, strict=True):
                for k, wrench in behind.items():
                    entry = ca.dot(sx(S), wrench)
                    # j = k if a mimic joint is behind the joint that it follows, whose rate it has.
                    # Then M_jk and M_kj both are part of the diagonal entry.
                    _add_entry(M, j, k, 2 * entry if j == k else entry)
                for k, wrench in of_link.items():
                    if j <= k:
                        _add_entry(M, j, k, ca.dot(sx(S), wrench))

            # The parent carries this link. The ground, link 0, needs no wrenches.
            R, p = placements[i]
            if link.parent:
                for k, wrench in add(behind, of_link).items():
                    force = R @ wrench[:3]
                    moment = R @ wrench[3:] + ca.cross(p, force)
                    at_parent = ca.vertcat(force, moment)
                    wrenches[link.parent] = add(wrenches[link.parent], {k: at_parent})
            composites[link.parent] = composites[i].joined_to(composites[link.parent], R, p)

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
    def link_inertias(self) -> list[SpatialInertia]:
        """Inertia of each link by itself."""
        bodies = (self._bodies[link.body] for link in self._kinematics.tree.links)
        return [SpatialInertia(body.mass, body.c, body.inertia) for body in bodies]

    def inertia_of_rotors_and_lines(self, columns: Sequence[Sparse]) -> SX:
        """L^T M L of the rotors and of the masses of lines alone, for some columns of L."""
        # Each mass, and the row that gives its velocity from the rates of the tree.
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
        """Forces along the rates of the tree for column k of the Coriolis matrix, Eq. (94).

        Column k of M T_dot + Omega M T consists of wrenches on the bodies. They need these forces.
        For a body with the mass centre at r and the inertia I_c about it, the force and the moment
        about the mass centre are

            m a + U c,   I_c alpha + omega x (I_c omega_k).

        Here a, alpha, omega_k and U are those of `LinkMotion` for the rates v_k = L, and c = m r.
        The moment about the origin is larger by the moment of the force,

            r x (m a + U c) = c x a + m r x (alpha x r) + m r x (omega_k x (omega x r)).

        The last term is m (r . omega_k) (r x omega). With the inertia about the origin,
        I = I_c + m (r^2 E - r r^T), the sum of both moments is

            c x a + I alpha + omega x ((I - m r^2 E) omega_k).

        Bodies that are welded together contribute the sum of their terms.

        Args:
            v: Rates of the tree.
            L: Column k of L.
            L_dot: Column k of L_dot.
        """
        wrenches = list[SX]()
        motions = self._kinematics.motions(v, L_dot, v_k=L)
        for link, motion in zip(self._kinematics.tree.links, motions, strict=True):
            body = self._bodies[link.body]
            force = body.mass * motion.a + motion.U @ body.c
            inner = body.inertia - body.polar * SX.eye(3)  # I - m r^2 E
            moment = body.inertia @ motion.alpha + ca.cross(motion.omega, inner @ motion.omega_k)
            wrenches.append(ca.vertcat(force, moment + ca.cross(body.c, motion.a)))
        forces = add(self._kinematics.joint_forces(wrenches), self._rotors(L_dot))
        return add(forces, self.along_lines(self._coriolis_pulls(v, L, L_dot)))

    def _coriolis_pulls(self, v: Sparse, L: Sparse, L_dot: Sparse) -> list[Any]:
        """Masses of lines times row L_dot + row_dot L, where row v is the rate of the length."""
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


def _moment(motion: LinkMotion, J: SX) -> SX:
    """The part of a body's inertial moment about the origin that does not contain a.

    It is I alpha + omega x (I omega) = 2 axial(U J), with the inertia I = trace(J) E - J.
    """
    omega = motion.omega
    components = [component for component in ca.vertsplit(omega) if not component.is_zero()]
    if len(components) == 1:  # then the first form takes fewer operations
        inertia = ca.trace(J) * SX.eye(3) - J
        return inertia @ motion.alpha + ca.cross(omega, inertia @ omega)
    UJ = motion.U @ J
    return ca.vertcat(UJ[2, 1] - UJ[1, 2], UJ[0, 2] - UJ[2, 0], UJ[1, 0] - UJ[0, 1])


def _add_entry(M: dict[tuple[int, int], Any], j: int, k: int, value: SX) -> None:
    """Add to the entry of the rates j and k of an upper triangle, unless the value is zero."""
    if not is_zero(value):
        pair = min(j, k), max(j, k)
        M[pair] = M.get(pair, 0) + value


def _sums(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Sums of numbers of lines, line by line."""
    return [x + y for x, y in zip(a, b, strict=True)]
