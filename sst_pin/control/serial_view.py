# SPDX-License-Identifier: BSD-2-Clause
"""A parallel joint as its controller sees it: motors there, joints here, and the maps between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, finite_array, for_each_sample, names, single_array
from ..chain.closed_chain import ClosedChain
from ..chain.named_positions import taken
from ..chain.redundancy import limits_of
from ..chain.thresholds import RANK_TOLERANCE
from ..errors import ActuationError, InputError, SingularConfigurationError, WorkspaceError
from ..motion.coordinate_motions import followed, start_of

#: The joints go to given motor positions in pieces of this size, [rad], or of the robot's length.
_PIECE = 0.2
#: Newton's method in a piece: steps, and the error at which it has arrived, as for the pieces.
_STEPS, _ARRIVED = 20, 1e-12


class SerialView:
    """Joints of a robot that motors move through linkages, as if the motors were in the joints.

    An ankle of two motors and two rods has the joints pitch and roll; a four-bar knee has one. Of a
    larger robot, the joints may be some of many. With the actuator Jacobian J of these joints and
    motors, rates and torques are

        motor rates = J joint rates,    joint torques = J^T motor torques.

    Both have the same power. Matrices of the whole robot have a row for each rate of
    `chain.coordinates`, of which the joints are a part.

    Args:
        chain: A robot with motors.
        joints: Names of the joints, [rad] or [m] each. They are made coordinates, beside those
            coordinates of the chain that these joints and their motors leave free.

    Attributes:
        chain: The robot in these coordinates; everything about it is in its methods.
        joints: The names given.
        motors: Names of the motors that move these joints.

    Raises:
        InputError: If the joints do not turn or slide, or a motor also moves with others.
        ActuationError: If the motors do not hold the joints.
        SingularConfigurationError: If the joints are not independent.
        UnknownNameError: For an unknown joint.

    Example:
        >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
        >>> q = ankle.from_joints([0.2, -0.1])
        >>> ankle.motor_positions(q).round(3)
        array([0.101, 0.301])
    """

    def __init__(self, chain: ClosedChain, joints: Sequence[str]) -> None:
        self.joints = tuple(names("joints", joints))
        space = chain.mechanism.space
        taken(space, chain.generic_configuration(), self.joints)  # each turns or slides
        rates = space.rates_of(self.joints)
        self.chain = chain.with_coordinates([*self.joints, *_others(chain, rates)])
        coordinates = self.chain.mechanism.coordinates
        self._columns = np.array([int(np.flatnonzero(coordinates == k)[0]) for k in rates])
        units = {"Nm": 1.0, "N": chain.mechanism.length}
        self._scale = np.array([units[unit] for unit in chain.motor_units])
        J = self.chain.actuator_jacobian(self.chain.generic_configuration())
        J = J / self._scale[:, None] * chain.mechanism.rate_scale[coordinates]
        self._rows = np.flatnonzero(np.abs(J[:, self._columns]).max(axis=1) > RANK_TOLERANCE)
        self.motors = tuple(self.chain.motor_names[k] for k in self._rows)
        self._check(J[self._rows])
        # After these a motor of a joint without limits is at the same position.
        endless = ~np.isin(space.rate_names, space.position_names)
        self._turns = 2 * np.pi * np.abs(chain.mechanism.motors[:, self._rows]).T @ endless
        self._linkages = self.chain._remade(_without_serial_bodies(self.chain))

    def _check(self, J: Array) -> None:
        """Judge the motors' rows of the Jacobian at a generic configuration, without units."""
        if np.linalg.matrix_rank(J[:, self._columns], tol=RANK_TOLERANCE) < len(self.joints):
            raise ActuationError(
                f"the motors {', '.join(self.motors) or '(none)'} do not hold the joints "
                f"{', '.join(self.joints)}"
            )
        others = np.delete(np.arange(J.shape[1]), self._columns)
        for motor, row in zip(self.motors, J, strict=True):
            for k in others:
                if abs(row[k]) > RANK_TOLERANCE:
                    other = self.chain.mechanism.coordinate_rate_names[k]
                    raise InputError(
                        "joints",
                        f"motor {motor} also moves with {other}: name all joints of its linkage",
                    )

    def compile(self) -> None:
        """Make kernels for all that is computed here; see `ClosedChain.compile`.

        Example:
            `view.compile()`
        """
        self.chain.compile()
        self._linkages.compile()

    # --- positions --------------------------------------------------------------------------

    def from_joints(self, positions: ArrayLike, start: ArrayLike | None = None) -> Array:
        """The configuration for positions of the joints, each reached from the start alone.

        On the way no singular configuration is passed, so the assembly mode is that of the start.

        Args:
            positions: Shape (..., joints), [rad] or [m].
            start: A configuration with closed loops, shape (nq,); by default `home`. It also gives
                the other coordinates.

        Returns:
            Shape (..., nq).

        Raises:
            ClosureError: If a position cannot be reached so.

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.from_joints([[0.5], [1.0]]).shape
            (2, 3)
        """
        first = self._start(start)

        def one(x: Array) -> Array:
            return self._moved(first, x - self.joint_positions(first))

        targets = finite_array("positions", positions, (len(self.joints),))
        return for_each_sample(one, [targets], (1,), first.shape)

    def from_motors(self, positions: ArrayLike, start: ArrayLike | None = None) -> Array:
        """The configuration for positions of the motors; see `from_joints`.

        Args:
            positions: Shape (..., motors), [rad] or [m]; of a motor on a line its length.
            start: A configuration with closed loops, shape (nq,); by default `home`.

        Returns:
            Shape (..., nq).

        Raises:
            ClosureError, SingularConfigurationError: If the way there leads out of reach.
            WorkspaceError: If there are more motors than joints, and no positions of the joints
                give these of the motors.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.joint_positions(ankle.from_motors([0.1, 0.1])).round(3) + 0.0
            array([0.1, 0. ])
        """
        first = self._start(start)
        here = self.motor_positions(first)
        unit = self._scale[self._rows]

        def one(target: Array) -> Array:
            q, way = first, target - here
            pieces = max(1, int(np.ceil(np.abs(way / unit).max() / _PIECE)))
            for part in range(1, pieces + 1):
                q = self._newton(q, here + way * (part / pieces), unit)
            return q

        targets = finite_array("positions", positions, (len(self.motors),))
        return for_each_sample(one, [targets], (1,), first.shape)

    def joint_positions(self, q: ArrayLike) -> Array:
        """Positions of the joints, shape (..., joints).

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.joint_positions(knee.chain.home)
            array([0.8])
        """
        return taken(self.chain.mechanism.space, self._configurations(q), self.joints)

    def motor_positions(self, q: ArrayLike) -> Array:
        """Positions of the motors, shape (..., motors); of a motor on a line its length.

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.motor_positions(knee.from_joints([1.0])).round(3)
            array([0.])
        """
        mechanism, array = self.chain.mechanism, self._configurations(q)
        B = mechanism.motors[:, self._rows]
        driven = np.flatnonzero(B.any(axis=1))
        at_joints = taken(mechanism.space, array, [mechanism.space.rate_names[k] for k in driven])
        on_lines = self.chain.line_lengths(array) @ mechanism.lines.motors[:, self._rows]
        return np.asarray(at_joints @ B[driven] + on_lines)

    def _configurations(self, q: ArrayLike) -> Array:
        return finite_array("q", q, (self.chain.mechanism.model.nq,))

    def _start(self, start: ArrayLike | None) -> Array:
        """Where the way begins, its loops closed."""
        size = (self.chain.mechanism.model.nq,)
        q = start_of(self.chain) if start is None else single_array("start", start, size)
        return self.chain.assemble(q)

    def _moved(self, q: Array, by: Array) -> Array:
        step = np.zeros(self.chain.degrees_of_freedom)
        step[self._columns] = by
        return followed(self.chain, self.chain._states(0.0), q, step)

    def _newton(self, q: Array, target: Array, unit: Array) -> Array:
        """From q to the configuration nearby where the motors are at their target."""
        for _ in range(_STEPS):
            step: Array = np.linalg.pinv(self.actuator_jacobian(q)) @ self._missing(q, target)
            q = self._moved(q, step)
            if np.abs(step).max() <= _ARRIVED * self.chain.mechanism.length:
                break
        missed = np.abs(self._missing(q, target) / unit).max()
        if missed > np.sqrt(_ARRIVED):
            raise WorkspaceError(
                f"no positions of the joints {', '.join(self.joints)} bring the motors "
                f"{', '.join(self.motors)} to {target.round(6).tolist()}"
            )
        return q

    def _missing(self, q: Array, target: Array) -> Array:
        """How far motors are from their target; full turns do not count."""
        error = target - self.motor_positions(q)
        turns = np.round(error / np.where(self._turns, self._turns, 1))
        return np.asarray(error - self._turns * turns)

    # --- rates and torques ------------------------------------------------------------------

    def actuator_jacobian(self, q: ArrayLike) -> Array:
        """J: rates of the motors by rates of the joints, shape (..., motors, joints).

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.actuator_jacobian(knee.from_joints([1.0])).round(3)
            array([[0.8]])
        """
        J = self.chain.actuator_jacobian(q)
        return np.asarray(J[..., self._rows, :][..., self._columns])

    def motor_rates(self, q: ArrayLike, rates: ArrayLike) -> Array:
        """Rates of the motors, shape (..., motors), for rates of the joints, (..., joints).

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.motor_rates(ankle.from_joints([0, 0]), [1, 0]).round(3)
            array([1., 1.])
        """
        rates = finite_array("rates", rates, (len(self.joints),))
        return np.einsum("...mk,...k->...m", self.actuator_jacobian(q), rates)

    def joint_rates(self, q: ArrayLike, rates: ArrayLike) -> Array:
        """Rates of the joints, shape (..., joints), for rates of the motors, (..., motors).

        With more motors than joints, they are those that fit best.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.joint_rates(ankle.from_joints([0, 0]), [1, 1]).round(3)
            array([1., 0.])
        """
        rates = finite_array("rates", rates, (len(self.motors),))
        return np.einsum("...km,...m->...k", np.linalg.pinv(self.actuator_jacobian(q)), rates)

    def joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Torques at the joints, shape (..., joints), for torques of the motors, (..., motors).

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.joint_torques(ankle.from_joints([0, 0]), [10, 10]).round(3)
            array([20.,  0.])
        """
        tau = finite_array("tau", tau, (len(self.motors),))
        return np.einsum("...mk,...m->...k", self.actuator_jacobian(q), tau)

    def motor_torques(self, q: ArrayLike, torques: ArrayLike) -> Array:
        """Torques of the motors, shape (..., motors), for torques at the joints, (..., joints).

        With more motors than joints, they are the smallest.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.motor_torques(ankle.from_joints([0, 0]), [20, 0]).round(3)
            array([10., 10.])
        """
        torques = finite_array("torques", torques, (len(self.joints),))
        return np.einsum("...km,...k->...m", np.linalg.pinv(self.actuator_jacobian(q)), torques)

    # --- inertia and damping ----------------------------------------------------------------

    def inertia(self, q: ArrayLike) -> Array:
        """The whole mass matrix in `chain.coordinates`, shape (..., n, n), Eq. (93).

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.inertia(knee.from_joints([1.0])).round(4)
            array([[0.1394]])
        """
        return self._mass_matrix(self.chain, q)

    def reflected_inertia(self, q: ArrayLike) -> Array:
        """What rotors, cranks and rods add to the mass matrix of the serial tree, (..., n, n).

        The serial tree has the bodies that only joints of `chain.coordinates` carry. A simulator
        that has this tree alone needs this matrix beside its own; its diagonal alone, as
        `armature`, is not enough.

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.reflected_inertia(knee.from_joints([1.0])).round(4)
            array([[0.0323]])
        """
        return self._mass_matrix(self._linkages, q)

    def damping(self, q: ArrayLike) -> Array:
        """D: viscous friction of all joints and dampers takes D times the rates, (..., n, n).

        Example:
            >>> knee = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
            >>> knee.damping(knee.from_joints([1.0]))
            array([[0.]])
        """
        n = self.chain.degrees_of_freedom
        each = self._configurations(q)[..., None, :]
        v = self.chain.joint_rates(each, np.eye(n))
        _, _, on_lines, _ = self.chain.mechanism.lines.numbers
        lines = self.chain._line_rates(each, v)
        D = np.einsum("...iv,v,...jv->...ij", v, self.chain.friction.viscous, v)
        return np.asarray(D + np.einsum("...il,l,...jl->...ij", lines, on_lines, lines))

    @staticmethod
    def _mass_matrix(chain: ClosedChain, q: ArrayLike) -> Array:
        return chain.reduced_terms(q, np.zeros(chain.degrees_of_freedom)).inertia

    # --- limits and gains -------------------------------------------------------------------

    def torque_polygon(self, q: ArrayLike, limits: ArrayLike | None = None) -> Array:
        """The corners of all torques that the motors can give at the joints.

        Args:
            q: Configurations, shape (..., nq).
            limits: Largest torque of each motor of `motors`, shape (motors,), or least and
                largest, (motors, 2); by default `effortLimit` of the model.

        Returns:
            Shape (..., corners, joints): of one joint the least and the largest torque, of two the
            corners of the polygon one after the other, of more the corners of the convex hull. In a
            batch, a polygon with fewer corners than another has its last one several times.

        Raises:
            InputError: If a motor has no limit.
            SingularConfigurationError: Where the motors do not hold all joints.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.torque_polygon(ankle.from_joints([0, 0]), [10, 10]).round(3)
            array([[-20.,   0.],
                   [  0., -20.],
                   [ 20.,   0.],
                   [  0.,  20.]])
        """
        bounds = self._limits(limits)
        corners = np.stack(np.meshgrid(*bounds, indexing="ij"), axis=-1).reshape(-1, len(bounds))
        at_joints = self.joint_torques(self._configurations(q)[..., None, :], corners)
        batch = at_joints.shape[:-2]
        found = [_hull(points) for points in at_joints.reshape(-1, *at_joints.shape[-2:])]
        most = max((len(points) for points in found), default=0)
        padded = [np.pad(x, ((0, most - len(x)), (0, 0)), mode="edge") for x in found]
        return np.array(padded).reshape(*batch, most, len(self.joints))

    def _limits(self, limits: ArrayLike | None) -> Array:
        """Least and largest torques of the motors, shape (motors, 2)."""
        if limits is None:
            B = self.chain.mechanism.motors[:, self._rows]
            one = (np.count_nonzero(B, axis=0) == 1) & (np.abs(B).sum(axis=0) == 1)
            given = np.abs(B).T @ self.chain.mechanism.model.effortLimit
            if not (one & (given > 0) & (given < np.finfo(float).max)).all():
                raise InputError("limits", "the model has no limits of these motors: give limits=")
        else:
            given = finite_array("limits", limits, ())
        return limits_of(given, len(self.motors))

    def joint_gains(self, q: ArrayLike, gains: ArrayLike, tau: ArrayLike | None = None) -> Array:
        """Gains at the joints for gains of the motors: J^T k J, shape (..., joints, joints).

        Args:
            q: Configurations where the motors are at their set points, shape (..., nq).
            gains: Gains of the motors' position or rate loops, shape (motors,), or a matrix.
            tau: Torques that the motors hold there, shape (..., motors): they change the stiffness,
                since J depends on q. For gains of positions only. None for none.

        Raises:
            InputError: For a wrong shape, or tau where a motor is on a line.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> ankle.joint_gains(ankle.from_joints([0, 0]), [300, 300]).round(3)
            array([[600.,   0.],
                   [  0., 600.]])
        """
        J = self.actuator_jacobian(q)
        K = np.einsum("...mi,mn,...nj->...ij", J, _matrix(gains, len(self.motors)), J)
        return K if tau is None else K - self._slope(q, tau)

    def motor_gains(self, q: ArrayLike, gains: ArrayLike, tau: ArrayLike | None = None) -> Array:
        """Gains of the motors that give gains at the joints, shape (..., motors, motors).

        Outside of the diagonal they couple the motors: a drive that only knows its own motor
        cannot have them.

        Args:
            q: Configurations where the motors are at their set points, shape (..., nq).
            gains: At the joints, shape (joints,), or a matrix.
            tau: See `joint_gains`.

        Raises:
            InputError: See `joint_gains`.

        Example:
            >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
            >>> q = ankle.from_joints([0, 0])
            >>> ankle.motor_gains(q, [600, 600]).round(3).diagonal()
            array([300., 300.])
        """
        K = _matrix(gains, len(self.joints))
        back = np.linalg.pinv(self.actuator_jacobian(q))
        if tau is not None:
            K = K + self._slope(q, tau)
        return np.einsum("...im,...ij,...jn->...mn", back, K, back)

    def _slope(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Derivatives of J^T tau by the joints' positions, shape (..., joints, joints).

        The motors' accelerations at constant rates x of the joints are a square form in x, whose
        matrix is the derivative of J; see Eq. (20).
        """
        mechanism = self.chain.mechanism
        if mechanism.lines.motors[:, self._rows].any():
            raise InputError("tau", "not for motors on lines")
        k, n = len(self.joints), self.chain.degrees_of_freedom
        tau = finite_array("tau", tau, (len(self.motors),))
        sums = np.zeros((k, k, n))
        sums[..., self._columns] = np.eye(k)[:, None] + np.eye(k)
        each = self._configurations(q)[..., None, None, :]
        of_sums = self.chain.joint_accelerations(each, sums, np.zeros(n))
        square = of_sums @ mechanism.motors[:, self._rows]
        own = np.einsum("...iim->...im", square) / 4
        slope = (square - own[..., :, None, :] - own[..., None, :, :]) / 2
        return np.einsum("...ijm,...m->...ij", slope, tau)

    def __repr__(self) -> str:
        return (
            f"SerialView of {self.chain.mechanism.model.name}: joints {', '.join(self.joints)}; "
            f"motors {', '.join(self.motors)}"
        )


def _others(chain: ClosedChain, rates: Indices) -> list[str]:
    """Coordinates of a chain that some joints leave free, by greedy choice at its example."""
    mechanism = chain.mechanism
    L = chain.joint_rates(chain.generic_configuration(), np.eye(chain.degrees_of_freedom)).T
    L = L / mechanism.rate_scale[:, None] * mechanism.rate_scale[mechanism.coordinates]
    chosen, found = list(L[rates]), list[str]()
    for name in chain.coordinates:
        group = list(L[mechanism.space.rates_of([name])])
        rows = np.array([*chosen, *group])
        if np.linalg.matrix_rank(rows, tol=RANK_TOLERANCE) == len(rows):
            chosen, found = [*rows], [*found, name]
    return found


def _without_serial_bodies(chain: ClosedChain) -> pin.Model:
    """The model with weightless bodies where only coordinates carry them."""
    mechanism = chain.mechanism
    model, own = pin.Model(mechanism.model), set(mechanism.coordinates.tolist())
    armature = model.armature.copy()
    for i in range(1, model.njoints):
        bearers = [model.joints[j] for j in list(model.supports[i])[1:]]
        if all(set(range(b.idx_v, b.idx_v + b.nv)) <= own for b in bearers):
            model.inertias[i] = pin.Inertia.Zero()
            armature[bearers[-1].idx_v : bearers[-1].idx_v + bearers[-1].nv] = 0
    model.armature = armature
    return model


def _hull(points: Array) -> Array:
    """Corners of the convex hull of points, in one dimension its ends, the first one first."""
    from scipy.spatial import ConvexHull, QhullError

    if points.shape[1] == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    try:
        around = ConvexHull(points).vertices
    except QhullError:
        raise SingularConfigurationError("the motors do not hold all joints", np.inf) from None
    return np.asarray(points[np.roll(around, -int(around.argmin()))])


def _matrix(gains: ArrayLike, size: int) -> Array:
    """Gains as a matrix."""
    given = finite_array("gains", gains, ())
    if given.shape == (size,):
        return np.diag(given)
    if given.shape != (size, size):
        raise InputError("gains", f"shape {given.shape}, expected ({size},) or ({size}, {size})")
    return given
