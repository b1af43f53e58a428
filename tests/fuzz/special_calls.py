# SPDX-License-Identifier: BSD-2-Clause
"""Bad and odd calls that no signature gives: odd models, odd names, files that are no motions.

Figures, maps and pages are asked for what they cannot give.
"""

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import sst_pin
from sst_pin.simulation.motion_files import read_motion
from tests.fuzz.call_world import World
from tests.fuzz.judged_calls import Call
from tests.fuzz.signature_calls import each, same

#: Subjects of a page that are drawn from the motion alone, or from the motion and the foot.
FROM_MOTION = ("path", "torques", "joints")


def chains(w: World) -> Iterator[Call]:
    """Chains built by hand."""
    yield from _constructors(w)
    yield from _hand_built(w)
    turned = (np.eye(3)[::-1], 2 * np.eye(3), np.zeros((3, 3)), np.eye(3) + 0.01)
    yield from each("inverse_kinematics", w.robot.inverse_kinematics, turned)
    branches = ((1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1))
    yield from each(
        "inverse_kinematics, branch",
        lambda branch: w.robot.inverse_kinematics(np.eye(3), branch),
        branches,
    )
    q, va, aa = w.states
    for robot in (w.robot, w.reference):
        yield Call("batches that differ", lambda r=robot: r.compute_torques(q, va[:3], aa[:2]))
        huge = [np.broadcast_to(q[0], (10**exponent, 9)) for exponent in (12, 15)]
        yield from each("huge", lambda x, r=robot: r.compute_torques(x, va[0], aa[0]), huge)


def motions(w: World) -> Iterator[Call]:
    """Motions, their files, and what is simulated."""
    yield from _in_time(w)
    yield from _trajectories(w)
    yield from _files(w)
    yield from _motion_files(w)
    yield from _of_the_star(w)


def _constructors(w: World) -> Iterator[Call]:
    table = w.table_of_four_bar
    q, va, aa, tau = w.chain_state
    closures, motors = list(table.closures), ["crank"]

    def made(**changes: Any) -> np.ndarray:
        given = {"model": table.model(), "closures": closures, "actuated": motors} | changes
        return sst_pin.ClosedChain(**given).compute_torques(q, va, aa)

    bad: dict[str, tuple[Any, ...]] = {
        "model": (
            None, "model", 5, pin.Model, pin.Model(), w.robot, table.model().createData(),
        ),
        "closures": (
            None, "AB", 5, ("A", "B"), [("A",)], [("A", "B", "3d", "x")], [("A", "B", None)],
            [(1, 2)], [None], [object()], [("A", "X")], [("A", None)], [(b"A", b"B")], [("", "")],
            [("A", "B", "9d")], [("A", "A", "3d")], [], {"A": "B"}, [("universe", "universe")],
            [("crank", "coupler", "3d")],
        ),
        "actuated": (
            None, "crank", 5, [0], [None], [["crank"]], ["krank"], ["crank", "crank"], [],
            [b"crank"], ["universe"], ["A"],
        ),
    }  # fmt: skip
    odd: dict[str, tuple[Any, ...]] = {
        "closures": (
            closures * 2, (c for c in closures), tuple(closures), [("A", "B", "3d")],
            [["A", "B", "3d"]], [("B", "A", "3d")],
        ),
        "actuated": ((m for m in motors), np.array(motors), {"crank"}, {"crank": 1}),
    }  # fmt: skip
    for name in ("model", "closures", "actuated"):

        def make(value: Any, name: str = name) -> np.ndarray:
            return made(**{name: value})

        yield from each(f"ClosedChain, bad {name}", make, bad[name])
        yield from each(f"ClosedChain, odd {name}", make, odd.get(name, ()), same(tau))
    pairs = (
        (None, None), ("A", "B", "9d"), ("A", "B", None), ("A", "B", ["6d"]), ("A", "B", 6), (1, 2),
        (["A"], "B"),
    )  # fmt: skip
    yield from each("Closure", lambda arguments: sst_pin.Closure(*arguments), pairs)
    yield from each("SST", sst_pin.SST, (5, "x", {}, object(), sst_pin.Parameters))


def _hand_built(w: World) -> Iterator[Call]:
    """Models that people write, and models with a fault in them."""
    table = w.table_of_four_bar
    q, va, aa, tau = w.chain_state

    def of(change: Callable[[pin.Model], Any]) -> sst_pin.ClosedChain:
        model = table.model()
        change(model)
        return sst_pin.ClosedChain(model, table.closures, table.actuated)

    def frame(name: str, kind: Any = pin.FrameType.OP_FRAME) -> Callable[[pin.Model], Any]:
        at = pin.SE3(np.eye(3), np.ones(3))
        return lambda m: m.addFrame(pin.Frame(name, 1, at, kind), False)

    def with_joint(joint: pin.JointModel) -> Callable[[pin.Model], None]:
        def add(model: pin.Model) -> None:
            i = model.addJoint(3, joint, pin.SE3.Identity(), "odd")
            model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())

        return add

    def entry(field: str, value: Any) -> Callable[[pin.Model], None]:
        return lambda m: getattr(m, field).__setitem__(2, value)

    def weight(x: float) -> Callable[[pin.Model], None]:
        return lambda m: setattr(m.gravity, "linear", np.array((x, 0, -9.81)))

    body = pin.FrameType.BODY
    for name, change, right in (
        ("a second frame A", frame("A"), same(tau)),  # Pinocchio adds no such frame
        ("a second frame A of a body", frame("A", body), None),
        ("a second frame A of a sensor", frame("A", pin.FrameType.SENSOR), None),
        ("a body and a joint of one name", frame("crank", body), same(tau)),
        ("two names alike", entry("names", "crank"), None),
        ("two joints of one name",
         lambda m: m.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "crank"), None),
        ("a NaN in gravity", weight(np.nan), None),
        ("infinite gravity", weight(np.inf), None),
        ("a mass of NaN", entry("inertias", pin.Inertia(np.nan, np.zeros(3), np.eye(3))), None),
        ("a mass centre at NaN",
         entry("inertias", pin.Inertia(1, np.full(3, np.nan), np.eye(3))), None),
        ("a NaN in a placement",
         entry("jointPlacements", pin.SE3(np.eye(3), np.full(3, np.nan))), None),
        ("NaN armature", lambda m: setattr(m, "armature", np.full(3, np.nan)), None),
        ("NaN damping", lambda m: setattr(m, "damping", np.full(3, np.nan)), None),
        ("infinite friction", lambda m: setattr(m, "friction", np.full(3, np.inf)), None),
    ):  # fmt: skip
        yield Call(f"a model with {name}", lambda c=change: of(c).compute_torques(q, va, aa), right)
    for kind in (pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned):
        yield Call(
            f"{kind.__name__} about nothing",
            lambda k=kind: of(with_joint(k(np.zeros(3)))).compute_torques(np.r_[q, 0], va, aa),
        )


def _in_time(w: World) -> Iterator[Call]:
    """Times, torques and loads of a simulation, steps of a rollout."""
    q, va, _ = (x[0] for x in w.states)
    state = {"torque": w.tau[0], "q0": q, "va0": va, "t": np.linspace(0, 0.002, 3)}
    times = ([], [1.0, 0.0], [[0.0, 1.0]], 1.0, [0.0, np.inf], ["now", "then"], [1e300, 1.1e300])
    bad = [{"t": t} for t in times] + [{"torque": {}}, {"torque": w.motion_of_another}]
    bad += [{"external_wrenches": lambda t, q, va, x=x: x} for x in (np.zeros(6), None)]
    yield from each("robot.simulate", lambda odd: w.robot.simulate(**state | odd), bad)
    tau = np.broadcast_to(w.tau[0], (10**12, 3, 3))
    for robot in (w.robot, w.reference):
        for huge in ({"dt": 1e300, "tau": tau[0]}, {"dt": 1e-3, "tau": tau}):
            given = {"q0": q, "va0": va} | huge
            yield Call("rollout", lambda r=robot, x=given: r.rollout(**x))


def _trajectories(w: World) -> Iterator[Call]:
    m, two = w.motion, [0.0, 1.0]
    good = {name: getattr(m, name) for name in ("t", "q", "va", "aa", "tau")}
    good |= {"joint_names": m.joint_names, "actuated": m.actuated}
    bad = ({"t": m.t[:-1]}, {"t": m.t[::-1]}, {"t": 0 * m.t}, {"q": m.q[:-1]})
    yield from each("Trajectory", lambda odd: sst_pin.Trajectory(**good | odd), bad)

    def saved(motion: Any, path: str) -> Any:
        motion.save(path, force=True)
        return motion, sst_pin.Trajectory.load(path)

    for joints in (
        ("a,b", "c"), ("a\nb", "c"), ('"a"', "c"), ("", "c"), ("t_s", "c"), ("a_rad", "c"),
        ("a", "a_rad_s"), ("a_rad", "a"), ("tau_1_Nm", "c"), (" a", "c"), ("é", "c"), ("a", "b_m"),
        ("a", "a_rad"), ("x_m_s", "x"), ("a\0", "b"), ("a_s", "b_s2"), ("time", "t"),
    ):  # fmt: skip
        arrays = two, np.ones((2, 2)), np.zeros((2, 1)), np.zeros((2, 1)), np.full((2, 1), 2.0)
        for ending in ("csv", "npz"):
            yield Call(
                f"joints {joints} saved and loaded as {ending}",
                lambda j=joints, a=arrays, e=ending: saved(
                    sst_pin.Trajectory(*a, j, j[:1]), f"odd.{e}"
                ),
                lambda pair: pair[0] == pair[1],
            )


def _table(cell: str, time: str = "1") -> bytes:
    text = f"t_s,a_rad,a_rad_s,a_rad_s2,tau_1_Nm\n0,1,2,3,4\n{time},{cell},2,3,4\n"
    return text.encode()


def _files(w: World) -> Iterator[Call]:
    """Files that are no motions."""
    m = w.motion
    Path("file").write_text("x")
    Path("there.csv").write_text("x")
    yield Call("motion.save onto what is there", lambda: m.save("there.csv"))
    arrays = {
        "t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau,
        "joint_names": np.array(m.joint_names), "actuated": np.array(m.actuated),
        "units": np.array(m.units), "stopped": np.array(""),
    }  # fmt: skip

    def npz(**changes: Any) -> bytes:
        file = io.BytesIO()
        np.savez(file, **{k: v for k, v in (arrays | changes).items() if v is not None})
        return file.getvalue()

    whole, other = npz(), io.BytesIO()
    np.savez(other, a=np.ones(3))
    archives = (
        b"", b"t_s,a_rad\n0,1\n", whole[: len(whole) // 2], bytes(1000),
        b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': ()}\n",
        other.getvalue(), npz(q=None), npz(q=np.full(m.q.shape, "x")), npz(q=m.q.astype(str)),
        npz(q=m.q + 1j), npz(q=m.q.astype(object)), npz(q=m.q * np.nan), npz(q=m.q[:-1]),
        npz(t=np.array(1.0)), npz(joint_names=np.array(5)), npz(joint_names=np.array("x")),
        npz(joint_names=np.arange(9)), npz(t=np.datetime64("2026-01-01") + np.arange(10)),
        whole[:3000] + bytes([whole[3000] ^ 255]) + whole[3001:],
    )  # fmt: skip
    tables = (
        _table("0", time="-1"), bytes(range(256)), b"t_s,a_rad\n0,\0\n",
        "t_s,\xe9_rad\n0,1\n".encode("latin-1"), "t_s,a_rad\n0,1\n".encode("utf-16"),
        b"t_s," + b"a" * 200_000 + b"\n0,1\n", b"t_s,a_rad\n0," + b"1" * 200_000 + b"\n",
        b"t_s,a_rad\n0,1,2\n", b"a_rad,a_rad_s\n0,1\n",
    )  # fmt: skip
    for ending, contents in (("npz", archives), ("csv", tables)):
        for i, content in enumerate(contents):
            path = f"bad_{i}.{ending}"
            Path(path).write_bytes(content)
            label = f"{path}: {content[-40:]!r}"
            yield Call(f"Trajectory.load({label})", lambda p=path: sst_pin.Trajectory.load(p))
            if ending == "csv":
                yield Call(f"read_motion({label})", lambda p=path: read_motion(w.robot, p))
    Path("bom.csv").write_bytes(b"\xef\xbb\xbf" + _table("0.5"))
    yield Call(
        "Trajectory.load(bom.csv)",
        lambda: sst_pin.Trajectory.load("bom.csv"),
        lambda value: value.q[1, 0] == 0.5 and value.joint_names == ("a",),
    )


def _motion_files(w: World) -> Iterator[Call]:
    """Motions of the star in files that are none."""
    t = np.arange(6) * 0.01
    still = np.column_stack([t, np.tile((1.0, 0, 0, 0), (6, 1))])
    turned = still.copy()
    turned[3, 1:] = (0.0, 1, 0, 0)
    quaternion = "t_s,qw,qx,qy,qz"
    files = {
        "zero quaternion": (quaternion, still * (1, 0, 0, 0, 0)),
        "half a turn between": (quaternion, turned),
        "theta alone": ("t_s,theta", still[:, :2]),
        "theta in two units": ("t_s,theta_rad,theta_deg,phi", still[:, :4]),
        "motors of 1e300": ("t_s,gamma_1,gamma_2,gamma_3", np.column_stack([t, *[t * 1e300] * 3])),
        "times of 1e-320": (quaternion, still * (1e-318, 1, 1, 1, 1)),
        "times of 1e300": (quaternion, still * (1e302, 1, 1, 1, 1)),
    }
    for name, (header, rows) in files.items():
        lines = [header, *(",".join(map(repr, map(float, row))) for row in rows)]
        Path(f"{name}.csv").write_text("\n".join(lines) + "\n")
        yield Call(
            f"read_motion of {name}",
            lambda n=name: read_motion(w.robot, f"{n}.csv"),
            (lambda value: np.isfinite(value.tau).all()) if name == "times of 1e300" else None,
        )


def _of_the_star(w: World) -> Iterator[Call]:
    t = np.linspace(0, 0.1, 8)
    R = sst_pin.paper_circle(t).R
    half_turns = R @ np.diag([1.0, -1, -1]) ** np.arange(8)[:, None, None]
    bad = (
        (t[:2], R[:2], t[:2]), (t, R[:-1], t), (t, R[0], t), (t, R * np.array([1, 1, -1]), t),
        (t, 2 * R, t), (t, R + 0.01 * np.arange(9).reshape(3, 3), t), (t, 0 * R, t),
        (t[::-1], R, t), (t, half_turns, t), (t, R, [-1.0]), (t, R, [0.2]), (t[None], R, t),
        (t, R[None], t),
    )  # fmt: skip
    yield from each("interpolate_orientations", lambda a: sst_pin.interpolate_orientations(*a), bad)
    for at in (np.empty(0), t[3], t[None]):
        yield Call(
            f"interpolate_orientations(at of shape {np.shape(at)})",
            lambda a=at: sst_pin.interpolate_orientations(t, R, a).R,
            lambda value, a=at: (
                value.shape == (*np.shape(a), 3, 3)
                and np.allclose(value, sst_pin.paper_circle(a).R, atol=1e-3)
            ),
        )

    def none(value: Any) -> bool:
        return value.shape == (0, 3, 3)

    yield Call("orientation, other shapes", lambda: sst_pin.orientation([0.1, 0.2], [1.0] * 3))
    yield Call("orientation of none", lambda: sst_pin.orientation([], []), none)
    yield Call("pairs", lambda: sst_pin.orientation_motion((0, 0), (1, 0), (0, 0)))
    yield Call("paper_circle of none", lambda: sst_pin.paper_circle([]).R, none)


def pictures(w: World) -> Iterator[Call]:
    """Figures, maps and the viewer."""
    from sst_pin import plots
    from sst_pin.sst.workspace import workspace_at, workspace_over_rolls
    from sst_pin.viewer import Viewer

    m, other = w.motion, w.motion_of_another
    for name, motion in (("one sample", m[:1]), ("another robot's motion", other)):
        subjects = [s for s in plots.SUBJECTS if motion is not other or s not in FROM_MOTION]
        yield from each(
            f"motion_page of {name}",
            lambda s, motion=motion: plots.motion_page(w.robot, motion, [s]),
            subjects,
        )
    odd = ([], (), "torques", ["torque"], [None], 5, "unknown", [["torques"]])
    yield from each("motion_page, subjects", lambda s: plots.motion_page(w.robot, m, s), odd)
    yield from each("picture_kind", plots.picture_kind, ("a.jpg", "a.csv", b"a.png"))
    sizes = ((2, 3), (3, 2), (10**12, 3), (3, 10**12))
    yield from each("workspace_at", lambda size: workspace_at(w.robot, 0.0, *size), sizes)
    yield Call("workspace_over_rolls(10**12)", lambda: workspace_over_rolls(w.robot, 10**12, 3, 3))
    Path("there.npz").write_text("x")
    map_ = workspace_at(w.robot, rings=5, spokes=6)
    yield Call("workspace.save onto what is there", lambda: map_.save("there.npz"))
    yield from each("viewer.show", Viewer(w.robot).show, (m.q[0, :8], m.q, "home"))
    yield Call("viewer.play(of an SST on a chain)", lambda: Viewer(w.chain).play(m))
    yield from each("Viewer", Viewer, (None, "robot", 5))
