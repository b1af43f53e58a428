# SPDX-License-Identifier: BSD-2-Clause
"""Options of `simulate` and `rollout`, trajectories, their files, energy."""

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from call_world import World
from chain_calls import same
from judged_calls import Call

import sst_pin
from sst_pin.sst.motion_files import read_motion

NOT_NUMBERS = (None, "fast", np.nan, np.inf, -np.inf, -1.0, 1j, [], {}, object())


def calls(w: World) -> Iterator[Call]:
    """All of them."""
    yield from _simulate(w)
    yield from _rollout(w)
    yield from _trajectories(w)
    yield from _files(w)
    yield from _motion_files(w)
    yield from _motions(w)


def word(value: Any) -> str:
    """A short name of a value."""
    return repr(value) if len(repr(value)) < 25 else type(value).__name__


def _simulate(w: World) -> Iterator[Call]:
    q, va, _ = (x[0] for x in w.states)
    tau, t = w.tau[0], np.linspace(0, 0.002, 3)
    chain_q, chain_va, _, chain_tau = w.chain_state
    plain = w.robot.simulate(tau, q, va, t).q
    chain_plain = w.chain.simulate(chain_tau, chain_q, chain_va, t).q

    def robot(**options: Any) -> np.ndarray:
        given = {"torque": tau, "q0": q, "va0": va, "t": t} | options
        return w.robot.simulate(**given).q

    def chain(**options: Any) -> np.ndarray:
        given = {"torque": chain_tau, "q0": chain_q, "va0": chain_va, "t": t} | options
        return w.chain.simulate(**given).q

    for name, run, answer in (("robot", robot, plain), ("chain", chain, chain_plain)):

        def near(value: Any, answer: np.ndarray = answer) -> bool:
            return value.shape == answer.shape and bool(np.abs(value - answer).max() < 1e-3)

        for option in ("rtol", "atol", "max_condition_number", "sign_width"):
            for value in (*NOT_NUMBERS, 0.0, np.ones(2), "1e-9"):
                zero = isinstance(value, float) and value == 0
                may = (zero and option != "max_condition_number") or (
                    value is np.inf and option in ("max_condition_number", "sign_width")
                )
                yield Call(
                    f"{name}.simulate({option}={word(value)})",
                    lambda r=run, o=option, v=value: r(**{o: v}),
                    near if may else None,
                )
        for method in ("Euler", None, 5, "", object(), ["DOP853"], "dop853"):
            yield Call(
                f"{name}.simulate(method={word(method)})", lambda r=run, m=method: r(method=m)
            )
        for method in ("RK45", "Radau", "LSODA"):
            yield Call(
                f"{name}.simulate(method={method})", lambda r=run, m=method: r(method=m), near
            )
        for progress in (5, "x", [], True):
            yield Call(
                f"{name}.simulate(progress={word(progress)})",
                lambda r=run, p=progress: r(progress=p),
            )
        odd_times = {
            "one": [0.0],
            "none": [],
            "falling": [1.0, 0.0],
            "twice": [0.0, 0.0],
            "a table": [[0.0, 1.0]],
            "a number": 1.0,
            "to NaN": [0.0, np.nan],
            "to infinity": [0.0, np.inf],
            "words": ["now", "then"],
            "too near": [1e300, 1.0000001e300],
        }
        for kind, times in odd_times.items():
            yield Call(f"{name}.simulate(t: {kind})", lambda r=run, x=times: r(t=x))
        n = 1 if name == "chain" else 3
        odd_torques: dict[str, Any] = {
            "gives None": lambda t, q, va: None,
            "gives text": lambda t, q, va: "x",
            "gives NaN": lambda t, q, va: np.full(n, np.nan),
            "gives inf": lambda t, q, va: np.full(n, np.inf),
            "gives too many": lambda t, q, va: np.zeros(n + 1),
            "gives a number": lambda t, q, va: 0.0,
            "gives complex": lambda t, q, va: np.ones(n) * 1j,
            "gives masked": lambda t, q, va: np.ma.masked_array(np.ones(n), mask=True),
            "gives dates": lambda t, q, va: np.full(n, np.datetime64("2026-01-01")),
            "samples, too few": np.ones((2, n)),
            "samples, three axes": np.ones((3, 3, n)),
            "samples of NaN": np.full((3, n), np.nan),
            "a dict": {},
            "a motion too short": w.motion if name == "robot" else None,
        }
        for kind, torque in odd_torques.items():
            long = [0.0, 1.0] if kind == "a motion too short" else t
            yield Call(
                f"{name}.simulate(torque: {kind})", lambda r=run, x=torque, t=long: r(torque=x, t=t)
            )
    yield Call("chain.simulate(torque: a motion of another robot)", lambda: chain(torque=w.motion))
    yield Call("robot.simulate from open loops", lambda: robot(q0=q + 0.01 * np.arange(9)))
    for kind, load in {
        "gives None": lambda t, q, va: None,
        "gives text": lambda t, q, va: "x",
        "gives NaN": lambda t, q, va: np.full((9, 6), np.nan),
        "gives one row": lambda t, q, va: np.zeros(6),
    }.items():
        yield Call(
            f"robot.simulate(external_wrenches: {kind})",
            lambda x=load: robot(external_wrenches=x),
        )
        yield Call(
            f"robot.simulate(platform_moment: {kind})", lambda x=load: robot(platform_moment=x)
        )


def _rollout(w: World) -> Iterator[Call]:
    q, va, _ = (x[0] for x in w.states)
    tau = np.tile(w.tau[0], (3, 1))
    for name, robot in (("robot", w.robot), ("reference", w.reference)):
        plain = robot.rollout(tau, q, va, 1e-3).q

        def run(robot=robot, **options: Any) -> np.ndarray:
            given = {"tau": tau, "q0": q, "va0": va, "dt": 1e-3} | options
            return robot.rollout(**given).q

        for value in (
            None,
            "fast",
            np.nan,
            np.inf,
            1j,
            [],
            {},
            object(),
            np.ones(2),
            1e300,
            "0.001",
        ):
            yield Call(f"{name}.rollout(dt={word(value)})", lambda r=run, v=value: r(dt=v))
        yield Call(f"{name}.rollout(dt=0)", lambda r=run: r(dt=0), same(np.tile(q, (4, 1))))
        for value in (0, -1, 1.5, "3", [], 2, 10**12, 10**30, np.nan, 1j):
            yield Call(f"{name}.rollout(steps={word(value)})", lambda r=run, v=value: r(steps=v))
        for value in (3, np.int64(3)):
            yield Call(
                f"{name}.rollout(steps={value!r})", lambda r=run, v=value: r(steps=v), same(plain)
            )
        for value in (0.0, *NOT_NUMBERS):
            yield Call(
                f"{name}.rollout(sign_width={word(value)})",
                lambda r=run, v=value: r(sign_width=v),
                same(plain) if value in (0.0, np.inf) else None,
            )
        for value in (0, -1, 1.5, "two", None, np.nan):
            yield Call(f"{name}.rollout(threads={value!r})", lambda r=run, v=value: r(threads=v))
        yield Call(f"{name}.rollout(threads=2**40)", lambda r=run: r(threads=2**40), same(plain))
        for value in ("ignore", None, 1, ["nan"]):
            yield Call(f"{name}.rollout(on_error={value!r})", lambda r=run, v=value: r(on_error=v))
        yield Call(
            f"{name}.rollout of no steps",
            lambda r=run: r(tau=np.empty((0, 3))),
            same(q[None]),
        )
        yield Call(
            f"{name}.rollout of no robots",
            lambda r=run: r(tau=np.empty((0, 4, 3))),
            lambda value: value.shape == (0, 5, 9),
        )
        yield Call(f"{name}.rollout of one torque", lambda r=run: r(tau=tau[0]))
        yield Call(
            f"{name}.rollout of 1e12 robots",
            lambda r=run: r(tau=np.broadcast_to(tau, (10**12, 3, 3))),
        )
        yield Call(f"{name}.rollout from open loops", lambda r=run: r(q0=q + 0.01 * np.arange(9)))
        yield Call(
            f"{name}.rollout of batches that differ",
            lambda r=run: r(tau=np.zeros((2, 3, 3)), q0=np.tile(q, (3, 1))),
        )


def _trajectories(w: World) -> Iterator[Call]:
    m = w.motion
    good = {
        "t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau,
        "joint_names": m.joint_names, "actuated": m.actuated,
    }  # fmt: skip
    names = list(m.joint_names)
    odd: dict[str, tuple[str, Any]] = {
        "joint_names None": ("joint_names", None),
        "joint_names text": ("joint_names", "abcdefghi"),
        "joint_names a number": ("joint_names", 9),
        "joint_names numbers": ("joint_names", range(9)),
        "joint_names twice": ("joint_names", ["a"] * 9),
        "joint_names too few": ("joint_names", names[:8]),
        "joint_names from a generator": ("joint_names", (n for n in names[:8])),
        "actuated None": ("actuated", None),
        "actuated text": ("actuated", "abc"),
        "actuated twice": ("actuated", ("gamma_1",) * 3),
        "actuated numbers": ("actuated", (0, 1, 2)),
        "units too few": ("units", ("rad",)),
        "units unknown": ("units", ("deg",) * 9),
        "units None in it": ("units", (None,) * 9),
        "units text": ("units", "rad"),
        "stopped a number": ("stopped", 5),
        "t of other length": ("t", m.t[:-1]),
        "q of other length": ("q", m.q[:-1]),
        "t falling": ("t", m.t[::-1]),
        "t twice": ("t", 0 * m.t),
    }
    for name, (key, value) in odd.items():
        yield Call(
            f"Trajectory({name})", lambda k=key, v=value: sst_pin.Trajectory(**good | {k: v})
        )
    yield Call(
        "Trajectory of generators",
        lambda: sst_pin.Trajectory(**good | {"joint_names": (n for n in names)}),
        lambda value: value == m,
    )
    for t in (-1.0, 1e3, np.nan, None, "now", np.inf):
        yield Call(f"motion.torque()({t!r})", lambda t=t: m.torque()(t))
    yield Call("motion.torque() at a sample", lambda: m.torque()(float(m.t[3])), same(m.tau[3]))
    for names_of_joints in (
        ("a,b", "c"), ("a\nb", "c"), ('"a"', "c"), ("", "c"), ("t_s", "c"), ("a_rad", "c"),
        ("a", "a_rad_s"), ("a_rad", "a"), ("tau_1_Nm", "c"), (" a", "c"), ("é", "c"), ("a", "b_m"),
        ("a", "a_rad"), ("x_m_s", "x"), ("a\0", "b"), ("a_s", "b_s2"), ("time", "t"),
    ):  # fmt: skip
        for ending in (".csv", ".npz"):

            def back(names=names_of_joints, ending=ending) -> Any:
                motion = sst_pin.Trajectory(
                    [0.0, 1.0], np.ones((2, 2)), np.zeros((2, 1)), np.zeros((2, 1)),
                    np.full((2, 1), 2.0), names, names[:1],
                )  # fmt: skip
                motion.save(f"odd{ending}", force=True)
                return motion, sst_pin.Trajectory.load(f"odd{ending}")

            yield Call(
                f"joints {names_of_joints} saved and loaded as {ending}",
                back,
                lambda pair: pair[0] == pair[1],
            )
    for ending in ("csv", "npz", "CSV"):

        def whole(ending=ending) -> Any:
            m.save(f"whole.{ending}", force=True)
            return sst_pin.Trajectory.load(f"whole.{ending}")

        yield Call(f"a motion saved and loaded as .{ending}", whole, lambda value: value == m)


ODD_PATHS: dict[str, Any] = {
    "None": None,
    "number": 5,
    "empty": "",
    "a folder": ".",
    "below a device": "/dev/null/all.csv",
    "NUL": "a\0b.csv",
    "300 letters": "a" * 300 + ".csv",
    "bytes": b"a.csv",
    "list": ["a.csv"],
    "other ending": "a.txt",
    "no ending": "a",
    "only an ending": ".csv",
    "below a file": "file/a.csv",
    "surrogate": "\udcff\ud800.csv",
}


def _files(w: World) -> Iterator[Call]:
    m = w.motion
    Path("file").write_text("x")
    Path("there.csv").write_text("x")
    for name, path in ODD_PATHS.items():
        yield Call(f"motion.save({name})", lambda p=path: m.save(p))
        yield Call(f"motion.writer({name})", lambda p=path: m.writer(p), callable)
        yield Call(f"Trajectory.load({name})", lambda p=path: sst_pin.Trajectory.load(p))
        yield Call(f"read_motion({name})", lambda p=path: read_motion(w.robot, p))
    yield Call("motion.save onto what is there", lambda: m.save("there.csv"))

    buffer = io.BytesIO()
    np.savez(buffer, a=np.ones(3))
    arrays = {
        "t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau,
        "joint_names": np.array(m.joint_names), "actuated": np.array(m.actuated),
        "units": np.array(m.units), "stopped": np.array(""),
    }  # fmt: skip

    def npz(**changes: Any) -> bytes:
        file = io.BytesIO()
        np.savez(file, **{k: v for k, v in (arrays | changes).items() if v is not None})
        return file.getvalue()

    whole = npz()
    contents = {
        "empty.npz": b"",
        "text.npz": b"t_s,a_rad\n0,1\n",
        "half.npz": whole[: len(whole) // 2],
        "zeros.npz": bytes(1000),
        "npy.npz": b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': ()}\n",
        "other.npz": buffer.getvalue(),
        "missing.npz": npz(q=None),
        "words.npz": npz(q=np.full(m.q.shape, "x")),
        "digits.npz": npz(q=m.q.astype(str)),
        "complex.npz": npz(q=m.q + 1j),
        "objects.npz": npz(q=m.q.astype(object)),
        "nan.npz": npz(q=m.q * np.nan),
        "shape.npz": npz(q=m.q[:-1]),
        "scalar.npz": npz(t=np.array(1.0)),
        "names.npz": npz(joint_names=np.array(5)),
        "name.npz": npz(joint_names=np.array("x")),
        "numbers.npz": npz(joint_names=np.arange(9)),
        "dates.npz": npz(t=np.datetime64("2026-01-01") + np.arange(10)),
        "flipped.npz": whole[:3000] + bytes([whole[3000] ^ 255]) + whole[3001:],
        "empty.csv": b"",
        "header.csv": b"t_s,a_rad,a_rad_s,a_rad_s2,tau_1_Nm\n",
        "binary.csv": bytes(range(256)),
        "nul.csv": b"t_s,a_rad\n0,\0\n",
        "latin.csv": "t_s,\xe9_rad\n0,1\n".encode("latin-1"),
        "utf16.csv": "t_s,a_rad\n0,1\n".encode("utf-16"),
        "quote.csv": b't_s,a_rad\n"0,1\n',
        "wide.csv": b"t_s," + b"a" * 200_000 + b"\n0,1\n",
        "digits.csv": b"t_s,a_rad\n0," + b"1" * 200_000 + b"\n",
        "underscore.csv": _table("1_0"),
        "comma.csv": _table('"0,5"'),
        "nan.csv": _table("nan"),
        "inf.csv": _table("-inf"),
        "huge.csv": _table("1e999"),
        "hex.csv": _table("0x10"),
        "arabic.csv": _table("\u0663"),
        "unit.csv": _table("3rad"),
        "none.csv": _table(""),
        "semicolons.csv": _table("0").replace(b",", b";"),
        "tabs.csv": _table("0").replace(b",", b"\t"),
        "backwards.csv": _table("0", time="-1"),
        "many.csv": b"t_s,a_rad\n" + b"0,1,2\n",
        "twice.csv": b"t_s,a_rad,a_rad\n0,1,2\n",
        "two times.csv": b"t_s,time,a_rad\n0,1,2\n",
        "no time.csv": b"a_rad,a_rad_s\n0,1\n",
    }
    for name, content in contents.items():
        Path(name).write_bytes(content)
        yield Call(f"Trajectory.load({name})", lambda n=name: sst_pin.Trajectory.load(n))
        if name.endswith(".csv"):
            yield Call(f"read_motion({name})", lambda n=name: read_motion(w.robot, n))
    Path("bom.csv").write_bytes(b"\xef\xbb\xbf" + _table("0.5"))
    yield Call(
        "Trajectory.load(bom.csv)",
        lambda: sst_pin.Trajectory.load("bom.csv"),
        lambda value: value.q[1, 0] == 0.5 and value.joint_names == ("a",),
    )


def _table(cell: str, time: str = "1") -> bytes:
    text = f"t_s,a_rad,a_rad_s,a_rad_s2,tau_1_Nm\n0,1,2,3,4\n{time},{cell},2,3,4\n"
    return text.encode()


def _motion_files(w: World) -> Iterator[Call]:
    """Motions of the star in files that are none."""

    def file(name: str, header: str, rows: Any) -> str:
        lines = [header, *(",".join(map(repr, map(float, row))) for row in rows)]
        Path(name).write_text("\n".join(lines) + "\n")
        return name

    t = np.arange(6) * 0.01
    still = np.column_stack([t, np.tile((1.0, 0, 0, 0), (6, 1))])
    turned = still.copy()
    turned[3, 1:] = (0.0, 1, 0, 0)
    files = {
        "two rows": ("t_s,qw,qx,qy,qz", still[:2]),
        "zero quaternion": ("t_s,qw,qx,qy,qz", still * (1, 0, 0, 0, 0)),
        "long quaternion": ("t_s,qw,qx,qy,qz", still * (1, 2, 1, 1, 1)),
        "half a turn between": ("t_s,qw,qx,qy,qz", turned),
        "no qz": ("t_s,qw,qx,qy", still[:, :4]),
        "two kinds": ("t_s,qw,theta,gamma_1,qz", still),
        "no kind": ("t_s,a,b,c,d", still),
        "theta alone": ("t_s,theta", still[:, :2]),
        "gamma of two": ("t_s,gamma_1,gamma_2", still[:, :3]),
        "theta in two units": ("t_s,theta_rad,theta_deg,phi", still[:, :4]),
        "motors of 1e300": ("t_s,gamma_1,gamma_2,gamma_3", np.column_stack([t, *[t * 1e300] * 3])),
        "times of 1e-320": ("t_s,qw,qx,qy,qz", still * (1e-318, 1, 1, 1, 1)),
        "times of 1e300": ("t_s,qw,qx,qy,qz", still * (1e302, 1, 1, 1, 1)),
    }
    for name, (header, rows) in files.items():
        yield Call(
            f"read_motion of {name}",
            lambda n=file(f"{name}.csv", header, rows): read_motion(w.robot, n),
            (lambda value: np.isfinite(value.tau).all()) if name == "times of 1e300" else None,
        )


def _motions(w: World) -> Iterator[Call]:
    m = w.motion
    single, other, opened = w.motion[:1], w.motion_of_another, w.open_motion
    renamed = sst_pin.Trajectory(
        m.t, m.q, m.va, m.aa, m.tau, [f"x{i}" for i in range(9)], ["x0", "x3", "x6"]
    )
    for name, motion in {
        "None": None,
        "text": "motion",
        "array": m.q,
        "of one sample": single,
        "of another robot": other,
        "of other names": renamed,
        "with open loops": opened,
    }.items():
        for robot in (w.robot, w.reference):
            yield Call(
                f"energy_error(robot, motion {name})",
                lambda r=robot, m=motion: sst_pin.energy_error(r, m),
            )
    yield Call("energy_error(chain, motion of an SST)", lambda: sst_pin.energy_error(w.chain, m))
    yield Call(
        "energy_error of example 1",
        lambda: sst_pin.energy_error(w.robot, m),
        lambda value: float(np.abs(value).max()) < 1e-4,  # a spline through ten samples
    )
    t = np.linspace(0, 0.1, 8)
    R = sst_pin.paper_circle(t).R
    reflected = R * np.array([1, 1, -1])
    odd: dict[str, tuple[Any, Any, Any]] = {
        "too few samples": (t[:2], R[:2], t[:2]),
        "other length": (t, R[:-1], t),
        "one rotation": (t, R[0], t),
        "reflected": (t, reflected, t),
        "scaled": (t, 2 * R, t),
        "sheared": (t, R + 0.01 * np.arange(9).reshape(3, 3), t),
        "zero": (t, 0 * R, t),
        "times falling": (t[::-1], R, t),
        "half turns": (t, R @ np.diag([1.0, -1, -1]) ** np.arange(8)[:, None, None], t),
        "before the first": (t, R, [-1.0]),
        "after the last": (t, R, [0.2]),
        "a table of times": (t[None], R, t),
        "four axes": (t, R[None], t),
    }
    for name, arguments in odd.items():
        yield Call(
            f"interpolate_orientations({name})",
            lambda a=arguments: sst_pin.interpolate_orientations(*a),
        )
    for at in (np.empty(0), t[3], t[None]):
        yield Call(
            f"interpolate_orientations(at of shape {np.shape(at)})",
            lambda a=at: sst_pin.interpolate_orientations(t, R, a).R,
            lambda value, a=at: (
                value.shape == (*np.shape(a), 3, 3)
                and np.allclose(value, sst_pin.paper_circle(a).R, atol=1e-3)
            ),
        )
    yield Call(
        "orientation of shapes that differ", lambda: sst_pin.orientation([0.1, 0.2], [1.0] * 3)
    )
    yield Call(
        "orientation of none",
        lambda: sst_pin.orientation([], []),
        lambda value: value.shape == (0, 3, 3),
    )
    yield Call(
        "orientation_motion of pairs", lambda: sst_pin.orientation_motion((0, 0), (1, 0), (0, 0))
    )
    yield Call(
        "paper_circle of none",
        lambda: sst_pin.paper_circle([]).R,
        lambda value: value.shape == (0, 3, 3),
    )
    for name, make in _bad_parameters().items():
        yield Call(f"Parameters({name})", make)


def _bad_parameters() -> dict[str, Callable[[], Any]]:
    P, B = sst_pin.Parameters, sst_pin.RigidBody
    body = P().star
    return {
        "two links": lambda: P(link=[body, body]),
        "link a number": lambda: P(link=5),
        "link None": lambda: P(link=None),
        "link text": lambda: P(link="rod"),
        "link of Nones": lambda: P(link=[None] * 3),
        "star None": lambda: P(star=None),
        "star three": lambda: P(star=[body] * 3),
        "degrees": lambda: P(arc_angles=(120, 120, 120)),
        "angle zero": lambda: P(arc_angles=(0, np.pi, np.pi)),
        "plane": lambda: P(base_directions=((1, 0, 0), (0, 1, 0), (1, 1, 0))),
        "direction zero": lambda: P(base_directions=((0, 0, 0), (0, 1, 0), (1, 1, 0))),
        "direction huge": lambda: P(base_directions=np.full((3, 3), 1e300)),
        "directions tiny": lambda: P(base_directions=1e-320 * np.eye(3)),
        "eight frictions": lambda: P(viscous_friction=np.ones(8)),
        "friction negative": lambda: P(coulomb_friction=-1.0),
        "friction digits": lambda: P(coulomb_friction="1.0"),
        "radius zero": lambda: P(base_radius=0),
        "radius negative": lambda: P(star_radius=-1),
        "radius array": lambda: P(star_radius=[1.0, 2.0]),
        "radius complex": lambda: P(star_radius=1j),
        "radius digits": lambda: P(star_radius="0.4"),
        "radius inf": lambda: P(star_radius=np.inf),
        "mass zero": lambda: P(star=B(0, (0, 0, 0), np.eye(3))),
        "mass negative": lambda: P(star=B(-1, (0, 0, 0), np.eye(3))),
        "mass digits": lambda: P(star=B("2.6", (0, 0, 0), np.eye(3))),
        "mass array": lambda: P(star=B(np.ones(2), (0, 0, 0), np.eye(3))),
        "mass complex": lambda: P(star=B(1j, (0, 0, 0), np.eye(3))),
        "mass 400 digits": lambda: P(star=B(10**400, (0, 0, 0), np.eye(3))),
        "inertia skew": lambda: P(star=B(1, (0, 0, 0), np.triu(np.ones((3, 3))))),
        "inertia flat": lambda: P(star=B(1, (0, 0, 0), np.diag((1, 1, 3)))),
        "inertia negative": lambda: P(star=B(1, (0, 0, 0), -np.eye(3))),
        "inertia zero": lambda: P(star=B(1, (0, 0, 0), np.zeros((3, 3)))),
        "inertia a vector": lambda: P(star=B(1, (0, 0, 0), np.ones(3))),
        "inertia NaN": lambda: P(star=B(1, (0, 0, 0), np.full((3, 3), np.nan))),
    }
