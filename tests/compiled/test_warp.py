# SPDX-License-Identifier: BSD-2-Clause
"""Kernels of NVIDIA Warp compute what the chain computes, and flag samples that they cannot."""

import copy

import numpy as np
import pinocchio as pin
import pytest

from sst_pin import InputError, SingularConfigurationError, robots
from sst_pin.compiled import extension, libraries
from tests.gallery import EVERY_ROBOT
from tests.support import any_chain
from tests.support.files import load
from tests.support.named_robots import robot_named

wp = pytest.importorskip("warp", reason="needs the extra 'gpu'")

from sst_pin.compiled.warp_batch import Status  # noqa: E402


def slow(*names):
    return [pytest.param(name, marks=pytest.mark.slow) for name in names]


#: Robots that differ in their closures, joints, or ways of elimination: loops whose rows all count,
#: surplus motors, joints of two and three rates, rails, lines, one loop behind another.
FEW = slow("ankle", "bricard", "governor", "planar_4rrr")
MORE = slow("andrews", "bennett", "excavator", "leg", "scissor_lift", "stewart", "ups_pu")


#: The closing kernel of Bricard's linkage, all of whose rows count together, has no pivots.
FLAGGED = {("bricard", "closed")}


@pytest.fixture(scope="module")
def four_bar():
    return robots.four_bar()


def arrays(batch, *values):
    return [wp.array(x, dtype=batch.dtype, device=batch.device) for x in values]


def size_of(values):
    return max(np.abs(values).max(), 1e-2)


def results(batch, chain, status):
    """Each result of a batch, that of the chain, and the size of the terms that it is the sum of.

    `status` is that of the result. Accelerations are differences of what torques and springs alone
    would cause, which are 40,000 times as large for Andrews' mechanism.
    """
    q, va, aa = any_chain.states(chain, 6, 0)
    q, va, aa = (x.numpy().astype(float) for x in arrays(batch, q, va, aa))  # as they are rounded
    tau = chain.compute_torques(q, va, aa)
    near = pin.integrate(chain.model, q[0], 1e-4 * np.ones(chain.model.nv))
    Q, VA, AA, TAU, NEAR = arrays(batch, q, va, aa, tau, np.tile(near, (6, 1)))
    frame = chain.model.frames[-1].name
    inertia, driven = chain.reduced_terms(q, va).inertia, chain.actuator_jacobian(q)
    forces = np.einsum("...mn,...m->...n", driven, tau)[..., None]
    terms = np.abs(np.linalg.solve(inertia, forces)).max()
    options = {"status": status}
    yield "torques", batch.torques(Q, VA, AA, **options), tau, size_of(tau)
    load = np.random.default_rng(0).normal(size=(6, chain.model.njoints - 1, 6))
    loaded = batch.torques(Q, VA, AA, external_wrenches=arrays(batch, load)[0], **options)
    expected = chain.compute_torques(q, va, aa, external_wrenches=load)
    yield "loaded torques", loaded, expected, size_of(expected)
    forces = chain.generalized_forces(q, va, aa)
    yield "forces", batch.generalized_forces(Q, VA, AA, **options), forces, size_of(forces)
    expected = chain.compute_accelerations(q, va, tau)
    size = max(terms, size_of(expected))
    yield "accelerations", batch.accelerations(Q, VA, TAU, **options), expected, size
    expected = chain.joint_rates(q, va)
    yield "rates", batch.rates(Q, VA, **options), expected, size_of(expected)
    expected = np.tile(chain.assemble(near), (6, 1))
    yield "closed", batch.closed(NEAR, **options), expected, size_of(expected)
    for part, expected in zip(
        batch.frame_placement(Q, frame, **options), chain.frame_placement(q, frame), strict=True
    ):
        yield "frame placement", part, expected, size_of(expected)
    slopes = batch.torque_derivatives(Q, VA, AA, **options)
    for part, expected in zip(slopes, chain.torque_derivatives(q, va, aa), strict=True):
        yield "torque derivatives", part, expected, size_of(expected)
    slopes = batch.acceleration_derivatives(Q, VA, TAU, **options)
    for part, expected in zip(slopes, chain.acceleration_derivatives(q, va, tau), strict=True):
        yield "acceleration derivatives", part, expected, size_of(expected)
    # So short that it does not matter which coordinates are integrated.
    state = batch.step((Q, VA), TAU, 2e-5, substeps=2, **options)
    motion = chain.rollout(np.repeat(tau[:, None], 2, axis=1), q, va, 1e-5)
    yield "q of a step", state.q, motion.q[:, -1], size_of(motion.q)
    yield "va of a step", state.va, motion.va[:, -1], size_of(motion.va)


@pytest.mark.parametrize("name", ["four_bar", *FEW, *MORE])
def test_results_are_those_of_the_chain(name, device):
    chain = EVERY_ROBOT[name]()
    batch, status = chain.warp(device), wp.full(6, 9, dtype=wp.int32, device=device)
    for result, actual, expected, size in results(batch, chain, status):
        if (name, result) in FLAGGED:
            assert (status.numpy() == Status.NOT_FINITE).all()
            continue
        error = np.abs(actual.numpy() - expected).max() / size
        assert error < (1e-11 if "step" in result else 1e-12), result  # two steps, each closed
        assert not status.numpy().any(), result


@pytest.mark.parametrize("name", FEW)
def test_results_in_single_precision_have_some_digits(name, device):
    """Roundings of 6e-8 grow with the conditioning of the loops, and of the inertia up to 1e5."""
    chain = EVERY_ROBOT[name]()
    batch, status = chain.warp(device, "float32"), wp.zeros(6, dtype=wp.int32, device=device)
    for result, actual, expected, size in results(batch, chain, status):
        if (name, result) in FLAGGED:
            continue
        by_inertia = "acceleration" in result or result == "va of a step"
        error = np.abs(actual.numpy() - expected).max() / size
        assert error < (2e-2 if by_inertia else 1e-4), result
        assert not status.numpy().any(), result


@pytest.mark.slow
def test_single_precision_has_five_digits(four_bar, device):
    """The largest error of 250 samples is 3e-6: some fifty roundings."""
    batch = four_bar.warp(device, "float32")
    states = (x.astype(np.float32) for x in any_chain.states(four_bar, 6, 0))
    q, va, aa = (x.astype(float) for x in states)
    result, expected = batch.torques(*arrays(batch, q, va, aa)), four_bar.compute_torques(q, va, aa)
    assert np.abs(result.numpy() - expected).max() < 1e-5 * np.abs(expected).max()


def test_each_bad_sample_is_flagged_and_becomes_nan(four_bar, device):
    batch, status = four_bar.warp(device), wp.zeros(6, dtype=wp.int32, device=device)
    q, va, aa = (np.tile(x, (6, 1)) for x in (four_bar.home, [1.0], [0.5]))
    q[1, 1] += 1e-3
    q[2, 0], va[3], q[4, 0] = np.nan, np.inf, 2e6
    expected = [Status.GOOD, Status.OPEN, *[Status.NOT_FINITE] * 3, Status.GOOD]
    Q, VA, AA = arrays(batch, q, va, aa)
    for result in (batch.torques(Q, VA, AA, status=status), *batch.step((Q, VA), AA, 1e-3)):
        assert list(np.isnan(result.numpy()).any(axis=1)) == [x != 0 for x in expected]
    assert list(status.numpy()) == expected
    batch.step((Q, VA), AA, 1e-3, status=status)
    assert list(status.numpy()) == expected


def test_steps_that_are_good_are_those_of_the_rollout(four_bar, device):
    """Fast motions with long steps pass singular configurations; none changes its mode unseen."""
    batch, random, count = four_bar.warp(device), np.random.default_rng(1), 60
    q, _, _ = any_chain.states(four_bar, count, 1)
    va, tau = 20 * random.normal(size=(count, 1)), random.normal(size=(count, 1))
    status = wp.zeros(count, dtype=wp.int32, device=device)
    end = batch.step(arrays(batch, q, va), *arrays(batch, tau), 0.02, status=status)
    motion = four_bar.rollout(tau[:, None], q, va, 0.02, on_error="nan")
    good = status.numpy() == Status.GOOD
    assert 10 < good.sum() < 50
    assert np.abs(end.q.numpy() - motion.q[:, -1])[good].max() < 1e-12
    assert np.isnan(motion.q[:, -1]).any()
    assert set(status.numpy()) <= {Status.GOOD, Status.MODE}


def test_arrays_of_any_strides_are_taken_without_copies(four_bar, device):
    batch = four_bar.warp(device)
    q, va, aa = any_chain.states(four_bar, 6, 0)
    whole = wp.array(np.hstack([va, q, aa]), dtype=wp.float64, device=device)
    row = wp.array(np.hstack([va, q, aa]).T.copy(), dtype=wp.float64, device=device)
    expected, out = four_bar.compute_torques(q, va, aa), wp.zeros((6, 3), wp.float64, device=device)
    for x in (whole, row.transpose((1, 0))):
        result = batch.torques(x[:, 1:4], x[:, :1], x[:, 4:], out=out[:, 1:2])
        assert result.ptr == out.ptr + 8
        assert np.abs(out.numpy()[:, 1:2] - expected).max() < 1e-13 * np.abs(expected).max()
    if device == "cpu":
        assert batch.torques(q, va, aa).numpy() == pytest.approx(expected, rel=1e-12)


def test_each_robot_may_have_its_own_parameters(four_bar, device):
    batch, names = four_bar.warp(device), four_bar.warp(device).parameter_names
    q, va, aa = any_chain.states(four_bar, 6, 0)
    bodies = [i for i, name in enumerate(names) if name.startswith("crank.")]
    assert [names[i] for i in bodies[:4]] == ["crank.mass", "crank.x", "crank.y", "crank.z"]
    many = np.repeat(batch.parameters.numpy(), 6, axis=0)
    many[:, bodies] *= np.linspace(1, 2, 6)[:, None]
    many[3, names.index("gravity.z")] = -1.62
    result = batch.with_parameters(many).torques(*arrays(batch, q, va, aa)).numpy()
    for k, scale in enumerate(np.linspace(1, 2, 6)):
        other = robots.four_bar()
        body = other.model.inertias[index := other.model.getJointId("crank")]
        other.model.inertias[index] = pin.Inertia(
            scale * body.mass, body.lever, scale * body.inertia
        )
        if k == 3:
            other.model.gravity.linear = np.array([0, 0, -1.62])
        other.refresh()
        assert result[k] == pytest.approx(other.compute_torques(q[k], va[k], aa[k]), rel=1e-12)
    with pytest.raises(InputError, match=r"^q: 2 samples of 6 robots"):
        batch.with_parameters(many).torques(*arrays(batch, q[:2], va[:2], aa[:2]))
    with pytest.raises(InputError, match=r"^parameters: shape \(1, 2\), expected"):
        batch.with_parameters([1.0, 2.0])
    one_row = batch.parameters.numpy()[0] * 2
    strided = wp.array(np.repeat(one_row, 2), dtype=wp.float64, device=device)[::2]
    assert (batch.with_parameters(strided).parameters.numpy() == one_row).all()


def test_arguments_are_checked(four_bar):
    batch = four_bar.warp("cpu")
    q, va = np.tile(four_bar.home, (2, 1)), np.zeros((2, 1))
    with pytest.raises(InputError, match=r"^va: shape \(2, 3\), expected \(2, 1\)"):
        batch.torques(q, q, va)
    with pytest.raises(InputError, match=r"^aa: shape \(1, 1\), expected \(2, 1\)"):
        batch.torques(q, va, va[:1])
    with pytest.raises(InputError, match=r"^aa: not an array of Warp"):
        batch.torques(q, va, [0.0, 0.0])
    with pytest.raises(InputError, match=r"^va: shape \(\), expected \(2, 1\)"):
        batch.torques(q, np.array(0.0), va)
    with pytest.raises(InputError, match=r"^q: shape \(\), expected \(N, 3\)"):
        batch.torques(np.array(0.0), va, va)
    with pytest.raises(InputError, match=r"^status: float64 on cpu, expected int32 on cpu"):
        batch.torques(q, va, va, status=np.zeros(2))
    with pytest.raises(InputError, match=r"^va: float32 on cpu, expected float64 on cpu"):
        batch.torques(q, va.astype(np.float32), va)
    with pytest.raises(InputError, match=r"^external_wrenches: wrenches at frames; give an array"):
        batch.torques(q, va, va, external_wrenches={"coupler_pin": np.zeros((2, 6))})
    with pytest.raises(InputError, match=r"^out: 1 arrays, expected q, va"):
        batch.step((q, va), va, 1e-3, out=(q.copy(),))
    with pytest.raises(InputError, match=r"^dtype: 'half' unknown; known: float64, float32"):
        four_bar.warp("cpu", "half")


def test_a_singular_configuration_is_flagged(device):
    """Coupler and rocker stretched: the crank is at the end of its range."""
    chain = robots.four_bar(coupler=0.13, rocker=0.12)
    crank = np.arccos(-0.3125)  # its tip is 0.25 m from the foot of the rocker
    way = np.arctan2(-0.1 * np.sin(crank), 0.2 - 0.1 * np.cos(crank))
    q = np.array([crank, way - crank, way + np.pi])
    with pytest.raises(SingularConfigurationError):
        chain.compute_torques(q, [1.0], [0.0])
    batch, status = chain.warp(device), wp.zeros(1, dtype=wp.int32, device=device)
    tau = batch.torques(*arrays(batch, [q], [[1.0]], [[0.0]]), status=status)
    assert status.numpy()[0] == Status.SINGULAR
    assert np.isnan(tau.numpy()).all()


def test_modules_are_cached_and_need_no_extension_module(four_bar, device, monkeypatch):
    batch = four_bar.warp(device)
    states = arrays(batch, *any_chain.states(four_bar, 6, 0))
    expected = batch.torques(*states).numpy()
    monkeypatch.setattr("sst_pin.compiled.warp_code.module", None)
    monkeypatch.setattr(extension, "binding", None)
    assert np.array_equal(four_bar.warp(device).torques(*states).numpy(), expected)
    assert "warp_torques_float64" in {library.kernel for library in libraries.cached()}


@pytest.mark.gpu
def test_steps_are_captured_in_a_cuda_graph(four_bar):
    if not wp.get_cuda_device_count():
        pytest.skip("no CUDA device")
    batch = four_bar.warp("cuda:0")
    q, va, tau = arrays(batch, *any_chain.states(four_bar, 6, 0))
    state = batch.step((q, va), tau, 1e-3)
    expected = batch.step(state, tau, 1e-3).q.numpy()
    with wp.ScopedCapture("cuda:0") as capture:
        batch.step((q, va), tau, 1e-3, out=(q, va))
    for _ in range(2):
        wp.capture_launch(capture.graph)
    assert np.abs(q.numpy() - expected).max() < 1e-15


@pytest.mark.slow
@pytest.mark.usefixtures("quickly_compiled")
def test_derivatives_of_a_floating_cassie_are_those_of_the_reference_path():
    """More coordinates than motors, and a pelvis that floats; on the CPU."""
    chain = copy.deepcopy(robot_named("floating cassie"))
    batch, (q, va, aa) = chain.warp("cpu"), any_chain.states(chain, 3, 0)
    tau = np.random.default_rng(0).normal(size=(3, len(chain.motor_names)))
    Q, VA, AA, TAU = arrays(batch, q, va, aa, tau)
    pairs = (
        (batch.torque_derivatives(Q, VA, AA), chain.torque_derivatives(q, va, aa)),
        (batch.acceleration_derivatives(Q, VA, TAU), chain.acceleration_derivatives(q, va, tau)),
    )
    for slopes, expected in pairs:
        for part, right in zip(slopes, expected, strict=True):
            # The inertia matrix has a condition number of 1e4.
            np.testing.assert_allclose(part.numpy(), right, atol=1e-11 * np.abs(right).max())


@pytest.mark.parametrize("name", slow("ankle", "bricard", "delta", "governor"))
def test_machine_code_for_a_gpu_is_made_without_one(name):
    """With at most the 255 registers that a thread can have, and 2 kB of stack."""
    chain = EVERY_ROBOT[name]()
    for row in load("scripts/benchmark/gpu.py").resources(name, chain, "float64", 90):
        assert 0 < row["registers"] <= 255
        assert row["stack"] <= 2048
        assert row["code"] > 1000
