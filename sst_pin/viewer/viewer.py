# SPDX-License-Identifier: BSD-2-Clause
"""`Viewer`: a robot and its motion on a page."""

from __future__ import annotations

import html
import json
import webbrowser
from collections.abc import Callable, Mapping
from functools import cached_property
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, positive_number, require_flags, single_array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..engine import require_robot
from ..errors import (
    DescriptionError,
    InputError,
    MissingExtraError,
)
from ..files import Writer, as_path, require_ending, write_files
from ..simulation.bearing_loads import require_no_other_loads
from ..simulation.nonsmooth_rollout import NonsmoothRollout
from ..simulation.trajectories import Trajectory, require_motion
from ..version import __version__
from .curve_sets import curves_of, joints_of, rates_of, torques_of
from .force_shares import (
    NO_FORCES,
    ShownForces,
    contact_forces,
    reaction_forces,
    torque_shares,
)
from .live_data import live_data
from .meshcat_scene import MeshcatScene
from .page_samples import mean_forces, same_time, samples_of_page, states_of, thinned
from .panel import page, warnings_of
from .pictures import gif, png
from .robot_scene import TRAIL_SIDES, Scene
from .server import Message, Server


class Viewer:
    """A page that shows a robot: as a file, on a port of this machine, or in a notebook.

    The server starts with `open` or `serve`, and stops with `close` or at the end of the `with`
    block. In Jupyter a viewer displays itself.

    Args:
        robot: Any closed chain. It is drawn with the shapes of its URDF, MJCF or gallery function.
            A robot without shapes is drawn as a skeleton, with an ellipsoid for the mass and
            inertia of each body. A planar robot is seen face-on, and its ellipsoids are hidden at
            first.
        visual_model: Shapes to draw instead of the robot's own. An empty
            `pinocchio.GeometryModel()` gives the skeleton.
        axes: Whether the axes of the joints are shown at first, e_1..9 of an `SST`.
        frames: Whether the frames of the closures are shown at first, {0k}..{3k}, {E} of an `SST`.
        frame: Name of the frame whose path is drawn; by default E of an `SST` and `platform` of
            other robots, if they have it.
        reactions: Whether arrows show the reaction forces: in a joint the force of the parent on
            the child, in a closure the force of frame A on frame B. If a force is not unique, its
            arrow shows the unique part, for instance the force in the plane of a planar robot. A
            mapping of stiffnesses, as in `ClosedChain.reactions`, makes more forces unique.
        live: Whether the page also computes. It then has sliders, bodies that can be dragged, and
            a simulation, and it shows reactions only while it plays a motion.

    Raises:
        UnknownNameError: For an unknown frame, or a stiffness of an unknown joint.
        InputError: If `reactions` is neither a bool nor a mapping.
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
        frame: str | None = None,
        reactions: bool | Mapping[str, ArrayLike] = False,
        live: bool = False,
    ) -> None:
        require_robot("robot", robot)
        require_flags(axes=axes, frames=frames, live=live)
        if not isinstance(reactions, bool | Mapping):
            raise InputError("reactions", f"{reactions!r} is no bool and no dict of stiffnesses")
        self._with_reactions = reactions is not False
        self._stiffness = None if isinstance(reactions, bool) else reactions
        self._scene = Scene(
            robot,
            visual_model,
            axes=axes,
            frames=frames,
            frame=frame,
            reactions=self._with_reactions,
        )
        self._robot = robot
        self._live = live
        self._server: Server | None = None
        self._drawing = MeshcatScene(self._scene)
        self._drawing.buffer.listener = self._tell
        self._panel: dict[str, Any] = {}
        self.show(self._scene.start)

    def show(self, q: ArrayLike, tau: ArrayLike | None = None) -> None:
        """Show a configuration.

        Args:
            q: Configuration, shape (nq,).
            tau: Motor torques, shape (motors,), [N m] or [N]. Without them the panel shows only
                the joints, and the reactions of the robot at rest in this pose.

        Example:
            >>> viewer.show(chain.home, tau=[0.2])
        """
        robot = self._robot
        # The functions below take arrays with an axis of samples: here it has the length 1.
        q = single_array("q", q, (len(robot.position_names),))[None]
        zero_rates = np.zeros((1, robot.degrees_of_freedom))
        motors = len(robot.motor_names)
        if tau is None:
            shares = np.zeros((1, motors))
            accelerations = zero_rates
            curves = [joints_of(robot, q)]
        else:
            tau = single_array("tau", tau, (motors,))[None]
            shares = torque_shares(robot, tau)
            accelerations = None  # computed from the torques
            curves = [torques_of(robot, tau), joints_of(robot, q)]
        reactions = NO_FORCES
        if self._with_reactions:
            reactions = reaction_forces(robot, q, zero_rates, accelerations, tau, self._stiffness)
        effort = self._scene.layout.efforts(shares, reactions.shares, None)
        self._drawing.place(q[0], effort[0])
        if self._live:
            # Sliders change the torques of a live page: the camera must see the longest arrows.
            effort[:, :motors] = 1.0
        self._set_panel(
            title="configuration",
            configuration_or_motion=q[0],
            q=q[0],
            va=zero_rates[0],
            outermost_points=self._scene.outermost_points(q, effort),
            curves=[*reactions.curves, *curves],  # a page shows the first set at first
            note=reactions.note,
        )

    def play(
        self,
        motion: Trajectory | NonsmoothRollout,
        *,
        speed: float = 1.0,
        ghost: Trajectory | None = None,
        wanted: Trajectory | None = None,
        title: str = "motion",
    ) -> None:
        """Play a motion in a loop. The page plays it, so this method returns immediately.

        Args:
            motion: A motion of this robot; if it is long, the page uses only some of its samples.
                For a single motion of `rollout(..., nonsmooth=True)`, points and arrows show the
                contacts that act and their forces: means between samples of the page.
            speed: Speed of the animation; 1 is real time.
            ghost: A second motion of this robot, such as the planned one, played at the same times
                by a translucent robot, which stands still before its start and after its end.
            wanted: A motion with the reference path; by default `ghost`, else `motion`.
            title: Title of the page.

        Raises:
            InputError: For the motion of another robot, several motions, a ghost that has no time
                in common with the motion, a reference of one sample, a speed that is not positive,
                or reactions of a nonsmooth motion.

        Example:
            >>> viewer.play(motion, speed=0.1, title="falling")
        """
        states = self._states_of(motion)
        for name, trajectory in (("motion", states), ("ghost", ghost), ("wanted", wanted)):
            if trajectory is not None:
                require_motion(trajectory, self._robot.mechanism, name)
        if ghost is not None:
            ghost = same_time(states, ghost)
        if wanted is None:
            wanted = ghost
        speed = positive_number("speed", speed)
        if wanted is not None and len(wanted) == 1:
            raise InputError("wanted", "one sample, which is no path")
        if len(states) == 1:
            self.show(states.q[0], states.tau[0])
            return

        # Forces and curves: a nonsmooth motion has contacts, others have torques and reactions.
        samples = samples_of_page(len(states))
        page_motion = states[samples]
        contacts = NO_FORCES
        reactions = NO_FORCES
        if isinstance(motion, NonsmoothRollout):
            curves = [joints_of(self._robot, page_motion.q), rates_of(page_motion)]
            if self._scene.contacts:
                forces = mean_forces(motion.contact_forces, samples)
                contacts = contact_forces(self._robot, forces)
        else:
            curves = curves_of(self._robot, page_motion)
            reactions = self._reactions_of(page_motion)
        shares = torque_shares(self._robot, page_motion.tau)
        effort = self._scene.layout.efforts(shares, reactions.shares, contacts.shares)

        # The scene, and the points that the camera must see.
        reference = thinned(states if wanted is None else wanted).q
        self._drawing.animate(page_motion, effort, reference, ghost)
        points = self._scene.outermost_points(page_motion.q, effort, reference)
        layers = self._scene.layers
        if ghost is not None:
            no_effort = np.zeros_like(effort[:1])
            points_of_ghost = self._scene.outermost_points(ghost.q, no_effort)
            points = np.vstack([points, points_of_ghost])
            layers = layers | {"ghost": True}
        self._set_panel(
            title=title,
            configuration_or_motion=states,
            q=states.q[0],
            va=states.va[0],
            outermost_points=points,
            curves=[*contacts.curves, *curves, *reactions.curves],
            note=contacts.note or reactions.note,
            t=page_motion.t,
            speed=speed,
            layers=layers,
        )

    def _states_of(self, motion: Trajectory | NonsmoothRollout) -> Trajectory:
        """The states of a motion, smooth or nonsmooth.

        Raises:
            InputError: For several nonsmooth motions, or if reactions of one would be shown.
        """
        if not isinstance(motion, NonsmoothRollout):
            return motion
        if self._with_reactions:
            problem = "not of a nonsmooth motion; pass a Trajectory, or reactions=False"
            raise InputError("reactions", problem)
        return states_of(self._robot.mechanism, motion)

    def _reactions_of(self, motion: Trajectory) -> ShownForces:
        """The reactions along a motion under its torques and weights; none if they are not shown.

        Raises:
            InputError: If other forces act.
        """
        if not self._with_reactions:
            return NO_FORCES
        require_no_other_loads(self._robot.engine, motion)
        return reaction_forces(self._robot, motion.q, motion.va, None, motion.tau, self._stiffness)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings for the motion or configuration: open loops, joints beyond their limits.

        Example:
            >>> viewer.show(chain.home + 0.1)
            >>> viewer.warnings
            ('the loops are open by ... (m or rad)',)
        """
        return tuple(self._panel["warnings"])

    @property
    def html(self) -> str:
        """The page as text; it needs no network."""
        return page(self._drawing.buffer.commands.values(), self._panel, self._functions)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the page, a picture or an animation.

        Args:
            path: A file name that ends in .html, .png or .gif; .png and .gif need Chromium.
            force: Whether an existing file may be replaced.

        Raises:
            OutputError: If the file cannot be written, or exists.
            MissingExtraError: For a picture without Playwright.
            BrowserError: For a picture without Chromium.
        """
        write_files({as_path(path): self.writer(path)}, force)

    def writer(self, path: str | Path) -> Writer:
        """A function that writes to a stream, in the format of the path's ending.

        Raises:
            OutputError: For another ending than .html, .png or .gif.
        """
        kinds: dict[str, Callable[[str], bytes]] = {".html": str.encode, ".png": png, ".gif": gif}
        kind = require_ending(path, *kinds)
        text = self.html

        def write(file: BinaryIO) -> None:
            file.write(kinds[kind](text))

        return write

    def serve(self, host: str = "127.0.0.1", port: int = 0) -> str:
        """Start a server for the page; by default only for browsers on this machine.

        Args:
            host: Address of the server.
            port: Port of the server; 0 for any free port.

        Returns:
            The URL of the page, also of a server that runs already.

        Raises:
            ServerError: If the address or port cannot be used.

        Example:
            >>> viewer.serve().startswith("http://127.0.0.1:")
            True
            >>> viewer.close()
        """
        if self._server is None:
            functions = self._functions  # here, so that its errors reach the caller

            def current_page() -> str:
                # Without commands: the page gets them from `_state`, through its socket.
                return page((), self._panel, functions, served=True)

            self._server = Server(current_page, self._state, host, port)
        return self._server.url

    def open(self, wait: float = 20.0) -> bool:
        """Start the server and open the browser.

        Args:
            wait: Time to wait until the browser has loaded the page, [s].

        Returns:
            Whether the page is loaded; then it plays even after this process has ended.
        """
        url = self.serve()
        server = self._server
        return server is not None and webbrowser.open(url) and server.visited.wait(wait)

    def close(self) -> None:
        """Stop the server."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        where = "not served" if self._server is None else self._server.url
        return f"<Viewer of {self._robot.mechanism.model.name}: {self._panel['title']}, {where}>"

    def _repr_html_(self) -> str:
        """The page in a notebook; a copy, which needs no port."""
        style = "width: 100%; height: 540px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.html)}" style="{style}"></iframe>'

    def _require_functions(self) -> None:
        """Raise the errors of a live page now: without CasADi it cannot be made."""
        _ = self._functions

    @cached_property
    def _functions(self) -> str:
        """JavaScript of a live page, and nothing for other pages.

        It is made once, for the robot near the configuration that is shown when it is first needed.
        """
        if not self._live:
            return ""
        try:
            from ..compiled.page_code import functions_of
        except ModuleNotFoundError:
            raise MissingExtraError("casadi", "viz") from None
        q = np.array(self._panel["live"]["q"])  # of the last `show` or `play`
        code, numbers = functions_of(self._robot.engine.reference, q)
        if not np.isfinite(numbers).all():
            raise DescriptionError("parameters of the robot", ["a number is not finite"])
        scripts = ["engine.js"]
        if not self._robot.mechanism.contacts.none:
            scripts.append("nonsmooth.js")
        folder = files("sst_pin.compiled")
        texts = [(folder / name).read_text(encoding="utf-8") for name in scripts]
        return f"{code}sst_functions.numbers = {numbers.tolist()};\n{''.join(texts)}"

    def _set_panel(
        self,
        *,
        title: str,
        configuration_or_motion: Trajectory | Array,
        q: Array,
        va: Array,
        outermost_points: Array,
        curves: list[dict[str, Any]],
        note: str,
        t: ArrayLike = (0.0,),
        speed: float = 1.0,
        layers: Mapping[str, bool] | None = None,
    ) -> None:
        """Set the data of the panel, with the names of `panel.js`, and send them to the pages.

        Args:
            title: Title of the page.
            configuration_or_motion: What the warnings are about.
            q: The configuration at which a live page starts, shape (nq,).
            va: The rates at which it starts, shape (n,).
            outermost_points: The points that the camera must see, shape (k, 3).
            curves: Sets of curves.
            note: A text below the curves.
            t: Times of the curves, [s].
            speed: Speed of the animation.
            layers: Layers, and whether each is shown at first; by default the scene's.
        """
        robot = self._robot
        scene = self._scene
        self._panel = {
            "title": title,
            "robot": robot.mechanism.model.name,
            "warnings": warnings_of(robot, configuration_or_motion),
            "t": np.asarray(t).tolist(),
            "speed": speed,
            "colours": HUES,
            "layers": scene.layers if layers is None else layers,
            "labels": [x._asdict() | {"point": x.point.tolist()} for x in scene.labels],
            "note": note,
            "live": live_data(robot, scene, q, va) if self._live else None,
            "reach": outermost_points.tolist(),
            "face": scene.face,
            "ground": scene.ground,
            # Vertex indices of the trail between two samples: each side is two triangles.
            "trail": 2 * 3 * TRAIL_SIDES,
            "credit": f"sst_pin {__version__}, Meshcat {version('meshcat')}",
            "curves": curves,
        }
        self._tell(json.dumps(self._panel))

    def _tell(self, message: Message) -> None:
        """Send a message to the open pages."""
        server = self._server  # one reading: `close` in another thread may set it to None
        if server is not None:
            server.send(message)

    def _state(self) -> list[Message]:
        """All messages that a new page needs."""
        return [*self._drawing.buffer.commands.values(), json.dumps(self._panel)]
