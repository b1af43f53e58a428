# SPDX-License-Identifier: BSD-2-Clause
"""`Viewer`: a robot and its motion on a page."""

from __future__ import annotations

import html
import json
import webbrowser
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import positive_number, single_array
from ..chain.closed_chain import ClosedChain
from ..chain.joint_space import JointSpace
from ..errors import InputError, OutputError, UnknownNameError
from ..files import Writer, as_path, write_files
from ..motion.trajectories import Trajectory, require_motion
from .curves import curves_of, joints_of, motor_units, torques_of
from .meshcat_scene import MeshcatScene
from .page import page
from .parts import COLOURS
from .scene import TRAIL_SIDES, Scene
from .server import Message, Server
from .warnings import warnings_of

Array = NDArray[np.float64]

#: Samples that a page is given at most.
_MOST_SAMPLES = 600


class Viewer:
    """A robot on a page for the browser: as a file, on a port of this machine, in a notebook.

    Nothing listens until `open` or `serve` is called; `close`, or leaving the `with` block, ends
    that. In Jupyter a viewer displays itself.

    Args:
        robot: Any closed chain. Its bodies are drawn as its URDF, MJCF or function has them; where
            they have no shapes, joints, the lines between them, and for each body the ellipsoid
            of its mass and inertia.
        visual_model: Shapes to be drawn instead of `robot.visual_model`; an empty
            `pinocchio.GeometryModel()` gives the skeleton.
        axes: Whether the joints' axes are shown at first, of an `SST` as e_1..9.
        frames: Whether the frames where loops close are, of an `SST` {0k}..{3k} and {E}.

    Raises:
        DescriptionError: When a shape's file cannot be read.
        MissingExtraError: Without Meshcat.

    Example:
        >>> viewer = Viewer(robot)
        >>> viewer.save("robot.html", force=True)
    """

    def __init__(
        self,
        robot: ClosedChain,
        visual_model: pin.GeometryModel | None = None,
        *,
        axes: bool = False,
        frames: bool = False,
    ) -> None:
        self._scene = Scene(robot, visual_model, axes=axes, frames=frames)
        self._robot = robot
        self._server: Server | None = None
        self._units = motor_units(robot)
        self._drawing = MeshcatScene(self._scene)
        self._drawing.buffer.listener = self._tell
        self._panel: dict[str, Any] = {}
        self.show(self._scene.start)

    # --- what is shown ----------------------------------------------------------------------

    def show(self, q: ArrayLike, tau: ArrayLike | None = None) -> None:
        """A configuration.

        Args:
            q: Configuration, shape (nq,).
            tau: Motor torques, shape (motors,), [N m] or [N]; unknown by default: then the panel
                has the joints only.

        Example:
            >>> viewer.show(chain.home, tau=[0.2])
        """
        motors = len(self._robot.motor_names)
        q = single_array("q", q, (len(self._robot.position_names),))[None]
        curves, effort = [joints_of(self._robot, q)], np.zeros((1, motors))
        if tau is not None:
            tau = single_array("tau", tau, (motors,))[None]
            curves, effort = [torques_of(self._robot, tau), *curves], self._shares(tau)
        self._drawing.place(q[0], effort[0])
        self._describe("configuration", [0.0], q, effort, curves, 1.0, None)

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
            speed: 1 is real time.
            wanted: The motion whose path is the reference; `motion` itself by default.
            title: Stands on the page.

        Raises:
            InputError: When the motion is another robot's, or the speed not positive.

        Example:
            >>> viewer.play(motion, speed=0.1, title="falling")
        """
        for name, given in (("motion", motion), ("wanted", motion if wanted is None else wanted)):
            self._require_own(given, name)
        speed = positive_number("speed", speed)
        if len(motion) == 1:
            self.show(motion.q[0], motion.tau[0])
            return
        known, effort = _thinned(motion), self._shares(_thinned(motion).tau)
        self._drawing.animate(known, effort, _thinned(wanted or motion).q)
        curves = curves_of(self._robot, known)
        self._describe(title, known.t.tolist(), known.q, effort, curves, speed, motion)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the machine could not take of what is shown: open loops, limits that are passed.

        Example:
            >>> viewer.show(chain.home + 0.1)
            >>> viewer.warnings
            ('the loops are open by ... (m or rad)',)
        """
        return tuple(self._panel["warnings"])

    # --- where it is shown ------------------------------------------------------------------

    @property
    def html(self) -> str:
        """The page by itself, which asks for nothing from outside.

        Example:
            >>> "<html" in viewer.html
            True
        """
        return page(self._drawing.buffer.commands.values(), self._panel)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the page, a picture or an animation.

        Args:
            path: Ends in .html, .png or .gif; the latter two need Chromium.
            force: Whether a file that is there may be replaced.

        Raises:
            OutputError: When it cannot be written, or exists.
            MissingExtraError: For a picture without Playwright.
            BrowserError: For a picture without Chromium.

        Example:
            >>> viewer.save("four_bar.html", force=True)
        """
        write_files({as_path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """What writes the file that the path's ending asks for.

        Raises:
            OutputError: For another ending than .html, .png or .gif.

        Example:
            >>> with open("four_bar.html", "wb") as file:
            ...     viewer.writer("four_bar.html")(file)
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

        Example:
            >>> viewer.serve().startswith("http://127.0.0.1:")
            True
            >>> viewer.close()
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

        Example:
            >>> came = viewer.open(wait=20)  # doctest: +SKIP
        """
        url, server = self.serve(), self._server
        return server is not None and webbrowser.open(url) and server.visited.wait(wait)

    def close(self) -> None:
        """Stop listening.

        Example:
            >>> url = viewer.serve()
            >>> viewer.close()
        """
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

    def _require_own(self, motion: Trajectory, name: str) -> None:
        robot = self._robot
        require_motion(motion, robot.position_names, name)
        if motion.tau.shape[1] != len(robot.motor_names):
            motors = f"{motion.tau.shape[1]} motors, the robot has {len(robot.motor_names)}"
            raise InputError(name, f"belongs to another robot, with torques of {motors}")
        space = JointSpace(robot.model)
        try:
            same = np.array_equal(
                space.rates_of(motion.coordinates), space.rates_of(robot.coordinates)
            )
        except UnknownNameError:
            same = False
        if not same:
            words = [", ".join(each.coordinates) for each in (motion, robot)]
            raise InputError(name, f"has rates of {words[0]}, the robot's coordinates: {words[1]}")

    def _shares(self, tau: Array) -> Array:
        """Torques as shares of the largest torque, forces as shares of the largest force."""
        shares = np.zeros_like(tau)
        for unit in set(self._units):
            own = [i for i, other in enumerate(self._units) if other == unit]
            shares[:, own] = tau[:, own] / (np.abs(tau[:, own]).max(initial=0.0) or 1.0)
        return shares

    def _describe(
        self,
        title: str,
        t: list[float],
        q: Array,
        effort: Array,
        curves: list[dict[str, Any]],
        speed: float,
        motion: Trajectory | None,
    ) -> None:
        """Tell the panel what there is to see."""
        robot, scene = self._robot, self._scene
        times, samples = (None, q) if motion is None else (motion.t, motion.q)
        self._panel = {
            "title": title,
            "robot": robot.model.name,
            "warnings": warnings_of(robot, times, samples),
            "t": t,
            "curves": curves,
            "speed": speed,
            "colours": COLOURS,
            "layers": scene.layers,
            "labels": [label._asdict() for label in scene.labels],
            "reach": scene.reach(q, effort).tolist(),
            "trail": 6 * TRAIL_SIDES,  # indices of its triangles for each sample passed
            "credit": f"sst_pin {version('sst-pin')}, Meshcat {version('meshcat')}",
        }
        self._tell(json.dumps(self._panel))

    def _tell(self, message: Message) -> None:
        if self._server is not None:
            self._server.send(message)

    def _state(self) -> list[Message]:
        return [*self._drawing.buffer.commands.values(), json.dumps(self._panel)]


def _thinned(motion: Trajectory) -> Trajectory:
    if len(motion) <= _MOST_SAMPLES:
        return motion
    return motion[np.linspace(0, len(motion) - 1, _MOST_SAMPLES).round().astype(int)]
