# SPDX-License-Identifier: BSD-2-Clause
"""Each refusal of the reference path is one of the kernels': the same error on every path."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.errors import (
    ActuationError,
    ClosureError,
    InputError,
    SingularConfigurationError,
    SSTError,
)
from tests.support.by_hand import add, at, mark
from tests.support.methods import METHODS
from tests.support.motor_cases import lift

Robot = sst_pin.ClosedChain


def scissors() -> Robot:
    """Two scissor cells, folded: their two pairs of bars turn apart from each other."""
    model, length = pin.Model(), 0.3

    def bar(parent: int, kind: pin.JointModel, name: str, x: float) -> int:
        body = pin.Inertia(1.0, np.array([0.1, 0, 0]), 0.01 * np.eye(3))
        joint = add(model, parent, kind, name, at(x), body)
        mark(model, joint, f"middle {name}", at(length / 2))
        return joint

    slide = bar(0, pin.JointModelPX(), "slide", 0)
    a1, b1 = bar(0, pin.JointModelRY(), "a1", 0), bar(slide, pin.JointModelRY(), "b1", 0)
    bar(b1, pin.JointModelRY(), "a2", length), bar(a1, pin.JointModelRY(), "b2", length)
    model.referenceConfigurations["home"] = np.array([0, 0.4, 0.4, 0.9, 0.9])
    closures = [sst_pin.Closure(f"middle a{k}", f"middle b{k}", "3d") for k in (1, 2)]
    return Robot(model, closures, ["a1", "b2"], coordinates=["a1", "b2"])


def pendulum() -> Robot:
    """A ball joint with two coupled sliders, whose loop a wrong quaternion does not open."""
    model, body = pin.Model(), pin.Inertia(1.0, np.array([0.1, 0, 0.2]), 0.01 * np.eye(3))
    ball = add(model, 0, pin.JointModelSpherical(), "ball", at(), body)
    for name in ("slide", "follower"):
        add(model, ball, pin.JointModelPX(), name, at(0.2, 0.1), body)
    model.referenceConfigurations["home"] = pin.neutral(model)
    return Robot(model, [sst_pin.Coupling("follower", {"slide": (0.0, -0.5)})], ["slide"])


ALL = ["lift", "crank", "coupler", "rocker"]
ROBOTS: dict[str, Callable[[], Robot]] = {
    "cart": lambda: lift(1.0, 1.0, ALL, pin.JointModelPX()),
    "cart without motor": lambda: lift(1.0, 1.0, ALL[1:], pin.JointModelPX()),
    "lift of 1e5 kg": lambda: lift(1e5, 1e-3, ["lift"]),
    "massless bars": lambda: lift(1.0, 0.0, ALL, pin.JointModelPX()),
    "folded lift": scissors,
    "pendulum": pendulum,
}


@cache
def robot(name: str, compiled: bool) -> Robot:
    made = ROBOTS[name]()
    made.generic_configuration()
    if compiled:
        made.compile()
    return made


class Fault(NamedTuple):
    """A sample that is refused: how q, va and x = aa or tau are spoilt."""

    robot: str
    error: type[SSTError]
    spoil: Callable[[Robot, np.ndarray, np.ndarray, np.ndarray], Any] = lambda *_: None


def flat(chain: Robot, q: np.ndarray, *_: np.ndarray) -> None:
    """Crank and coupler in line, where the rocker does not determine their rates."""
    crank = np.arccos((0.73**2 + 0.47**2 - 0.41**2) / (2 * 0.73 * 0.47))  # the law of cosines
    end = 0.73 * np.array([np.cos(crank), np.sin(crank)]) - [0.47, 0]
    q[1:] = crank, 0.0, np.arctan2(end[1], end[0])


def upright(chain: Robot, q: np.ndarray, *_: np.ndarray) -> None:
    """In this mode the lift has one freedom: rows that were redundant are not."""
    q[:] = 0.3 * np.cos(1.2), -1.2, 1.2 - np.pi, np.pi - 2.4, 2.4 - np.pi


def set_nan(x: np.ndarray) -> None:
    x[0] = np.nan


FAULTS = {
    "q not finite": Fault("cart", InputError, lambda _, q, va, x: set_nan(q)),
    "va not finite": Fault("cart", InputError, lambda _, q, va, x: set_nan(va)),
    "x not finite": Fault("cart", InputError, lambda _, q, va, x: set_nan(x)),
    "results not finite": Fault("cart", InputError, lambda _, q, va, x: va.fill(1e300)),
    "a quaternion of length 2": Fault(
        "pendulum", InputError, lambda _, q, va, x: q.__setitem__(slice(4), 2 * q[:4])
    ),
    "open loops": Fault("cart", ClosureError, lambda _, q, va, x: q.__setitem__(3, q[3] + 1e-3)),
    "singular": Fault("cart", SingularConfigurationError, flat),
    "fewer freedoms than coordinates": Fault("folded lift", SingularConfigurationError, upright),
    "no motor of the cart": Fault("cart without motor", ActuationError),
    "no motor of the light bars": Fault("lift of 1e5 kg", ActuationError),
    "no mass": Fault("massless bars", SingularConfigurationError),
}
#: Methods by their arguments, where x are accelerations.
TAKES = {
    name: takes.replace("aa", "x")
    for name, takes in METHODS.items()
    if name not in ("actuator_jacobian", "linearize", "reactions")
}
#: What a fault can be seen by, if not by all.
SEEN_BY = {
    "a quaternion of length 2": set(TAKES) - {"compute_torques"},  # it has one motor
    "va not finite": {name for name, takes in TAKES.items() if "va" in takes},
    "x not finite": {name for name, takes in TAKES.items() if {"x", "tau"} & set(takes.split())},
    "results not finite": {"compute_torques", "generalized_forces", "compute_accelerations"},
    "no motor of the cart": {"compute_torques"},
    "no motor of the light bars": {"compute_torques"},
    "no mass": {"compute_accelerations", "acceleration_derivatives"},
}
#: The other kernels compile for seconds.
QUICK = {"compute_torques", "compute_accelerations"}
CASES = [
    pytest.param(
        fault,
        name,
        marks=() if name in QUICK else pytest.mark.slow,
    )
    for fault in FAULTS
    for name in TAKES
    if name in SEEN_BY.get(fault, TAKES)
]


def samples(chain: Robot, fault: Fault, takes: str) -> list[Any]:
    """Three samples of the arguments, the second of them spoilt."""
    motors, n = len(chain.motor_names), chain.degrees_of_freedom
    random = np.random.default_rng(0)
    q = np.tile(chain.generic_configuration(), (3, 1))
    va, x = (0.1 * random.normal(size=(3, k)) for k in (n, motors if "tau" in takes else n))
    fault.spoil(chain, q[1], va[1], x[1])
    if fault.error is ActuationError:  # the others need nothing of the motors that are not there
        q, va, x = (np.tile(a[1], (3, 1)) for a in (q, va, x))
    by_name = {"q": q, "va": va, "x": x, "tau": x, "frame": chain.model.frames[-1].name}
    return [by_name[name] for name in takes.split()]


@pytest.mark.parametrize("compiled", [False, True], ids=["reference", "compiled"])
@pytest.mark.parametrize(("fault", "name"), CASES)
def test_every_path_refuses_alike(fault, name, compiled):
    chain, case = robot(FAULTS[fault].robot, compiled), FAULTS[fault]
    method, arguments = getattr(chain, name), samples(chain, case, TAKES[name])
    one = [a if isinstance(a, str) else a[1] for a in arguments]
    with pytest.raises(case.error):
        method(*one)
    if name in ("joint_rates", "joint_accelerations"):
        return
    with pytest.raises(case.error) as caught:
        method(*arguments)
    assert (1,) in caught.value.samples
    options: list[dict[str, Any]] = [{}]
    if name != "generalized_forces":
        options.append({"threads": 2})
    others = method(*(a if isinstance(a, str) else a[::2] for a in arguments), on_error="nan")
    for more in options:
        result = method(*arguments, on_error="nan", **more)
        parts = result if isinstance(result, tuple) else (result,)
        assert all(np.isnan(part[1]).all() for part in parts)
        for part, rest in zip(parts, others if len(parts) > 1 else (others,), strict=True):
            np.testing.assert_array_equal(part[::2], rest)
    if isinstance(result, np.ndarray):
        out = np.zeros_like(result)
        with pytest.raises(case.error):
            method(*arguments, out=out)


@pytest.mark.parametrize("compiled", [False, True], ids=["reference", "compiled"])
@pytest.mark.parametrize("fault", ["x not finite", "open loops", "singular", "no mass"])
def test_rollouts_end_where_a_single_call_is_refused(fault, compiled):
    case = FAULTS[fault]
    chain = robot(case.robot, compiled)
    q, va, tau = (a[1] for a in samples(chain, case, "q va tau"))
    with pytest.raises(case.error):
        chain.rollout(np.tile(tau, (3, 1)), q, va, 1e-3)


@pytest.mark.parametrize("mass", [1e-3, 1.0, 1e5])
def test_torques_of_redundant_motors_make_the_motion(mass):
    """L^T B tau = f in each coordinate, relative to what meets in it, also for extreme weights."""
    reference, kernels = (lift(1e5, mass, ALL, pin.JointModelPX()) for _ in range(2))
    kernels.compile()  # those of the cart
    random = np.random.default_rng(2)
    q = reference.generic_configuration()
    A = reference.noc(q, np.zeros(2)).L.T @ reference.actuation
    for _ in range(3):
        motion = q, *random.normal(size=(2, 2))
        f = reference.generalized_forces(*motion)
        for weights in (None, [1, 1, 1, 1], [1, 1e24, 1e20, 1e24], [1e24, 1, 1, 1]):
            for chain in (reference, kernels):
                tau = chain.compute_torques(*motion, weights=weights)
                assert np.allclose(A @ tau, f, rtol=1e-9, atol=0)


def test_what_balances_needs_no_motor():
    """At rest nothing pushes a cart, though weights on it are large: rounding is no force."""
    for compiled in (False, True):
        chain = robot("cart without motor", compiled)
        q, zero = chain.generic_configuration(), np.zeros(2)
        assert np.isfinite(chain.compute_torques(q, zero, zero)).all()


def test_functions_of_direct_dynamics_refuse_a_motion_without_mass():
    """Inverse dynamics has an answer there."""
    chain = robot("massless bars", False)
    functions, q, rest = chain.casadi(), chain.generic_configuration(), np.zeros(2)
    assert np.allclose(
        functions.torques(q, rest, rest).full().ravel(), chain.compute_torques(q, rest, rest)
    )
    for name in ("accelerations", "acceleration_derivatives", "step"):
        with pytest.raises(SingularConfigurationError, match="move no mass"):
            getattr(functions, name)
