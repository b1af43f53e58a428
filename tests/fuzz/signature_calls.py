# SPDX-License-Identifier: BSD-2-Clause
"""Bad arguments for everything public, generated from the signatures.

Each parameter gets all bad values of its annotated type while the others stay good. An odd value
that is sound must give the answer of the good call (`SAME`), one of finite numbers (huge arrays),
or any (`FINE`).
"""

from __future__ import annotations

import datetime
import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

import sst_pin
from tests.fuzz.call_world import ODD_PATHS, World
from tests.fuzz.judged_calls import Call

#: Difference of torques that are computed in two ways: rounding times the condition of a mild pose.
CLOSE = 1e-8
NOT_NUMBERS = (
    None, "fast", "1e-9", 0.0, np.nan, np.inf, -np.inf, -1.0, 1j, [], np.ones(2), {}, object,
)  # fmt: skip
NOT_COUNTS = (
    None, "two", "2", 0, -1, -(2**100), 1.0, 1.5, True, np.nan, np.inf, [1], 1j, 10**30, object(),
)  # fmt: skip
NOT_NAMES = (
    None, "unknown", "", 5, True, b"raise", np.array("nan"), ["x"], [None], object(),
)  # fmt: skip
NOT_LISTS_OF_NAMES = (
    None, "gamma_1", 5, object(), ["unknown"], [None], [0], [["gamma_1"]], [b"gamma_1"],
)  # fmt: skip


class Unwilling:
    """An object whose conversion to an array fails by an error of its own."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no array today")


class Lying:
    """Promises an array that it does not have."""

    __array_interface__ = {"shape": "many", "typestr": "<f8", "version": 3}  # noqa: RUF012


class Subject(NamedTuple):
    """Something to call."""

    name: str
    call: Callable[..., Any]
    examples: dict[str, Any]
    needed: str = ""

    @property
    def parameters(self) -> dict[str, inspect.Parameter]:
        return dict(inspect.signature(self.call).parameters)

    @property
    def good(self) -> dict[str, Any]:
        """Arguments that it takes."""
        of = self.parameters.items()
        return {n: self.examples[n] for n, p in of if p.default is p.empty or n == self.needed}


def word(value: Any) -> str:
    """A short name of a value."""
    return repr(value) if len(repr(value)) < 25 else type(value).__name__


def each(
    name: str, call: Callable[[Any], Any], values: Any, right: Callable[[Any], bool] | None = None
) -> Iterator[Call]:
    """A call for each value; those of a mapping are called by its keys."""
    numbered = {f"{i}: {word(value)}": value for i, value in enumerate(values)}
    for label, value in (values if isinstance(values, dict) else numbered).items():
        yield Call(f"{name}({label})", lambda v=value: call(v), right)


def numbers_of(value: Any) -> list[np.ndarray]:
    """All arrays and numbers in an answer."""
    if isinstance(value, np.ndarray | float | int | np.number):
        return [np.asarray(value, dtype=float)]
    if isinstance(value, tuple | list):
        return [x for part in value for x in numbers_of(part)]
    if is_dataclass(value):
        return [x for field in fields(value) for x in numbers_of(getattr(value, field.name))]
    return [x for part in vars(value).values() for x in numbers_of(part)] if _holds(value) else []


def _holds(value: Any) -> bool:
    return hasattr(value, "__dict__") and type(value).__module__.startswith("sst_pin")


def finite(value: Any) -> bool:
    """Whether all numbers are finite: what is true of a huge but sound argument."""
    return all(np.isfinite(part).all() for part in numbers_of(value))


def same(wanted: Any) -> Callable[[Any], bool]:
    """Whether an answer has the wanted numbers."""

    def right(value: Any) -> bool:
        pairs = list(zip(numbers_of(value), numbers_of(wanted), strict=True))
        return bool(pairs) and all(
            a.shape == b.shape and np.allclose(a, b, rtol=CLOSE, atol=CLOSE, equal_nan=True)
            for a, b in pairs
        )

    return right


def bad_arrays(good: Any, fixed_shape: bool) -> Iterator[tuple[str, Any]]:
    """What stands in the place of a good array, by a word for it."""
    good = np.asarray(good, dtype=float)

    def with_first(value: float) -> np.ndarray:
        bad = good.reshape(-1).copy()
        bad[0] = value
        return bad.reshape(good.shape)

    first, endless = with_first(np.nan) != with_first(np.nan), []
    endless.append(endless)
    hidden = [np.ma.masked_array(row, np.ones(np.shape(row), bool)) for row in np.atleast_1d(good)]
    days = np.full(good.shape, datetime.date(2026, 1, 1))
    yield from {
        "None": None,
        "text": "fast",
        "digits": good.astype(str),
        "digits as objects": good.astype(str).astype(object),
        "bytes": good.astype(str).astype(bytes),
        "complex": good + 0.1j,
        "list of complex": (good + 0.1j).tolist(),
        "truth values": np.ones(good.shape, bool),
        "masked": np.ma.masked_array(good, mask=first),
        "masked nowhere": np.ma.masked_array(good),
        "rows of masked": hidden,
        "dates": np.full(good.shape, np.datetime64("2026-01-01")),
        "spans": np.full(good.shape, np.timedelta64(1, "s")),
        "days": days,
        "list of days": days.tolist(),
        "object": object(),
        "objects": np.full(good.shape, None),
        "endless": endless,
        "unwilling": Unwilling(),
        "lying": Lying(),
        "records": np.zeros(good.shape, dtype=[("x", float)]),
        "dict": {},
        "set": {1.0},
        "class": float,
        "ragged": [[1.0], [2.0, 3.0]],
        "NaN": with_first(np.nan),
        "inf": with_first(np.inf),
        "huge": np.full(good.shape, 1e200),
    }.items()
    if fixed_shape:
        yield "empty", np.empty(0)
        yield "longer", np.concatenate([good, good[..., :1]], axis=-1)
        yield "scalar", 1.0
        yield "gaps", np.full(good.shape, None).tolist()


def bad_outs(good: np.ndarray) -> Iterator[tuple[str, Any]]:
    """What stands in the place of an array for the results."""
    frozen = np.empty(good.shape)
    frozen.setflags(write=False)
    kinds = {"float32": np.float32, "int": int, "complex": complex, "objects": object, ">f8": ">f8"}
    yield from {kind: np.empty(good.shape, dtype) for kind, dtype in kinds.items()}.items()
    yield from {
        "False": False,
        "True": True,
        "list": [0.0] * 3,
        "text": "out",
        "wrong shape": np.empty((7, 3)),
        "a column": np.empty((*good.shape, 1)),
        "masked": np.ma.zeros(good.shape),
        "one too many": np.empty((*good.shape[:-1], good.shape[-1] + 1)),
        "read-only": frozen,
        "a type": np.ndarray,
    }.items()


def bad_functions(good: Any) -> Iterator[tuple[str, Any]]:
    """Functions of (t, q, va) with a bad value, and arrays in their place."""
    good = np.asarray(good, dtype=float)
    shape = good.shape
    values = {
        "None": None,
        "text": "x",
        "NaN": np.full(shape, np.nan),
        "inf": np.full(shape, np.inf),
        "too many": np.zeros((*shape, 2)),
        "complex": np.ones(shape) * 1j,
        "masked": np.ma.masked_array(np.ones(shape), mask=True),
        "dates": np.full(shape, np.datetime64("2026-01-01")),
    }
    for kind, value in values.items():
        yield f"gives {kind}", lambda t, q, va, value=value: value
    for kind, value in bad_arrays(good, True):
        if kind != "class":  # what a function of the caller's raises is the caller's
            yield kind, value


def bad_motions(w: World) -> dict[str, Any]:
    """What stands in the place of a motion of the SST."""
    m = w.motion
    names = [f"x{i}" for i in range(9)]
    renamed = sst_pin.Trajectory(m.t, m.q, m.va, m.aa, m.tau, names, names[::3])
    of = {"of one sample": m[:1], "of another robot": w.motion_of_another, "renamed": renamed}
    return {"None": None, "text": "m", "array": m.q, "open loops": w.open_motion} | of


def bad_values(w: World, name: str, kind: str, good: Any, out: Any) -> Iterator[tuple[str, Any]]:
    """Bad values for a parameter by its annotated type."""
    plain = kind.removesuffix(" | None").removesuffix(" | Mapping[str, float]")
    if name == "out":
        if np.ndim(out):
            yield from bad_outs(np.asarray(out))
    elif plain in ("ArrayLike", "Array", "Sequence[ArrayLike]", "ForwardRef('Array')"):
        shape = name not in ANY_SHAPE and np.ndim(good) > 0
        yield from ((k, v) for k, v in bad_arrays(good, shape) if (k, plain) != ("None", kind))
    elif plain in ("Torque", "Load"):
        if good is not None:
            yield from bad_functions(good)
    elif plain in VALUES:
        yield from ((word(value), value) for value in VALUES[plain])
    elif plain in ("Trajectory", "Trajectory | ArrayLike"):
        yield from bad_motions(w).items()
    elif plain in ("str | Path", "str | Path | None"):
        yield from ODD_PATHS.items()
    elif plain not in WITHOUT:
        raise TypeError(f"{name}: no bad values for the type {kind}")


VALUES = {
    "float": NOT_NUMBERS,
    "int": NOT_COUNTS,
    "str": NOT_NAMES,
    "Sequence[str]": NOT_LISTS_OF_NAMES,
    "Sequence[str] | Mapping[str, float]": (*NOT_LISTS_OF_NAMES, {"crank": None}, {"unknown": 0.1}),
    "Mapping[str, ArrayLike]": (
        *(5, "x", ["crank"], {"unknown": np.ones(6)}, {"gamma_1": None}, {"gamma_1": "x"}),
        *({"gamma_1": np.ones(5)}, {"gamma_1": np.full(6, np.nan)}, {"gamma_1": -np.ones(6)}),
    ),
    "Sequence[LineForce]": (5, "x", [5], ["a-b"], [None]),
    "Sequence[Crossing]": (5, "x", [5], [None]),
    "Callable[[float], None]": (5, "x", [], True),
    "ClosedChain": (),  # an object that is no robot has not the methods of one
    "SST": (),
}
WITHOUT = {
    "bool", "Axes", "Figure", "Motion", "WorkspaceMap", "bool | None",
    "Sequence[tuple[str, Array, Array]]", "Sequence[tuple[str, Trajectory]]",
    "tuple[float, float]", "tuple[str, Array]",
}  # fmt: skip
#: Parameters that take arrays of every shape.
ANY_SHAPE = {"theta", "phi", "psi", "t", "at"}


def calls_of(w: World, subject: Subject) -> Iterator[Call]:
    """A call for each parameter of a subject and each bad value."""
    given = subject.good

    @cache
    def plain() -> Any:
        return subject.call(**given)

    for name, parameter in subject.parameters.items():
        if f"{subject.name.split('.')[-1]}.{name}" in FREE:
            continue
        good = subject.examples.get(name, parameter.default)
        out = plain() if name == "out" else None
        for kind, value in bad_values(w, name, str(parameter.annotation), good, out):
            yield Call(
                f"{subject.name}({name}: {kind})",
                lambda n=name, v=value: subject.call(**given | {n: v}),
                _right(subject.name.split(".")[-1], f"{name}: {kind}", parameter.default, plain),
            )


def _right(
    method: str, label: str, default: Any, plain: Callable[[], Any]
) -> Callable[[Any], bool] | None:
    """What an answer must be; None where only an error is right."""
    if label in FINE or f"{method}({label})" in FINE or (label.endswith(" None") and not default):
        return lambda answer: True
    if label in SAME or f"{method}({label})" in SAME:
        return lambda answer: same(plain())(answer)
    return finite if label.endswith(" huge") else None


#: Odd values that have the answer of the good call.
SAME = {"threads: int", "tries: int", "seed: 0", "seed: int"}
ABILITIES = [
    f"{kind}_{form}" for kind in ("force", "acceleration") for form in ("ellipsoid", "polytope")
]
#: Odd values that have an answer.
FINE = {
    "stopped: 'unknown'", "stopped: ''", "start: -1.0", "psi: -1.0", "port: 0", "end: inf",
    "viscous_friction: scalar", "coulomb_friction: scalar", "check(motion: open loops)",
    "check(motion: of one sample)", "play(motion: of one sample)", "play(wanted: open loops)",
    "play(ghost: open loops)",
    "writer(path: below a device)", "writer(path: 300 letters)", "writer(path: below a file)",
    "sign_width: 0.0", "rollout(dt: 0.0)", "start: 0.0", "end: 0.0", "psi: 0.0", "delay: 0.0",
    "with_payload(mass: 0.0)", "assemble(q: dict)", "with_parameters(theta: dict)",
    "reactions(va: huge)", "reactions(aa: huge)",
    "reactions(tau: huge)", "reactions(platform_moment: huge)", "loads(motion: of one sample)",
    *(f"Adaptive({word}: scalar)" for word in ("stiffness", "damping", "limits")),
    *(f"ComputedTorque({word}: scalar)" for word in ("kp", "kd", "limits")),
    *(f"GravityPD({word}: scalar)" for word in ("kp", "kd", "limits")),
    *(f"{name}(torques: scalar)" for name in ABILITIES), "force_ellipsoid(torques: huge)",
    "reach_map(torques: scalar)",
    *(f"time_optimal({word}: scalar)" for word in ("torques", "rates", "accelerations")),
    "TrackingLQR(limits: scalar)", "Adaptive(learning: 0.0)",
    "reactions(external_wrenches: huge)",  # NaN where a wrench is not unique
}  # fmt: skip
#: Parameters that are not called with bad values: by method and name.
FREE = {
    "Trajectory.stopped", "play.title", "ClosedChain.model",
    "ClosedChain.closures", "ClosedChain.actuated", "Parameters.link", "Parameters.passive_link",
    "Parameters.star", "chain.chain", "SampledTorque.function",
}  # fmt: skip

#: Methods that show, compile, read files, or have no arguments that are judged here.
SKIPPED = {"casadi", "compile", "show", "from_urdf", "from_mjcf", "refresh", "states"}
#: Methods of one sample.
SINGLE = {
    "noc", "Phi", "Phi_dot", "assemble", "mobility", "simulate", "forward_kinematics", "rollout",
    "check", "trajectory", "loads", "with_coordinates", "with_parameters",
}  # fmt: skip


def calls(w: World) -> Iterator[Call]:
    """All of them."""
    for subject in subjects(w):
        yield from calls_of(w, subject)


def subjects(w: World) -> Iterator[Subject]:
    """All public methods and functions."""
    yield from _of_robots(w)
    yield from _of_motions(w)
    yield from _of_parameters(w)
    yield from _of_control(w)
    yield from _of_pictures(w)


def _of_robots(w: World) -> Iterator[Subject]:
    q, va, aa = w.states
    R, omega, alpha = w.star_states
    bodies = len(w.robot.joint_names)
    star = {
        "q": q, "va": va, "aa": aa, "tau": w.tau, "q_dot": q * 0, "R": R, "omega": omega,
        "alpha": alpha, "branch": np.ones(3), "platform_moment": omega,
        "external_wrenches": np.ones((len(q), bodies, 6)), "weights": np.ones(3),
    }  # fmt: skip
    one = {name: x[0] if np.ndim(x) and len(x) == len(q) else x for name, x in star.items()}
    one |= {
        "torque": one["tau"], "q0": q[0], "va0": va[0], "t": np.linspace(0, 0.002, 3), "dt": 1e-3,
        "gamma": q[0, ::3], "near": q[0], "frame": "star_1", "motion": w.motion,
        "coordinates": w.robot.coordinates, "theta": w.reference.dynamic_parameters,
    }  # fmt: skip
    q, va, aa, tau = w.chain_state
    chain = {
        "q": q, "va": va, "aa": aa, "tau": tau, "q_dot": 0 * q, "torque": tau, "q0": q, "va0": va,
        "t": one["t"], "dt": 1e-3, "frame": "B", "external_wrenches": np.ones((3, 6)),
        "motion": w.motion_of_another, "coordinates": w.chain.coordinates,
        "theta": w.chain.dynamic_parameters, "weights": np.ones(1),
    }  # fmt: skip
    for name, robot, examples in (
        ("robot", w.robot, one),
        ("reference", w.reference, one),
        ("batch of robot", w.robot, star | {"frame": "star_1"}),
        ("batch of reference", w.reference, star | {"frame": "star_1"}),
        ("chain", w.chain, chain),
    ):
        for attribute, _ in inspect.getmembers(type(robot), callable):
            batch = name.startswith("batch")
            if attribute.startswith("_") or attribute in SKIPPED or (batch and attribute in SINGLE):
                continue
            call = getattr(robot, attribute)
            motion = {}
            if attribute == "rollout":
                motion = {"tau": np.tile(examples["tau"], (3, 1))}
            if attribute == "trajectory":
                m = w.motion if name != "chain" else w.motion_of_another
                motion = {"t": m.t, "q": m.q, "va": m.va, "aa": m.aa}
            # Reactions take accelerations or torques.
            for needed in ("aa", "tau") if attribute == "reactions" else ("",):
                yield Subject(f"{name}.{attribute}", call, examples | motion, needed)

    def show(speed: float) -> Any:
        return w.robot.show(w.motion, speed=speed, open_browser=False)

    yield Subject("robot.show", show, {"speed": 1.0})
    table = w.table_of_four_bar
    made = {"model": table.model(), "closures": table.closures, "actuated": ["crank"]}
    arrays = ("viscous_friction", "coulomb_friction", "stiffness", "spring_reference")
    good = made | dict.fromkeys(arrays, np.ones(3))
    yield Subject("ClosedChain", sst_pin.ClosedChain, good)


def _of_control(w: World) -> Iterator[Subject]:
    view = sst_pin.SerialView(sst_pin.robots.knee(), ["knee"])
    q, one = view.chain.home, np.ones(1)
    good = dict.fromkeys(("positions", "rates", "tau", "torques", "gains", "limits"), one)
    good |= {"q": q, "start": q, "chain": view.chain, "joints": ["knee"]}
    yield Subject("SerialView", sst_pin.SerialView, good)
    for attribute, call in inspect.getmembers(view, inspect.ismethod):
        if not attribute.startswith("_") and attribute != "compile":
            yield Subject(f"view.{attribute}", call, good)
    gains = {"kp": np.ones(3), "kd": np.ones(3), "Q": np.ones(6), "R": np.ones(3)}
    gains |= {"stiffness": np.ones(3), "damping": np.ones(3), "learning": 1.0}
    for name in ("Adaptive", "ComputedTorque", "GravityPD", "TrackingLQR"):
        made = {"chain": w.robot, "motion": w.motion, "limits": np.ones(3)}
        yield Subject(name, getattr(sst_pin, name), made | gains)

    made = {"function": lambda t, q, va: np.ones(3), "period": 0.01, "delay": 0.0}
    yield Subject("SampledTorque", sst_pin.SampledTorque, made)
    able = {"chain": w.robot, "q": w.motion.q[0], "frame": "star_1", "torques": np.full(3, 60.0)}
    able |= {"va": np.ones(3)}
    for name in ABILITIES:
        yield Subject(name, getattr(sst_pin, name), able | {"turning": True})

    def reach(
        frame: str, torques: ArrayLike, roll: ArrayLike, wrench: ArrayLike, start: ArrayLike
    ) -> Any:
        values: Any = {"roll": roll, "pitch": [0.0, 0.01], "wrench": wrench, "start": start}
        return sst_pin.reach_map(w.robot, frame, torques, **values)

    able |= {"roll": np.array([0.0, 0.01]), "wrench": np.ones(6), "start": w.robot.home}
    yield Subject("reach_map", reach, able)
    made = {"chain": w.robot, "path": w.motion.q, "torques": np.full(3, 60.0)}
    made |= {"rates": np.full(3, 50.0), "accelerations": np.full(3, 500.0), "dt": 0.01}
    yield Subject("time_optimal", sst_pin.time_optimal, made, "torques")


def _of_motions(w: World) -> Iterator[Subject]:
    m, robot, tau = w.motion, w.robot, w.tau
    q, va, _ = w.states
    rows = {"q0": q[0], "va0": va[0], "t": np.linspace(0, 0.002, 3)}
    yield Subject("robot.simulate", robot.simulate, rows | {"torque": np.tile(tau[0], (3, 1))})
    good = {"t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau, "start": 0.0, "end": 0.05}
    good |= {"joint_names": m.joint_names, "actuated": m.actuated, "units": m.units}
    yield Subject("Trajectory", sst_pin.Trajectory, good)
    yield Subject("motion.between", m.between, good)
    yield Subject("motion.save", m.save, {"path": "all.csv"})
    yield Subject("motion.writer", m.writer, {"path": "all.csv"})
    yield Subject("Trajectory.load", sst_pin.Trajectory.load, {"path": "all.csv"})
    closed_at_zero = {"chain": sst_pin.robots.n_four_bar(1), "path": "all.yaml", "force": True}
    yield Subject("write_loop_closures", sst_pin.write_loop_closures, closed_at_zero)
    times = np.linspace(0, 0.1, 8)
    of_star = {"t": times, "R": sst_pin.paper_circle(times).R, "at": times[2:4]}
    yield Subject("interpolate_orientations", sst_pin.interpolate_orientations, of_star)
    through = {"R": sst_pin.paper_circle(times[[0, 3, 6]]).R, "count": 5}
    yield Subject("orientation_path", sst_pin.orientation_path, through)
    ends = {"chain": w.chain, "t": times[:3], "frame": "B", "start": w.chain_state[0]}
    at_rest = w.chain.model, w.chain.model.createData()
    pin.framesForwardKinematics(*at_rest, w.chain_state[0])
    point = at_rest[1].oMf[w.chain.model.getFrameId("B")].translation
    ends["poses"] = np.tile(point, (3, 1))
    yield Subject("frame_motion", sst_pin.frame_motion, ends)
    yield Subject("paper_circle", sst_pin.paper_circle, of_star)
    angles = dict.fromkeys(("theta", "phi", "psi"), np.ones(2))
    yield Subject("orientation", sst_pin.orientation, angles)
    rates = dict.fromkeys(angles, np.ones((3, 2)))
    yield Subject("orientation_motion", sst_pin.orientation_motion, rates)
    for name, chain in (("robot", w.robot), ("reference", w.reference)):
        good = {"chain": chain, "motion": m}
        yield Subject(f"energy_error of {name}", sst_pin.energy_error, good)


def _of_parameters(w: World) -> Iterator[Subject]:
    p = sst_pin.Parameters()
    names = inspect.signature(sst_pin.Parameters).parameters
    own = {name: getattr(p, name) for name in names if hasattr(p, name)}
    yield Subject("Parameters", sst_pin.Parameters, own)
    body = {"mass": 2.6, "center_of_mass": np.ones(3), "inertia": np.eye(3), "at": np.ones(3)}
    yield Subject("with_payload", p.with_payload, body)

    def star(mass: float, center_of_mass: ArrayLike, inertia: ArrayLike) -> Any:
        return sst_pin.Parameters(star=sst_pin.RigidBody(mass, center_of_mass, inertia))

    yield Subject("Parameters(star=RigidBody)", star, body)


def _of_pictures(w: World) -> Iterator[Subject]:
    from matplotlib.figure import Figure

    from sst_pin import plots
    from sst_pin.sst.workspace import workspace_at, workspace_over_rolls
    from sst_pin.viewer import Viewer

    m, ax = w.motion, Figure().add_subplot(projection="3d")
    good = {"robot": w.robot, "motion": m, "q": m.q[0], "tau": m.tau[0]}
    good |= {"ax": ax, "figure": ax.figure, "path": "a.png"}
    for name in ("motion_page", "robot_pose", "figure_writer", "picture_kind"):
        yield Subject(f"plots.{name}", getattr(plots, name), good)

    at = partial(workspace_at, w.robot, rings=3, spokes=3)
    over_rolls = partial(workspace_over_rolls, w.robot, rolls=3, rings=3, spokes=3)
    yield Subject("workspace_at", at, {})
    yield Subject("workspace_over_rolls", over_rolls, {})
    workspace, viewer = at(rings=5, spokes=6), Viewer(w.robot)
    for name in ("save", "writer"):
        yield Subject(f"workspace.{name}", getattr(workspace, name), {"path": "a.npz"})
    for name in ("show", "play", "save"):
        yield Subject(f"viewer.{name}", getattr(viewer, name), good)

    def serve(host: str = "127.0.0.1", port: int = 0) -> Any:
        return Viewer(w.robot).serve(host, port)

    yield Subject("viewer.serve", serve, {})
