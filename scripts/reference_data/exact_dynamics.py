# SPDX-License-Identifier: BSD-2-Clause
"""Dynamics of a described robot in as many digits as one likes, by mpmath alone.

Newton-Euler body by body in base axes, closures differentiated by hand, and the closures' forces
as Lagrange multipliers. Nothing of `sst_pin`, Pinocchio or NumPy comes in. A twist is a pair
(omega, v0) of the angular velocity and the velocity of the body's point at the base's origin.
"""

from dataclasses import dataclass

from mpmath import cos, matrix, mp, mpf, radians, sin, sqrt

mp.dps = 60
#: Pivots below this are those of redundant rows.
REDUNDANT = mpf("1e-9")
CLOSED = mpf("1e-50")


# --- vectors ------------------------------------------------------------------------------------


def vector(values):
    """Three numbers, decimals taken as they are printed."""
    return [mpf(repr(value)) for value in values]


def add(*vectors):
    return [sum(parts) for parts in zip(*vectors, strict=True)]


def scaled(factor, u):
    return [factor * x for x in u]


def minus(u, v):
    return [x - y for x, y in zip(u, v, strict=True)]


def dot(u, v):
    return sum(x * y for x, y in zip(u, v, strict=True))


def cross(u, v):
    (a, b, c), (x, y, z) = u, v
    return [b * z - c * y, c * x - a * z, a * y - b * x]


def times(R, u):
    return [dot(row, u) for row in R]


def product(A, B):
    columns = list(zip(*B, strict=True))
    return [[dot(row, column) for column in columns] for row in A]


def turn(axis, angle):
    """Rodrigues' formula about a unit vector."""
    x, y, z = axis
    s, c = sin(angle), cos(angle)
    d = 1 - c
    return [
        [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
        [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
        [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
    ]


def of_quaternion(quaternion):
    x, y, z, w = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


UNIT = [[mpf(int(i == j)) for j in range(3)] for i in range(3)]
ZERO = [mpf(0)] * 3


def placement(record):
    """Rotation and translation of a described placement."""
    roll, pitch, yaw = (radians(mpf(repr(angle))) for angle in record["rpy_degrees"])
    R = product(turn(UNIT[2], yaw), product(turn(UNIT[1], pitch), turn(UNIT[0], roll)))
    return R, vector(record["xyz"])


def moved(frame, at):
    """A placement in a moved frame, in the base."""
    (R, p), (S, s) = frame, at
    return product(R, S), add(p, times(R, s))


def bracket(V, S):
    """Rate of a twist S that is fixed in a body of twist V."""
    (omega, v), (a, m) = V, S
    return cross(omega, a), add(cross(omega, m), cross(v, a))


def combined(twists, factors):
    """Sum of factor times twist."""
    omega, v = ZERO, ZERO
    for (a, m), factor in zip(twists, factors, strict=True):
        omega, v = add(omega, scaled(factor, a)), add(v, scaled(factor, m))
    return omega, v


# --- the robot ----------------------------------------------------------------------------------

SIZES = {"revolute": (1, 1), "prismatic": (1, 1), "universal": (2, 2)}
SIZES |= {"spherical": (4, 3), "free-flyer": (7, 6)}


@dataclass
class Body:
    """A body in motion: placement, twist and its rate, and the twists of its joint's rates."""

    at: tuple
    V: tuple
    A: tuple
    columns: list
    mass_centre: list


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
        self.start_q, self.start_v = [0], [0]
        for joint in self.joints:
            nq, nv = SIZES[joint["type"]]
            self.start_q.append(self.start_q[-1] + nq)
            self.start_v.append(self.start_v[-1] + nv)
        self.nq, self.nv = self.start_q[-1], self.start_v[-1]
        self.closures = [(c["kind"], *self._ends(c)) for c in record["closures"]]
        numbers = ("stiffness", "rest_length", "damping", "preload")
        self.lines = [
            (*self._ends(line), *(mpf(repr(line[x])) for x in numbers)) for line in record["forces"]
        ]
        self.coordinates = self._rates_of(record["coordinates"])
        self.motors = self._rates_of(record["motors"])
        self.others = [i for i in range(self.nv) if i not in self.coordinates]

    def _ends(self, pair):
        """Body and placement of two frames."""
        frames = pair["frame_a"], pair["frame_b"]
        return [(self.index.get(f["joint"], -1), placement(f["placement"])) for f in frames]

    def _rates_of(self, names):
        return [
            i
            for name in names
            for i in range(self.start_v[self.index[name]], self.start_v[self.index[name] + 1])
        ]

    def _chain(self, body):
        """The body and those that bear it."""
        while body >= 0:
            yield body
            body = self.parents[body]

    # --- motion of the tree -----------------------------------------------------------------

    def bodies(self, q, v, dv):
        """All bodies, at q with joint rates v and accelerations dv."""
        found = []
        still = Body((UNIT, ZERO), (ZERO, ZERO), (ZERO, ZERO), [], ZERO)
        for i, joint in enumerate(self.joints):
            carrier = found[self.parents[i]] if self.parents[i] >= 0 else still
            own_q = q[self.start_q[i] : self.start_q[i + 1]]
            rates = v[self.start_v[i] : self.start_v[i + 1]]
            at = moved(carrier.at, self.placements[i])
            V, A = carrier.V, carrier.A
            columns = []
            if joint["type"] in ("spherical", "free-flyer"):
                local = of_quaternion(own_q[-4:])
                at = moved(at, (local, own_q[:3] if joint["type"] == "free-flyer" else ZERO))
                R, p = at
                body_axes = list(zip(*R, strict=True))
                if joint["type"] == "free-flyer":
                    columns += [(ZERO, list(axis)) for axis in body_axes]
                columns += [(list(axis), cross(p, axis)) for axis in body_axes]
                V = combined([V, *columns], [1, *rates])
                drifts = [bracket(V, S) for S in columns]
            else:
                drifts = []
                for axis, value, rate in zip(self.axes[i], own_q, rates, strict=True):
                    R, p = at
                    axis_in_base = times(R, axis)
                    if joint["type"] == "prismatic":
                        S = ZERO, axis_in_base
                        at = R, add(p, scaled(value, axis_in_base))
                    else:
                        S = axis_in_base, cross(p, axis_in_base)
                        at = product(R, turn(axis, value)), p
                    columns.append(S)
                    drifts.append(bracket(V, S))
                    V = combined([V, S], [1, rate])
            own_dv = dv[self.start_v[i] : self.start_v[i + 1]]
            A = combined([A, *columns, *drifts], [1, *own_dv, *rates])
            centre = moved(at, (UNIT, vector(joint["mass_centre"])))[1]
            found.append(Body(at, V, A, columns, centre))
        return found

    def line_forces(self, bodies, v):
        """Forces in all joints by which springs and dampers along lines pull, (nv,)."""
        forces = [mpf(0)] * self.nv
        for a, b, stiffness, rest, damping, preload in self.lines:
            (A, a_rates, *_), (B, b_rates, *_) = (self._frame_motion(bodies, *f) for f in (a, b))
            way = minus(B[1], A[1])
            length = sqrt(dot(way, way))
            of_rates = [
                dot(way, minus(y, x)) / length for x, y in zip(a_rates, b_rates, strict=True)
            ]
            tension = preload + stiffness * (length - rest) + damping * dot(of_rates, v)
            forces = [f - tension * rate for f, rate in zip(forces, of_rates, strict=True)]
        return forces

    def tree_forces(self, bodies, gravity):
        """Forces in all joints that the motion of the tree takes, (nv,)."""
        forces = [mpf(0)] * self.nv
        for i, (joint, body) in enumerate(zip(self.joints, bodies, strict=True)):
            (omega, v), (alpha, a), c = body.V, body.A, body.mass_centre
            at_centre = add(v, cross(omega, c))
            acceleration = add(a, cross(alpha, c), cross(omega, at_centre))
            f = scaled(mpf(repr(joint["mass"])), minus(acceleration, gravity))
            n = add(
                self._turned(joint, body, alpha), cross(omega, self._turned(joint, body, omega))
            )
            moment = add(n, cross(c, f))  # about the base's origin
            for j in self._chain(i):
                for k, (axis, m) in enumerate(bodies[j].columns):
                    forces[self.start_v[j] + k] += dot(axis, moment) + dot(m, f)
        return forces

    def _turned(self, joint, body, u):
        """The body's inertia about its mass centre times a vector in base axes."""
        xx, yy, zz, xy, xz, yz = vector(joint["inertia"])
        R = body.at[0]
        inner = times([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], times(zip(*R, strict=True), u))
        return times(R, inner)

    def energies(self, bodies):
        """Kinetic energy, and potential energy, zero with all masses at the origin."""
        kinetic = potential = mpf(0)
        for joint, body in zip(self.joints, bodies, strict=True):
            (omega, v), c, mass = body.V, body.mass_centre, mpf(repr(joint["mass"]))
            at_centre = add(v, cross(omega, c))
            kinetic += mass * dot(at_centre, at_centre) / 2
            kinetic += dot(omega, self._turned(joint, body, omega)) / 2
            potential -= mass * dot(self.gravity, c)
        for a, b, stiffness, rest, _, preload in self.lines:
            ends = [self._frame_motion(bodies, *frame)[0][1] for frame in (a, b)]
            way = minus(*ends)
            drawn = sqrt(dot(way, way)) - rest
            potential += stiffness * drawn**2 / 2 + preload * drawn
        return kinetic, potential

    # --- closures ---------------------------------------------------------------------------

    def rows(self, bodies):
        """Residual, Jacobian and, for bodies with dv = 0, drift of the closures."""
        residual, J, drift = [], [], []
        for kind, *frames in self.closures:
            seen = [self._frame_motion(bodies, *frame) for frame in frames]
            (A, a), (B, b) = ((motion[0], motion[1:]) for motion in seen)
            rows = [minus(y, x) for x, y in zip(a[0], b[0], strict=True)]  # of each rate
            turns = [minus(y, x) for x, y in zip(a[1], b[1], strict=True)]
            residual += minus(B[1], A[1])
            J += [[row[k] for row in rows] for k in range(3)]
            drift += minus(b[2], a[2])
            if kind == "3d":
                continue
            x, y, z = (list(axis) for axis in zip(*A[0], strict=True))
            X, Y, Z = (list(axis) for axis in zip(*B[0], strict=True))
            alpha = minus(b[3], a[3])
            if kind == "6d":
                small = add(cross(x, X), cross(y, Y), cross(z, Z))
                residual += scaled(mpf(1) / 2, small)
                J += [[row[k] for row in turns] for k in range(3)]
                drift += alpha
            elif kind == "hinge":
                small = cross(z, Z)
                omega = minus(b[4], a[4])
                for axis in (x, y):
                    residual.append(dot(axis, small))
                    J.append([dot(axis, row) for row in turns])
                    drift.append(dot(axis, alpha) + dot(cross(a[4], axis), omega))
            else:
                raise ValueError(f"closure {kind}")
        return residual, J, drift

    def _frame_motion(self, bodies, body, local):
        """Placement, velocity and turn per rate, accelerations of origin and axes, omega."""
        linear, angular = ([ZERO] * self.nv for _ in range(2))
        if body < 0:
            return local, linear, angular, ZERO, ZERO, ZERO
        at = moved(bodies[body].at, local)
        p = at[1]
        for j in self._chain(body):
            for k, (axis, m) in enumerate(bodies[j].columns):
                angular[self.start_v[j] + k] = axis
                linear[self.start_v[j] + k] = add(m, cross(axis, p))
        (omega, v), (alpha, a) = bodies[body].V, bodies[body].A
        acceleration = add(a, cross(alpha, p), cross(omega, add(v, cross(omega, p))))
        return at, linear, angular, acceleration, alpha, omega

    def moved_from(self, home, step):
        """A closed configuration: from a closed one along a motion of the coordinates."""
        zero = [mpf(0)] * self.nv
        _, J, _ = self.rows(self.bodies(home, zero, zero))
        rows = independent_rows(J)
        rates = self._completed([J[r] for r in rows], step, [mpf(0)] * len(rows))
        q = self._stepped(home, rates)
        for _ in range(30):  # Newton's method, shortest steps
            residual, J, _ = self.rows(self.bodies(q, zero, zero))
            if max(map(abs, residual), default=0) < CLOSED:
                return q
            A = matrix([J[r] for r in rows])
            step = A.T * solve(A * A.T, [-residual[r] for r in rows])
            q = self._stepped(q, list(step))
        raise ArithmeticError(f"open by {max(map(abs, residual))}")

    def _stepped(self, q, step):
        q = list(q)
        for i, joint in enumerate(self.joints):
            own, rates = self.start_q[i], step[self.start_v[i] : self.start_v[i + 1]]
            if joint["type"] in ("spherical", "free-flyer"):
                if joint["type"] == "free-flyer":
                    R = of_quaternion(q[own + 3 : own + 7])
                    q[own : own + 3] = add(q[own : own + 3], times(R, rates[:3]))
                    own, rates = own + 3, rates[3:]
                x, y, z, w = q[own : own + 4]
                u = [x, y, z]
                half = scaled(mpf(1) / 2, rates)
                q[own : own + 3] = add(u, scaled(w, half), cross(u, half))
                q[own + 3] = w - dot(u, half)
            else:
                for k, rate in enumerate(rates):
                    q[own + k] += rate
        return self._normalized(q)

    def _normalized(self, q):
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
        _, J, _ = self.rows(self.bodies(q, zero, zero))
        rows = independent_rows(J)
        J = [J[r] for r in rows]
        v = self._completed(J, va, [mpf(0)] * len(rows))
        _, _, drift = self.rows(self.bodies(q, v, zero))
        dv = self._completed(J, aa, [drift[r] for r in rows])
        _, _, moved_on = self.rows(self.bodies(q, v, dv))
        assert max(map(abs, moved_on), default=0) < mpf("1e-40"), (
            "redundant rows must hold by themselves"
        )
        return Motion(self, q, v, dv, J, [drift[r] for r in rows])

    def _completed(self, J, of_coordinates, drift):
        """Rates of all joints from those of the coordinates."""
        rates = [mpf(0)] * self.nv
        for i, value in zip(self.coordinates, of_coordinates, strict=True):
            rates[i] = value
        right = [-d - dot(row, rates) for row, d in zip(J, drift, strict=True)]
        for i, x in zip(self.others, solve(self._of_others(J), right), strict=True):
            rates[i] = x
        return rates

    def _of_others(self, J):
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
        multipliers = solve(robot._of_others(self.J).T, [forces[i] for i in robot.others])
        return [
            forces[i] - sum(row[i] * m for row, m in zip(self.J, multipliers, strict=True))
            for i in robot.coordinates
        ]

    def _motor_rates(self):
        """Rates of the motors for unit rates of the coordinates, (n, motors)."""
        robot, n = self.robot, len(self.robot.coordinates)
        still = [mpf(0)] * len(self.J)
        units = [[mpf(int(i == j)) for j in range(n)] for i in range(n)]
        rates = [robot._completed(self.J, unit, still) for unit in units]
        return matrix([[row[i] for i in robot.motors] for row in rates])

    def torques(self):
        """Motor torques, the smallest where there are more motors than freedoms."""
        forces = self.generalized_forces(self.v, self.dv, self.robot.gravity)
        P = self._motor_rates()
        return list(P.T * solve(P * P.T, forces))

    def accelerations(self, torques):
        """Accelerations of the coordinates under given torques."""
        robot, n = self.robot, len(self.robot.coordinates)
        rest = robot._completed(self.J, [mpf(0)] * n, self.drift)
        bias = self.generalized_forces(self.v, rest, robot.gravity)
        zero, still = [mpf(0)] * robot.nv, [mpf(0)] * len(self.J)
        units = [[mpf(int(i == j)) for j in range(n)] for i in range(n)]
        columns = [
            self.generalized_forces(zero, robot._completed(self.J, unit, still), ZERO, False)
            for unit in units
        ]
        supplied = self._motor_rates() * matrix(torques)
        return list(solve(matrix(columns).T, minus(list(supplied), bias)))

    def energies(self):
        robot = self.robot
        return robot.energies(robot.bodies(self.q, self.v, self.dv))


# --- linear algebra -----------------------------------------------------------------------------


def independent_rows(J):
    """Indices of rows that carry the rank, by elimination with full pivoting."""
    left = {i: list(row) for i, row in enumerate(J)}
    chosen = []
    while left:
        size, i, k = max(
            ((abs(x), i, k) for i, row in left.items() for k, x in enumerate(row)),
            key=lambda entry: entry[0],
        )
        if size < REDUNDANT:
            break
        chosen.append(i)
        pivot = left.pop(i)
        for row in left.values():
            factor = row[k] / pivot[k]
            row[:] = [x - factor * y for x, y in zip(row, pivot, strict=True)]
    return sorted(chosen)


def solve(A, b):
    """The solution of a regular system."""
    if not b:
        return []
    return mp.lu_solve(A, matrix(b))
