# SPDX-License-Identifier: BSD-2-Clause
"""`EngineArguments`: checks the arguments of an engine's methods."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .arrays import Array, as_array, finite_array, for_each_sample, require_policy
from .dynamics.design_derivatives import FrameWrenches
from .errors import InputError
from .loops.closed_loops import ClosedLoops
from .model.mechanism import Mechanism
from .model.normal_tree import NormalTree
from .model.tree import body_of, frame_id
from .summaries import listed

#: External wrenches: [force; moment] on all bodies at their mass centres, shape (..., r, 6), or a
#: mapping from names of frames to [force; moment] at their origins, shapes (..., 6).
Wrenches = ArrayLike | Mapping[str, ArrayLike]


class _TreeOfThread(threading.local):
    """The normal tree of a model, and its data, which Pinocchio changes: one for each thread."""

    def __init__(self, model: pin.Model) -> None:
        self.tree = NormalTree(model)
        self.data = self.tree.model.createData()


def _finite_loads(name: str, value: ArrayLike, shape: tuple[int, ...], on_error: str) -> Array:
    """Loads, shape (..., *shape); samples that are not finite are refused or, for "nan", NaN."""
    require_policy(on_error)
    if on_error != "nan":
        return finite_array(name, value, shape)
    array = as_array(name, value, shape)
    axes = tuple(range(-len(shape), 0))
    return np.where(np.isfinite(array).all(axis=axes, keepdims=True), array, np.nan)


class EngineArguments:
    """Turns arguments into arrays of the shapes of a mechanism, or refuses them.

    Args:
        mechanism: The mechanism.
        loops: Its loops.
        platform: Name of the frame whose body a `platform_moment` acts on.
    """

    def __init__(self, mechanism: Mechanism, loops: ClosedLoops, platform: str) -> None:
        self._mechanism = mechanism
        self._loops = loops
        self._platform = platform

    def state(self, q: ArrayLike, **others: ArrayLike) -> list[Array]:
        """q, shape (..., nq), then the others in their order.

        `tau` has shape (..., motors); all others, such as `va` and `aa`, have shape (..., n).
        """
        mechanism = self._mechanism
        if not len(mechanism.coordinates):
            self._require_rest(others)
        arrays = [as_array("q", q, (mechanism.model.nq,))]
        for name, value in others.items():
            if name == "tau":
                arrays.append(as_array(name, value, (mechanism.motor_count,)))
            else:
                arrays.append(self._of_coordinates(name, value))
        return arrays

    def _require_rest(self, others: Mapping[str, ArrayLike]) -> None:
        """Check that a robot without coordinates is at rest: its va and aa have to be empty.

        If it was never assembled (`example` is None), it is refused at rest too.
        """
        mechanism = self._mechanism
        moves = any(np.size(value) for name, value in others.items() if name != "tau")
        if moves or mechanism.example is None:
            mechanism.require_freedom()

    def _of_coordinates(self, name: str, value: ArrayLike) -> Array:
        """A number for each rate of the coordinates, shape (..., n)."""
        mechanism = self._mechanism
        n = len(mechanism.coordinates)
        try:
            return as_array(name, value, (n,))
        except InputError as error:
            if n != mechanism.motor_count:
                # The caller may have given a number for each motor. So the message says more.
                names = listed(mechanism.coordinate_rate_names)
                error.args = (
                    f"{error.args[0]}: one for each rate of the coordinates {names}; in another "
                    "assembly make it home, or use chain.with_coordinates([...])",
                )
            raise

    # --- loads ------------------------------------------------------------------------------

    def wrenches(
        self,
        platform_moment: ArrayLike | None,
        external_wrenches: Wrenches | None,
        on_error: str,
        q: ArrayLike | None = None,
    ) -> Array | None:
        """Wrenches on all bodies, shape (..., r, 6); None if there are no loads.

        The platform's moment is added to the wrench on its body. Wrenches at frames need the
        configurations q. Numbers that are not finite are refused here: kernels leave out wrenches
        that do no work, so NaN would not reach their results.
        """
        if platform_moment is None and external_wrenches is None:
            return None
        model = self._mechanism.model
        shape = model.njoints - 1, 6
        wrenches = None
        if isinstance(external_wrenches, Mapping):
            wrenches = self._at_mass_centres(external_wrenches, q, on_error)
        elif external_wrenches is not None:
            wrenches = _finite_loads("external_wrenches", external_wrenches, shape, on_error)
        if platform_moment is None:
            return wrenches
        body = body_of(model, self._platform)
        if body is None:
            problem = f'the robot has no body with a frame "{self._platform}"'
            raise InputError("platform_moment", f"{problem}; use external_wrenches=")
        moment = _finite_loads("platform_moment", platform_moment, (3,), on_error)
        on_platform = np.zeros((*moment.shape[:-1], *shape))
        on_platform[..., body, 3:] = moment
        return on_platform if wrenches is None else on_platform + wrenches

    def _at_mass_centres(
        self, wrenches: Mapping[str, ArrayLike], q: ArrayLike | None, on_error: str
    ) -> Array:
        """Wrenches at frames as wrenches on all bodies at their mass centres, shape (..., r, 6)."""
        if q is None:
            raise InputError(
                "external_wrenches",
                "wrenches at frames change with the pose at the mass centres, and are not possible "
                "here; give an array of wrenches on the bodies at their mass centres",
            )
        count = self._mechanism.model.njoints - 1
        on_bodies = np.zeros((count, 6))
        for name, value in wrenches.items():
            body, wrench = self.at_frame(name, value, on_error)
            force = wrench[..., :3]
            moment = wrench[..., 3:]
            arm = self.arms(name, q)  # from the mass centre to the frame
            try:
                moment_at_centre = moment + np.cross(arm, force)
            except ValueError:
                problem = f"shape {wrench.shape} does not fit q of shape {np.shape(q)}"
                raise InputError(f"external_wrenches[{name!r}]", problem) from None
            on_one_body = np.zeros((*moment_at_centre.shape[:-1], count, 6))
            on_one_body[..., body, :3] = force
            on_one_body[..., body, 3:] = moment_at_centre
            try:
                on_bodies = on_bodies + on_one_body
            except ValueError:
                problem = "wrenches of several frames have batches of different shapes"
                raise InputError("external_wrenches", problem) from None
        return on_bodies

    def frame_wrenches(self, wrenches: Wrenches | None) -> FrameWrenches | None:
        """Wrenches at frames with their bodies; None if wrenches are not given at frames."""
        if not isinstance(wrenches, Mapping) or not wrenches:
            return None
        bodies = []
        values = []
        for name, value in wrenches.items():
            body, wrench = self.at_frame(name, value, "raise")
            bodies.append(body)
            values.append(wrench)
        stacked = np.stack(np.broadcast_arrays(*values), axis=-2)  # (..., frames, 6)
        return FrameWrenches(frames=list(wrenches), bodies=bodies, wrenches=stacked)

    def at_frame(self, name: str, value: ArrayLike, on_error: str) -> tuple[int, Array]:
        """The index of a frame's body, from 0, and the checked wrench `value`, shape (..., 6)."""
        argument = f"external_wrenches[{name!r}]"
        wrench = _finite_loads(argument, value, (6,), on_error)
        frame_id(self._mechanism.model, name)  # refuses unknown names
        body = body_of(self._mechanism.model, name)
        if body is None:
            raise InputError(
                argument, "the frame is fixed to the base, where a wrench does no work"
            )
        return body, wrench

    @cached_property
    def _tree_of_thread(self) -> _TreeOfThread:
        return _TreeOfThread(self._mechanism.model)

    def arms(self, name: str, q: ArrayLike) -> Array:
        """Vectors from the mass centre of a frame's body to the frame, in base axes, (..., 3).

        q is not checked here. Open loops and wrong quaternions are found where the quantity itself
        is computed.
        """
        model = self._mechanism.model
        tree = self._tree_of_thread.tree
        data = self._tree_of_thread.data
        index = frame_id(model, name)
        frame = model.frames[index]
        # In axes of the parent joint, which are also those of its body in the normal tree.
        from_centre = frame.placement.translation - model.inertias[frame.parentJoint].lever
        body = tree.bodies[frame.parentJoint]

        def arm(q: Array) -> Array:
            pin.forwardKinematics(tree.model, data, q)
            return np.asarray(data.oMi[body].rotation @ from_centre)

        on_tree = tree.configurations(self._loops.configurations(q))
        return for_each_sample(arm, [on_tree], (1,), (3,))
