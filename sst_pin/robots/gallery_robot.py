# SPDX-License-Identifier: BSD-2-Clause
"""`GalleryRobot`: a closed chain with a platform that can be placed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, finite_array, for_each_sample, positive_number
from ..closed_chain import ClosedChain
from ..errors import InputError, WorkspaceError
from ..model.closures import Closure, Distance
from ..model.lines import LineForce
from ..model.thresholds import CLOSURE_TOLERANCE
from ..model.tree import frame_id, joint_id
from .building_blocks import Tree
from .joint_shapes import joint_shapes

#: Coordinates of joints by name: a number, or several of a joint with several coordinates.
Joints = dict[str, Any]
_Build = TypeVar("_Build", bound=Callable[..., "GalleryRobot"])


def of_dimensions(build: _Build) -> _Build:
    """Decorator of a gallery function: keyword numbers must be positive, else an InputError."""
    defaults = {name: p.default for name, p in signature(build).parameters.items()}

    @wraps(build)
    def checked(*args: Any, **dimensions: Any) -> GalleryRobot:
        for name, value in dimensions.items():
            if type(defaults.get(name)) in (int, float):
                positive_number(name, value)
        return build(*args, **dimensions)

    return checked  # type: ignore[return-value]  # it has the parameters of `build`


class GalleryRobot(ClosedChain):
    """A robot of the gallery: a closed chain with shapes and a platform, its frame "platform".

    Args:
        tree: The tree and its shapes.
        closures: Its closures; none for a tree.
        actuated: Names of the motors' joints.
        joints: Inverse kinematics in closed form: coordinates of all joints for a pose of the
            platform; NaN where it is out of reach.
        home: A pose of the platform where the robot is regular.
        point: Whether the platform is a point, so that its orientation does not count.
        lines: Springs and dampers between two frames.

    Raises:
        WorkspaceError: When the loops do not close at home.
    """

    def __init__(
        self,
        tree: Tree,
        closures: Sequence[Closure | Distance],
        actuated: Sequence[str],
        joints: Callable[[pin.SE3], Joints],
        home: pin.SE3,
        *,
        point: bool = False,
        lines: Sequence[LineForce] = (),
    ) -> None:
        self._tree = tree.model
        self._shapes = tree.visual_model
        self._closed_form = joints
        self._is_point = point
        problem = f"{tree.model.name}: with these dimensions the loops do not close at home"
        # The model must have its home before the closed chain is made of it.
        q = self._configuration(home)
        if not np.isfinite(q).all():
            raise WorkspaceError(problem)
        tree.model.referenceConfigurations["home"] = pin.normalize(tree.model, q)
        super().__init__(tree.model, closures, actuated, lines=lines)
        for shape in joint_shapes(tree.model, tree.visual_model, closures, actuated):
            tree.visual_model.addGeometryObject(shape)
        try:
            self.inverse_kinematics(home)  # it checks that the loops close
        except (InputError, WorkspaceError):
            raise WorkspaceError(problem) from None

    def inverse_kinematics(self, pose: pin.SE3 | ArrayLike) -> Array:
        """Inverse kinematics: the configuration for a pose of the platform, in the mode of `home`.

        Args:
            pose: Pose of the platform in the base: `pinocchio.SE3`, or matrices, (..., 4, 4).

        Returns:
            Closed configurations, shape (..., nq).

        Raises:
            InputError: For a wrong shape or a number that is not finite.
            WorkspaceError: If the platform cannot reach the pose.

        Example:
            >>> chain = sst_pin.robots.delta()
            >>> pose = chain.platform_pose(chain.home)
            >>> bool(np.allclose(chain.inverse_kinematics(pose), chain.home))
            True
        """
        matrices = pose.homogeneous if isinstance(pose, pin.SE3) else pose
        poses = finite_array("pose", matrices, (4, 4))

        return for_each_sample(self._checked_configuration, (poses,), (2,), (self._tree.nq,))

    def _checked_configuration(self, pose: Array) -> Array:
        """The configuration for one pose, a homogeneous matrix, if the robot reaches the pose."""
        q = self._configuration(pin.SE3(pose))
        if not np.isfinite(q).all():
            raise WorkspaceError("the pose of the platform is out of reach")
        q = self.mechanism.space.normalised(q)
        loops = self.engine.loops.at(q)
        openings = np.abs(loops.f)
        errors = np.abs(self._pose_in(loops.data) - pose)
        if self._is_point:
            errors[:3, :3] = 0.0  # its orientation does not count
        # Errors and openings are compared free of units: lengths in units of the robot's length.
        units = np.ones((4, 4))
        units[:3, 3] = self.mechanism.length
        largest_error = (errors / units).max()
        largest_opening = (openings * self.mechanism.row_scale).max(initial=0.0)
        if max(largest_error, largest_opening) > CLOSURE_TOLERANCE:
            raise WorkspaceError(
                f"the platform cannot reach this pose: its error would be {errors.max():.3g} and "
                f"the loops open by {openings.max(initial=0.0):.3g} (m or rad); "
                "platform_pose(q) gives poses that it can reach"
            )
        return q

    def platform_pose(self, q: ArrayLike) -> Array:
        """Poses of the platform in the base, homogeneous matrices of shape (..., 4, 4).

        Args:
            q: Joint coordinates, shape (..., nq).

        Example:
            >>> chain = sst_pin.robots.delta()
            >>> chain.platform_pose(chain.home)[:3, 3].round(3)
            array([ 0.   ,  0.   , -0.232])
        """
        configurations = finite_array("q", q, (self._tree.nq,))
        return for_each_sample(self._pose, (configurations,), (1,), (4, 4))

    def _configuration(self, pose: pin.SE3) -> Array:
        """The configuration by the closed-form inverse kinematics; NaN out of reach."""
        q: Array = pin.neutral(self._tree)
        with np.errstate(invalid="ignore"):  # the arccosine of a ratio above 1 is NaN
            coordinates = self._closed_form(pose)
        for name, value in coordinates.items():
            joint = self._tree.joints[joint_id(self._tree, name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = value
        return q

    def _pose(self, q: Array) -> Array:
        """Pose of the platform, whether the loops are closed or not."""
        return self._pose_in(self.engine.loops.at(q).data)

    def _pose_in(self, data: pin.Data) -> Array:
        """Pose of the platform in data with the placements of all frames."""
        return np.asarray(data.oMf[frame_id(self._tree, "platform")].homogeneous)
