# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of a described robot in as many digits as one likes, by mpmath alone.

Newton-Euler body by body in base axes, closures differentiated by hand, and the closures' forces
as Lagrange multipliers. Nothing of `sst_pin`, Pinocchio or NumPy comes in. `exact_algebra` says
what vectors, placements and twists are.
"""

from dataclasses import dataclass

from mpmath import matrix, mpf, sqrt

from exact_algebra import (
    UNIT,
    ZERO,
    add,
    composed,
    cross,
    dot,
    independent_rows,
    minus,
    placement,
    product,
    rate_of_twist,
    rotation_of,
    scaled,
    solve,
    sum_of_twists,
    times,
    turn,
    vector,
)

#: The largest residual of closed loops.
CLOSED = mpf("1e-50")
#: Numbers of coordinates and of rates of each kind of joint.
SIZES = {"revolute": (1, 1), "prismatic": (1, 1), "universal": (2, 2)}
SIZES |= {"spherical": (4, 3), "free-flyer": (7, 6)}


@dataclass
class Body:
    """A body in motion, in base axes.

    Attributes:
        at: Its placement.
        V: Its twist.
        A: The rate of its twist.
        columns: Its twists for a rate of 1 of each rate of its joint.
        mass_centre: A point.
    """

    at: tuple
    V: tuple
    A: tuple
    columns: list
    mass_centre: list


@dataclass
class FrameMotion:
    """A frame that moves with a body, in base axes.

    Attributes:
        at: Its placement.
        linear: Velocities of its origin for a rate of 1 of each joint rate, nv vectors.
        angular: Its angular velocities for a rate of 1 of each joint rate, nv vectors.
        acceleration: The acceleration of its origin.
        omega: Its angular velocity.
        alpha: Its angular acceleration.
    """

    at: tuple
    linear: list
    angular: list
    acceleration: list
    omega: list
    alpha: list


@dataclass
class Line:
    """A spring and damper along a line between two frames, each (body, placement on it)."""

    frame_a: tuple
    frame_b: tuple
    stiffness: mpf
    rest_length: mpf
    damping: mpf
    preload: mpf


@dataclass
class ClosureRows:
    """The equations of all closures.

    Attributes:
        residual: Their values.
        J: Their derivatives by the joint rates, rows of nv numbers.
        drift: Their second derivatives by time without J dv.
    """

    residual: list
    J: list
    drift: list


class ExactRobot:
    """A described robot.

    Args:
        record: What `describe` gives.
    """

    def __init__(self, record):
        self.gravity = vector(record["gravity"])
        self.joints = record["joints"]
        self.index = {joint["name"]: i for i, joint in enumerate(self.joints)}
        self.parents = [self.index.get(joint["parent"], -1) for joint in self.joints]
        self.placements = [placement(joint["placement"]) for joint in self.joints]
        self.axes = [[vector(axis) for axis in joint.get("axes", [])] for joint in self.joints]
        # Where the numbers of each joint begin in q and v.
        self.start_q = [0]
        self.start_v = [0]
        for joint in self.joints:
            nq, nv = SIZES[joint["type"]]
            self.start_q.append(self.start_q[-1] + nq)
            self.start_v.append(self.start_v[-1] + nv)
        self.nq = self.start_q[-1]
        self.nv = self.start_v[-1]
        self.closures = [(c["kind"], *self._ends(c)) for c in record["closures"]]
        numbers = ("stiffness", "rest_length", "damping", "preload")
        self.lines = []
        for line in record["forces"]:
            frame_a, frame_b = self._ends(line)
            values = {name: mpf(repr(line[name])) for name in numbers}
            self.lines.append(Line(frame_a, frame_b, **values))
        self.coordinates = self._rates_of(record["coordinates"])
        self.motors = self._rates_of(record["motors"])
        #: The dependent rates.
        self.others = [i for i in range(self.nv) if i not in self.coordinates]

    def _ends(self, pair):
        """Two frames: for each the number of its body, -1 for the base, and its placement there."""
        ends = []
        for name in ("frame_a", "frame_b"):
            frame = pair[name]
            ends.append((self.index.get(frame["joint"], -1), placement(frame["placement"])))
        return ends

    def _rates_of(self, names):
        """Indices in v of the rates of joints."""
        rates = []
        for name in names:
            i = self.index[name]
            rates += range(self.start_v[i], self.start_v[i + 1])
        return rates

    def _chain(self, body):
        """The body and those that carry it."""
        while body >= 0:
            yield body
            body = self.parents[body]

    # --- motion of the tree -----------------------------------------------------------------

    def bodies(self, q, v, dv):
        """All bodies, at q with joint rates v and accelerations dv."""
        bodies = []
        base = Body((UNIT, ZERO), (ZERO, ZERO), (ZERO, ZERO), [], ZERO)
        for i, joint in enumerate(self.joints):
            carrier = bodies[self.parents[i]] if self.parents[i] >= 0 else base
            q_of_joint = q[self.start_q[i] : self.start_q[i + 1]]
            rates = v[self.start_v[i] : self.start_v[i + 1]]
            accelerations = dv[self.start_v[i] : self.start_v[i + 1]]
            at = composed(carrier.at, self.placements[i])
            if joint["type"] in ("spherical", "free-flyer"):
                at, columns = self._free_joint(joint["type"], at, q_of_joint)
                V = sum_of_twists([carrier.V, *columns], [1, *rates])
                # The twists of the rates are fixed in the body.
                drifts = [rate_of_twist(V, S) for S in columns]
            else:
                # One axis after the other, each fixed in what the axes before it move.
                columns = []
                drifts = []
                V = carrier.V
                for axis, value, rate in zip(self.axes[i], q_of_joint, rates, strict=True):
                    at, S = self._single_axis(joint["type"], at, axis, value)
                    columns.append(S)
                    drifts.append(rate_of_twist(V, S))
                    V = sum_of_twists([V, S], [1, rate])
            A = sum_of_twists([carrier.A, *columns, *drifts], [1, *accelerations, *rates])
            _, mass_centre = composed(at, (UNIT, vector(joint["mass_centre"])))
            bodies.append(Body(at, V, A, columns, mass_centre))
        return bodies

    @staticmethod
    def _free_joint(kind, at, q):
        """The placement of the body of a ball joint or free-flyer, and the twists of its rates.

        The rates are velocities and angular velocities in axes of the body.
        """
        translation = q[:3] if kind == "free-flyer" else ZERO
        R, p = composed(at, (rotation_of(q[-4:]), translation))
        body_axes = [list(axis) for axis in zip(*R, strict=True)]
        columns = []
        if kind == "free-flyer":
            columns += [(ZERO, axis) for axis in body_axes]
        columns += [(axis, cross(p, axis)) for axis in body_axes]
        return (R, p), columns

    @staticmethod
    def _single_axis(kind, at, axis, value):
        """The placement after a slide along or a turn about an axis, and the twist of its rate."""
        R, p = at
        axis_in_base = times(R, axis)
        if kind == "prismatic":
            return (R, add(p, scaled(value, axis_in_base))), (ZERO, axis_in_base)
        return (product(R, turn(axis, value)), p), (axis_in_base, cross(p, axis_in_base))

    def line_forces(self, bodies, v):
        """Forces in all joints by which springs and dampers along lines pull, (nv,)."""
        forces = [mpf(0)] * self.nv
        for line in self.lines:
            a = self._frame_motion(bodies, *line.frame_a)
            b = self._frame_motion(bodies, *line.frame_b)
            a_to_b = minus(b.at[1], a.at[1])
            length = sqrt(dot(a_to_b, a_to_b))
            # The rate of the length for each joint rate.
            length_rates = []
            for velocity_a, velocity_b in zip(a.linear, b.linear, strict=True):
                length_rates.append(dot(a_to_b, minus(velocity_b, velocity_a)) / length)
            spring = line.stiffness * (length - line.rest_length)
            tension = line.preload + spring + line.damping * dot(length_rates, v)
            forces = [f - tension * rate for f, rate in zip(forces, length_rates, strict=True)]
        return forces

    def tree_forces(self, bodies, gravity):
        """Forces in all joints that the motion of the tree takes, (nv,)."""
        forces = [mpf(0)] * self.nv
        for i, (joint, body) in enumerate(zip(self.joints, bodies, strict=True)):
            omega, v = body.V
            alpha, a = body.A
            c = body.mass_centre
            # Newton and Euler about the mass centre.
            velocity = add(v, cross(omega, c))
            acceleration = add(a, cross(alpha, c), cross(omega, velocity))
            f = scaled(mpf(repr(joint["mass"])), minus(acceleration, gravity))
            n = add(
                self._inertia_times(joint, body, alpha),
                cross(omega, self._inertia_times(joint, body, omega)),
            )
            moment = add(n, cross(c, f))  # about the base's origin
            for j in self._chain(i):
                for k, (axis, m) in enumerate(bodies[j].columns):
                    forces[self.start_v[j] + k] += dot(axis, moment) + dot(m, f)
        return forces

    def _inertia_times(self, joint, body, u):
        """The body's inertia about its mass centre times a vector in base axes."""
        xx, yy, zz, xy, xz, yz = vector(joint["inertia"])
        inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        R, _ = body.at
        R_transposed = list(zip(*R, strict=True))
        return times(R, times(inertia, times(R_transposed, u)))

    def energies(self, bodies):
        """Kinetic energy, and potential energy, zero with all masses at the origin."""
        kinetic = mpf(0)
        potential = mpf(0)
        for joint, body in zip(self.joints, bodies, strict=True):
            omega, v = body.V
            mass = mpf(repr(joint["mass"]))
            velocity = add(v, cross(omega, body.mass_centre))
            kinetic += mass * dot(velocity, velocity) / 2
            kinetic += dot(omega, self._inertia_times(joint, body, omega)) / 2
            potential -= mass * dot(self.gravity, body.mass_centre)
        for line in self.lines:
            a = self._frame_motion(bodies, *line.frame_a)
            b = self._frame_motion(bodies, *line.frame_b)
            b_to_a = minus(a.at[1], b.at[1])
            extension = sqrt(dot(b_to_a, b_to_a)) - line.rest_length
            potential += line.stiffness * extension**2 / 2 + line.preload * extension
        return kinetic, potential

    # --- closures ---------------------------------------------------------------------------

    def rows(self, bodies):
        """The equations of all closures; their drift is that of bodies with dv = 0."""
        rows = ClosureRows([], [], [])
        for kind, frame_a, frame_b in self.closures:
            a = self._frame_motion(bodies, *frame_a)
            b = self._frame_motion(bodies, *frame_b)
            self._add_position_rows(rows, a, b)
            if kind == "6d":
                self._add_weld_rows(rows, a, b)
            elif kind == "hinge":
                self._add_hinge_rows(rows, a, b)
            elif kind != "3d":
                raise ValueError(f"closure {kind}")
        return rows

    @staticmethod
    def _add_position_rows(rows, a, b):
        """The origins of A and B coincide."""
        differences = [minus(y, x) for x, y in zip(a.linear, b.linear, strict=True)]
        rows.residual += minus(b.at[1], a.at[1])
        rows.J += [[velocity[k] for velocity in differences] for k in range(3)]
        rows.drift += minus(b.acceleration, a.acceleration)

    @staticmethod
    def _add_weld_rows(rows, a, b):
        """The axes of A and B coincide: half the sum of their cross products is zero.

        Near zero this is the vector of the small rotation from A to B.
        """
        axes_a = zip(*a.at[0], strict=True)
        axes_b = zip(*b.at[0], strict=True)
        crosses = [cross(x, y) for x, y in zip(axes_a, axes_b, strict=True)]
        differences = [minus(y, x) for x, y in zip(a.angular, b.angular, strict=True)]
        rows.residual += scaled(mpf(1) / 2, add(*crosses))
        rows.J += [[omega[k] for omega in differences] for k in range(3)]
        rows.drift += minus(b.alpha, a.alpha)

    @staticmethod
    def _add_hinge_rows(rows, a, b):
        """The z axes are parallel: z_a x z_b has no component along the axes x and y of A."""
        x_a, y_a, z_a = (list(axis) for axis in zip(*a.at[0], strict=True))
        _, _, z_b = (list(axis) for axis in zip(*b.at[0], strict=True))
        small_rotation = cross(z_a, z_b)
        differences = [minus(y, x) for x, y in zip(a.angular, b.angular, strict=True)]
        omega = minus(b.omega, a.omega)
        alpha = minus(b.alpha, a.alpha)
        for axis in (x_a, y_a):
            rows.residual.append(dot(axis, small_rotation))
            rows.J.append([dot(axis, difference) for difference in differences])
            # The axis turns with A.
            rows.drift.append(dot(axis, alpha) + dot(cross(a.omega, axis), omega))

    def _frame_motion(self, bodies, body, local):
        """The motion of a frame at a placement on a body; -1 is the base."""
        linear = [ZERO] * self.nv
        angular = [ZERO] * self.nv
        if body < 0:
            return FrameMotion(local, linear, angular, acceleration=ZERO, omega=ZERO, alpha=ZERO)
        at = composed(bodies[body].at, local)
        _, p = at
        for j in self._chain(body):
            for k, (axis, m) in enumerate(bodies[j].columns):
                angular[self.start_v[j] + k] = axis
                linear[self.start_v[j] + k] = add(m, cross(axis, p))
        omega, v = bodies[body].V
        alpha, a = bodies[body].A
        velocity = add(v, cross(omega, p))
        acceleration = add(a, cross(alpha, p), cross(omega, velocity))
        return FrameMotion(at, linear, angular, acceleration, omega=omega, alpha=alpha)

    def moved_from(self, home, step):
        """A closed configuration: from a closed one along a motion of the coordinates."""
        zero = [mpf(0)] * self.nv
        J = self.rows(self.bodies(home, zero, zero)).J
        independent = independent_rows(J)
        rates = self._completed([J[r] for r in independent], step, [mpf(0)] * len(independent))
        q = self._stepped(home, rates)
        for _ in range(30):  # Newton's method, shortest steps
            rows = self.rows(self.bodies(q, zero, zero))
            if max(map(abs, rows.residual), default=0) < CLOSED:
                return q
            A = matrix([rows.J[r] for r in independent])
            step = A.T * solve(A * A.T, [-rows.residual[r] for r in independent])
            q = self._stepped(q, list(step))
        raise ArithmeticError(f"open by {max(map(abs, rows.residual))}")

    def _stepped(self, q, step):
        """q after a small step of all rates; quaternions to first order, then normalised."""
        q = list(q)
        for i, joint in enumerate(self.joints):
            start = self.start_q[i]
            rates = step[self.start_v[i] : self.start_v[i + 1]]
            if joint["type"] == "free-flyer":
                R = rotation_of(q[start + 3 : start + 7])
                q[start : start + 3] = add(q[start : start + 3], times(R, rates[:3]))
                start += 3
                rates = rates[3:]
            if joint["type"] in ("spherical", "free-flyer"):
                x, y, z, w = q[start : start + 4]
                u = [x, y, z]
                half = scaled(mpf(1) / 2, rates)
                q[start : start + 3] = add(u, scaled(w, half), cross(u, half))
                q[start + 3] = w - dot(u, half)
            else:
                for k, rate in enumerate(rates):
                    q[start + k] += rate
        return self._normalized(q)

    def _normalized(self, q):
        """q with unit quaternions."""
        q = list(q)
        for i, joint in enumerate(self.joints):
            if joint["type"] in ("spherical", "free-flyer"):
                part = slice(self.start_q[i + 1] - 4, self.start_q[i + 1])
                q[part] = scaled(1 / sqrt(dot(q[part], q[part])), q[part])
        return q

    # --- motion on the closures -------------------------------------------------------------

    def state(self, q, va, aa):
        """Everything about a motion of the coordinates at a closed q, as a `Motion`."""
        zero = [mpf(0)] * self.nv
        J_of_all_rows = self.rows(self.bodies(q, zero, zero)).J
        independent = independent_rows(J_of_all_rows)
        J = [J_of_all_rows[r] for r in independent]
        v = self._completed(J, va, [mpf(0)] * len(independent))
        drift_of_all_rows = self.rows(self.bodies(q, v, zero)).drift
        drift = [drift_of_all_rows[r] for r in independent]
        dv = self._completed(J, aa, drift)
        # With this dv, the second derivatives of all equations are zero.
        second_derivatives = self.rows(self.bodies(q, v, dv)).drift
        assert max(map(abs, second_derivatives), default=0) < mpf("1e-40"), (
            "redundant rows must hold by themselves"
        )
        return Motion(self, q, v, dv, J, drift)

    def _completed(self, J, of_coordinates, drift):
        """All joint rates v with J v + drift = 0, from those of the coordinates."""
        rates = [mpf(0)] * self.nv
        for i, value in zip(self.coordinates, of_coordinates, strict=True):
            rates[i] = value
        right = [-d - dot(row, rates) for row, d in zip(J, drift, strict=True)]
        for i, x in zip(self.others, solve(self._of_others(J), right), strict=True):
            rates[i] = x
        return rates

    def _of_others(self, J):
        """The columns of the dependent rates."""
        return matrix([[row[i] for i in self.others] for row in J])


@dataclass
class Motion:
    """A motion that keeps the loops closed; J and its drift in independent rows."""

    robot: ExactRobot
    q: list
    v: list
    dv: list
    J: list
    drift: list

    def generalized_forces(self, v, dv, gravity, lines=True):
        """What a motion of the tree takes along the coordinates, (n,)."""
        robot = self.robot
        bodies = robot.bodies(self.q, v, dv)
        forces = robot.tree_forces(bodies, gravity)
        if lines:
            forces = minus(forces, robot.line_forces(bodies, v))
        # No motor drives a dependent joint, so the multipliers m of the closures give its force:
        # (J^T m)_i = f_i.
        multipliers = solve(robot._of_others(self.J).T, [forces[i] for i in robot.others])
        along_coordinates = []
        for i in robot.coordinates:
            force_of_closures = sum(row[i] * m for row, m in zip(self.J, multipliers, strict=True))
            along_coordinates.append(forces[i] - force_of_closures)
        return along_coordinates

    def _unit_motions(self):
        """All joint rates for a rate of 1 of each coordinate, n lists of nv numbers."""
        n = len(self.robot.coordinates)
        no_drift = [mpf(0)] * len(self.J)
        motions = []
        for i in range(n):
            unit = [mpf(int(i == j)) for j in range(n)]
            motions.append(self.robot._completed(self.J, unit, no_drift))
        return motions

    def _motor_rates(self):
        """Rates of the motors for unit rates of the coordinates, (n, motors)."""
        return matrix([[v[i] for i in self.robot.motors] for v in self._unit_motions()])

    def torques(self):
        """Motor torques, the smallest where there are more motors than freedoms."""
        forces = self.generalized_forces(self.v, self.dv, self.robot.gravity)
        P = self._motor_rates()
        return list(P.T * solve(P * P.T, forces))

    def accelerations(self, torques):
        """Accelerations of the coordinates under given torques."""
        robot = self.robot
        zero = [mpf(0)] * robot.nv
        # The forces without accelerations of the coordinates, and those of the accelerations alone,
        # which are the columns of the inertia matrix.
        without_aa = robot._completed(self.J, [mpf(0)] * len(robot.coordinates), self.drift)
        bias = self.generalized_forces(self.v, without_aa, robot.gravity)
        columns = []
        for dv in self._unit_motions():
            columns.append(self.generalized_forces(zero, dv, ZERO, lines=False))
        supplied = self._motor_rates() * matrix(torques)
        return list(solve(matrix(columns).T, minus(list(supplied), bias)))

    def energies(self):
        """Kinetic and potential energy."""
        robot = self.robot
        return robot.energies(robot.bodies(self.q, self.v, self.dv))
