# SPDX-License-Identifier: BSD-2-Clause
"""`Engine`: which samples a kernel computes, and which the reference path."""

import dataclasses
import importlib
import inspect
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import control, design, identification, robots
from sst_pin.arrays import Array
from sst_pin.dynamics.quantities import QUANTITIES
from sst_pin.engine import Engine, _key


class FailingKernel:
    """A kernel that vouches for no sample, and notes how it was asked."""

    def __init__(self) -> None:
        self.calls = list[str]()

    def answer(self, a, b, c, load, out, threads):
        self.calls.append("answer")

    def derivatives(self, kind, a, b, c, threads):
        self.calls.append("derivatives")

    def many(self, arrays, out, threads=1):
        self.calls.append("many")
        return np.arange(len(out))


class FailingKernels:
    """All kernels of a robot, the same object."""

    def __init__(self) -> None:
        self.one = FailingKernel()

    def kernel(self, key):
        return self.one

    def __str__(self):
        return "kernels that fail"


@pytest.fixture
def engines():
    reference = robots.five_bar().engine
    kernels = FailingKernels()
    return reference, Engine(reference.mechanism, None, kernels), kernels.one.calls


#: Methods with arguments, in the order of the engine's signatures.
METHODS = {
    "torques": ("va", "aa"),
    "generalized_forces": ("va", "aa"),
    "accelerations": ("va", "tau"),
    "torque_derivatives": ("va", "aa"),
    "acceleration_derivatives": ("va", "tau"),
    "torque_regressor": ("va", "aa"),
    "joint_rates": ("va",),
    "joint_accelerations": ("va", "aa"),
    "actuator_jacobian": (),
}
NUMBERS = {"va": [0.3, -0.2], "aa": [0.5, 0.1], "tau": [0.02, -0.03]}


@pytest.mark.parametrize("name", METHODS)
def test_a_sample_that_fails_asks_its_kernel_once(engines, name: str) -> None:
    reference, engine, calls = engines
    arguments = [reference.loops.home, *(np.array(NUMBERS[x]) for x in METHODS[name])]
    expected = getattr(reference, name)(*arguments)
    result = getattr(engine, name)(*arguments)
    assert len(calls) == 1
    assert np.array_equal(np.concatenate(result, axis=None), np.concatenate(expected, axis=None))


def test_a_sample_whose_result_overwrites_an_argument_is_asked_as_a_batch(engines) -> None:
    """`Kernel.answer` refuses such arguments unseen."""
    reference, engine, calls = engines
    q, va, aa = reference.loops.home, np.array(NUMBERS["va"]), np.array(NUMBERS["aa"])
    expected = reference.torques(q, va, aa)
    result = engine.torques(q, va, aa, out=aa)
    assert calls == ["answer", "many"]
    assert result is aa
    assert np.array_equal(result, expected)


def test_every_quantity_with_kernels_has_a_typed_method() -> None:
    """Rates are called joint_rates; those of integrators are in `states`."""
    names = set(QUANTITIES) - {"rates", "closing", "rollout"}
    for name in names | {"joint_rates"}:
        returned = inspect.signature(getattr(Engine, name)).return_annotation
        assert returned not in (inspect.Signature.empty, "Any"), name


def test_the_loops_of_a_thread_have_one_owner(engines) -> None:
    engine = engines[0]
    assert engine.loops.assembly is engine.reference.context.assembly
    assert engine.loops.at(engine.loops.home) is engine.reference.context.loops


def test_out_of_reactions_has_the_wrenches() -> None:
    chain = robots.four_bar()
    out: Array = np.empty((2, 4, 6))
    w = chain.reactions(np.tile(chain.home, (2, 1)), [0.1], [0.2], out=out)
    assert np.shares_memory(w.joints, out)
    assert np.array_equal(out, np.concatenate([w.joints, w.closures], axis=1), equal_nan=True)
    assert np.isnan(out).any()


def test_keys_of_many_widths_do_not_fill_the_memory():
    for width in np.linspace(1e-3, 1e-2, 3000):
        _key("torque_derivatives", sign_width=float(width))
    assert _key.cache_info().currsize < 2000


def _functions_of_robots():
    """Names, functions and classes of the package whose first argument but axes is a robot."""
    places = [sst_pin, control, identification, design]
    with suppress(sst_pin.errors.MissingExtraError):  # without Matplotlib
        places.append(importlib.import_module("sst_pin.plots"))
    for place in places:
        for name in place.__all__:
            function = getattr(place, name)
            if not callable(function) or name.endswith(("Error", "Warning")):
                continue
            parameters = inspect.signature(function).parameters
            robots = [word for word in parameters if word in ("chain", "robot")]
            if robots and not dataclasses.is_dataclass(function):
                yield pytest.param(function, robots[0], id=f"{place.__name__}.{name}")


@pytest.mark.parametrize(("function", "robot"), [*_functions_of_robots()])
@pytest.mark.parametrize("value", [None, "robot.urdf", pin.Model(), sst_pin.ClosedChain])
def test_what_is_no_robot_is_refused_by_the_name_of_the_argument(function, robot, value):
    others = {
        name: None
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.default is parameter.empty and parameter.kind is not parameter.VAR_KEYWORD
    }
    with pytest.raises(sst_pin.errors.InputError) as caught:
        function(**others | {robot: value})
    assert caught.value.name == robot
