# SPDX-License-Identifier: BSD-2-Clause
"""A cart that rolls, with a mimic joint, a coupling, springs on a ball and a wheel: compiled."""

import ctypes
import pickle
import subprocess

import numpy as np
import pinocchio as pin
import pytest

import any_chain
from sst_pin import ClosedChain, ClosureError, InputError, robots
from sst_pin.chain.backend import Key
from sst_pin.compiled import build
from sst_pin.compiled.export import c_files
from sst_pin.files import write_files


@pytest.fixture(scope="module")
def pair():
    """By kernels and by the reference path."""
    kernels, reference = any_chain.cart(), any_chain.cart()
    for chain in (kernels, reference):
        chain.generic_configuration()
    kernels.compile()
    return kernels, reference


@pytest.fixture(scope="module")
def motions(pair):
    return any_chain.states(pair[1], 12, 0)


def same(actual, expected, tolerance=1e-12):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def address(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def exported(chain, folder):
    """Its C99, compiled strictly, in this process."""
    write_files(c_files(chain, folder))
    source, made = folder / "robot.c", folder / "robot.so"
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
    subprocess.run(["cc", *strict, "-O1", "-shared", "-fPIC", source, "-o", made], check=True)
    return ctypes.CDLL(str(made))


def test_no_sample_is_handed_over_and_all_are_those_of_the_reference_path(pair, motions):
    (kernels, reference), (q, va, aa) = pair, motions
    backend = kernels._current.backend
    assert not len(backend.kernel(Key("torques")).many((q, va, aa), np.empty_like(va)))
    assert not len(backend.kernel(Key("accelerations")).many((q, va, aa), np.empty_like(va)))
    for name, third in (("compute_torques", aa), ("compute_accelerations", aa)):
        expected = getattr(reference, name)(q, va, third)
        same(getattr(kernels, name)(q, va, third), expected)
        same(
            [getattr(kernels, name)(*motion) for motion in zip(q, va, third, strict=True)], expected
        )
    assert kernels.path.startswith("compiled")
    assert "reference path" not in kernels.path


@pytest.mark.slow
def test_a_rollout_rolls_as_on_the_reference_path(pair, motions):
    """Wheels roll on while the loops are closed; friction smooth: the paths round differently.

    The stages of a step lie off the closures by h^2, where each path solves other rows: one step of
    1e-3 s differs by 3e-12, half of it by a 32nd of that, and steps of 2.5e-4 s by rounding.
    """
    (kernels, reference), (q, va, _) = pair, motions
    tau = np.random.default_rng(0).normal(size=(3, 20, va.shape[1]))

    def rolled(h, steps=20):
        return [
            chain.rollout(tau[:, :steps], q[:3], 0.5 * va[:3], h, sign_width=0.3) for chain in pair
        ]

    ours, theirs = rolled(2.5e-4)
    same(ours.q, theirs.q)
    same(ours.va, theirs.va, 1e-11)
    step = reference.casadi(sign_width=0.3).step(q[0], 0.5 * va[0], tau[0, 0], 2.5e-4)
    same(step[0].full().ravel(), theirs.q[0, 1])
    same(step[1].full().ravel(), theirs.va[0, 1])
    assert np.abs(ours.q[:, -1] - ours.q[:, 0]).max() > 1e-3
    assert "rollout" not in kernels.path
    one, half = (np.abs(a.va - b.va).max() for a, b in (rolled(2e-3, 1), rolled(1e-3, 1)))
    assert one / half == pytest.approx(32, rel=0.1)


def test_gravity_and_inertias_count_without_compiling_again(pair, motions, monkeypatch):
    kernels, (q, va, aa) = pickle.loads(pickle.dumps(pair[0])), motions
    monkeypatch.setattr(build, "_compile", None)  # whoever compiles fails
    before = kernels.compute_torques(q, va, aa)
    model = kernels.model
    model.gravity.linear = np.array([0.0, 3.0, -20.0])
    for joint in ("follower", "ball", "base"):
        model.inertias[model.getJointId(joint)] += pin.Inertia.FromSphere(0.7, 0.2)
    kernels.refresh()
    after = kernels.compute_torques(q, va, aa)
    assert np.abs(after - before).max() > 1
    reference = any_chain.cart()
    reference.model.gravity, reference.model.inertias[:] = model.gravity, model.inertias
    reference.refresh()
    same(after, reference.compute_torques(q, va, aa))
    assert kernels.path.startswith("compiled")


def test_faulty_samples_are_named_or_become_nan(pair, motions):
    kernels, (q, va, aa) = pair[0], motions
    tip = kernels.model.joints[kernels.model.getJointId("tip")].idx_q
    opened = q.copy()
    opened[4, tip] += 1e-3
    with pytest.raises(ClosureError, match=r"1 of 12 samples \(index 4\)"):
        kernels.compute_torques(opened, va, aa)
    for name in ("compute_torques", "compute_accelerations"):
        found = getattr(kernels, name)(opened, va, aa, on_error="nan")
        assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [4]
    endless = va.copy()
    endless[2, 0] = np.nan
    with pytest.raises(InputError, match="va"):
        kernels.compute_torques(q, endless, aa)


def test_exported_it_computes_the_same(pair, motions, tmp_path):
    """Springs' references are listed by the coordinates that they are."""
    reference, (q, va, aa) = pair[1], motions
    functions = exported(reference, tmp_path)
    for name, method in (
        ("torques", "compute_torques"),
        ("accelerations", "compute_accelerations"),
    ):
        for motion in zip(q, va, aa, strict=True):
            result = np.empty(va.shape[1])
            assert getattr(functions, f"robot_{name}")(*map(address, (*motion, result))) == 0
            same(result, getattr(reference, method)(*motion), 1e-11)
    assert "spring reference of ball_qw" in (tmp_path / "robot.c").read_text()


def test_a_robot_without_motors_falls_as_on_the_reference_path(tmp_path):
    robot = robots.four_bar()
    kernels, reference = (ClosedChain(robot.model, robot.closures, []) for _ in range(2))
    q, va, _ = any_chain.states(reference, 3, 0)
    kernels.generic_configuration()
    kernels.compile()
    tau = np.empty((3, 0))
    assert not len(
        kernels._current.backend.kernel(Key("accelerations")).many((q, va, tau), np.empty((3, 1)))
    )
    expected = reference.compute_accelerations(q, va, tau)
    same(kernels.compute_accelerations(q, va, tau), expected)
    same(kernels.compute_accelerations(q[0], va[0], tau[0]), expected[0])
    functions = exported(reference, tmp_path)
    aa = np.empty(1)
    assert functions.robot_accelerations(*map(address, (q[1], va[1], aa))) == 0
    same(aa, expected[1])
