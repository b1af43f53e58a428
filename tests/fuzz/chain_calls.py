# SPDX-License-Identifier: BSD-2-Clause
"""Chains built by hand, changed afterwards, and asked with odd options and odd arrays."""

import copy
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin
from call_world import World
from judged_calls import Call

import sst_pin
from sst_pin.verification.referees import lagrange

#: Of torques computed twice by other ways: rounding times the condition of a mild pose.
CLOSE = 1e-8


def same(wanted: Any) -> Callable[[Any], bool]:
    """Whether an array is the wanted one."""

    def right(value: Any) -> bool:
        wanted_array = np.asarray(wanted)
        return np.shape(value) == wanted_array.shape and np.allclose(
            value, wanted_array, rtol=CLOSE, atol=CLOSE
        )

    return right


def calls(w: World) -> Iterator[Call]:
    """All of them."""
    yield from _constructors(w)
    yield from _hand_built(w)
    yield from _changed(w)
    yield from _copies(w)
    yield from _options(w)
    yield from _arrays(w)


def _constructors(w: World) -> Iterator[Call]:
    table = w.table_of_four_bar
    q, va, aa, tau = w.chain_state
    closures, motors = list(table.closures), ["crank"]

    def torques(chain: sst_pin.ClosedChain) -> np.ndarray:
        return chain.compute_torques(q, va, aa)

    def made(**changes: Any) -> np.ndarray:
        given = {"model": table.model(), "closures": closures, "actuated": motors} | changes
        return torques(sst_pin.ClosedChain(*given.values()))

    right = same(tau)
    for model in (None, "model", 5, pin.Model, pin.Model(), w.robot, table.model().createData()):
        yield Call(f"ClosedChain({_short(model)}, ...)", lambda m=model: made(model=m))
    odd_closures = {
        "None": None,
        "text": "AB",
        "number": 5,
        "a pair without a list": ("A", "B"),
        "one frame": [("A",)],
        "four entries": [("A", "B", "3d", "x")],
        "kind None": [("A", "B", None)],
        "numbers": [(1, 2)],
        "None in it": [None],
        "an object": [object()],
        "a frame unknown": [("A", "X")],
        "None for a frame": [("A", None)],
        "bytes": [(b"A", b"B")],
        "empty names": [("", "")],
        "kind unknown": [("A", "B", "9d")],
        "itself": [("A", "A", "3d")],
        "none": [],
        "a dict": {"A": "B"},
        "of the base": [("universe", "universe")],
        "joints on one body": [("crank", "coupler", "3d")],
    }
    for name, value in odd_closures.items():
        yield Call(f"ClosedChain(closures: {name})", lambda v=value: made(closures=v))
    for name, value in {
        "twice": closures * 2,
        "from a generator": (c for c in closures),
        "a tuple": tuple(closures),
        "a triple": [("A", "B", "3d")],
        "letters": [["A", "B", "3d"]],
        "turned round": [("B", "A", "3d")],
    }.items():
        yield Call(f"ClosedChain(closures: {name})", lambda v=value: made(closures=v), right)
    odd_motors = {
        "None": None,
        "text": "crank",
        "number": 5,
        "index": [0],
        "None in it": [None],
        "nested": [["crank"]],
        "unknown": ["krank"],
        "twice": ["crank", "crank"],
        "none": [],
        "bytes": [b"crank"],
        "universe": ["universe"],
        "a frame": ["A"],
    }
    for name, value in odd_motors.items():
        yield Call(f"ClosedChain(actuated: {name})", lambda v=value: made(actuated=v))
    for name, value in {
        "from a generator": (m for m in motors),
        "array": np.array(motors),
        "set": {"crank"},
        "dict": {"crank": 1},
    }.items():
        yield Call(f"ClosedChain(actuated: {name})", lambda v=value: made(actuated=v), right)
    yield Call(
        "ClosedChain(actuated: all), torques that do the same work",
        lambda: made(actuated=["crank", "coupler", "rocker"]) @ w.chain.joint_rates(q, [1.0]),
        same(tau[0]),
    )
    for arguments in (
        (None, None),
        ("A", "B", "9d"),
        ("A", "B", None),
        ("A", "B", ["6d"]),
        ("A", "B", 6),
        (1, 2),
        (["A"], "B"),
    ):
        yield Call(f"Closure{arguments}", lambda a=arguments: sst_pin.Closure(*a))
    for name, kind in (("ClosedChain", sst_pin.ClosedChain), ("SST", sst_pin.SST)):
        child = type(f"Own{name}", (kind,), {})
        yield Call(
            f"Own{name}.from_urdf",
            lambda c=child: c.from_urdf(sst_pin.URDF_PATH),
            lambda value, c=child: type(value) is c,
        )
    yield Call(
        "OwnClosedChain.from_mjcf",
        lambda: type("Own", (sst_pin.ClosedChain,), {}).from_mjcf(sst_pin.MJCF_PATH),
        lambda value: type(value).__name__ == "Own",
    )
    for argument in (5, "x", {}, object(), sst_pin.Parameters):
        yield Call(f"SST({_short(argument)})", lambda a=argument: sst_pin.SST(a))


def _short(value: Any) -> str:
    return type(value).__name__ if len(repr(value)) > 20 else repr(value)


def _hand_built(w: World) -> Iterator[Call]:
    """Models that people write, and models with a fault in them."""
    table = w.table_of_four_bar
    q, va, aa, tau = w.chain_state
    right = same(tau)

    def of(change: Callable[[pin.Model], Any]) -> sst_pin.ClosedChain:
        model = table.model()
        model = change(model) or model
        return sst_pin.ClosedChain(model, table.closures, table.actuated)

    def breadth_first() -> sst_pin.ClosedChain:
        """Crank and rocker before the coupler that the crank bears."""
        return sst_pin.ClosedChain(_reordered(table, [0, 2, 1]), table.closures, table.actuated)

    order = [0, 2, 1]
    yield Call(
        "joints breadth first: compute_torques",
        lambda: breadth_first().compute_torques(q[order], va, aa),
        same(tau),
    )
    yield Call(
        "joints breadth first: compute_accelerations",
        lambda: breadth_first().compute_accelerations(q[order], va, tau),
        same(aa),
    )
    yield Call(
        "joints breadth first: kinetic_energy",
        lambda: breadth_first().kinetic_energy(q[order], va),
        same(w.chain.kinetic_energy(q, va)),
    )
    yield Call(
        "joints breadth first: reduced_terms",
        lambda: breadth_first().reduced_terms(q[order], va).inertia,
        same(w.chain.reduced_terms(q, va).inertia),
    )

    def doubled(model: pin.Model) -> None:
        model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "crank")

    yield Call("two joints of one name", lambda: of(doubled))

    def renamed(model: pin.Model) -> None:
        model.names[2] = "crank"

    yield Call("two names alike", lambda: of(renamed))

    def frame_called(name: str, kind: Any = pin.FrameType.OP_FRAME) -> Callable[[pin.Model], None]:
        def add(model: pin.Model) -> None:
            at = pin.SE3(np.eye(3), np.ones(3))
            model.addFrame(pin.Frame(name, 1, at, kind), False)

        return add

    for kind in (pin.FrameType.OP_FRAME, pin.FrameType.BODY, pin.FrameType.SENSOR):
        yield Call(
            f"a second frame A of type {kind}",
            lambda k=kind: of(frame_called("A", k)).compute_torques(q, va, aa),
            right if kind == pin.FrameType.OP_FRAME else None,  # Pinocchio adds no such frame
        )

    def body_called_as_joint(model: pin.Model) -> None:
        model.addFrame(pin.Frame("crank", 1, pin.SE3.Identity(), pin.FrameType.BODY))

    yield Call(
        "a body and a joint of one name",
        lambda: of(body_called_as_joint).compute_torques(q, va, aa),
        same(tau),
    )

    def with_joint(joint: pin.JointModel) -> Callable[[pin.Model], None]:
        def add(model: pin.Model) -> None:
            i = model.addJoint(3, joint, pin.SE3.Identity(), "odd")
            model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())

        return add

    for kind in (
        pin.JointModelRevoluteUnaligned,
        pin.JointModelPrismaticUnaligned,
    ):
        yield Call(
            f"{kind.__name__} about nothing",
            lambda k=kind: of(with_joint(k(np.zeros(3)))).compute_torques(np.r_[q, 0], va, aa),
        )
    faults: dict[str, Callable[[pin.Model], Any]] = {
        "a NaN in gravity": lambda m: _put(m.gravity.linear, 0, np.nan, m.gravity, "linear"),
        "infinite gravity": lambda m: _put(m.gravity.linear, 0, np.inf, m.gravity, "linear"),
        "a mass of NaN": lambda m: _inertia(m, mass=np.nan),
        "an infinite mass": lambda m: _inertia(m, mass=np.inf),
        "a mass centre at NaN": lambda m: _inertia(m, lever=np.full(3, np.nan)),
        "a NaN in a placement": lambda m: _placement(m, np.array((np.nan, 0, 0))),
        "a joint at infinity": lambda m: _placement(m, np.array((np.inf, 0, 0))),
        "NaN armature": lambda m: setattr(m, "armature", np.full(3, np.nan)),
        "NaN damping": lambda m: setattr(m, "damping", np.full(3, np.nan)),
        "infinite friction": lambda m: setattr(m, "friction", np.full(3, np.inf)),
    }
    for name, fault in faults.items():
        yield Call(f"a model with {name}", lambda f=fault: of(f).compute_torques(q, va, aa))

    def massless(model: pin.Model) -> None:
        for j in range(1, model.njoints):
            model.inertias[j] = pin.Inertia.Zero()
        model.armature = np.zeros(3)

    yield Call("a massless chain", lambda: of(massless).compute_accelerations(q, va, tau))


def _put(array: np.ndarray, index: int, value: float, owner: Any, name: str) -> None:
    array = array.copy()
    array[index] = value
    setattr(owner, name, array)


def _inertia(model: pin.Model, mass: float | None = None, lever: np.ndarray | None = None) -> None:
    old = model.inertias[2]
    model.inertias[2] = pin.Inertia(
        old.mass if mass is None else mass, old.lever if lever is None else lever, old.inertia
    )


def _placement(model: pin.Model, translation: np.ndarray) -> None:
    model.jointPlacements[2] = pin.SE3(np.eye(3), translation)


def _reordered(table: Any, order: list[int]) -> pin.Model:
    """The model of a table of links, its joints added in another order."""
    whole, model, numbers = table.model(), pin.Model(), {0: 0}
    model.gravity.linear = whole.gravity.linear
    for i in order:
        j = i + 1
        numbers[j] = model.addJoint(
            numbers[whole.parents[j]],
            whole.joints[j],
            whole.jointPlacements[j],
            whole.names[j],
        )
        model.appendBodyToJoint(numbers[j], whole.inertias[j], pin.SE3.Identity())
    for frame in whole.frames:
        if frame.name in ("A", "B"):
            at = numbers[frame.parentJoint]
            model.addFrame(pin.Frame(frame.name, at, frame.placement, frame.type))
    for name in ("armature", "damping", "friction"):
        setattr(model, name, getattr(whole, name)[order])
    return model


def _by_multipliers(robot: Any, q: np.ndarray, va: np.ndarray, aa: np.ndarray) -> np.ndarray:
    """Torques by Lagrange multipliers of what stands in `robot.model` now."""
    model = robot.model
    own = sst_pin.ClosedChain(
        pin.Model(model), robot.closures, robot.motor_names, coordinates=robot.coordinates
    )
    return lagrange.torques(own, q, va, aa)


def _changed(w: World) -> Iterator[Call]:
    """A model that is changed after the robot was made; what it computes must follow, or fail."""
    x = tuple(a[0] for a in w.states)

    def frame(model: pin.Model) -> None:
        model.addFrame(pin.Frame("late", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))

    def joint(model: pin.Model) -> None:
        model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "late")

    def joint_at_the_end(model: pin.Model) -> None:
        model.addJoint(3, pin.JointModelRX(), pin.SE3.Identity(), "late")

    def gravity(model: pin.Model) -> None:
        model.gravity.linear = np.array((1.0, -2, 3))

    def gravity_in_place(model: pin.Model) -> None:
        model.gravity.linear[:] = (1.0, -2, 3)

    def mass(model: pin.Model) -> None:
        model.inertias[1] = pin.Inertia(9.0, np.ones(3), np.eye(3))

    def mass_in_place(model: pin.Model) -> None:
        model.inertias[1].mass = 9.0

    def placement(model: pin.Model) -> None:
        turned = model.jointPlacements[1]
        model.jointPlacements[1] = pin.SE3(turned.rotation, np.array((0, 0, 0.1)))

    def damping(model: pin.Model) -> None:
        model.damping = np.arange(1.0, 10)

    def damping_in_place(model: pin.Model) -> None:
        model.damping[:] = np.arange(1.0, 10)

    def friction(model: pin.Model) -> None:
        model.friction = np.arange(1.0, 10)

    def armature(model: pin.Model) -> None:
        model.armature = np.arange(1.0, 10)

    def frame_moved(model: pin.Model) -> None:
        i = model.getFrameId("closedloop1_B")
        model.frames[i].placement = pin.SE3(np.eye(3), np.zeros(3))

    changes = (
        frame, joint, joint_at_the_end, gravity, gravity_in_place, mass, mass_in_place,
        placement, damping, damping_in_place, friction, armature, frame_moved,
    )  # fmt: skip
    for change in changes:
        for kernels in (True, False):
            for refreshed in (False, True):

                def run(change=change, kernels=kernels, refreshed=refreshed) -> Any:
                    robot = w.fresh(kernels=kernels)
                    robot.compute_torques(*x)
                    change(robot.model)
                    if refreshed:
                        robot.refresh()
                    return robot, robot.compute_torques(*x)

                def right(pair: Any) -> bool:
                    robot, tau = pair
                    if robot.model.nv != 9:
                        return same(w.tau[0])(tau)
                    return same(_by_multipliers(robot, *x))(tau)

                yield Call(
                    f"{change.__name__} changed, kernels={kernels}{', refresh()' * refreshed}",
                    run,
                    right,
                )
    q, va, aa, tau = w.chain_state
    for change in (frame, joint, gravity):

        def run_chain(change=change) -> Any:
            chain = w.table_of_four_bar.chain()
            change(chain.model)  # before the first call
            return chain, chain.compute_torques(q, va, aa)

        def right_chain(pair: Any) -> bool:
            chain, found = pair
            if chain.model.nv != 3:
                return same(tau)(found)
            return same(_by_multipliers(chain, q, va, aa))(found)

        yield Call(f"{change.__name__} changed in a chain never used", run_chain, right_chain)


def _copies(w: World) -> Iterator[Call]:
    x = tuple(a[0] for a in w.states)
    for name, make in (
        ("copy.copy", copy.copy),
        ("copy.deepcopy", copy.deepcopy),
        ("pickle", lambda robot: pickle.loads(pickle.dumps(robot))),
    ):

        def run(make=make) -> Any:
            robot = w.fresh()
            robot.compute_torques(*x)
            twin = make(robot)
            return twin.compute_torques(*x)

        yield Call(f"{name} of an SST", run, same(w.tau[0]))

        def independent(make=make) -> Any:
            robot = w.fresh()
            robot.compute_torques(*x)
            twin = make(robot)
            if twin.model is robot.model:
                return w.tau[0]  # one model: one robot
            twin.model.gravity.linear = np.array((1.0, -2, 3))
            twin.refresh()
            return robot.compute_torques(*x)

        yield Call(f"{name} of an SST, the copy changed", independent, same(w.tau[0]))
        yield Call(
            f"{name} of a chain",
            lambda make=make: make(w.chain).compute_torques(*w.chain_state[:3]),
            same(w.chain_state[3]),
        )


def _options(w: World) -> Iterator[Call]:
    (q, va, aa), tau = w.states, w.tau
    single = q[0], va[0], aa[0]
    chain_state = w.chain_state[:3]
    targets = (
        ("robot", w.robot, single, tau[0]),
        ("batch of robot", w.robot, (q, va, aa), tau),
        ("reference", w.reference, single, tau[0]),
        ("batch of reference", w.reference, (q, va, aa), tau),
        ("chain", w.chain, chain_state, w.chain_state[3]),
    )
    w.robot.compute_torques(*single)  # the kernels are there: the fast entry answers
    for name, robot, state, answer in targets:
        for policy in ("ignore", None, 1, "", ["nan"], "NaN", b"raise"):
            for attribute in ("compute_torques", "compute_accelerations", "reduced_terms"):
                arrays = state[:2] if attribute == "reduced_terms" else state
                yield Call(
                    f"{name}.{attribute}(on_error={policy!r})",
                    lambda f=getattr(robot, attribute), a=arrays, p=policy: f(*a, on_error=p),
                )
        shape = np.shape(answer)
        outs = {
            "False": False,
            "True": True,
            "list": [0.0] * 3,
            "text": "out",
            "wrong shape": np.empty((7, 3)),
            "one row too many": np.empty((*shape[:-1], shape[-1] + 1)),
            "float32": np.empty(shape, np.float32),
            "int": np.empty(shape, int),
            "complex": np.empty(shape, complex),
            "objects": np.empty(shape, object),
            "read-only": _read_only(shape),
            "big-endian": np.empty(shape, ">f8"),
            "a type": np.ndarray,
        }
        for kind, out in outs.items():
            yield Call(
                f"{name}.compute_torques(out: {kind})",
                lambda f=robot.compute_torques, a=state, o=out: f(*a, out=o),
            )
        strided = np.empty((*shape[:-1], 2 * shape[-1]))[..., ::2]
        yield Call(
            f"{name}.compute_torques(out: strided)",
            lambda f=robot.compute_torques, a=state, o=strided: f(*a, out=o),
            lambda value, o=strided, t=answer: value is o and same(t)(o),
        )

        def overlapping(robot=robot, state=state) -> np.ndarray:
            aa = np.array(state[2])
            return robot.compute_torques(state[0], state[1], aa, out=aa)

        yield Call(f"{name}.compute_torques(out: aa itself)", overlapping, same(answer))
        if name == "chain":
            continue
        for threads in (0, -1, 1.5, "two", None, np.nan, np.inf, [1], 1j, 2**70):
            yield Call(
                f"{name}.compute_torques(threads={threads!r})",
                lambda f=robot.compute_torques, a=state, n=threads: f(*a, threads=n),
                same(answer) if threads == 2**70 else None,
            )
        for threads in (3, 10**6, 2**31, 2**40, np.int64(2)):
            yield Call(
                f"{name}.compute_torques(threads={threads!r})",
                lambda f=robot.compute_torques, a=state, n=threads: f(*a, threads=n),
                same(answer),
            )
        for threads in (0, "two", None):
            yield Call(
                f"{name}.reduced_terms(threads={threads!r})",
                lambda f=robot.reduced_terms, a=state[:2], n=threads: f(*a, threads=n),
            )
    closed = w.robot.assemble(q[0])
    off = q[0] + 0.01
    for fixed in (
        "gamma_1",
        ["gama_1"],
        [None],
        [0],
        5,
        [["gamma_1"]],
        object(),
        list(w.robot.joint_names),
        [b"gamma_1"],
    ):
        yield Call(f"assemble(fixed={_short(fixed)})", lambda f=fixed: w.robot.assemble(off, f))
    for fixed in (["gamma_1", "gamma_1"], np.array(["gamma_1"]), {"gamma_1"}, (), None):
        yield Call(
            f"assemble(fixed={_short(fixed)})",
            lambda f=fixed: w.robot.residual(w.robot.assemble(off, f)),
            lambda value: float(np.abs(value).max()) < 1e-11,
        )
    yield Call(
        "assemble(fixed=all) of what is closed",
        lambda: w.robot.assemble(closed, list(w.robot.joint_names)),
        same(closed),
    )


def _read_only(shape: tuple[int, ...]) -> np.ndarray:
    array = np.empty(shape)
    array.setflags(write=False)
    return array


def _arrays(w: World) -> Iterator[Call]:
    """Odd arrays that hold the right numbers, and odd batches."""
    (q, va, aa), tau = w.states, w.tau

    def unaligned(array: np.ndarray) -> np.ndarray:
        raw = np.empty(array.nbytes + 1, np.uint8)
        moved = raw[1:].view(np.float64).reshape(array.shape)
        moved[:] = array
        return moved

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
        "read-only": lambda a: _frozen(a),
        "a matrix": lambda a: np.asmatrix(a),
        "a masked array, nothing masked": np.ma.masked_array,
    }
    for name, form in forms.items():
        for label, robot in (("robot", w.robot), ("reference", w.reference)):
            yield Call(
                f"{label}.compute_torques of {name}",
                lambda f=form, r=robot: r.compute_torques(f(q), f(va), f(aa)),
                same(tau),
            )
    for label, robot in (("robot", w.robot), ("reference", w.reference)):
        for shape in ((0,), (0, 5), (5, 0)):
            empty = [np.empty((*shape, n)) for n in (9, 3, 3)]
            yield Call(
                f"{label}.compute_torques of {shape} samples",
                lambda r=robot, e=empty: r.compute_torques(*e),
                lambda value, s=shape: value.shape == (*s, 3),
            )
        yield Call(
            f"{label}.compute_torques of batches that differ",
            lambda r=robot: r.compute_torques(q, va[:3], aa[:2]),
        )
        for exponent in (12, 15):
            huge = np.broadcast_to(q[0], (10**exponent, 9))
            yield Call(
                f"{label}.compute_torques of 1e{exponent} samples",
                lambda r=robot, h=huge: r.compute_torques(h, va[0], aa[0]),
            )
        spoilt = q.copy()
        spoilt[1, 2] = np.nan
        opened = q.copy()
        opened[2, 1] += 0.1
        for kind, bad, i in (("NaN", spoilt, 1), ("open", opened, 2)):
            wanted = tau.copy()
            wanted[i] = np.nan
            yield Call(
                f"{label}.compute_torques of a batch with one {kind} sample, on_error='nan'",
                lambda r=robot, b=bad: r.compute_torques(b, va, aa, on_error="nan"),
                lambda value, t=wanted: np.allclose(value, t, rtol=CLOSE, equal_nan=True),
            )
            yield Call(
                f"{label}.compute_torques of a batch with one {kind} sample",
                lambda r=robot, b=bad: r.compute_torques(b, va, aa),
            )
        turned = q + 2 * np.pi * np.arange(9)
        yield Call(
            f"{label}.compute_torques some turns further",
            lambda r=robot, b=turned: r.compute_torques(b, va, aa),
            same(tau),
        )
    for name, value in {
        "turned": np.eye(3)[::-1],
        "scaled": 2 * np.eye(3),
        "zero": np.zeros((3, 3)),
        "sheared": np.eye(3) + 0.01,
    }.items():
        yield Call(f"inverse_kinematics of R {name}", lambda v=value: w.robot.inverse_kinematics(v))
    for branch in ((1, 1, 0), (1, 1, 2), (1, 1), (0.5, 1, 1)):
        yield Call(
            f"inverse_kinematics(branch={branch})",
            lambda b=branch: w.robot.inverse_kinematics(np.eye(3), b),
        )


def _frozen(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.setflags(write=False)
    return array
