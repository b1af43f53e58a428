# SPDX-License-Identifier: BSD-2-Clause
"""Chains computed by kernels of their own."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import compiled_backend, compiler
from sst_pin.dynamics.derivatives import TorqueDerivatives
from sst_pin.dynamics.quantities import QUANTITIES, Quantity
from sst_pin.engine import Engine
from sst_pin.errors import CompilationError
from tests.gallery import ladder
from tests.support import any_chain, link_tables
from tests.support.files import ROOT


@pytest.fixture(scope="module")
def four_bar():
    chain = link_tables.four_bar(link_tables.SKEW_PLANE).chain()
    chain.compile()
    return chain


@pytest.fixture(scope="module")
def five_bar():
    chain = sst_pin.robots.five_bar()
    chain.compile()
    return chain


@pytest.fixture(scope="module")
def lines():
    """Its kernels are compared in test_same_numbers.py too."""
    chain = any_chain.lines()
    chain.generic_configuration()
    chain.compile()
    return chain


def moving(chain, count):
    return any_chain.states(chain, count, 0)


def test_no_number_of_coordinates_is_too_many_for_kernels():
    """Accelerations of a ladder take the same operations for each cell: test_articulated.py."""
    mechanism = ladder(34).mechanism
    assert not any(compiled_backend.impossible(mechanism, name) for name in QUANTITIES)


@pytest.mark.parametrize("count", [1, 5, 33, 5003])
def test_every_sample_has_the_same_bits_alone_and_in_any_batch(four_bar, count):
    rng = np.random.default_rng(count)
    states = moving(four_bar, 10)
    pick = rng.integers(10, size=count)
    q, va, aa = (x[pick] for x in states)
    alone = np.array([four_bar.compute_torques(*(x[k] for x in states)) for k in range(10)])[pick]
    for threads in (1, 2, 5):
        assert np.array_equal(four_bar.compute_torques(q, va, aa, threads=threads), alone)
    accelerations = four_bar.compute_accelerations(q, va, alone, threads=2)
    one = four_bar.compute_accelerations(q[0], va[0], alone[0])
    assert np.array_equal(accelerations[0], one)


@pytest.mark.parametrize("threads", [1, 3])
def test_samples_at_fault_are_found_wherever_they_stand(four_bar, threads):
    """Every hundredth of a batch that is large enough for several threads."""
    q, va, aa = (x[np.arange(5003) % 10] for x in moving(four_bar, 10))
    tau = four_bar.compute_torques(q, va, aa)
    q[::100, 1] += 0.1
    result = four_bar.compute_torques(q, va, aa, threads=threads, on_error="nan")
    tau[::100] = np.nan
    assert np.array_equal(result, tau, equal_nan=True)


def test_closures_are_judged_as_on_the_reference_path(four_bar):
    """Gaps from far below to far above the tolerance, in each joint: the same samples pass."""
    reference = link_tables.four_bar(link_tables.SKEW_PLANE).chain()
    q = four_bar.generic_configuration()
    q = np.tile(q, (len(q), 40, 1))
    for joint in range(len(q)):
        q[joint, :, joint] += np.geomspace(1e-8, 1e-4, 40)
    fast, slow = (r.generalized_forces(q, [0], [0], on_error="nan") for r in (four_bar, reference))
    assert np.array_equal(np.isnan(fast), np.isnan(slow))
    assert 0 < np.isnan(fast).mean() < 1


def test_angles_of_many_turns_are_angles(four_bar):
    """Up to a million radians by the kernels, beyond them by the reference path."""
    (q,), (va,), (aa,) = moving(four_bar, 1)
    tau = four_bar.compute_torques(q, va, aa)
    for turns in (1, -100, 10**5, 10**6):
        away = 2 * np.pi * turns
        # An angle of so many turns is known to its last digit only.
        result = four_bar.compute_torques(q + away, va, aa)
        assert np.abs(result - tau).max() < (1e-12 + 1e-14 * abs(away)) * np.abs(tau).max()


@pytest.mark.parametrize("count", [1, 65])
def test_a_moment_on_the_platform_alone_is_that_of_the_wrenches_of_all_bodies(five_bar, count):
    """To the bit, in batches of any size, one moment for all or one for each, whatever strides."""
    robot, random = five_bar, np.random.default_rng(4)
    q, va, aa = (x[np.arange(count) % 10] for x in moving(robot, 10))
    moments = random.normal(size=(count, 6))[:, ::2]
    platform = robot.model.frames[robot.model.getFrameId("platform")].parentJoint - 1
    for moment in (moments, moments[0].copy()):
        wrenches = np.zeros((*moment.shape[:-1], 4, 6))
        wrenches[..., platform, 3:] = moment
        for f in (robot.compute_torques, robot.compute_accelerations):
            loaded = f(q, va, aa, platform_moment=moment)
            assert np.array_equal(loaded, f(q, va, aa, external_wrenches=wrenches))
            alone = f(q[-1], va[-1], aa[-1], platform_moment=moments[-1])
            assert np.array_equal(alone, f(q, va, aa, platform_moment=moments)[-1])


@pytest.mark.slow
def test_wrenches_are_no_moment_on_the_platform(four_bar, five_bar):
    """Of a robot without a platform, and with one."""
    for robot in (four_bar, five_bar):
        (q,), (va,), (x,) = moving(robot, 1)
        moment = np.arange(6.0 * len(robot.joint_names))
        for name in ("compute_torques", "generalized_forces", "compute_accelerations"):
            for wrong in (moment, moment[None]):
                with pytest.raises(sst_pin.InputError, match="platform_moment"):
                    getattr(robot, name)(q, va, x, platform_moment=wrong)


SMALL_STACK = """
import threading
import numpy as np
import sst_pin

robot = sst_pin.robots.five_bar()
robot.compile()
q, rates = np.tile(robot.home, (2000, 1)), np.zeros((2000, 2))

def work():
    for threads in (1, 2, 300):
        robot.compute_torques(q, rates, rates, threads=threads)
        robot.compute_accelerations(q, rates, rates, threads=threads)
        robot.reduced_terms(q, rates, threads=threads)
        robot.rollout(np.zeros((2000, 2, 2)), q, rates, 1e-4, threads=threads)
    robot.compute_torques(q[0], rates[0], rates[0])
    print("done")

work()
threading.stack_size(64 * 1024)
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


@pytest.mark.slow
def test_batches_run_in_a_thread_with_a_small_stack():
    """64 KiB, what a server gives each of many threads; in a process of its own, it may crash."""
    command = [sys.executable, "-c", SMALL_STACK]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "done\ndone\n"), result.stderr


def test_no_samples_have_no_results(four_bar):
    (q, va, aa), bodies = moving(four_bar, 1), four_bar.model.njoints - 1
    loads = {"external_wrenches": np.empty((0, bodies, 6))}
    assert four_bar.compute_torques(q[:0], va[:0], aa[:0], **loads).shape == (0, 1)


def test_a_sample_that_is_almost_closed_is_handed_over(four_bar):
    """Open, but less than the reference path minds: it is asked."""
    (q,), va, aa = moving(four_bar, 1)
    q[2] += 0.8e-6
    for name, x in (("torques", aa), ("accelerations", np.ones((1, 1)))):
        kernel = four_bar.engine.kernels.kernel(Quantity(name))
        assert list(kernel.many((q[None], va, x), np.empty((1, 1)))) == [0]
    assert np.isfinite(four_bar.compute_torques(q, va[0], aa[0])).all()


@pytest.mark.parametrize("numbers", [list, tuple, lambda x: np.array(x, dtype=np.int32)])
def test_whole_numbers_and_lists_are_answered_by_the_kernel_at_once(lines, numbers):
    """The caller would check them at some twenty times the cost; what is no number it refuses."""
    (q,), (va, aa) = moving(lines, 1)[0], (np.array([2]), np.array([-3]))
    kernel, kind = lines.engine.kernel(Quantity("torques")), Quantity("torque_derivatives")
    result = kernel.answer(q, numbers(va.tolist()), numbers(aa.tolist()), None, None, 1)
    assert np.array_equal(result, lines.compute_torques(q, va * 1.0, aa * 1.0))
    slopes = lines.engine.kernel(kind._replace(sign_width=1e-3))
    assert slopes.derivatives(TorqueDerivatives, q, numbers([2]), numbers([-3]), 1) is not None
    for no_number in ([True], ["2"], [2j], [np.ma.masked], [10**400], np.array([True]), [None]):
        assert kernel.answer(q, no_number, aa * 1.0, None, None, 1) is None


def test_the_path_says_in_plain_words_what_has_no_kernel():
    bars = sst_pin.robots.four_bar()
    chain = sst_pin.ClosedChain(bars.model, bars.closures, [])
    chain.compile()
    with pytest.raises(sst_pin.ActuationError):
        chain.compute_torques(bars.home, [0.0], [1.0])
    assert chain.backend.endswith(
        "; torques by the reference path: fewer motors (0) than coordinates (1)"
    )


def test_without_a_compiler_the_reason_is_said_and_the_reference_path_computes(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "find_spec", lambda _: None)
    chain = link_tables.four_bar().chain()
    with pytest.raises(CompilationError, match=r"no C compiler found.*\[compiler\]"):
        chain.compile()
    q, va, aa = moving(chain, 1)
    assert np.isfinite(chain.compute_torques(q, va, aa)).all()
    assert "compile()" in chain.backend
    chain._engine = Engine(chain.mechanism, compiled_backend.CompiledBackend)
    elsewhere = pickle.loads(pickle.dumps(chain))
    assert np.isfinite(elsewhere.compute_torques(q, va, aa)).all()
    assert "no C compiler found" in elsewhere.backend


@pytest.mark.slow
def test_every_instruction_set_gives_the_same(tmp_path, monkeypatch):
    """Two, four and eight samples at once, as far as this processor can."""
    from sst_pin.compiled import _binding

    order = ["plain", "avx2", "avx512"]
    for target in order[: order.index(_binding.INSTRUCTIONS) + 1]:
        chain = link_tables.planar_3rrr().chain()
        q, va, aa = moving(chain, 11)
        expected = chain.compute_torques(q, va, aa)
        monkeypatch.setattr(_binding, "INSTRUCTIONS", target)
        chain.compile()
        assert target in chain.backend
        assert np.allclose(chain.compute_torques(q, va, aa), expected, rtol=1e-10)


def test_no_generated_c_stays_in_memory(monkeypatch):
    """For single samples the derivatives are by directions: their C is that of no other variant."""

    def load(robot, name, content, target, sources, options):
        return sources()

    monkeypatch.setattr(compiled_backend.libraries, "load", load)
    key = Quantity("torque_derivatives")
    five_bar = sst_pin.robots.five_bar()
    kernels = compiled_backend.CompiledBackend(five_bar.engine.reference)
    kernels.make([key])
    assert not kernels._sources
    assert kernels._codes_of(key) is not None
    assert not kernels._sources


def test_a_failure_of_nonsmooth_code_says_nothing_about_the_ordinary_rollout(monkeypatch):
    def fail(*arguments):
        raise CompilationError("no compiler")

    monkeypatch.setattr(compiled_backend.CompiledBackend, "_nonsmooth_code", fail)
    kernels = compiled_backend.CompiledBackend(sst_pin.robots.five_bar().engine.reference)
    assert kernels.nonsmooth(None, loaded=False, many=True) is None
    assert "; nonsmooth by the reference path: no compiler" in str(kernels)
    assert "rollout" not in str(kernels)
