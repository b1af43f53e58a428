# SPDX-License-Identifier: BSD-2-Clause
"""Every argument that is an array, given everything that is no such array."""

import datetime
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from call_world import World
from judged_calls import Call

import sst_pin
from sst_pin.chain.dynamics import Terms


class Method(NamedTuple):
    """A function of arrays.

    Attributes:
        name: How it is called.
        call: Takes the arrays by name.
        good: Arguments that it takes.
        core: Number of core axes of each.
        may: Pairs (argument, kind of bad value) for which it has an answer.
    """

    name: str
    call: Callable[..., Any]
    good: dict[str, Any]
    core: dict[str, int]
    may: frozenset[tuple[str, str]] = frozenset()


_CALLABLE = ("torque", "external_wrenches", "platform_moment")


def bad_values(good: np.ndarray, core: int) -> dict[str, Any]:
    """What stands in the place of a good array, by a word for it."""
    flat = good.reshape(-1)

    def with_first(value: float) -> np.ndarray:
        bad = flat.copy()
        bad[0] = value
        return bad.reshape(good.shape)

    values = {
        "None": None,
        "text": "fast",
        "digits": good.astype(str),
        "bytes": good.astype(str).astype(bytes),
        "complex": good + 0.1j,
        "masked": np.ma.masked_array(good, mask=with_first(np.nan) != with_first(np.nan)),
        "dates": np.full(good.shape, np.datetime64("2026-01-01")),
        "spans": np.full(good.shape, np.timedelta64(1, "s")),
        "days": np.full(good.shape, datetime.date(2026, 1, 1)),
        "object": object(),
        "objects": np.full(good.shape, None),
        "records": np.zeros(good.shape, dtype=[("x", float)]),
        "dict": {},
        "set": {1.0},
        "class": float,
        "ragged": [[1.0], [2.0, 3.0]],
        "NaN": with_first(np.nan),
        "inf": with_first(np.inf),
        "huge": np.full(good.shape, 1e200),
    }
    if core:
        values["empty"] = np.empty(0)
        values["longer"] = np.concatenate([good, good[..., :1]], axis=-1)
        values["scalar"] = 1.0
    return values


def calls(world: World) -> Iterator[Call]:
    """A call for each argument of each method and each bad value."""
    for method in methods(world):
        for name, argument in method.good.items():
            good = np.asarray(argument, dtype=float)
            for kind, value in bad_values(good, method.core[name]).items():
                if kind == "class" and name in _CALLABLE:
                    continue  # what a function of the caller's raises is the caller's
                yield Call(
                    f"{method.name}({name}: {kind})",
                    lambda m=method, a=method.good | {name: value}: m.call(**a),
                    (lambda value: True)
                    if (name, kind) in method.may
                    else _finite
                    if kind == "huge"
                    else None,
                )


def _finite(value: Any) -> bool:
    """Whether all numbers are finite: what is true of a huge but sound argument."""
    parts = (
        value
        if isinstance(value, tuple)
        else vars(value).values()
        if isinstance(value, Terms)
        else (value,)
    )
    return all(isinstance(p, np.ndarray | float) and np.isfinite(p).all() for p in parts)


def methods(w: World) -> Iterator[Method]:
    """Everything in the package that takes arrays."""
    for name, robot, many in (
        ("robot", w.robot, True),
        ("robot", w.robot, False),
        ("reference", w.reference, False),
        ("chain", w.chain, False),
    ):
        q, va, aa, tau = w.chain_state if name == "chain" else (*w.states, w.tau)
        if not many and name != "chain":
            q, va, aa, tau = q[0], va[0], aa[0], tau[0]
        yield from _of_chain(f"{'batch of ' * many}{name}", robot, q, va, aa, tau, many)
    yield from _of_star(w)
    yield from _of_motion(w)
    yield from _of_parameters()


def _of_chain(name, robot, q, va, aa, tau, many) -> Iterator[Method]:
    batch = {"q": 1, "va": 1, "aa": 1, "tau": 1, "q_dot": 1}

    def method(attribute: str, *may: tuple[str, str], **good: Any) -> Method:
        call = getattr(robot, attribute)
        return Method(f"{name}.{attribute}", call, good, batch, frozenset(may))

    yield method("compute_torques", q=q, va=va, aa=aa)
    yield method("compute_accelerations", q=q, va=va, tau=tau)
    yield method("reduced_terms", q=q, va=va)
    yield method("kinetic_energy", q=q, va=va)
    yield method("potential_energy", q=q)
    yield method("friction_power", q=q, va=va)
    yield method("joint_rates", q=q, va=va)
    wrenches = np.ones((*q.shape[:-1], len(robot.joint_names), 6))
    loaded = {"external_wrenches": wrenches}
    optional = frozenset({("external_wrenches", "None")})
    for attribute, last in (("compute_torques", aa), ("compute_accelerations", tau)):
        yield Method(
            f"{name}.{attribute}",
            lambda external_wrenches, f=getattr(robot, attribute), x=last: f(
                q, va, x, external_wrenches=external_wrenches
            ),
            loaded,
            {"external_wrenches": 2},
            optional,
        )
    yield method("residual", ("q", "huge"), q=q)
    yield method("condition_number", ("q", "huge"), q=q)
    if not many:
        yield method("noc", q=q, va=va)
        yield method("Phi", ("q", "huge"), q=q)
        yield method("Phi_dot", ("q", "huge"), q=q, q_dot=0 * q)
        yield method("assemble", ("q", "huge"), q=q)
        yield method("mobility", ("q", "None"), q=q)


def _of_star(w: World) -> Iterator[Method]:
    robot, (R, omega, alpha), (q, va, aa) = w.robot, w.star_states, w.states
    core = {"R": 2, "omega": 1, "alpha": 1, "branch": 1, "q": 1, "va": 1, "gamma": 1, "near": 1}
    core |= {"platform_moment": 1}
    signs = np.ones(3)
    yield Method(
        "robot.inverse_kinematics", robot.inverse_kinematics, {"R": R, "branch": signs}, core
    )
    yield Method(
        "robot.joint_motion",
        robot.joint_motion,
        {"R": R, "omega": omega, "alpha": alpha, "branch": signs},
        core,
    )
    yield Method(
        "robot.forward_kinematics",
        robot.forward_kinematics,
        {"gamma": q[0, ::3], "near": q[0]},
        core,
        frozenset({("near", "None"), ("gamma", "huge"), ("near", "huge")}),
    )
    for attribute in ("platform_orientation", "branch", "singularities"):
        yield Method(f"robot.{attribute}", getattr(robot, attribute), {"q": q}, core)
    yield Method("robot.platform_velocity", robot.platform_velocity, {"q": q, "va": va}, core)
    for robot in (w.robot, w.reference):
        for attribute, last in (("compute_torques", aa), ("compute_accelerations", w.tau)):
            for rows in (slice(None), 0):
                yield Method(
                    f"{'robot' if robot is w.robot else 'reference'}.{attribute}",
                    lambda platform_moment, f=getattr(robot, attribute), x=last, i=rows: f(
                        q[i], va[i], x[i], platform_moment=platform_moment
                    ),
                    {"platform_moment": omega[rows]},
                    core,
                    frozenset({("platform_moment", "None")}),
                )


def _of_motion(w: World) -> Iterator[Method]:
    q, va, _ = (x[0] for x in w.states)
    t = np.linspace(0, 0.002, 3)
    core = {"torque": 1, "q0": 1, "va0": 1, "t": 1, "external_wrenches": 2, "platform_moment": 1}
    optional = frozenset({("external_wrenches", "None"), ("platform_moment", "None")})
    state = {"torque": w.tau[0], "q0": q, "va0": va, "t": t}
    yield Method("robot.simulate", w.robot.simulate, state, core)
    chain_q, chain_va, _, chain_tau = w.chain_state
    of_chain = {"torque": chain_tau, "q0": chain_q, "va0": chain_va, "t": t}
    yield Method("chain.simulate", w.chain.simulate, of_chain, core)
    yield Method(
        "robot.simulate",
        lambda torque: w.robot.simulate(torque, q, va, t),
        {"torque": np.tile(w.tau[0], (3, 1))},
        {"torque": 2},
    )
    for name, good in (("external_wrenches", np.ones((9, 6))), ("platform_moment", np.ones(3))):
        yield Method(
            "robot.simulate",
            lambda w=w, **load: w.robot.simulate(w.tau[0], q, va, t, **load),
            {name: good},
            core,
            optional,
        )
    for name, robot in (("robot", w.robot), ("reference", w.reference)):
        yield Method(
            f"{name}.rollout",
            lambda tau, q0, va0, robot=robot, **load: robot.rollout(tau, q0, va0, 1e-3, **load),
            {"tau": np.tile(w.tau[0], (3, 1)), "q0": q, "va0": va, "platform_moment": np.ones(3)},
            {"tau": 2, "q0": 1, "va0": 1, "platform_moment": 1},
            optional,
        )
    angles = {"theta": np.ones(2), "phi": np.ones(2), "psi": np.ones(2)}
    yield Method("orientation", sst_pin.orientation, angles, dict.fromkeys(angles, 0))
    rates = {name: np.ones((3, 2)) for name in angles}
    yield Method("orientation_motion", sst_pin.orientation_motion, rates, dict.fromkeys(rates, 2))
    yield Method("paper_circle", sst_pin.paper_circle, {"t": np.ones(2)}, {"t": 0})
    times = np.linspace(0, 0.1, 8)
    yield Method(
        "interpolate_orientations",
        sst_pin.interpolate_orientations,
        {"t": times, "R": sst_pin.paper_circle(times).R, "at": times[2:4]},
        {"t": 1, "R": 2, "at": 0},
    )
    m = w.motion
    yield Method(
        "Trajectory",
        lambda **arrays: sst_pin.Trajectory(
            joint_names=m.joint_names, actuated=m.actuated, **arrays
        ),
        {"t": m.t, "q": m.q, "va": m.va, "aa": m.aa, "tau": m.tau},
        {"t": 1, "q": 1, "va": 1, "aa": 1, "tau": 1},
        frozenset((name, "huge") for name in ("q", "va", "aa", "tau")),
    )
    friction = {"viscous_friction": np.ones(3), "coulomb_friction": np.ones(3)}
    yield Method(
        "ClosedChain",
        lambda **f: w.table_of_four_bar.chain(**f),
        friction,
        dict.fromkeys(friction, 1),
        frozenset((name, "None") for name in friction) | {(name, "huge") for name in friction},
    )


def _of_parameters() -> Iterator[Method]:
    p = sst_pin.Parameters()
    fields = {
        "base_directions": 2,
        "arc_angles": 1,
        "viscous_friction": 1,
        "coulomb_friction": 1,
        "gravity": 1,
        "base_radius": 0,
        "star_radius": 0,
    }
    huge = {(name, "huge") for name in fields} - {("arc_angles", "huge")}
    scalar = {(name, "scalar") for name in ("viscous_friction", "coulomb_friction")}
    yield Method(
        "Parameters",
        sst_pin.Parameters,
        {name: getattr(p, name) for name in fields},
        fields,
        frozenset(huge | scalar),
    )
    body = p.star
    yield Method(
        "Parameters(star=RigidBody)",
        lambda **values: sst_pin.Parameters(star=sst_pin.RigidBody(**values)),
        {"mass": body.mass, "center_of_mass": body.center_of_mass, "inertia": body.inertia},
        {"mass": 0, "center_of_mass": 1, "inertia": 2},
        frozenset({("mass", "huge"), ("center_of_mass", "huge"), ("inertia", "huge")}),
    )
