# SPDX-License-Identifier: BSD-2-Clause
"""Bad and odd calls that no signature gives: odd models, odd files, odd arrays that are right."""

import copy
import io
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from call_world import World
from judged_calls import Call
from signature_calls import each, same, word

import sst_pin
from sst_pin.motion.motion_files import read_motion
from sst_pin.verification.referees import lagrange


def chains(w: World) -> Iterator[Call]:
    """Chains built by hand, changed afterwards, and asked with odd arrays."""
    yield from _constructors(w)
    yield from _hand_built(w)
    yield from _changed(w)
    yield from _copies(w)
    yield from _options(w)
    yield from _arrays(w)


def motions(w: World) -> Iterator[Call]:
    """Motions, their files, and what is simulated."""
    yield from _simulate(w)
    yield from _rollout(w)
    yield from _trajectories(w)
    yield from _files(w)
    yield from _motion_files(w)
    yield from _of_the_star(w)
    for name, make in _bad_parameters().items():
        yield Call(f"Parameters({name})", make)


# --- chains -----------------------------------------------------------------------------------


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
    yield Call(
        "ClosedChain(actuated: all), torques that do the same work",
        lambda: made(actuated=["crank", "coupler", "rocker"]) @ w.chain.joint_rates(q, [1.0]),
        same(tau[0]),
    )
    pairs = (
        (None, None), ("A", "B", "9d"), ("A", "B", None), ("A", "B", ["6d"]), ("A", "B", 6), (1, 2),
        (["A"], "B"),
    )  # fmt: skip
    yield from each("Closure", lambda arguments: sst_pin.Closure(*arguments), pairs)
    yield from each("SST", sst_pin.SST, (5, "x", {}, object(), sst_pin.Parameters))

    class OwnChain(sst_pin.ClosedChain):
        pass

    class OwnSST(sst_pin.SST):
        pass

    own = {"from_urdf": sst_pin.URDF_PATH, "from_mjcf": sst_pin.MJCF_PATH}
    for method, path in own.items():
        read = getattr(OwnChain, method)
        yield from each(f"own {method}", read, [path], lambda chain: type(chain) is OwnChain)
    yield from each("OwnSST", OwnSST.from_urdf, [sst_pin.URDF_PATH], lambda r: type(r) is OwnSST)


def _hand_built(w: World) -> Iterator[Call]:
    """Models that people write, and models with a fault in them."""
    table = w.table_of_four_bar
    q, va, aa, tau = w.chain_state

    def of(change: Callable[[pin.Model], Any]) -> sst_pin.ClosedChain:
        model = table.model()
        change(model)
        return sst_pin.ClosedChain(model, table.closures, table.actuated)

    order = [0, 2, 1]  # crank and rocker before the coupler that the crank bears
    for method, last, wanted in (
        ("compute_torques", [aa], tau),
        ("compute_accelerations", [tau], aa),
        ("kinetic_energy", [], w.chain.kinetic_energy(q, va)),
        ("reduced_terms", [], w.chain.reduced_terms(q, va)),
    ):

        def breadth_first(method=method, last=last) -> Any:
            chain = sst_pin.ClosedChain(table.model(order), table.closures, table.actuated)
            return getattr(chain, method)(q[order], va, *last)

        yield Call(f"joints breadth first: {method}", breadth_first, same(wanted))

    def frame(name: str, kind: Any = pin.FrameType.OP_FRAME) -> Callable[[pin.Model], Any]:
        at = pin.SE3(np.eye(3), np.ones(3))
        return lambda m: m.addFrame(pin.Frame(name, 1, at, kind), False)

    def with_joint(joint: pin.JointModel) -> Callable[[pin.Model], None]:
        def add(model: pin.Model) -> None:
            i = model.addJoint(3, joint, pin.SE3.Identity(), "odd")
            model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())

        return add

    def massless(model: pin.Model) -> None:
        for j in range(1, model.njoints):
            model.inertias[j] = pin.Inertia.Zero()
        model.armature = np.zeros(3)

    def renamed(model: pin.Model) -> None:
        model.names[2] = "crank"

    def inertia(mass: float = 1.0, lever: float = 0.0) -> Callable[[pin.Model], None]:
        def change(model: pin.Model) -> None:
            model.inertias[2] = pin.Inertia(mass, np.full(3, lever), model.inertias[2].inertia)

        return change

    def placement(x: float) -> Callable[[pin.Model], None]:
        def change(model: pin.Model) -> None:
            model.jointPlacements[2] = pin.SE3(np.eye(3), np.array((x, 0, 0)))

        return change

    def gravity(x: float) -> Callable[[pin.Model], None]:
        return lambda m: setattr(m.gravity, "linear", np.array((x, 0, -9.81)))

    body = pin.FrameType.BODY
    for name, change, right in (
        ("a second frame A", frame("A"), same(tau)),  # Pinocchio adds no such frame
        ("a second frame A of a body", frame("A", body), None),
        ("a second frame A of a sensor", frame("A", pin.FrameType.SENSOR), None),
        ("a body and a joint of one name", frame("crank", body), same(tau)),
        ("two names alike", renamed, None),
        ("two joints of one name",
         lambda m: m.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "crank"), None),
        ("a NaN in gravity", gravity(np.nan), None),
        ("infinite gravity", gravity(np.inf), None),
        ("a mass of NaN", inertia(mass=np.nan), None),
        ("an infinite mass", inertia(mass=np.inf), None),
        ("a mass centre at NaN", inertia(lever=np.nan), None),
        ("a NaN in a placement", placement(np.nan), None),
        ("a joint at infinity", placement(np.inf), None),
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
    yield Call("a massless chain", lambda: of(massless).compute_accelerations(q, va, tau))


def _by_multipliers(robot: Any, q: np.ndarray, va: np.ndarray, aa: np.ndarray) -> np.ndarray:
    """Torques of `robot.model` as it is now, by Lagrange multipliers."""
    own = sst_pin.ClosedChain(
        pin.Model(robot.model), robot.closures, robot.motor_names, coordinates=robot.coordinates
    )
    return lagrange.torques(own, q, va, aa)


def _changes() -> dict[str, Callable[[pin.Model], Any]]:
    """What may be changed in the model of a robot that is made."""

    def joint(parent: int) -> Callable[[pin.Model], Any]:
        return lambda m: m.addJoint(parent, pin.JointModelRX(), pin.SE3.Identity(), "late")

    def put(array: str, value: Any) -> Callable[[pin.Model], None]:
        def change(model: pin.Model) -> None:
            owner, name = (model.gravity, "linear") if array == "gravity" else (model, array)
            getattr(owner, name)[:] = value

        return change

    def mass(model: pin.Model) -> None:
        model.inertias[1] = pin.Inertia(9.0, np.ones(3), np.eye(3))

    def placement(model: pin.Model) -> None:
        turned = model.jointPlacements[1]
        model.jointPlacements[1] = pin.SE3(turned.rotation, np.array((0, 0, 0.1)))

    def frame_moved(model: pin.Model) -> None:
        i = model.getFrameId("closedloop1_B")
        model.frames[i].placement = pin.SE3(np.eye(3), np.zeros(3))

    gravity, friction = np.array((1.0, -2, 3)), np.arange(1.0, 10)
    late = pin.Frame("late", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    return {
        "frame": lambda m: m.addFrame(late),
        "joint": joint(0),
        "joint at the end": joint(3),
        "gravity": lambda m: setattr(m.gravity, "linear", gravity),
        "gravity in place": put("gravity", gravity),
        "mass": mass,
        "mass in place": lambda m: setattr(m.inertias[1], "mass", 9.0),
        "placement": placement,
        "damping": lambda m: setattr(m, "damping", friction),
        "damping in place": put("damping", friction),
        "friction": lambda m: setattr(m, "friction", friction),
        "armature": lambda m: setattr(m, "armature", friction),
        "frame moved": frame_moved,
    }


def _changed(w: World) -> Iterator[Call]:
    """A model that is changed after the robot was made: it counts from `refresh()` on."""
    x = tuple(a[0] for a in w.states)

    def run(kernels: bool, change: Any, refreshed: bool) -> Any:
        robot = w.fresh(kernels=kernels)
        robot.compute_torques(*x)
        change(robot.model)
        if refreshed:
            robot.refresh()
        return robot, robot.compute_torques(*x)

    def unchanged(pair: Any) -> bool:
        return same(w.tau[0])(pair[1])

    def follows(pair: Any) -> bool:
        robot, tau = pair
        return same(w.tau[0] if robot.model.nv != 9 else _by_multipliers(robot, *x))(tau)

    for name, change in _changes().items():
        for kernels in (True, False):
            for refreshed, right in ((False, unchanged), (True, follows)):
                yield Call(
                    f"{name} changed, kernels={kernels}{', refresh()' * refreshed}",
                    lambda c=change, k=kernels, r=refreshed: run(k, c, r),
                    right,
                )
    *state, tau = w.chain_state

    def never_used(change: Any) -> Any:
        chain = w.table_of_four_bar.chain()
        change(chain.model)
        return chain.compute_torques(*state)

    changes = {name: _changes()[name] for name in ("frame", "joint", "gravity")}
    yield from each("a chain never used, changed", never_used, changes, same(tau))


def _copies(w: World) -> Iterator[Call]:
    x = tuple(a[0] for a in w.states)
    for name, make in (
        ("copy.copy", copy.copy),
        ("copy.deepcopy", copy.deepcopy),
        ("pickle", lambda robot: pickle.loads(pickle.dumps(robot))),
    ):

        def twin_of(make=make) -> tuple[Any, Any]:
            robot = w.fresh()
            robot.compute_torques(*x)
            return robot, make(robot)

        def independent(twins=twin_of) -> Any:
            robot, twin = twins()
            if twin.model is robot.model:
                return w.tau[0]  # one model: one robot
            twin.model.gravity.linear = np.array((1.0, -2, 3))
            twin.refresh()
            return robot.compute_torques(*x)

        yield Call(
            f"{name} of an SST", lambda t=twin_of: t()[1].compute_torques(*x), same(w.tau[0])
        )
        yield Call(f"{name} of an SST, the copy changed", independent, same(w.tau[0]))
        yield Call(
            f"{name} of a chain",
            lambda make=make: make(w.chain).compute_torques(*w.chain_state[:3]),
            same(w.chain_state[3]),
        )


def _options(w: World) -> Iterator[Call]:
    """Odd options that have an answer."""
    (q, va, aa), tau = w.states, w.tau
    w.robot.compute_torques(q[0], va[0], aa[0])  # the kernels are there: the fast entry answers
    for name, robot, state, answer in (
        ("robot", w.robot, (q[0], va[0], aa[0]), tau[0]),
        ("batch of robot", w.robot, (q, va, aa), tau),
        ("reference", w.reference, (q[0], va[0], aa[0]), tau[0]),
        ("batch of reference", w.reference, (q, va, aa), tau),
        ("chain", w.chain, w.chain_state[:3], w.chain_state[3]),
    ):
        strided = np.empty((*answer.shape[:-1], 2 * answer.shape[-1]))[..., ::2]

        def overlapping(robot=robot, state=state) -> np.ndarray:
            aa = np.array(state[2])
            return robot.compute_torques(state[0], state[1], aa, out=aa)

        call = f"{name}.compute_torques"
        yield Call(
            f"{call}(out: strided)",
            lambda r=robot, a=state, o=strided: r.compute_torques(*a, out=o),
            lambda value, o=strided, t=answer: value is o and same(t)(o),
        )
        yield Call(f"{call}(out: aa itself)", overlapping, same(answer))
        for threads in (3, 10**6, 2**31, 2**40, np.int64(2)):
            yield Call(
                f"{call}(threads={threads!r})",
                lambda r=robot, a=state, n=threads: r.compute_torques(*a, threads=n),
                same(answer),
            )
    closed, off = w.robot.assemble(q[0]), q[0] + 0.01
    every = list(w.robot.joint_names)
    yield Call("assemble(fixed=all)", lambda: w.robot.assemble(off, every))
    yield Call("assemble(fixed=all), closed", lambda: w.robot.assemble(closed, every), same(closed))
    for fixed in (["gamma_1", "gamma_1"], np.array(["gamma_1"]), {"gamma_1"}, (), None):
        yield Call(
            f"assemble(fixed={word(fixed)})",
            lambda f=fixed: w.robot.residual(w.robot.assemble(off, f)),
            lambda value: float(np.abs(value).max()) < 1e-11,
        )


def _arrays(w: World) -> Iterator[Call]:
    """Odd arrays that hold the right numbers, and odd batches."""

    def unaligned(array: np.ndarray) -> np.ndarray:
        raw = np.empty(array.nbytes + 1, np.uint8)
        moved = raw[1:].view(np.float64).reshape(array.shape)
        moved[:] = array
        return moved

    def frozen(array: np.ndarray) -> np.ndarray:
        array = array.copy()
        array.setflags(write=False)
        return array

    forms: dict[str, Callable[[np.ndarray], Any]] = {
        "lists": lambda a: a.tolist(),
        "tuples": lambda a: tuple(map(tuple, a)),
        "Fortran order": np.asfortranarray,
        "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
        "backwards": lambda a: a[::-1].copy()[::-1],
        "big-endian": lambda a: a.astype(">f8"),
        "unaligned": unaligned,
        "objects of floats": lambda a: a.astype(object),
        "long doubles": lambda a: a.astype(np.longdouble),
        "read-only": frozen,
        "a matrix": np.asmatrix,
        "a masked array, nothing masked": np.ma.masked_array,
    }
    for label, robot in (("robot", w.robot), ("reference", w.reference)):
        yield from _batches(w, f"{label}.compute_torques", robot.compute_torques, forms)
    turned = (np.eye(3)[::-1], 2 * np.eye(3), np.zeros((3, 3)), np.eye(3) + 0.01)
    yield from each("inverse_kinematics", w.robot.inverse_kinematics, turned)
    yield from each(
        "inverse_kinematics, branch",
        lambda branch: w.robot.inverse_kinematics(np.eye(3), branch),
        ((1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1)),
    )


def _batches(w: World, name: str, torques: Any, forms: dict[str, Any]) -> Iterator[Call]:
    (q, va, aa), tau = w.states, w.tau
    spoilt, opened = q.copy(), q.copy()
    spoilt[1, 2], opened[2, 1] = np.nan, opened[2, 1] + 0.1
    yield from each(f"{name} of", lambda f: torques(f(q), f(va), f(aa)), forms, same(tau))
    for shape in ((0,), (0, 5), (5, 0)):
        none = [np.empty((*shape, n)) for n in (9, 3, 3)]
        yield from each(f"{name} of none", lambda x: torques(*x), [none], same(none[1]))
    yield Call(f"{name} of batches that differ", lambda: torques(q, va[:3], aa[:2]))
    huge = [np.broadcast_to(q[0], (10**exponent, 9)) for exponent in (12, 15)]
    yield from each(f"{name} of huge batches", lambda x: torques(x, va[0], aa[0]), huge)
    bad = {"NaN": spoilt, "open": opened}
    yield from each(f"{name}, one sample", lambda x: torques(x, va, aa), bad)
    for i, x in enumerate(bad.values(), start=1):
        wanted = tau.copy()
        wanted[i] = np.nan
        others = [x]
        yield from each(
            f"{name}, one bad sample {i}, on_error='nan'",
            lambda x: torques(x, va, aa, on_error="nan"),
            others,
            same(wanted),
        )
    turned = [q + 2 * np.pi * np.arange(9)]
    yield from each(f"{name} some turns further", lambda x: torques(x, va, aa), turned, same(tau))


# --- motions ----------------------------------------------------------------------------------


def _simulate(w: World) -> Iterator[Call]:
    q, va, _ = (x[0] for x in w.states)
    t = np.linspace(0, 0.002, 3)
    chain_q, chain_va, _, chain_tau = w.chain_state
    of_robot = {"torque": w.tau[0], "q0": q, "va0": va, "t": t}
    of_chain = {"torque": chain_tau, "q0": chain_q, "va0": chain_va, "t": t}
    yield from _simulated(w, "robot", w.robot, of_robot)
    yield from _simulated(w, "chain", w.chain, of_chain)
    for name, value, many in (("external_wrenches", (9, 6), 6), ("platform_moment", 3, 1)):

        def loaded(odd: Any, name: str = name) -> Any:
            return w.robot.simulate(**of_robot, **{name: lambda t, q, va: odd})

        yield from each(name, loaded, (np.full(value, np.nan), np.zeros(many), None, "x"))


def _simulated(w: World, name: str, robot: Any, state: dict[str, Any]) -> Iterator[Call]:
    def run(options: dict[str, Any]) -> np.ndarray:
        return robot.simulate(**state | options).q

    plain, n = run({}), len(state["torque"])
    methods = [{"method": method} for method in ("RK45", "Radau", "LSODA")]
    yield from each(
        f"{name}.simulate",
        run,
        methods,
        lambda q: q.shape == plain.shape and bool(np.abs(q - plain).max() < 1e-3),
    )
    times = (
        [0.0], [], [1.0, 0.0], [0.0, 0.0], [[0.0, 1.0]], 1.0, [0.0, np.nan], [0.0, np.inf],
        ["now", "then"], [1e300, 1.0000001e300],
    )  # fmt: skip
    yield from each(f"{name}.simulate, t", lambda x: run({"t": x}), times)
    torques = (
        np.ones((2, n)), np.ones((3, 3, n)), np.full((3, n), np.nan), {},
        lambda t, q, va: np.zeros(n + 1),
    )  # fmt: skip
    yield from each(f"{name}.simulate, torque", lambda x: run({"torque": x}), torques)
    bad = {
        "a motion too short, or another's": {"torque": w.motion, "t": [0.0, 1.0]},
        "another's motion": {"torque": w.motion if name == "chain" else w.motion_of_another},
        "open loops": {"q0": state["q0"] + 0.01 * np.arange(len(state["q0"]))},
    }
    yield from each(f"{name}.simulate", run, bad)


def _rollout(w: World) -> Iterator[Call]:
    for name, robot in (("robot", w.robot), ("reference", w.reference)):
        yield from _rolled_out(w, f"{name}.rollout", robot)


def _rolled_out(w: World, name: str, robot: Any) -> Iterator[Call]:
    q, va, _ = (x[0] for x in w.states)
    tau, few = np.tile(w.tau[0], (3, 1)), np.tile(q, (3, 1))

    def run(options: dict[str, Any]) -> np.ndarray:
        return robot.rollout(**{"tau": tau, "q0": q, "va0": va, "dt": 1e-3} | options).q

    bad = (
        {"dt": 1e300}, {"steps": 2}, {"tau": tau[0]}, {"q0": q + 0.01 * np.arange(9)},
        {"tau": np.broadcast_to(tau, (10**12, 3, 3))}, {"tau": np.zeros((2, 3, 3)), "q0": few},
    )  # fmt: skip
    odd = ({"steps": 3}, {"steps": np.int64(3)}, {"sign_width": 0.0}, {"threads": 2**40})
    yield from each(name, run, bad)
    yield from each(name, run, odd, same(run({})))
    yield from each(f"{name}, odd", run, [{"dt": 0}], same(np.tile(q, (4, 1))))
    yield from each(f"{name} of no steps", run, [{"tau": np.empty((0, 3))}], same(q[None]))
    nobody = [{"tau": np.empty((0, 4, 3))}]
    yield from each(f"{name} of no robots", run, nobody, lambda q: q.shape == (0, 5, 9))


def _trajectories(w: World) -> Iterator[Call]:
    m = w.motion
    names, two = list(m.joint_names), [0.0, 1.0]
    good = {
        "t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau,
        "joint_names": m.joint_names, "actuated": m.actuated,
    }  # fmt: skip
    for key, values in {
        "joint_names": (
            "abcdefghi", 9, range(9), ["a"] * 9, names[:8], (n for n in names[:8]),
        ),
        "actuated": ("abc", ("gamma_1",) * 3, (0, 1, 2)),
        "units": (("rad",), ("deg",) * 9, (None,) * 9, "rad"),
        "stopped": (5,),
        "t": (m.t[:-1], m.t[::-1], 0 * m.t),
        "q": (m.q[:-1],),
    }.items():  # fmt: skip

        def make(value: Any, key: str = key) -> Any:
            return sst_pin.Trajectory(**good | {key: value})

        yield from each(f"Trajectory, {key}", make, values)
    yield Call(
        "Trajectory of generators",
        lambda: sst_pin.Trajectory(**good | {"joint_names": (n for n in names)}),
        lambda value: value == m,
    )
    yield from each("torque()", lambda t: m.torque()(t), (-1.0, 1e3, np.nan, None, "now", np.inf))
    yield Call("motion.torque() at a sample", lambda: m.torque()(float(m.t[3])), same(m.tau[3]))

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
    for ending in ("csv", "npz", "CSV"):
        yield Call(
            f"a motion saved and loaded as .{ending}",
            lambda e=ending: saved(m, f"whole.{e}"),
            lambda pair: pair[1] == m,
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
    cells = ("1_0", '"0,5"', "nan", "-inf", "1e999", "0x10", "\u0663", "3rad", "")
    tables = (
        *map(_table, cells), _table("0").replace(b",", b";"), _table("0").replace(b",", b"\t"),
        _table("0", time="-1"), b"", b"t_s,a_rad,a_rad_s,a_rad_s2,tau_1_Nm\n", bytes(range(256)),
        b"t_s,a_rad\n0,\0\n", "t_s,\xe9_rad\n0,1\n".encode("latin-1"),
        "t_s,a_rad\n0,1\n".encode("utf-16"), b't_s,a_rad\n"0,1\n',
        b"t_s," + b"a" * 200_000 + b"\n0,1\n", b"t_s,a_rad\n0," + b"1" * 200_000 + b"\n",
        b"t_s,a_rad\n0,1,2\n", b"t_s,a_rad,a_rad\n0,1,2\n", b"t_s,time,a_rad\n0,1,2\n",
        b"a_rad,a_rad_s\n0,1\n",
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
        "two rows": (quaternion, still[:2]),
        "zero quaternion": (quaternion, still * (1, 0, 0, 0, 0)),
        "long quaternion": (quaternion, still * (1, 2, 1, 1, 1)),
        "half a turn between": (quaternion, turned),
        "no qz": ("t_s,qw,qx,qy", still[:, :4]),
        "two kinds": ("t_s,qw,theta,gamma_1,qz", still),
        "no kind": ("t_s,a,b,c,d", still),
        "theta alone": ("t_s,theta", still[:, :2]),
        "gamma of two": ("t_s,gamma_1,gamma_2", still[:, :3]),
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
    yield Call("energy_error of another's", lambda: sst_pin.energy_error(w.chain, w.motion))
    yield Call(
        "energy_error of example 1",
        lambda: sst_pin.energy_error(w.robot, w.motion),
        lambda value: float(np.abs(value).max()) < 1e-4,  # a spline through ten samples
    )
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


def _bad_parameters() -> dict[str, Callable[[], Any]]:
    body, calls = sst_pin.Parameters().star, {}
    for name, values in {
        "link": ([body, body], 5, None, "rod", [None] * 3),
        "star": (None, [body] * 3),
        "arc_angles": ((120, 120, 120), (0, np.pi, np.pi)),
        "base_directions": (
            ((1, 0, 0), (0, 1, 0), (1, 1, 0)), ((0, 0, 0), (0, 1, 0), (1, 1, 0)),
            np.full((3, 3), 1e300), 1e-320 * np.eye(3),
        ),
        "viscous_friction": (np.ones(8),),
        "coulomb_friction": (-1.0, "1.0"),
        "base_radius": (0,),
        "star_radius": (-1, [1.0, 2.0], 1j, "0.4", np.inf),
    }.items():  # fmt: skip
        for i, value in enumerate(values):
            calls[f"{name}: {word(value)} {i}"] = lambda n=name, v=value: sst_pin.Parameters(
                **{n: v}
            )
    masses = (0, -1, "2.6", np.ones(2), 1j, 10**400)
    inertias = (
        np.triu(np.ones((3, 3))), np.diag((1, 1, 3)), -np.eye(3), np.zeros((3, 3)), np.ones(3),
        np.full((3, 3), np.nan),
    )  # fmt: skip
    bodies = [(mass, np.eye(3)) for mass in masses] + [(1, inertia) for inertia in inertias]
    for i, (mass, inertia) in enumerate(bodies):
        calls[f"star: body {i}"] = lambda m=mass, i=inertia: sst_pin.Parameters(
            star=sst_pin.RigidBody(m, (0, 0, 0), i)
        )
    return calls
