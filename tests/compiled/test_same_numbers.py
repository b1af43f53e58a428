# SPDX-License-Identifier: BSD-2-Clause
"""Kernels compute what the reference path computes, robot by robot; samples at fault are named.

`test_every_state.py` takes the robots of the gallery to states close to singular ones.
"""

import copy
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin import ClosedChain, LineForce, SingularConfigurationError, robots
from sst_pin.compiled import compiled_backend, libraries
from sst_pin.dynamics.quantities import QUANTITIES
from tests.gallery import EVERY_ROBOT
from tests.gallery.humanoids import humanoid
from tests.support import any_chain, link_tables
from tests.support.derivative_cases import WIDTH, floating_four_bar, of_gallery
from tests.support.methods import METHODS
from tests.support.named_robots import robot_named


def full(name):
    """A robot with springs, friction and a spring along a line."""
    robot, random = EVERY_ROBOT[name](), np.random.default_rng(1)
    model = robot.model.copy()
    model.damping, model.friction, model.armature = random.uniform(0.1, 1, (3, model.nv))
    line = LineForce("universe", model.frames[-1].name, stiffness=50, preload=3, damping=2)
    stiffness = random.uniform(1, 9, model.nv)
    return ClosedChain(model, robot.closures, robot.motor_names, lines=[line], stiffness=stiffness)


def _four_bar_without_motors():
    robot = robots.four_bar()
    return robot.model, robot.closures, []


GALLERY = ("delta", "planar_4rrr", "ladder", "bennett", "bricard", "governor", "excavator")
ROBOTS = {
    **{name: EVERY_ROBOT[name] for name in GALLERY},
    "SST": sst_pin.SST,
    "four-bar": lambda: link_tables.four_bar(link_tables.SKEW_PLANE).chain(),
    "five-bar": lambda: of_gallery("five_bar").chain,
    "floating four-bar": lambda: floating_four_bar().chain,
    "Cassie": lambda: copy.deepcopy(robot_named("cassie")),
    "floating Cassie": lambda: copy.deepcopy(robot_named("floating cassie")),
    "humanoid": humanoid,
    "floating": lambda: any_chain.with_joint("free-flyer", kind="hinge"),
    "cart": any_chain.cart,
    "lines": any_chain.lines,
    "rods": any_chain.rods,
    "coupled": any_chain.coupled,
    "composite": lambda: any_chain.with_joint("composite"),
    "no motors": lambda: ClosedChain(robots.four_bar().model, robots.four_bar().closures, []),
    "sprung": lambda: any_chain.sprung("RY"),
    "motors on dependent joints": lambda: any_chain.chain(
        kind="hinge", coordinates=["arm_1", "arm_2"]
    ),
    "four-bar by directions": lambda: link_tables.four_bar(link_tables.SKEW_PLANE).chain(),
    "five_bar by directions": lambda: full("five_bar"),
    "floating four-bar by directions": lambda: floating_four_bar().chain,
    "no motors by directions": lambda: ClosedChain(*_four_bar_without_motors()),
    "lines by directions": any_chain.lines,
}
DYNAMICS, LOADABLE = [*METHODS][:3], {*[*METHODS][:3], "linearize", "reactions"}
LOADABLE |= {"torque_derivatives", "acceleration_derivatives"}
FRAMES = [name for name in METHODS if name.startswith("frame")]
DERIVATIVES = ["torque_derivatives", "acceleration_derivatives", "linearize"]
OF_TREE = ["joint_rates", "joint_accelerations", "frame_jacobian", "reduced_terms"]
BY_DIRECTIONS = [name for name in ROBOTS if name.endswith("by directions")]
REACTING = (*GALLERY, "SST", "five-bar", "cart", "lines", "rods", "coupled", "composite")
#: Robots and what is compared of them: what compiles quickly, and the others.
QUICK = [
    (["four-bar"], [*DYNAMICS, *OF_TREE, "torque_regressor"]),
    (["lines"], [*DYNAMICS, "torque_derivatives"]),
    (["five-bar"], [*DERIVATIVES[1:], *FRAMES]),
    (["no motors"], ["compute_accelerations"]),
    (["four-bar by directions"], ["torque_regressor", "reduced_terms", "linearize"]),
    (["five_bar by directions"], ["frame_velocity_derivatives"]),
    (["no motors by directions"], DERIVATIVES[1:2]),
]
SLOW = [
    (["five-bar"], DERIVATIVES[:1]),
    (["floating"], [*DYNAMICS[1:], *OF_TREE]),  # a motor is missing
    (["floating four-bar"], [*DERIVATIVES, *FRAMES]),
    (["SST", "Cassie", "cart"], DYNAMICS),
    (["no motors"], DERIVATIVES[1:2]),
    (["sprung", "cart", "delta", "governor"], ["torque_regressor"]),
    (BY_DIRECTIONS[1:3], [*DERIVATIVES, *OF_TREE[2:], "torque_regressor"]),
    (BY_DIRECTIONS[2:3], FRAMES[1:]),
    (BY_DIRECTIONS[4:], DERIVATIVES[:2]),
    (["floating Cassie"], [*DERIVATIVES, "torque_regressor"]),
    (["humanoid"], [*DERIVATIVES, FRAMES[1], *OF_TREE[2:], "torque_regressor"]),
    ([*REACTING, "motors on dependent joints"], ["actuator_jacobian", "reactions"]),
]
CASES = [
    pytest.param(name, method, marks=marks, id=f"{name}, {method}")
    for table, marks in ((QUICK, ()), (SLOW, pytest.mark.slow))
    for names, methods in table
    for name in names
    for method in methods
]
#: Largest differences, of the largest number of a sample; 1e-11 for the others: two ways of
#: solving, with condition numbers up to 1e3.
TOLERANCES = {"cart": 1e-12, "five-bar": 1e-10, "floating four-bar": 1e-10}
TOLERANCES |= dict.fromkeys(BY_DIRECTIONS, 1e-10)


def same(actual, expected, tolerance=1e-12):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


@cache
def pair(name):
    """A robot by kernels, and by the reference path."""
    kernels, reference = ROBOTS[name](), ROBOTS[name]()
    for chain in (kernels, reference):
        chain.generic_configuration()
    kernels.compile()
    return kernels, reference


@pytest.fixture
def by_directions(monkeypatch):
    """Whole matrices count as too large for all."""
    monkeypatch.setattr(compiled_backend, "_LARGEST", 0)


@cache
def samples(name):
    """Motions of a robot, torques, wrenches on all bodies, and a frame."""
    chain = pair(name)[1]
    q, va, aa = any_chain.states(chain, 9, 0)
    random, model = np.random.default_rng(1), chain.model
    given = {"q": q, "va": va, "aa": aa, "frame": model.frames[-1].name}
    given["tau"] = random.normal(size=(len(q), len(chain.motor_names)))
    return given, random.normal(size=(len(q), model.njoints - 1, 6))


def results(chain, method, given, loads, k=..., **how):
    """All parts of what a method returns, sample k or all."""
    names = METHODS[method].split()
    taken = {x: given[x.strip("=")] for x in names}
    taken = {x: value if isinstance(value, str) else value[k] for x, value in taken.items()}
    how |= {x.strip("="): taken.pop(x) for x in names if x.endswith("=")}
    if method in DERIVATIVES:
        how["sign_width"] = WIDTH
    if loads is not None:
        how["external_wrenches"] = loads[k]
    result = getattr(chain, method)(*taken.values(), **how)
    if method == "reactions":
        return [result.joints, result.closures, result.ground, result.motors, *result.determined]
    return list(result) if isinstance(result, tuple) else [result]


@pytest.mark.usefixtures("kernels_at_their_first_use")
@pytest.mark.parametrize(("name", "method"), CASES)
def test_kernels_compute_what_the_reference_path_computes(name, method, request, monkeypatch):
    """Batches and single samples, with wrenches and without; none is handed over."""
    if name in BY_DIRECTIONS:
        request.getfixturevalue("by_directions")
    (kernels, reference), (given, wrenches) = pair(name), samples(name)
    loaded = [None, wrenches] if method in LOADABLE else [None]
    expected = [results(reference, method, given, loads) for loads in loaded]
    for loads in loaded:  # compiles
        results(kernels, method, given, loads)

    def handed_over(*_, **__):
        raise AssertionError("a sample is handed over")

    for quantity in QUANTITIES:
        monkeypatch.setattr(kernels.engine.reference, quantity, handed_over, raising=False)
    tolerance = TOLERANCES.get(name, 1e-11)
    for loads, wanted in zip(loaded, expected, strict=True):
        scale = np.nanmax(np.abs(wanted[0])) if method == "reactions" else None
        result = results(kernels, method, given, loads)
        single = results(kernels, method, given, loads, 3)
        for got, one, right in zip(result, single, wanted, strict=True):
            if right.dtype == bool:
                assert np.array_equal(got, right)
                continue
            assert got.shape == right.shape
            most = tolerance * (scale or np.abs(right).max(initial=0))
            np.testing.assert_allclose(got, right, rtol=0, atol=most)
            np.testing.assert_allclose(one, right[3], rtol=0, atol=most)
    assert "by the reference path" not in kernels.backend


@pytest.fixture
def no_compiler(monkeypatch):
    """Whoever compiles fails; what `compile` makes, and the regressor of a four-bar, are there."""
    for name in ("lines", "four-bar"):
        pair(name)[0].compile()
    results(pair("four-bar")[0], "torque_regressor", samples("four-bar")[0], None)

    def forbidden(*_):
        raise AssertionError("a compiler")

    monkeypatch.setattr(libraries, "compile_library", forbidden)


@pytest.mark.filterwarnings("ignore:.*the first moment and the inertia of the body stay")
def test_regressors_of_other_masses_need_no_new_kernel(no_compiler):
    kernels, given = pair("four-bar")[0], samples("four-bar")[0]
    motions = [given[name] for name in ("q", "va", "aa")]
    heavier = kernels.with_parameters({"coupler.mass": 3.0, "rocker.coulomb": 0.2})
    Y = heavier.torque_regressor(*motions)
    np.testing.assert_allclose(Y, kernels.torque_regressor(*motions), rtol=1e-12, atol=1e-13)
    forces = heavier.generalized_forces(*motions)
    np.testing.assert_allclose(Y @ heavier.dynamic_parameters, forces, atol=1e-12)


def test_gravity_inertias_and_friction_count_without_compiling_again(no_compiler):
    given, kernels = samples("four-bar")[0], pickle.loads(pickle.dumps(pair("four-bar")[0]))
    motions = [given[name] for name in ("q", "va", "aa")]
    before = kernels.compute_torques(*motions)
    model = kernels.model
    model.gravity.linear = np.array([0.0, 3.0, -20.0])
    model.damping, model.friction, model.armature = (
        3 * x for x in (model.damping, model.friction, model.armature)
    )
    for joint in range(1, model.njoints):
        model.inertias[joint] += pin.Inertia.FromSphere(0.7, 0.2)
    kernels.refresh()
    after = kernels.compute_torques(*motions)
    assert np.abs(after - before).max() > 1
    reference = ClosedChain(model, kernels.closures, kernels.motor_names)
    same(after, reference.compute_torques(*motions))
    assert kernels.backend.startswith("compiled")


def test_numbers_of_lines_change_without_a_new_compilation_and_ends_with_one(no_compiler):
    """Kernels hold the ends, not the numbers."""
    q, va, aa = any_chain.states(any_chain.lines(), 3, 0)
    soft = LineForce("wall", "platform", name="gas", stiffness=7, damping=1, preload=2, mass=0.5)
    soft = replace(soft, coulomb_friction=0.3)
    robot, twin = (any_chain.lines(lines=(soft, any_chain.SPRING)) for _ in range(2))
    robot.compile()
    same(robot.compute_torques(q, va, aa), twin.compute_torques(q, va, aa), 1e-12)
    with pytest.raises(AssertionError, match="a compiler"):
        any_chain.lines((-0.2, 0, 0.3)).compile()


def test_samples_whose_line_has_no_direction_are_refused_on_both_paths():
    """The other sample has the torques of both, with an end elsewhere than in other tests."""
    plain, home = any_chain.lines(), robots.four_bar().home
    data = plain.model.createData()
    pin.framesForwardKinematics(plain.model, data, home)
    where = data.oMf[plain.model.getFrameId("platform")].translation
    kernels, reference = any_chain.lines(where), any_chain.lines(where)
    kernels.compile()
    q = np.array([plain.assemble([*home[:2], home[2] + 0.2]), home])
    for robot in (kernels, reference):
        with pytest.raises(SingularConfigurationError, match="gas is not determined") as caught:
            robot.compute_torques(q, [0], [0])
        assert caught.value.samples == ((1,),)
    tau, expected = (r.compute_torques(q, [0], [0], on_error="nan") for r in (kernels, reference))
    assert np.isnan(tau).any(axis=1).tolist() == [False, True]
    np.testing.assert_allclose(tau, expected, rtol=1e-12)
