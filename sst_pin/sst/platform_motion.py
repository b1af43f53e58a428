# SPDX-License-Identifier: BSD-2-Clause
"""Motions of the star: by the paper's angles, along its circle, through samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, empty, finite_array, whole_number
from ..errors import InputError
from ..model.joint_space import without_sign_changes
from ..simulation.samples import sample_times, spline, times_within
from .kinematics import require_rotation

#: Neighbours on a path differ by more than this angle, and by less than half a turn minus this
#: angle, [rad]. Otherwise the axis of the turn from one to the next is inexact.
_LEAST_STEP = 1e-6


class PlatformMotion(NamedTuple):
    """A motion of the star; the arguments of `SST.joint_motion`.

    Attributes:
        R: {E} in the base, shape (N, 3, 3).
        omega: Angular velocity, base axes, shape (N, 3), [rad/s].
        alpha: Angular acceleration, base axes, shape (N, 3), [rad/s^2].
    """

    R: Array
    omega: Array
    alpha: Array


def orientation(theta: ArrayLike, phi: ArrayLike, psi: ArrayLike = 0.0) -> Array:
    """Orientation of the star, {E} in the base, from the paper's angles (Fig. 4).

    Args:
        theta: Longitude of E, shape (...), [rad].
        phi: Colatitude of E, shape (...), [rad].
        psi: Roll about s, shape (...), [rad]; zero if arc 1 is in the meridian plane through z_0.

    Returns:
        R, shape (..., 3, 3).

    Example:
        >>> sst_pin.sst.orientation(theta=0.0, phi=np.pi / 2).round(3)
        array([[ 1., -0.,  0.],
               [ 0.,  0., -1.],
               [ 0.,  1.,  0.]])
    """
    R, _, _ = orientation_motion((theta, 0.0, 0.0), (phi, 0.0, 0.0), (psi, 0.0, 0.0))
    return R


def orientation_motion(
    theta: Sequence[ArrayLike], phi: Sequence[ArrayLike], psi: Sequence[ArrayLike]
) -> PlatformMotion:
    """Orientation, angular velocity and acceleration of the star from the paper's angles.

    Args:
        theta: Longitude, its rate and its acceleration, each of shape (...), [rad].
        phi: Colatitude, its rate and its acceleration.
        psi: Roll, its rate and its acceleration.

    Raises:
        InputError: If one is not three arrays of finite numbers, or shapes do not broadcast.
    """
    angles = []
    for name, value in (("theta", theta), ("phi", phi), ("psi", psi)):
        try:
            angle, rate, acceleration = value
        except (TypeError, ValueError):
            raise InputError(name, "not an angle, its rate and its acceleration") from None
        angles += [finite_array(name, part, ()) for part in (angle, rate, acceleration)]
    try:
        values = np.broadcast_arrays(*angles)
    except ValueError:
        shapes = ", ".join(str(angle.shape) for angle in angles[::3])
        raise InputError("theta, phi, psi", f"shapes {shapes} do not broadcast") from None
    # Each angle with its first and second derivative by time.
    theta_0, theta_1, theta_2 = values[0:3]
    phi_0, phi_1, phi_2 = values[3:6]
    psi_0, psi_1, psi_2 = values[6:9]
    zero = np.zeros_like(theta_0)
    one = np.ones_like(theta_0)
    sin_theta = np.sin(theta_0)
    cos_theta = np.cos(theta_0)
    sin_phi = np.sin(phi_0)
    cos_phi = np.cos(phi_0)

    # {E} = Rot(z, theta) Rot(x, pi/2) Rot(z, pi/2 - phi) Rot(x, psi): leg 1 with mu_1 = pi/2. The
    # angles turn about z, about the horizontal axis -n, and about s. The columns of R are s, y and
    # n, with y and n turned by psi about s.
    z = np.stack([zero, zero, one], -1)
    n = np.stack([sin_theta, -cos_theta, zero], -1)
    s = np.stack([sin_phi * cos_theta, sin_phi * sin_theta, cos_phi], -1)
    y = np.cross(n, s)
    cos_psi = np.cos(psi_0)[..., None]
    sin_psi = np.sin(psi_0)[..., None]
    R = np.stack([s, cos_psi * y + sin_psi * n, cos_psi * n - sin_psi * y], -1)

    # The angular velocity is the sum of the rotations about the three axes.
    about_z = theta_1[..., None] * z
    about_n = -phi_1[..., None] * n
    about_s = psi_1[..., None] * s
    omega = about_z + about_n + about_s
    # Its derivative: n turns with about_z, so n_dot = about_z x n, and s turns with about_z and
    # about_n.
    alpha = theta_2[..., None] * z - phi_2[..., None] * n + psi_2[..., None] * s
    alpha = alpha + np.cross(about_z, about_n) + np.cross(about_z + about_n, about_s)
    return PlatformMotion(R, omega, alpha)


def paper_circle(t: ArrayLike) -> PlatformMotion:
    """The motion of Sect. 7.2: E moves along a circle, one turn in pi/6 s, with psi = 0.

    Args:
        t: Times, shape (...), [s].

    Example:
        >>> R, omega, alpha = sst_pin.paper_circle(0.0)
        >>> R[:, 0].round(4)  # s
        array([0.6814, 0.6814, 0.2674])
    """
    time = finite_array("t", t, ())
    # s = (a cos 12t + b sin 12t + c) / 71, and its first and second derivative s_1 and s_2.
    a = np.array((4, 4, -8)) * np.sqrt(6)
    b = np.array((-12, 12, 0)) * np.sqrt(2)
    c = np.sqrt(13395) / 3 * np.ones(3)
    rate = 12.0
    cos = np.cos(rate * time)[..., None]
    sin = np.sin(rate * time)[..., None]
    s = (a * cos + b * sin + c) / 71
    s_1 = rate * (b * cos - a * sin) / 71
    s_2 = -(rate**2) * (a * cos + b * sin) / 71

    # The longitude theta of s = (x, y, z), with tan(theta) = y / x. Its rate is
    # (x y_1 - y x_1) / h with h = x^2 + y^2, whose rate is 2 (x x_1 + y y_1).
    x, y, z = np.moveaxis(s, -1, 0)
    x_1, y_1, z_1 = np.moveaxis(s_1, -1, 0)
    x_2, y_2, z_2 = np.moveaxis(s_2, -1, 0)
    h = x * x + y * y
    theta_1 = (x * y_1 - y * x_1) / h
    theta_2 = (x * y_2 - y * x_2) / h - 2 * theta_1 * (x * x_1 + y * y_1) / h
    # The colatitude phi, with z = cos(phi): z_1 = -sin(phi) phi_1, and
    # z_2 = -sin(phi) phi_2 - cos(phi) phi_1^2.
    sin_phi = np.sqrt(1 - z * z)
    phi_1 = -z_1 / sin_phi
    phi_2 = -z_2 / sin_phi - z * phi_1**2 / sin_phi
    return orientation_motion(
        (np.arctan2(y, x), theta_1, theta_2), (np.arccos(z), phi_1, phi_2), (0.0, 0.0, 0.0)
    )


def interpolate_orientations(t: ArrayLike, R: ArrayLike, at: ArrayLike) -> PlatformMotion:
    """A smooth motion through sampled orientations.

    It is a spline of degree five through the unit quaternions, normalized to unit length. The
    result does not depend on the choice of axes. Derivatives are continuous up to the fourth.

    Args:
        t: Sample times, increasing, shape (N,), N >= 3, [s].
        R: {E} in the base at these times, shape (N, 3, 3).
        at: Times of the output, within the samples, shape (M,), [s].

    Raises:
        InputError: For matrices that are not rotations, for times outside the samples, or if two
            neighbouring samples differ by more than a quarter turn.

    Example:
        >>> R = sst_pin.sst.orientation([0.7, 0.8, 0.9], 0.9)
        >>> motion = sst_pin.sst.interpolate_orientations([0, 0.5, 1], R, np.linspace(0, 1, 11))
        >>> motion.omega.shape
        (11, 3)
    """
    from scipy.spatial.transform import Rotation

    times = sample_times(t, 3)
    t_out = times_within("at", at, times)
    matrices = finite_array("R", R, (3, 3))
    if matrices.shape[:-2] != times.shape:
        raise InputError("R", f"shape {matrices.shape}, expected {(len(times), 3, 3)}")
    require_rotation(matrices)
    samples = Rotation.from_matrix(matrices)
    steps = (samples[:-1].inv() * samples[1:]).magnitude()
    if steps.max() > np.pi / 2:
        i = int(np.argmax(steps > np.pi / 2))
        raise InputError(
            "R",
            f"{np.degrees(steps[i]):.0f} degrees between the samples at t = {times[i]:g} and "
            f"{times[i + 1]:g} s, more than a quarter turn; use more samples",
        )
    curve = spline(times, without_sign_changes(samples.as_quat()))
    p = curve(t_out)
    inverse = p * (-1, -1, -1, 1) / (p * p).sum(axis=-1, keepdims=True)
    # The quaternion p_dot p^-1 has the vector w = omega / 2. Its scalar a is the rate of ln |p|,
    # which does not turn the star.
    first = _times(curve.derivative(1)(t_out), inverse)
    omega = 2 * first[..., :3]
    a = first[..., 3:]
    # p_ddot p^-1 = d/dt(p_dot p^-1) + (p_dot p^-1)^2 has the vector w_dot + 2 a w.
    second = _times(curve.derivative(2)(t_out), inverse)
    alpha = 2 * second[..., :3] - 2 * a * omega
    return PlatformMotion(Rotation.from_quat(p).as_matrix(), omega, alpha)


def orientation_path(R: ArrayLike, count: int = 201) -> Array:
    """Orientations along a smooth path through samples, on the rotation group.

    Angular velocity and acceleration are continuous (SciPy's `RotationSpline`), and the speed is
    about constant. `robot.inverse_kinematics` makes it a path for `time_optimal`.

    Args:
        R: Samples of {E} in the base, shape (N, 3, 3), N >= 2, steps less than half a turn.
        count: Number of samples of the path, evenly spaced.

    Returns:
        Orientations, shape (count, 3, 3), from the first R to the last.

    Raises:
        InputError: For matrices that are not rotations, or neighbours equal or half a turn apart.
    """
    from scipy.spatial.transform import Rotation, RotationSpline

    matrices = finite_array("R", R, (3, 3))
    outputs = whole_number("count", count, 2)
    if matrices.ndim != 3 or len(matrices) < 2:
        raise InputError("R", f"shape {matrices.shape}, expected (N, 3, 3) with N >= 2")
    require_rotation(matrices)
    rotations = Rotation.from_matrix(matrices)
    steps = (rotations[:-1].inv() * rotations[1:]).magnitude()
    for i, step in enumerate(steps):
        if not _LEAST_STEP < step < np.pi - _LEAST_STEP:
            raise InputError("R", f"{np.degrees(step):.6g} degrees between samples {i} and {i + 1}")
    # The parameter of the path is the angle turned since the first sample.
    angle = np.append(0, np.cumsum(steps))
    path = empty((outputs, 3, 3))  # refuses a number that memory does not hold
    angles_of_outputs = np.linspace(0, angle[-1], outputs)
    path[:] = RotationSpline(angle, rotations)(angles_of_outputs).as_matrix()
    return path


def _times(p: Array, q: Array) -> Array:
    """Product of quaternions (x, y, z, w), shapes (..., 4)."""
    u = p[..., :3]  # the vector of p
    a = p[..., 3:]  # its scalar
    v = q[..., :3]
    b = q[..., 3:]
    scalar = a * b - (u * v).sum(axis=-1, keepdims=True)
    return np.concatenate([a * v + b * u + np.cross(u, v), scalar], axis=-1)
