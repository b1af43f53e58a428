# SPDX-License-Identifier: BSD-2-Clause
"""Moves a frame of a closed chain from pose to pose: inverse kinematics along a path.

The closures and the wanted pose are one system of equations in all joints, M dq = -f, which
Newton's method solves. M has the rows of Phi and those of the frame's Jacobian J:

    M = [Phi; J].

The path goes from a configuration a to the next one, b, only if |M_a^+ (M_b - M_a)| <= 1/2. Then M
has full rank between them; see `loops/continuity.py`. So the frame stays in its *working mode*: the
branch of the inverse kinematics in which it is.

The same holds for a second matrix D = [Phi; S], where S v are the rates that determine the motion:
those of the *drives*, by default the coordinates. So the loops stay in their *assembly mode*: the
branch of the direct kinematics.

All matrices are free of units. `FrameGuide` moves the frame; `frame_configurations` is the inverse
kinematics of `ClosedChain`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, for_each_sample
from ..errors import InputError, SingularConfigurationError, SSTError, WorkspaceError
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE, RANK_TOLERANCE
from ..model.tree import frame_id
from .assembly import Assembly
from .continuity import CHANGE
from .loops import Loops
from .ranks import scaled_Phi

#: Most steps of Newton's method.
_STEPS = 12
#: Its longest step, [rad] or lengths of the loop.
_LONGEST = 0.5
#: A step of at most this size is the last one: the size of the next one is about its square.
_LAST = 1e-9
#: The same for a pose on the way, which is only approached. Near such a pose the steps become
#: shorter slowly, and it need not be exact.
_LAST_NEARBY = 1e-5
#: Largest error of R R^T for a rotation R: six digits are enough.
_NO_ROTATION = 1e-6
#: Weight of the closures in least squares where a pose is only approached. It is a choice: a frame
#: that misses its pose by 1e-2 opens the loops by about 1e-2 / _HEAVY^2 = 1e-10 then.
_HEAVY = 1e4
#: The next step along the path is such that the change is about this part of the limit `CHANGE`.
_AIM = 0.8
#: Without a solution, the next step is shorter by this factor. Both are choices; they change the
#: number of steps only.
_SHORTER = 0.4

#: A function that returns a matrix for a configuration.
MatrixOf = Callable[[Array], Array]


class Approach(NamedTuple):
    """The end of a motion to a pose, which may miss the pose."""

    #: The last configuration, shape (nq,).
    q: Array
    #: The distance left to the pose, [rad] or parts of the robot's length; 0 at the pose.
    missed: float
    #: Whether it ends where the drives do not determine the motion.
    singular: bool


class _Sample(NamedTuple):
    """A configuration, the pose of the frame there, and the matrices M and D there."""

    q: Array
    pose: pin.SE3
    M: Array
    D: Array


class _Anchor(NamedTuple):
    """The configuration a with which the next one, b, is compared, and its M_a^+ and D_a^+."""

    sample: _Sample
    M_inverse: Array
    #: None where the drives do not determine the motion.
    D_inverse: Array | None


class _FrameRows(NamedTuple):
    """Phi and J at a configuration, free of units, and the pose of the frame there."""

    Phi: Array
    J: Array
    pose: pin.SE3


class FrameGuide:
    """Moves a frame of a robot from pose to pose, in its working and assembly modes.

    Args:
        mechanism: The robot.
        generic: A configuration without symmetry, shape (nq,). The ranks of M and D there are those
            of regular configurations.
        frame: Name of the frame.
        position: Whether targets prescribe the position of the frame.
        orientation: Whether targets prescribe its orientation.
        drives: Returns S for q, shape (k, nv), free of units: S v are the rates that determine the
            motion. By default these are the rates of the coordinates.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        generic: Array,
        frame: str,
        position: bool,
        orientation: bool,
        drives: MatrixOf | None = None,
    ) -> None:
        self._mechanism = mechanism
        self._loops = Loops(mechanism.model, mechanism.closures)
        self._name = frame
        self._frame = frame_id(mechanism.model, frame)
        if drives is None:
            rows_of_coordinates = np.eye(mechanism.model.nv)[mechanism.coordinates]
            self._drives: MatrixOf = lambda _: rows_of_coordinates
        else:
            self._drives = drives
        self._position_counts = position
        self._orientation_counts = orientation
        #: Which components of a twist [linear; angular] targets prescribe, shape (6,).
        self._counts = np.repeat([position, orientation], 3)
        #: Units of these components: the length of the robot, [m], or 1 rad; shape (3,) or (6,).
        self._units = np.repeat([mechanism.length, 1.0], 3)[self._counts]
        sample = self._sample(generic)
        self._M_rank = _rank(sample.M)
        self._D_rank = _rank(sample.D)

    # --- motions ----------------------------------------------------------------------------

    def pose(self, q: Array) -> pin.SE3:
        """The placement of the frame in the base."""
        return self._rows(q).pose

    def follow(
        self, q: Array, target: pin.SE3, shortest: float = 2**-10, nearby: bool = False
    ) -> Approach:
        """Move the frame from a configuration with closed loops straight to a pose.

        The motion ends early where steps would be shorter than the fraction `shortest` of it. With
        `nearby`, poses on the way need not be reached exactly, as some frames cannot move in all
        directions. The target itself must be reached.
        """
        anchor = self._anchor(self._sample(q))
        start = anchor.sample.pose
        # Both are fractions of the motion: the part that is done, and the next step.
        done = 0.0
        step = 1.0
        singular = False  # whether the change of D, and not that of M, stopped the last step
        while done < 1 and step >= shortest:
            fraction = min(1.0, done + step)
            pose = _between(start, target, fraction)
            sample = self._solved(anchor.sample.q, pose, exact=fraction == 1 or not nearby)
            if sample is None:
                singular = False
                step *= _SHORTER
                continue
            M_change = _change(anchor.M_inverse, sample.M - anchor.sample.M)
            D_change = _change(anchor.D_inverse, sample.D - anchor.sample.D)
            singular = M_change <= CHANGE < D_change
            change = max(M_change, D_change)
            if change <= CHANGE:
                anchor = self._anchor(sample)
                done = fraction
            # The change is about proportional to the step. Where it is infinite, the step becomes
            # zero, and the motion ends.
            if change > 0:
                step *= min(2.0, _AIM * CHANGE / change)
            else:
                step *= 2.0
        end = anchor.sample
        if done == 1:
            return Approach(end.q, 0.0, singular=False)
        missed = float(np.abs(self._error(end.pose, target)).max())
        return Approach(end.q, missed, singular)

    def lead(self, q: Array, target: pin.SE3) -> Array:
        """The configuration where `follow` reaches a pose; an error if it ends before the pose."""
        end = self.follow(q, target, nearby=True)
        if end.missed:
            raise self._unreached(end, target)
        return end.q

    # --- at a configuration -----------------------------------------------------------------

    def _sample(self, q: Array) -> _Sample:
        rows = self._rows(q)
        M = np.vstack([rows.Phi, rows.J])
        D = np.vstack([rows.Phi, self._drives(q)])
        return _Sample(q, rows.pose, M, D)

    def _anchor(self, sample: _Sample) -> _Anchor:
        M_inverse = np.asarray(np.linalg.pinv(sample.M, RANK_TOLERANCE), dtype=float)
        if _rank(sample.D) < self._D_rank:
            return _Anchor(sample, M_inverse, None)
        return _Anchor(sample, M_inverse, np.asarray(np.linalg.pinv(sample.D, RANK_TOLERANCE)))

    def _rows(self, q: Array) -> _FrameRows:
        """Phi, and the rows of J that targets prescribe; the loops are evaluated at q."""
        mechanism = self._mechanism
        Phi = scaled_Phi(mechanism, self._loops, q)
        J = self._loops.frame_jacobian(self._frame)[self._counts]
        J = J / self._units[:, None] * mechanism.rate_scale
        return _FrameRows(Phi, J, self._loops.data.oMf[self._frame].copy())

    def _error(self, at: pin.SE3, target: pin.SE3) -> Array:
        """The components of `pose_error` that targets prescribe, free of units."""
        error = pose_error(at, target.translation, target.rotation)
        return np.asarray(error[self._counts] / self._units)

    # --- Newton's method --------------------------------------------------------------------

    def _solved(self, q: Array, target: pin.SE3, exact: bool) -> _Sample | None:
        """The sample near q with closed loops and the frame at its target; None if none is found.

        Unless `exact`, the frame is only as near to its target as it can be with closed loops: in
        the least squares, closures have a large weight. Steps of Newton's method must become
        shorter, else there is no result.
        """
        mechanism = self._mechanism
        rows_of_closures = len(mechanism.row_scale)
        weights = np.ones(rows_of_closures + len(self._units))
        last = _LAST
        if not exact:
            weights[:rows_of_closures] = _HEAVY
            last = _LAST_NEARBY
        longest = _LONGEST
        for _ in range(_STEPS):
            rows = self._rows(q)
            f_of_closures = self._loops.f * mechanism.row_scale
            f = np.concatenate([f_of_closures, -self._error(rows.pose, target)])
            weighted_M = np.vstack([rows.Phi, rows.J]) * weights[:, None]
            step = np.linalg.lstsq(weighted_M, -f * weights, rcond=RANK_TOLERANCE)[0]
            size = float(np.abs(step).max())
            if not size <= longest:  # NaN ends it too
                return None
            q = pin.integrate(mechanism.model, q, step * mechanism.rate_scale)
            longest = size
            if size <= last:
                # f is from before the last step, which has reduced it further.
                must_vanish = f if exact else f_of_closures
                if np.abs(must_vanish).max(initial=0.0) <= CLOSURE_TOLERANCE:
                    return self._sample(q)
                return None
        return None

    # --- errors -----------------------------------------------------------------------------

    def _unreached(self, end: Approach, target: pin.SE3) -> SSTError:
        """The error of a motion that ends before its target."""
        here = self._sample(end.q)
        error = pose_error(here.pose, target.translation, target.rotation)
        distances = list[str]()
        if self._position_counts:
            distances.append(f"{np.linalg.norm(error[:3]):.3g} m")
        if self._orientation_counts:
            distances.append(f"{np.linalg.norm(error[3:]):.3g} rad")
        problem = (
            f"frame {self._name} does not reach the pose: it misses it by {' and '.join(distances)}"
        )
        if end.singular:
            return SingularConfigurationError(
                f"{problem}; the motion ends where the coordinates cannot move in all directions; "
                "start elsewhere",
                _condition(here.D, self._D_rank),
            )
        if _rank(here.M) < self._M_rank:
            return SingularConfigurationError(
                f"{problem}; the motion ends where the frame cannot move in all directions; start "
                "elsewhere",
                _condition(here.M, self._M_rank),
            )
        if not self._can_move_towards(here, target):
            return WorkspaceError(f"{problem}, in a direction in which it has too few freedoms")
        return WorkspaceError(
            f"{problem}; it is out of reach, or behind a singular configuration on the straight "
            "path; start closer to it"
        )

    def _can_move_towards(self, here: _Sample, target: pin.SE3) -> bool:
        """Whether M v = [0; error] has a solution: Phi v = 0 moves the frame to the target."""
        wanted = self._error(here.pose, target)
        at_rest = np.zeros(len(here.M) - len(wanted))
        right = np.concatenate([at_rest, wanted])
        v = np.linalg.lstsq(here.M, right, rcond=RANK_TOLERANCE)[0]
        missing = right - here.M @ v
        # The bound is a choice, far above rounding and far below a direction that is missing.
        bound = np.sqrt(RANK_TOLERANCE) * np.abs(wanted).max()
        return bool(np.abs(missing).max() <= bound)


def _between(start: pin.SE3, target: pin.SE3, fraction: float) -> pin.SE3:
    """The pose at a fraction of the path from start to target, which turns about one axis."""
    p = start.translation + fraction * (target.translation - start.translation)
    turn = pin.log3(start.rotation.T @ target.rotation)
    return pin.SE3(start.rotation @ pin.exp3(fraction * turn), p)


def _change(inverse: Array | None, difference: Array) -> float:
    """|M_a^+ (M_b - M_a)|, Frobenius norm; infinite without an inverse of M_a."""
    return np.inf if inverse is None else float(np.linalg.norm(inverse @ difference))


def _rank(M: Array) -> int:
    """Rank of a matrix that is free of units."""
    return int(np.linalg.matrix_rank(M, rtol=RANK_TOLERANCE))


def _condition(M: Array, rank: int) -> float:
    """Condition number of a matrix that has this rank at regular configurations."""
    sizes = np.linalg.svd(M, compute_uv=False)
    return float(sizes[0] / max(sizes[rank - 1], 1e-300))


# --- frame_configuration ------------------------------------------------------------------------


def frame_configurations(
    assembly: Assembly,
    generic: Array,
    frame: str,
    position: ArrayLike | None,
    rotation: ArrayLike | None,
    start: ArrayLike,
) -> Array:
    """`ClosedChain.frame_configuration`, shape (..., nq), by the motion of a frame from a start.

    `generic` is that of `FrameGuide`. The starts, shape (..., nq), may have open loops.
    """
    if position is None and rotation is None:
        raise InputError("position", "give a position, a rotation, or both")
    mechanism = assembly.mechanism
    p = None if position is None else finite_array("position", position, (3,))
    R = None if rotation is None else rotations("rotation", rotation)
    guide = FrameGuide(mechanism, generic, frame, p is not None, R is not None)
    size = (mechanism.model.nq,)
    q = finite_array("start", start, size)

    def configuration(q: Array, p: Array | None, R: Array | None) -> Array:
        return guide.lead(q, pose_of(p, R))

    closed = for_each_sample(assembly.closed, [q], (1,), size)
    return for_each_sample(configuration, [closed, p, R], (1, 1, 2), size)


def rotations(name: str, value: ArrayLike) -> Array:
    """The argument `name` as rotation matrices, shape (..., 3, 3); an error for other matrices."""
    R = finite_array(name, value, (3, 3))
    gap = np.abs(R @ R.mT - np.eye(3)).max(initial=0.0)
    if gap > _NO_ROTATION or (np.linalg.det(R) < 0).any():
        raise InputError(name, "not all are rotation matrices")
    return R


def pose_of(position: Array | None, R: Array | None) -> pin.SE3:
    """A pose of these components; without one the position is zero, or the axes are the base's."""
    return pin.SE3(np.eye(3) if R is None else R, np.zeros(3) if position is None else position)


def pose_error(at: pin.SE3, position: Array | None, R: Array | None) -> Array:
    """The displacement from a pose to a target, in base axes, [m] and [rad], shape (3,) or (6,).

    It has [linear; angular] parts, without that of a component that is None.
    """
    parts = list[Array]()
    if position is not None:
        parts.append(position - at.translation)
    if R is not None:
        parts.append(at.rotation @ pin.log3(at.rotation.T @ R))
    return np.concatenate(parts)
