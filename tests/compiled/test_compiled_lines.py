# SPDX-License-Identifier: BSD-2-Clause
"""Forces and motors on lines by kernels, CasADi, JAX and exported C."""

import ctypes
import shutil
import subprocess

import numpy as np
import pinocchio as pin
import pytest

import any_chain
import sst_pin
from derivative_cases import assert_derivatives_are_those_of_differences, case, close
from doors import Casadi, Jax, Kernels
from sst_pin import ClosedChain, LineForce, robots
from sst_pin.compiled.export import c_files
from sst_pin.files import write_files

GAS = LineForce("wall", "platform", name="gas", stiffness=60, rest_length=0.4, damping=5)
SPRING = LineForce("rocker_pin", "wall", stiffness=300, rest_length=0.1, preload=-9)
MOTORS = ["gas", {"rocker": 0.3, SPRING.name: 2.0}]


def model(where=(-0.3, 0.1, 0.3)):
    """A four-bar with a point on the wall."""
    made = pin.Model(robots.four_bar().model)
    place = pin.SE3(np.eye(3), np.array(where))
    made.addFrame(pin.Frame("wall", 0, place, pin.FrameType.OP_FRAME))
    return made


def made(where=(-0.3, 0.1, 0.3), forces=(GAS, SPRING)):
    closures = robots.four_bar().closures
    return ClosedChain(model(where), closures, MOTORS, forces=forces)


@pytest.fixture(scope="module")
def both():
    fast = made()
    fast.compile(derivatives=True)
    return fast, made()


def test_kernels_compute_what_the_reference_path_does(both):
    fast, plain = both
    q, va, aa = any_chain.states(plain, 20, 0)
    tau = np.random.default_rng(1).normal(size=(20, 2))
    for name, arguments in {
        "compute_torques": (q, va, aa),
        "generalized_forces": (q, va, aa),
        "compute_accelerations": (q, va, tau),
        "torque_derivatives": (q, va, aa),
        "acceleration_derivatives": (q, va, tau),
        "reduced_terms": (q, va),
    }.items():
        results = [getattr(robot, name)(*arguments) for robot in both]
        parts = zip(*results, strict=True) if isinstance(results[0], tuple) else [results]
        for a, b in parts:
            close(a, b, 1e-11)
    rolled = [robot.rollout(np.ones((50, 2)), q[0], [0.1], 1e-3) for robot in both]
    close(rolled[0].q, rolled[1].q, 1e-11)
    assert fast.path.startswith("compiled")


@pytest.mark.slow
def test_kernels_give_the_reactions_of_the_reference_path(both):
    """1e-11 of the largest: two ways of solving."""
    q, va, aa = any_chain.states(both[1], 5, 0)
    random = np.random.default_rng(1)
    loads = {"external_wrenches": random.normal(size=(5, 3, 6))}
    for given in ({"aa": aa}, {"tau": random.normal(size=(5, 2)), **loads}):
        w, wanted = (robot.reactions(q, va, **given) for robot in both)
        assert np.array_equal(np.concatenate(w.determined, 1), np.concatenate(wanted.determined, 1))
        for part in ("joints", "closures", "ground", "motors"):
            largest = np.nanmax(np.abs(wanted.joints))
            assert getattr(w, part) == pytest.approx(
                getattr(wanted, part), abs=1e-11 * largest, nan_ok=True
            )
    assert "by the reference path" not in both[0].path


def test_numbers_of_lines_change_without_a_new_compilation_and_ends_with_one(both):
    """Kernels hold the ends, not the numbers: both give what the reference path gives."""
    q, va, aa = any_chain.states(both[1], 3, 0)
    soft = LineForce("wall", "platform", name="gas", stiffness=7, damping=1, preload=2)
    for where, forces in (((-0.3, 0.1, 0.3), (soft, SPRING)), ((-0.2, 0, 0.3), (GAS, SPRING))):
        robot, twin = made(where, forces), made(where, forces)
        robot.compile()
        close(robot.compute_torques(q, va, aa), twin.compute_torques(q, va, aa), 1e-12)


def test_samples_whose_line_has_no_direction_are_refused_by_kernels_too(both):
    home = robots.four_bar().home
    data = model().createData()
    pin.framesForwardKinematics(model(), data, home)
    at = data.oMf[model().getFrameId("platform")].translation
    robot = made(at)
    robot.compile()
    q = np.array([both[1].assemble([*home[:2], home[2] + 0.2]), home])
    with pytest.raises(sst_pin.SingularConfigurationError, match="gas is not determined"):
        robot.compute_torques(q, [0], [0])
    tau = robot.compute_torques(q, [0], [0], on_error="nan")
    assert np.isnan(tau).any(axis=1).tolist() == [False, True]


def test_a_motor_between_frames_of_one_body_moves_nothing():
    """On both paths it is refused, alone; beside another motor its force is zero."""
    line, bar = LineForce("coupler_pin", "platform", name="idle"), robots.four_bar()
    for motors in (["idle"], ["idle", "crank"]):
        fast, plain = (ClosedChain(bar.model, bar.closures, motors, forces=[line]) for _ in "ab")
        fast.compile()
        if len(motors) == 1:
            for robot in (fast, plain):
                with pytest.raises(sst_pin.ActuationError):
                    robot.compute_torques(bar.home, [1], [0])
        else:
            tau = plain.compute_torques(bar.home, [1], [0])
            assert tau[0] == 0
            close(fast.compute_torques(bar.home, [1], [0]), tau, 1e-12)


@pytest.mark.parametrize(
    "door", [Casadi, *(pytest.param(door, marks=pytest.mark.slow) for door in (Kernels, Jax))]
)
def test_derivatives_are_those_of_differences(door):
    closures = robots.four_bar().closures
    some = case(model(), closures, MOTORS, robots.four_bar().home, forces=(GAS, SPRING))
    random, opened = np.random.default_rng(2), door(some)
    if door is not Kernels:  # their derivatives by tau are those of as many motors as coordinates
        some = case(model(), closures, MOTORS[:1], robots.four_bar().home, forces=(GAS, SPRING))
        opened = door(some)
    for q, va, aa, wrenches in some.states(3):
        loads = wrenches if opened.takes_wrenches else None
        assert_derivatives_are_those_of_differences(some, opened, q, va, aa, loads, random)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_exported_c_has_lines(tmp_path):
    plain = made()
    write_files(c_files(plain, tmp_path))
    source, library = tmp_path / "robot.c", tmp_path / "robot.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", source, "-o", library], check=True)
    assert "line gas: stiffness, rest length, damping, preload" in source.read_text()
    torques = ctypes.CDLL(str(library)).robot_torques
    for q, va, aa in zip(*any_chain.states(plain, 4, 0), strict=True):
        tau = np.zeros(2)
        addresses = [ctypes.c_void_p(x.ctypes.data) for x in (q, va, aa, tau)]
        assert torques(*addresses) == 0
        close(tau, plain.compute_torques(q, va, aa), 1e-12)
