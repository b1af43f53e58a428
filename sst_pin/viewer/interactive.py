# SPDX-License-Identifier: BSD-2-Clause
"""A page that answers: sliders that move a closed robot (viser).

Meshcat's Python side hears nothing from its page. viser's does, so the kinematics and dynamics of
the page are those of the package.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, redirect_stdout
from http import HTTPStatus
from io import StringIO
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ..chain.appearance import Sliders
from ..chain.closed_chain import ClosedChain
from ..errors import MissingExtraError, ServerError, SSTError
from .hosts import is_ours, listen, url_of
from .jog import Jog, Pose
from .panel_curves import motor_units
from .robot_scene import Scene
from .scene_parts import Shape, decompose
from .warnings import warnings_of

try:
    import viser
    import websockets.asyncio.server
except ImportError:
    raise MissingExtraError("viser", "interactive") from None

Array = NDArray[np.float64]

_PORT = 8080
#: Vertical field of view of the camera, [rad].
_FIELD = np.radians(24)
#: Units of the sliders and their factors; the step.
_SHOWN, _STEP = {"rad": ("deg", 180 / np.pi), "m": ("mm", 1e3)}, 0.1


class Interactive:
    """A page with sliders; its server runs until `close` or the end of the `with` block.

    Attributes:
        url: Address of the page.
        q: The configuration shown, shape (nq,).

    Args:
        robot: Any closed chain. Its sliders are its coordinates, within the limits of the joints
            where there are any; an SST has those of its star, too.
        host: Address to listen on, by default this machine alone.
        port: 0 for 8080, or the next one that is free.
        visual_model: Shapes to be drawn instead of `robot.visual_model`; an empty
            `pinocchio.GeometryModel()` gives the skeleton.
        axes: Whether the joints' axes are shown at first.
        frames: Whether frames are shown at first.

    Raises:
        InputError: If the robot is not a ClosedChain.
        MissingExtraError: Without viser.
        ServerError: When nothing can listen there.

    Example:
        >>> from sst_pin.viewer.interactive import Interactive
        >>> with Interactive(chain, port=0) as page:
        ...     page.url.startswith("http://127.0.0.1:")
        True
    """

    def __init__(
        self,
        robot: ClosedChain,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        visual_model: pin.GeometryModel | None = None,
        axes: bool = False,
        frames: bool = False,
    ) -> None:
        self._robot = robot
        self._scene = scene = Scene(robot, visual_model, axes=axes, frames=frames)
        self._jog = Jog(robot, scene.start, scene.size)
        self._units = motor_units(robot)
        self._busy, self._wishes = threading.Lock(), 0
        for tried in listen(host, port):  # viser would go on trying for ever
            tried.close()
        with _guarded_requests(host), _silence():
            self._server = viser.ViserServer(host, port or _PORT, verbose=False)
        self.url = url_of(host, self._server.get_port())
        self.q = scene.start
        # The largest arrow: the robot's weight, half of it for a torque, on the robot's length.
        gravity = np.linalg.norm(robot.mechanism.model.gravity.linear)
        weight = float(sum(i.mass for i in robot.mechanism.model.inertias) * gravity) or 1.0
        lever = scene.size / 2
        self._largest = np.array([weight * (lever if u == "N m" else 1) for u in self._units])
        try:
            self._draw_scene()
            self._add_controls()
            self._show(Pose(self.q))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop listening."""
        with _silence():
            self._server.stop()

    def __enter__(self) -> Interactive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- inside -----------------------------------------------------------------------------

    def _draw_scene(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)  # takes seconds where there is no graphics card
        scene.add_light_ambient("/light", intensity=1.5)
        seen = self._scene.reach(self.q[None], np.ones((1, len(self._units))))
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        radius = float(np.linalg.norm(seen - middle, axis=1).max()) or 1.0
        camera = self._server.initial_camera
        camera.look_at, camera.fov = middle, _FIELD
        towards = np.array((1.0, 0.7, 0.6)) / np.linalg.norm((1.0, 0.7, 0.6))
        distance = 1.15 * radius / np.sin(_FIELD / 2)
        camera.position = middle + distance * towards
        camera.near, camera.far = distance / 100, 100 * distance
        self._movers = {
            mover: scene.add_frame(f"/{mover}", show_axes=False)
            for mover in self._scene.poses(self.q)
        }
        self._layers: dict[str, list[Any]] = {name: [] for name in self._scene.layers}
        for shape in (*self._scene.shapes, *(arrow.shape for arrow in self._scene.arrows)):
            self._layers[shape.layer].append(self._add(shape))
        for i, label in enumerate(self._scene.labels):
            name = f"/{label.mover}/{label.layer}/label_{i}"
            words = scene.add_label(name, label.text, position=label.point)
            self._layers[label.layer].append(words)
        for name, shown in self._scene.layers.items():
            self._show_layer(name, shown)

    def _add(self, shape: Shape) -> Any:
        mesh = self._server.scene.add_mesh_simple(
            f"/{shape.node}",
            *shape.mesh,
            color=np.array(list(bytes.fromhex(shape.colour[1:]))),
            opacity=shape.opacity if shape.opacity < 1 else None,
            side="double",
        )
        mesh.scale = _place(mesh, shape.at)
        return mesh

    def _show_layer(self, name: str, shown: bool) -> None:
        for handle in self._layers[name]:
            handle.visible = shown

    def _add_controls(self) -> None:
        gui = self._server.gui
        gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )
        gui.main_panel.dock_right()  # beside the robot, which it would cover elsewhere
        gui.set_panel_label(self._robot.mechanism.model.name)
        self._sliders = [(group, self._add_sliders(group)) for group in self._jog.sliders]
        home = gui.add_button("Home")
        home.on_click(lambda _: self._when_free(lambda: self._show(Pose(self._scene.start))))
        self._status = gui.add_markdown("")
        with gui.add_folder("Show"):
            for name, shown in self._scene.layers.items():
                if name != "trail":
                    self._add_check_box(name, shown)

    def _add_sliders(self, group: Sliders) -> list[Any]:
        gui = self._server.gui
        unit, factor = _SHOWN[group.unit]
        low, high = (np.ceil(factor * group.low / _STEP), np.floor(factor * group.high / _STEP))
        ends = zip(
            group.names, *(np.round(_STEP * x, 1).tolist() for x in (low, high)), strict=True
        )
        with gui.add_folder(f"{group.title} [{unit}]"):
            sliders = [gui.add_slider(name, a, b, _STEP, a) for name, a, b in ends]

        def moved(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # else it was `_show` that moved it
                self._move(group, sliders)

        for slider in sliders:
            slider.on_update(moved)
        return sliders

    def _add_check_box(self, name: str, shown: bool) -> None:
        box = self._server.gui.add_checkbox(name, initial_value=shown)
        box.on_update(lambda event: self._show_layer(name, event.target.value))

    def _move(self, group: Sliders, sliders: list[Any]) -> None:
        goal = np.array([slider.value for slider in sliders]) / _SHOWN[group.unit][1]
        self._when_free(lambda: self._show(self._jog.move(group, self.q, goal), sliders))

    def _when_free(self, act: Callable[[], None]) -> None:
        """Do only what was requested last."""
        self._wishes += 1
        mine = self._wishes
        with self._busy:
            if mine == self._wishes:  # else a newer one waits
                act()

    def _show(self, pose: Pose, held: Sequence[Any] = ()) -> None:
        """Draw a pose and set the sliders to it; those in hand only when they went too far."""
        self.q = pose.q
        tau, status = self._statics()
        status += [f"**Stopped:** {pose.stopped}"] if pose.stopped else []
        found = warnings_of(self._robot, self.q)
        status += [f"**The machine cannot reach this pose:** {'; '.join(found)}."] if found else []
        if not pose.stopped and not found:
            status.append("Loops closed, not singular.")
        poses = self._scene.poses(self.q)
        arrows = [arrow.at(tau) for arrow in self._scene.arrows]
        with self._server.atomic():
            for name, matrix in poses.items():
                _place(self._movers[name], matrix)
            for handle, matrix in zip(self._layers.get("torques", []), arrows, strict=True):
                handle.scale = _place(handle, matrix)
            for group, sliders in self._sliders:
                values = np.round(_SHOWN[group.unit][1] * group.read(self.q), 1) + 0.0
                for slider, value in zip(sliders, values.tolist(), strict=True):
                    if pose.stopped or slider not in held:
                        slider.value = min(max(value, slider.min), slider.max)
        self._status.content = "\n\n".join(status)

    def _statics(self) -> tuple[Array, list[str]]:
        """Torques that hold the robot still, as shares of the largest, and what to say of them."""
        robot, still = self._robot, np.zeros(self._robot.degrees_of_freedom)
        try:
            tau = robot.compute_torques(self.q, still, still)
        except SSTError as error:  # too few motors, or singular
            return np.zeros(len(self._units)), [f"**No torques hold this pose:** {error}"]
        rows = [
            f"tau_{k} ({name}) | {value:.3f} {unit}"
            for k, (name, value, unit) in enumerate(
                zip(robot.motor_names, tau.round(3) + 0.0, self._units, strict=True), 1
            )
        ]
        for name, value in robot.singularity_measures(self.q).items():
            rows.append(f"condition number ({name}) | {value:.2f}")
        table = "".join(f"| {row} |\n" for row in rows)
        shares = np.clip(tau / self._largest, -1, 1)
        return shares, [f"| torques at rest | |\n|---|---|\n{table}"]


def _place(handle: Any, matrix: Array) -> tuple[float, float, float]:
    """Place an object by a homogeneous matrix; return the scale of the matrix."""
    (handle.position,), ((x, y, z, w),), (scale,) = decompose(matrix[None])
    handle.wxyz = (w, x, y, z)
    x, y, z = scale.tolist()
    return x, y, z


def _silence() -> AbstractContextManager[object]:
    """Suppress the text that viser prints."""
    return redirect_stdout(StringIO())


@contextmanager
def _guarded_requests(host: str) -> Iterator[None]:
    """Servers that viser starts meanwhile answer our page alone; viser has no option for it.

    Raises:
        ServerError: When viser has started none in the way that is known.
    """
    serve, started = websockets.asyncio.server.serve, []

    def guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def judge(connection: Any, request: Any) -> Any:
            headers = request.headers
            if not is_ours(host, headers.get("Host"), headers.get("Origin")):
                return connection.respond(HTTPStatus.FORBIDDEN, "not this machine's page\n")
            return process_request(connection, request)

        started.append(True)
        return serve(*arguments, process_request=judge, **options)

    websockets.asyncio.server.serve = guarded  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not started:
        raise ServerError(
            "this version of viser cannot refuse requests of other pages; install another"
        )
