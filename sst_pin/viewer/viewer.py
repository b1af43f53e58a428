# SPDX-License-Identifier: BSD-2-Clause
"""`Viewer`: a robot and its motion on a page."""

from __future__ import annotations

import html
import json
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import positive_number, single_array
from ..chain.closed_chain import ClosedChain
from ..errors import OutputError
from ..files import Writer, as_path, write_files
from ..motion.trajectories import Trajectory, require_motion
from ..sst.check import findings
from .markers import TRAIL_SIDES
from .meshcat_scene import MeshcatScene
from .page import page
from .server import Message, Server
from .star import Star


class Viewer:
    """A robot on a page for the browser: as a file, on a port of this machine, in a notebook.

    Nothing listens until `open` or `serve` is called; `close`, or leaving the `with` block, ends
    that. In Jupyter a viewer displays itself.

    Args:
        robot: An `SST`, a robot of the gallery, or any `ClosedChain` with its `visual_model`.
        visual_model: Bodies to be drawn; its own for an `SST` and a robot of the gallery.
        axes: Whether the joint axes e_1..9 of an `SST` are shown at first.
        frames: Whether its frames {0k}..{3k} and {E} are shown at first.

    Raises:
        InputError: For another `ClosedChain` without `visual_model`.
    """

    def __init__(
        self,
        robot: ClosedChain,
        visual_model: pin.GeometryModel | None = None,
        *,
        axes: bool = False,
        frames: bool = False,
    ) -> None:
        self._robot = robot
        self._server: Server | None = None
        self._scene = MeshcatScene(robot, visual_model)
        self._scene.buffer.listener = self._tell
        shown = {"torques": True, "trail": True, "axes": axes, "frames": frames}
        self._settings: dict[str, Any] = {
            "layers": shown if self._scene.markers else {},
            "labels": self._scene.markers.labels if self._scene.markers else [],
            "camera": self._scene.camera,
            "trail": 6 * TRAIL_SIDES,  # indices of its triangles for each sample passed
        }
        self._panel: dict[str, Any] = {}
        self.show(self._scene.start)

    # --- what is shown ----------------------------------------------------------------------

    def show(self, q: ArrayLike, tau: ArrayLike | None = None) -> None:
        """A configuration.

        Args:
            q: Configuration, shape (nq,).
            tau: Motor torques, shape (motors,), [N m] or [N]; none by default.
        """
        motors = len(self._robot.motor_names)
        q = single_array("q", q, (len(self._robot.position_names),))
        tau = np.zeros(motors) if tau is None else single_array("tau", tau, (motors,))
        self._scene.place(q, tau / (np.abs(tau).max() or 1.0))
        robot, warnings = self._robot, []
        if isinstance(robot, Star):
            found = findings(robot.model, robot.geometry, np.zeros(1), q[None])
            warnings = [finding.problem for finding in found]
        self._describe("configuration", [0.0], [tau.tolist()], 1.0, warnings)

    def play(
        self,
        motion: Trajectory,
        *,
        speed: float = 1.0,
        wanted: Trajectory | None = None,
        title: str = "motion",
    ) -> None:
        """A motion, round and round; the page plays it, so this returns at once.

        Args:
            motion: Of this robot; of a long one the page gets every so many samples.
            speed: 1 is true speed.
            wanted: The motion whose path of E is the reference; `motion` itself by default.
            title: Stands on the page.

        Raises:
            InputError: When the motion is another robot's, or the speed not positive.
        """
        for name, given in (("motion", motion), ("wanted", motion if wanted is None else wanted)):
            require_motion(given, self._robot.position_names, name)
        speed = positive_number("speed", speed)
        if len(motion) == 1:
            self.show(motion.q[0], motion.tau[0])
            return
        known = self._scene.animate(motion, wanted or motion)
        robot = self._robot
        warnings = [str(f) for f in robot.check(motion)] if isinstance(robot, Star) else []
        self._describe(title, known.t.tolist(), known.tau.tolist(), speed, warnings)

    # --- where it is shown ------------------------------------------------------------------

    @property
    def html(self) -> str:
        """The page by itself, which asks for nothing from outside."""
        return page(self._scene.buffer.commands.values(), self._panel)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the page, a picture or an animation.

        Args:
            path: Ends in .html, .png or .gif; the latter two need Chromium.
            force: Whether a file that is there may be replaced.

        Raises:
            OutputError: When it cannot be written, or exists.
            MissingExtraError: For a picture without Playwright.
            BrowserError: For a picture without Chromium.
        """
        write_files({as_path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """What writes the file that the path's ending asks for.

        Raises:
            OutputError: For another ending than .html, .png or .gif.
        """
        from . import pictures

        kinds: dict[str, Callable[[], bytes]] = {
            ".html": self.html.encode,
            ".png": lambda: pictures.png(self.html),
            ".gif": lambda: pictures.gif(self.html),
        }
        kind = as_path(path).suffix.lower()
        if kind not in kinds:
            raise OutputError(path, f"ending {kind!r} unknown; known: {', '.join(kinds)}")

        def write(file: BinaryIO) -> None:
            file.write(kinds[kind]())

        return write

    def serve(self, host: str = "127.0.0.1", port: int = 0) -> str:
        """Listen for browsers, on this machine alone unless another host is asked for.

        Args:
            host: Address to listen on.
            port: 0 for any that is free.

        Returns:
            The URL of the page; when it is served already, that of before.

        Raises:
            ServerError: When nothing can listen there.
        """
        if self._server is None:
            self._server = Server(lambda: page((), self._panel, live=True), self._state, host, port)
        return self._server.url

    def open(self, wait: float = 20.0) -> bool:
        """Serve, and open the browser.

        Args:
            wait: How long to wait until the page has come, [s].

        Returns:
            Whether it has; then it plays on, even when this process ends.
        """
        url, server = self.serve(), self._server
        return server is not None and webbrowser.open(url) and server.visited.wait(wait)

    def close(self) -> None:
        """Stop listening."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        where = "not served" if self._server is None else self._server.url
        return f"<Viewer of {self._robot.model.name}: {self._panel['title']}, {where}>"

    def _repr_html_(self) -> str:
        """The page in a notebook; a copy, which needs no port."""
        style = "width: 100%; height: 540px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.html)}" style="{style}"></iframe>'

    # --- inside -----------------------------------------------------------------------------

    def _describe(
        self,
        title: str,
        t: list[float],
        tau: list[list[float]],
        speed: float,
        warnings: list[str],
    ) -> None:
        """Tell the panel what there is to see."""
        units = [self._robot.joint_units[i] for i in self._robot.actuated]
        kinds = {"rad": "motor torques (N m)", "m": "motor forces (N)"}
        self._panel = self._settings | {
            "title": title,
            "warnings": warnings,
            "t": t,
            "tau": tau,
            "speed": speed,
            "names": [f"tau_{k}" for k, _ in enumerate(units, 1)],
            "units": [{"rad": "N m", "m": "N"}[unit] for unit in units],
            "what": ", ".join(kinds[unit] for unit in sorted(set(units), reverse=True)),
        }
        self._tell(json.dumps(self._panel))

    def _tell(self, message: Message) -> None:
        if self._server is not None:
            self._server.send(message)

    def _state(self) -> list[Message]:
        return [*self._scene.buffer.commands.values(), json.dumps(self._panel)]
