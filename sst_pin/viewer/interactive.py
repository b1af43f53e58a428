# SPDX-License-Identifier: BSD-2-Clause
"""A page that answers: sliders that move the closed robot (viser).

Meshcat's Python side hears nothing from its page. viser's does, so the kinematics and dynamics of
the page are those of the package.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MissingExtraError, ServerError
from ..sst.check import findings
from ..sst.robot import SST
from . import jog
from .hosts import is_ours, listen, url_of
from .parts import Shape, decompose
from .scene import Scene

try:
    import viser
    import websockets.asyncio.server
except ImportError:
    raise MissingExtraError("viser", "interactive") from None

Array = NDArray[np.float64]

Move = Callable[[SST, Array, Array], jog.Pose]

_PORT = 8080


class Interactive:
    """Serves until it is closed, or its `with` block is left.

    Attributes:
        url: Of the page.
        q: Where the robot stands, shape (9,), [rad].

    Args:
        robot: The SST.
        host: Address to listen on, by default this machine alone.
        port: 0 for 8080, or the next one that is free.

    Raises:
        MissingExtraError: Without viser.
        ServerError: When nothing can listen there.
    """

    def __init__(self, robot: SST, host: str = "127.0.0.1", port: int = 0) -> None:
        self._robot, self._scene = robot, Scene(robot, None)
        self._busy, self._wishes = threading.Lock(), 0
        for tried in listen(host, port):  # viser would go on trying for ever
            tried.close()
        with _guarded_requests(host):
            self._server = viser.ViserServer(host, port or _PORT, verbose=False)
        self.url = url_of(host, self._server.get_port())
        self.q = robot.home
        # The torque of the largest arrow: half the robot's weight on the star's radius.
        weight = sum(i.mass for i in robot.model.inertias) * np.linalg.norm(
            robot.model.gravity.linear
        )
        self._largest = float(weight) * robot.star_radius / 2 or 1.0
        try:
            self._draw_scene()
            self._add_controls()
            self._show(jog.Pose(self.q))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop listening."""
        self._server.stop()

    def __enter__(self) -> Interactive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- inside -----------------------------------------------------------------------------

    def _draw_scene(self) -> None:
        scene, r = self._server.scene, self._robot.star_radius
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)  # takes seconds where there is no graphics card
        scene.add_light_ambient("/light", intensity=1.5)
        target = np.array((0.3, 0.3, 0.1)) * r
        camera = self._server.initial_camera
        camera.look_at, camera.fov = target, np.radians(24)
        camera.position = target + 5.2 * r * np.array((1.0, 0.7, 0.6))
        self._movers = {
            mover: scene.add_frame(f"/{mover}", show_axes=False)
            for mover in self._scene.poses(self.q)
        }
        self._layers: dict[str, list[Any]] = {name: [] for name in self._scene.layers}
        for shape in (*self._scene.shapes, *(arrow.shape for arrow in self._scene.arrows)):
            self._layers[shape.layer].append(self._add(shape))
        for label in self._scene.labels:
            name = f"/{label.mover}/{label.layer}/{label.text}"
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
        gui.set_panel_label("SST")
        names = ("theta", "phi", "psi"), ("gamma_1", "gamma_2", "gamma_3")
        self._star, self._motors = (
            self._add_sliders(title, group, move)
            for title, group, move in (
                ("Star, by inverse kinematics [deg]", names[0], jog.move_star),
                ("Motors, by direct kinematics [deg]", names[1], jog.move_motors),
            )
        )
        home = gui.add_button("Home")
        home.on_click(lambda _: self._move(lambda *_: jog.Pose(self._robot.home), ()))
        self._status = gui.add_markdown("")
        with gui.add_folder("Show"):
            for name, shown in self._scene.layers.items():
                if name != "trail":
                    self._add_check_box(name, shown)

    def _add_sliders(self, title: str, names: Sequence[str], move: Move) -> list[Any]:
        gui = self._server.gui
        with gui.add_folder(title):
            sliders = [
                gui.add_slider(name, *((0, 180) if name == "phi" else (-180, 180)), 0.1, 0.0)
                for name in names
            ]

        def moved(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # else it was `_show` that moved it
                self._move(move, sliders)

        for slider in sliders:
            slider.on_update(moved)
        return sliders

    def _add_check_box(self, name: str, shown: bool) -> None:
        box = self._server.gui.add_checkbox(name, initial_value=shown)
        box.on_update(lambda event: self._show_layer(name, event.target.value))

    def _move(self, move: Move, sliders: Sequence[Any]) -> None:
        goal = np.radians([slider.value for slider in sliders])
        self._wishes += 1
        mine = self._wishes
        with self._busy:
            if mine == self._wishes:  # else a newer one waits
                self._show(move(self._robot, self.q, goal), sliders)

    def _show(self, pose: jog.Pose, held: Sequence[Any] = ()) -> None:
        """Draw a pose and set the sliders to it; those in hand only when they went too far."""
        self.q, robot = pose.q, self._robot
        tau = robot.compute_torques(self.q, np.zeros(3), np.zeros(3))
        near = robot.singularities(self.q)
        found = findings(robot.model, robot.geometry, np.zeros(1), self.q[None])
        problems = "; ".join(finding.problem for finding in found)
        verdict = [f"**Stopped:** {pose.stopped}"] if pose.stopped else []
        verdict += [f"**The machine cannot stand so:** {problems}."] if found else []
        poses = self._scene.poses(self.q)
        arrows = [arrow.at(tau / self._largest) for arrow in self._scene.arrows]
        with self._server.atomic():
            for name, matrix in poses.items():
                _place(self._movers[name], matrix)
            for handle, matrix in zip(self._layers["torques"], arrows, strict=True):
                handle.scale = _place(handle, matrix)
            angles = (*jog.angles_of(robot.platform_orientation(self.q)), *self.q[::3])
            for slider, angle in zip((*self._star, *self._motors), angles, strict=True):
                if pose.stopped or slider not in held:
                    turned = (angle + np.pi) % (2 * np.pi) - np.pi
                    slider.value = float(np.degrees(turned).round(1))
        rows = "".join(
            f"| tau_{k} | {value:.3f} N m |\n" for k, value in enumerate(tau.round(3) + 0.0, 1)
        )
        self._status.content = (
            f"| to stand still | |\n|---|---|\n{rows}"
            f"| condition number | {near.condition_number:.2f} |\n"
            f"| smallest sin mu_k | {near.first_kind:.3f} |\n\n"
            + ("\n\n".join(verdict) or "Closed and movable.")
        )


def _place(handle: Any, matrix: Array) -> tuple[float, float, float]:
    """Put something where a homogeneous matrix has it; the matrix's scale."""
    (handle.position,), ((x, y, z, w),), (scale,) = decompose(matrix[None])
    handle.wxyz = (w, x, y, z)
    x, y, z = scale.tolist()
    return x, y, z


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
        raise ServerError("this version of viser cannot be kept from answering foreign pages")
