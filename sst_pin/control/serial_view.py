# SPDX-License-Identifier: BSD-2-Clause
"""A parallel joint as a serial one: maps between its motors and its joints."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, finite_array
from ..closed_chain import ClosedChain
from ..dynamics.torque_sharing import limits_of
from ..engine import require_robot
from ..errors import InputError, SingularConfigurationError
from .convex_sets import hull
from .linkage import Linkage


class SerialView(Linkage):
    """Joints of a robot that motors move through linkages, as if the motors were in the joints.

    An ankle of two motors and two rods has the joints pitch and roll; a four-bar knee has one. Of a
    larger robot, the joints may be some of many. With the actuator Jacobian J of these joints and
    motors, rates and torques are

        motor rates = J joint rates,    joint torques = J^T motor torques.

    Both have the same power. Matrices of the whole robot have a row for each rate of
    `chain.coordinates`, of which the joints are a part.

    Args:
        chain: A robot with motors.
        joints: Names of the joints, [rad] or [m] each. They become coordinates; the coordinates of
            the chain that are independent of them stay.

    Attributes:
        chain: The robot in these coordinates; everything about it is in its methods.
        joints: Their names.
        motors: Names of the motors that move these joints.

    Raises:
        InputError: If a joint does not turn or slide, or a motor also moves with other joints.
        ActuationError: If the motors do not hold the joints; the message names the free joints.
        SingularConfigurationError: If the joints are not independent.

    Example:
        >>> ankle = sst_pin.SerialView(sst_pin.robots.ankle(), ["ankle_pitch", "ankle_roll"])
        >>> q = ankle.from_joints([0.2, -0.1])
        >>> ankle.motor_positions(q).round(3), ankle.joint_positions(q)
        (array([0.101, 0.301]), array([ 0.2, -0.1]))
        >>> upright = ankle.from_motors([0, 0])
        >>> ankle.motor_torques(upright, [20, 0]).round(3)
        array([10., 10.])
        >>> ankle.torque_polygon(upright, [10, 10]).round(3)
        array([[-20.,   0.],
               [  0., -20.],
               [ 20.,   0.],
               [  0.,  20.]])
        >>> ankle.joint_gains(upright, [300, 300]).round(3)
        array([[600.,   0.],
               [  0., 600.]])
    """

    def __init__(self, chain: ClosedChain, joints: Sequence[str]) -> None:
        require_robot("chain", chain)
        super().__init__(chain, joints)
        #: The same robot without the masses of the serial tree: what is left are the linkages.
        self._linkages = self.chain.with_model(_without_serial_bodies(self.chain))

    def compile(self) -> None:
        """Make kernels for all that is computed here; see `ClosedChain.compile`."""
        self.chain.compile()
        self._linkages.compile()

    def motor_rates(self, q: ArrayLike, rates: ArrayLike) -> Array:
        """Rates of the motors, shape (..., motors), for rates of the joints, (..., joints)."""
        return _mapped(self.actuator_jacobian(q), "rates", rates)

    def joint_rates(self, q: ArrayLike, rates: ArrayLike) -> Array:
        """Rates of the joints, shape (..., joints), for rates of the motors, (..., motors).

        With more motors than joints, they are the least-squares fit.
        """
        return _mapped(np.linalg.pinv(self.actuator_jacobian(q)), "rates", rates)

    def joint_torques(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Torques at the joints, shape (..., joints), for torques of the motors, (..., motors)."""
        return _mapped(self.actuator_jacobian(q).mT, "tau", tau)

    def motor_torques(self, q: ArrayLike, torques: ArrayLike) -> Array:
        """Torques of the motors, shape (..., motors), for torques at the joints, (..., joints).

        With more motors than joints, they are the smallest.
        """
        return _mapped(np.linalg.pinv(self.actuator_jacobian(q)).mT, "torques", torques)

    def inertia(self, q: ArrayLike) -> Array:
        """The whole mass matrix in `chain.coordinates`, shape (..., n, n), Eq. (93)."""
        return self.chain.reduced_terms(q, np.zeros(self.chain.degrees_of_freedom)).inertia

    def reflected_inertia(self, q: ArrayLike) -> Array:
        """The contribution of rotors, cranks and rods to the mass matrix, shape (..., n, n).

        The serial tree has the bodies that only joints of `chain.coordinates` carry. A simulator of
        this tree must add this matrix to its own mass matrix; the diagonal, as `armature`, is not
        enough.
        """
        return self._linkages.reduced_terms(q, np.zeros(self.chain.degrees_of_freedom)).inertia

    def damping(self, q: ArrayLike) -> Array:
        """Damping matrix of viscous friction and dampers in `chain.coordinates`, (..., n, n)."""
        # Rates of joints and lines for the unit rate of coordinate i, in row i: L^T and L_lines^T.
        q_for_rates = self._configurations(q)[..., None, :]
        L_T = self.chain.joint_rates(q_for_rates, np.eye(self.chain.degrees_of_freedom))
        L_lines_T = self.chain.engine.line_rates(q_for_rates, L_T)
        if self.chain.mechanism.lines.pull_only.any():
            problem = "not defined with cables that only pull: they damp only where they are taut"
            raise InputError("damping", problem)
        # L^T diag(viscous) L, and the same for the lines.
        by_joints = (L_T * self.chain.friction.viscous) @ L_T.mT
        by_lines = (L_lines_T * self.chain.mechanism.lines.damping) @ L_lines_T.mT
        return by_joints + by_lines

    def torque_polygon(self, q: ArrayLike, limits: ArrayLike | None = None) -> Array:
        """The corners of all torques that the motors can give at the joints.

        Args:
            q: Configurations, shape (..., nq).
            limits: Largest torque of each motor of `motors`, shape (motors,), or least and
                largest, (motors, 2); by default `effortLimit` of the model.

        Returns:
            Shape (..., corners, joints): for one joint the least and the largest torque, for two
            the corners in order around the polygon, for more the corners of the convex hull. In a
            batch, the last corner is repeated where a polygon has fewer corners than others.

        Raises:
            InputError: Without `limits`, if a motor has none or does not drive one joint 1:1.
            SingularConfigurationError: Where the motors do not hold all joints.
        """
        from scipy.spatial import QhullError

        least_and_largest = self._limits(limits)  # of each motor
        corners = np.array(list(product(*least_and_largest)))
        at_joints = self.joint_torques(self._configurations(q)[..., None, :], corners)
        try:
            polygons = [hull(points) for points in at_joints.reshape(-1, *at_joints.shape[-2:])]
        except QhullError:
            raise SingularConfigurationError("the motors do not hold all joints", np.inf) from None
        # All have the same number of corners: shorter ones repeat the last corner.
        most = max(map(len, polygons), default=0)
        padded = []
        for polygon in polygons:
            missing = most - len(polygon)
            padded.append(np.pad(polygon, ((0, missing), (0, 0)), mode="edge"))
        return np.array(padded).reshape(*at_joints.shape[:-2], most, len(self.joints))

    def _limits(self, limits: ArrayLike | None) -> Array:
        """Least and largest torques of the motors, shape (motors, 2)."""
        if limits is not None:
            return limits_of(finite_array("limits", limits, ()), len(self.motors))
        # The model has limits of joints. A motor that drives one joint 1:1 has the same limits.
        B = self.chain.mechanism.actuation[:, self._motor_rows]
        is_direct = (np.count_nonzero(B, axis=0) == 1) & (np.abs(B).sum(axis=0) == 1)
        effort = np.abs(B).T @ self.chain.mechanism.model.effortLimit
        is_limited = (effort > 0) & (effort < np.finfo(float).max)
        if not (is_direct & is_limited).all():
            raise InputError("limits", "the model has no limits of these motors: give limits=")
        return np.column_stack([-effort, effort])

    def joint_gains(self, q: ArrayLike, gains: ArrayLike, tau: ArrayLike | None = None) -> Array:
        """Gains at the joints for gains of the motors: J^T k J, shape (..., joints, joints).

        Args:
            q: Configurations where the motors are at their set points, shape (..., nq).
            gains: Gains of the motors' position or rate loops, shape (motors,), or a matrix.
            tau: Torques that the motors hold there, shape (..., motors): they change the stiffness,
                since J depends on q. Only for position gains; by default no torques.

        Raises:
            InputError: For a wrong shape, or tau where a motor is on a line.
        """
        # With the joints at a distance dx from the set point, the motors give tau - k J dx. At the
        # joints this is J^T (tau - k J dx). The gain is minus the derivative of this by dx.
        J = self.actuator_jacobian(q)
        K = J.mT @ _matrix(gains, len(self.motors)) @ J
        return K if tau is None else K - self._slope(q, tau)

    def motor_gains(self, q: ArrayLike, gains: ArrayLike, tau: ArrayLike | None = None) -> Array:
        """Gains of the motors that give gains at the joints, shape (..., motors, motors).

        Off-diagonal gains couple the motors: a drive that controls only its own motor cannot
        realize them.

        Args:
            q: Configurations where the motors are at their set points, shape (..., nq).
            gains: At the joints, shape (joints,), or a matrix.
            tau: See `joint_gains`.

        Raises:
            InputError: See `joint_gains`.
        """
        # The inverse of `joint_gains`: K = J^T k J minus the slope of J^T tau.
        J_inverse = np.linalg.pinv(self.actuator_jacobian(q))
        K = _matrix(gains, len(self.joints))
        if tau is not None:
            K = K + self._slope(q, tau)
        return np.asarray(J_inverse.mT @ K @ J_inverse)

    def _slope(self, q: ArrayLike, tau: ArrayLike) -> Array:
        """Derivatives of J^T tau by the joints' positions, shape (..., joints, joints).

        They are the sum of tau_m H_m over the motors m. The matrix H_m has the derivatives of row m
        of J by the positions of the joints. It is symmetric, as the row has the first derivatives
        of the position of the motor. At constant rates x of the joints, the motor has the
        acceleration a_m(x) = x^T H_m x, Eq. (20). So the entries of H_m follow from accelerations,
        with unit vectors e_i:

            2 H_m[i, j] = a_m(e_i + e_j) - a_m(e_i) - a_m(e_j).
        """
        mechanism = self.chain.mechanism
        if mechanism.lines.actuation[:, self._motor_rows].any():
            raise InputError("tau", "not for motors on lines")
        k = len(self.joints)
        n = self.chain.degrees_of_freedom
        tau = finite_array("tau", tau, (len(self.motors),))
        # The rates e_i + e_j of the joints, for each pair i, j; other coordinates do not move.
        rates = np.zeros((k, k, n))
        rates[..., self._joint_columns] = np.eye(k)[:, None] + np.eye(k)
        q_for_pairs = self._configurations(q)[..., None, None, :]
        accelerations = self.chain.joint_accelerations(q_for_pairs, rates, np.zeros(n))
        # a_m(e_i + e_j), shape (..., i, j, m).
        a_of_sums = accelerations @ mechanism.actuation[:, self._motor_rows]
        # a_m(e_i), shape (..., i, m): the diagonal i = j has a_m(2 e_i) = 4 a_m(e_i).
        a_of_single = np.einsum("...iim->...im", a_of_sums) / 4
        H = (a_of_sums - a_of_single[..., :, None, :] - a_of_single[..., None, :, :]) / 2
        # The sum of tau_m H_m.
        return np.einsum("...ijm,...m->...ij", H, tau)


def _without_serial_bodies(chain: ClosedChain) -> pin.Model:
    """The model without the mass and armature of the bodies of the serial tree.

    The serial tree has each body whose supporting joints, from the base on, are all coordinates.
    The other bodies are those of the linkages: cranks, rods and rotors.
    """
    mechanism = chain.mechanism
    model = pin.Model(mechanism.model)
    coordinates = set(mechanism.coordinates.tolist())
    armature = model.armature.copy()
    for i in range(1, model.njoints):
        rates_of_supports = set[int]()
        for j in list(model.supports[i])[1:]:  # without the base
            joint = model.joints[j]
            rates_of_supports.update(range(joint.idx_v, joint.idx_v + joint.nv))
        if rates_of_supports <= coordinates:
            joint_of_body = model.joints[i]
            model.inertias[i] = pin.Inertia.Zero()
            armature[joint_of_body.idx_v : joint_of_body.idx_v + joint_of_body.nv] = 0
    model.armature = armature
    return model


def _mapped(matrices: NDArray[np.floating[Any]], name: str, vectors: ArrayLike) -> Array:
    """Matrices, shape (..., i, j), times vectors, shape (..., j), of the argument `name`."""
    array = finite_array(name, vectors, (matrices.shape[-1],))
    return np.einsum("...ij,...j->...i", matrices, array)


def _matrix(gains: ArrayLike, size: int) -> Array:
    """Gains, shape (size,) or (size, size), as a matrix."""
    matrix = finite_array("gains", gains, ())
    if matrix.shape == (size,):
        return np.diag(matrix)
    if matrix.shape != (size, size):
        raise InputError("gains", f"shape {matrix.shape}, expected ({size},) or ({size}, {size})")
    return matrix
