# SPDX-License-Identifier: BSD-2-Clause
"""`Viewer`: a robot and its motion on a page."""

from __future__ import annotations

import html
import json
import webbrowser
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Indices, positive_number, single_array
from ..closed_chain import ClosedChain
from ..description.colours import HUES
from ..engine import require_robot
from ..errors import (
    ActuationError,
    ClosureError,
    DescriptionError,
    InputError,
    MissingExtraError,
    SingularConfigurationError,
)
from ..files import Writer, as_path, require_ending, write_files
from ..simulation.bearing_loads import require_no_other_loads
from ..simulation.nonsmooth_rollout import NOT_REACHED, NonsmoothRollout
from ..simulation.trajectories import Trajectory, require_motion, trajectory_of
from ..summaries import listed
from ..version import __version__
from .meshcat_scene import MeshcatScene
from .panel import (
    contacts_of,
    curves_of,
    forces_of,
    joints_of,
    live_data,
    page,
    rates_of,
    torques_of,
    warnings_of,
)
from .pictures import gif, png
from .robot_scene import TRAIL_SIDES, Scene
from .server import Message, Server

#: The most samples of a motion in a page.
_MOST_SAMPLES = 600
#: The longest arrow of a contact, in weights of the robot, if a force is larger.
_MOST_WEIGHTS = 2.0


class _ReactionArrows(NamedTuple):
    """Reactions of some samples, as the page shows them."""

    shares: Array | None  #: As shares of the largest, shape (n, reactions, 3); None without arrows.
    curves: list[dict[str, Any]]
    note: str


_NO_REACTIONS = _ReactionArrows(None, [], "")


class Viewer:
    """A page that shows a robot: as a file, on a port of this machine, or in a notebook.

    The server starts with `open` or `serve`, and stops with `close` or at the end of the `with`
    block. In Jupyter a viewer displays itself.

    Args:
        robot: Any closed chain, with the shapes of its URDF, MJCF or gallery function. Without any
            it is drawn as a skeleton, with an ellipsoid for the mass and inertia of each body. A
            planar robot is seen face-on, and its ellipsoids are hidden at first.
        visual_model: Shapes that replace these; `pinocchio.GeometryModel()` gives the skeleton.
        axes: Whether the axes of the joints are shown at first, e_1..9 of an `SST`.
        frames: Whether the frames of the closures are shown at first, {0k}..{3k}, {E} of an `SST`.
        frame: Name of the frame whose path is drawn; by default E of an `SST` and `platform` of
            other robots, if they have it.
        reactions: Whether arrows show the forces in joints and closures: of the parent on the
            child, of A on B; of a force that is not unique its unique part, such as that in the
            plane of a planar robot. Stiffnesses, as in `ClosedChain.reactions`, make others unique.
        live: Whether the page also computes: sliders, dragging, simulation. Arrows of reactions
            are then only in motions.

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
        motors = len(self._robot.motor_names)
        q = single_array("q", q, (len(self._robot.position_names),))[None]
        curves = [joints_of(self._robot, q)]
        torque_shares = np.zeros((1, motors))
        if tau is not None:
            tau = single_array("tau", tau, (motors,))[None]
            curves = [torques_of(self._robot, tau), *curves]
            torque_shares = self._torque_shares(tau)
        zero_rates = np.zeros((1, self._robot.degrees_of_freedom))
        reactions = _NO_REACTIONS
        if self._with_reactions:
            accelerations = zero_rates if tau is None else None
            reactions = self._reactions(q, zero_rates, accelerations, tau)
            curves = reactions.curves + curves
        no_contacts = np.zeros((1, 3 * len(self._scene.touches)))
        effort = self._effort(torque_shares, reactions, no_contacts)
        self._drawing.place(q[0], effort[0])
        if self._live:  # its arrows of torques may become as long as they can
            effort[:, :motors] = 1.0
        reach = self._scene.outermost_points(q, effort)
        self._describe(
            "configuration",
            q[0],
            q[0],
            zero_rates[0],
            reach,
            curves=curves,
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
        rollout = None
        if isinstance(motion, NonsmoothRollout):
            rollout = motion
            motion = self._states_of(motion)
        for name, each in (("motion", motion), ("ghost", ghost), ("wanted", wanted)):
            if each is not None:
                require_motion(each, self._robot.mechanism, name)
        if ghost is not None:
            ghost = _during(motion, ghost)
        if wanted is None:
            wanted = ghost
        speed = positive_number("speed", speed)
        if wanted is not None and len(wanted) == 1:
            raise InputError("wanted", "one sample, which is no path")
        if len(motion) == 1:
            self.show(motion.q[0], motion.tau[0])
            return

        # Curves, and shares of torques, reactions and contacts for the arrows.
        samples = _samples(len(motion))
        shown = motion[samples]
        reactions = _NO_REACTIONS
        contact_shares = np.zeros((len(shown), 3 * len(self._scene.touches)))
        note = ""
        if rollout is not None:
            curves = [joints_of(self._robot, shown.q), rates_of(shown)]
            if self._scene.touches:
                forces = _between(rollout.contact_forces, samples)
                contact_shares, note = self._contact_shares(forces)
                curves.insert(0, contacts_of(self._robot, forces))
        else:
            curves = curves_of(self._robot, shown)
            if self._with_reactions:
                require_no_other_loads(self._robot.engine, shown)
                reactions = self._reactions(shown.q, shown.va, None, shown.tau)
                curves += reactions.curves
                note = reactions.note
        effort = self._effort(self._torque_shares(shown.tau), reactions, contact_shares)

        # The scene, and the points that the camera must see.
        reference = _thinned(wanted or motion).q
        self._drawing.animate(shown, effort, reference, ghost)
        reach = self._scene.outermost_points(shown.q, effort, reference)
        layers = self._scene.layers
        if ghost is not None:
            reach = np.vstack([reach, self._scene.outermost_points(ghost.q, 0 * effort[:1])])
            layers = layers | {"ghost": True}
        self._describe(
            title,
            motion,
            motion.q[0],
            motion.va[0],
            reach,
            t=shown.t.tolist(),
            speed=speed,
            layers=layers,
            curves=curves,
            note=note,
        )

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
            text = partial(page, (), functions=self._functions, served=True)
            self._server = Server(lambda: text(panel=self._panel), self._state, host, port)
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

    @cached_property
    def _functions(self) -> str:
        """JavaScript of a live page, for the robot near the configuration shown; else nothing."""
        if not self._live:
            return ""
        try:
            from ..compiled.page_code import functions_of
        except ModuleNotFoundError:
            raise MissingExtraError("casadi", "viz") from None
        q = np.array(self._panel["live"]["q"])
        code, numbers = functions_of(self._robot.engine.reference, q)
        if not np.isfinite(numbers).all():
            raise DescriptionError("parameters of the robot", ["a number is not finite"])
        scripts = ["engine.js"]
        if not self._robot.mechanism.contacts.none:
            scripts.append("nonsmooth.js")
        folder = files("sst_pin.compiled")
        texts = [(folder / name).read_text(encoding="utf-8") for name in scripts]
        return f"{code}sst_functions.numbers = {numbers.tolist()};\n{''.join(texts)}"

    def _torque_shares(self, tau: Array) -> Array:
        """Torques as shares of the largest torque, forces as shares of the largest force."""
        shares = np.zeros_like(tau)
        units = np.array(self._robot.motor_units)
        for unit in set(self._robot.motor_units):
            of_unit = units == unit
            largest = np.abs(tau[:, of_unit]).max(initial=0.0)
            shares[:, of_unit] = tau[:, of_unit] / (largest or 1.0)
        return shares

    def _states_of(self, motion: NonsmoothRollout) -> Trajectory:
        """The states of one nonsmooth motion up to its end, as a motion without torques."""
        if self._with_reactions:
            problem = "not of a nonsmooth motion; pass a Trajectory, or reactions=False"
            raise InputError("reactions", problem)
        if motion.q.ndim != 2:
            shape = motion.q.shape
            raise InputError("motion", f"{shape[:-2]} motions; give one, motion.single(0)")
        mechanism = self._robot.mechanism
        for name, shape, needed in (
            ("positions", motion.q.shape, mechanism.model.nq),
            ("rates", motion.va.shape, len(mechanism.coordinates)),
            ("contacts", motion.contact_forces.shape[:-1], len(mechanism.contacts.points)),
        ):
            if shape[-1] != needed:
                problem = f"belongs to another robot, with {shape[-1]} {name} instead of {needed}"
                raise InputError("motion", problem)
        count = 1 + int(np.count_nonzero(motion.status != NOT_REACHED))
        q = motion.q[:count]
        va = motion.va[:count]
        torques = np.zeros((count, len(mechanism.motor_names)))
        return trajectory_of(mechanism, motion.t[:count], q, va, np.zeros_like(va), torques)

    def _effort(
        self, torque_shares: Array, reactions: _ReactionArrows, contact_shares: Array
    ) -> Array:
        """What the arrows of the scene show, in their order: torques, reactions, contacts."""
        samples = len(torque_shares)
        # Without reactions, or where they are not defined, their arrows have no length.
        reaction_shares = np.zeros((samples, self._scene.reactions, 3))
        if reactions.shares is not None:
            reaction_shares[:] = reactions.shares
        return np.hstack([torque_shares, reaction_shares.reshape(samples, -1), contact_shares])

    def _contact_shares(self, forces: Array) -> tuple[Array, str]:
        """Forces of contacts, (n, c, 3), as shares of the longest arrow, (n, 3 c); a note."""
        sizes = np.linalg.norm(forces, axis=2, keepdims=True)
        # An impact is hundreds of times larger than the forces of standing: longer arrows are cut.
        model = self._robot.mechanism.model
        weight = np.linalg.norm(model.gravity.linear) * sum(x.mass for x in model.inertias)
        longest = float(sizes.max())
        if weight > 0:
            longest = min(longest, float(_MOST_WEIGHTS * weight))
        if longest == 0:
            longest = 1.0
        shares = forces / np.maximum(sizes, longest)
        more = " or more" if sizes.max() > longest else ""
        note = (
            f"Green arrows: forces on what touches a ground; the longest is {longest:.3g}\xa0N"
            f"{more}. Lengths grow with the square root."
        )
        return shares.reshape(len(forces), -1), note

    def _reactions(
        self, q: Array, va: Array, aa: Array | None, tau: Array | None
    ) -> _ReactionArrows:
        """Unique forces in joints and closures as shares of the largest, with curves and a note.

        Where the reactions are not defined, there are no arrows, and the note says why.
        """
        engine = self._robot.engine
        try:
            w = engine.reactions(q, va, aa, tau, self._stiffness)
            forces = np.concatenate([w.joints, w.closures], axis=1)[..., :3]
            is_unknown = np.isnan(forces).any(axis=0)  # components of each force
            directions = np.zeros(len(w.names))
            if is_unknown.any():
                # In a planar robot these are the forces in its plane.
                forces, counts = engine.unique_forces(q, va, aa, tau, self._stiffness)
                directions = counts.max(axis=0)
        except (ActuationError, ClosureError, SingularConfigurationError) as error:
            return _ReactionArrows(None, [], f"No reactions: {error}")
        # A force is drawn if a part of it is unique in all samples.
        is_drawn = directions < 3
        forces = np.where(is_drawn[:, None], forces, 0.0)
        largest = float(np.linalg.norm(forces, axis=2).max(initial=0.0)) or 1.0

        curves = []
        notes = []
        if is_drawn.any():
            curves.append(forces_of(w.names, forces, is_drawn))
            notes.append(
                f"Dark arrows: forces of joints on what they carry; the largest is "
                f"{largest:.3g}\xa0N. Lengths grow with the square root."
            )
        not_unique = []
        for k, name in enumerate(w.names):
            letters = [letter for letter, x in zip("xyz", is_unknown[k], strict=True) if x]
            if not is_drawn[k]:
                not_unique.append(name)
            elif directions[k] == len(letters) > 0:
                not_unique.append(f"{name} ({', '.join(letters)})")
            elif directions[k] == 1:
                not_unique.append(f"{name} (along one direction)")
            elif directions[k] == 2:
                not_unique.append(f"{name} (along two directions)")
        if not_unique:
            notes.append(f"Not unique, so not drawn: {listed(not_unique)}.")
        return _ReactionArrows(forces / largest, curves, " ".join(notes))

    def _describe(
        self, title: str, shown: Trajectory | Array, q: Array, va: Array, reach: Array, **panel: Any
    ) -> None:
        """Set the data of the panel and send them; a live page starts at q and va."""
        robot = self._robot
        scene = self._scene
        self._panel = {
            "title": title,
            "robot": robot.mechanism.model.name,
            "warnings": warnings_of(robot, shown),
            "t": [0.0],
            "speed": 1.0,
            "colours": HUES,
            "layers": scene.layers,
            "labels": [x._asdict() | {"point": x.point.tolist()} for x in scene.labels],
            "note": "",
            "live": live_data(robot, scene, q, va) if self._live else None,
            "reach": reach.tolist(),
            "face": scene.face,
            "ground": scene.ground,
            "trail": 6 * TRAIL_SIDES,  # indices of its triangles for each sample passed
            "credit": f"sst_pin {__version__}, Meshcat {version('meshcat')}",
        } | panel
        self._tell(json.dumps(self._panel))

    def _tell(self, message: Message) -> None:
        if self._server is not None:
            self._server.send(message)

    def _state(self) -> list[Message]:
        return [*self._drawing.buffer.commands.values(), json.dumps(self._panel)]


def _samples(count: int) -> Indices:
    """Indices of the samples of a motion that a page shows."""
    return np.linspace(0, count - 1, min(count, _MOST_SAMPLES)).round().astype(np.intp)


def _thinned(motion: Trajectory) -> Trajectory:
    return motion[_samples(len(motion))]


def _between(forces: Array, samples: Indices) -> Array:
    """Mean forces of the steps that end at each sample, or after the sample before; (n, c, 3).

    Step k ends at sample k + 1. The first sample has the forces of the first step.
    """
    sums = np.concatenate([np.zeros_like(forces[:1]), np.cumsum(forces, axis=0)])
    means = np.diff(sums[samples], axis=0) / np.diff(samples)[:, None, None]
    return np.concatenate([forces[:1], means])


def _during(motion: Trajectory, ghost: Trajectory) -> Trajectory:
    """The samples of a second motion between the ends of the first."""
    low = max(motion.t[0], ghost.t[0])
    high = min(motion.t[-1], ghost.t[-1])
    if low >= high:
        spans = [f"{m.t[0]:g} to {m.t[-1]:g} s" for m in (ghost, motion)]
        raise InputError("ghost", f"from {spans[0]}, the motion from {spans[1]}: no time in common")
    first = np.searchsorted(ghost.t, low, "right") - 1
    last = np.searchsorted(ghost.t, high)
    return _thinned(ghost[first : last + 1])
