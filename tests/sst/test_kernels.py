# SPDX-License-Identifier: BSD-2-Clause
"""The kernels against the reference path."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from sst_pin.compiled import _binding
from sst_pin.engine import Key
from sst_pin.sst import kernels
from sst_pin.verification.sampling import random_parameters, random_state, random_states
from tests.support.without_kernels import on_reference_path

ROOT = Path(__file__).resolve().parents[2]
compiled = pytest.mark.skipif(bool(kernels.missing()), reason=f"no kernels: {kernels.missing()}")

#: Both paths lose the digits that the inverse of A costs, and its square in the acceleration terms:
#: 1e-16 times a few hundred for the condition numbers below 10 here (median measured 1e-15).
RELATIVE = 1e-12


def error(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


@pytest.fixture(params=range(6))
def case(request):
    """A random robot with rotors and friction, q, va, aa in random states, on random branches."""
    rng = np.random.default_rng(100 + request.param)
    robot = sst_pin.SST(random_parameters(rng))
    robot.model.armature = rng.uniform(0, 0.1, 9)
    robot.refresh()
    states = random_states(robot, rng, 40)
    return robot, *robot.joint_motion(*states, rng.choice((-1, 1), (40, 3)))


@compiled
def test_the_compiled_path_is_the_one_in_use(robot):
    """Otherwise this file would compare the reference path with itself."""
    assert robot.path.startswith("compiled kernels: ")
    assert sst_pin.SST(kernels=False).path == "the reference path: switched off by kernels=False"


@compiled
def test_derivatives_equal_the_reference(case):
    robot, q, va, aa = case
    both = robot, on_reference_path(robot)
    for name in ("torque_derivatives", "acceleration_derivatives"):
        for k in (0, slice(0, 8)):
            ours, right = (getattr(x, name)(q[k], va[k], aa[k], sign_width=0.1) for x in both)
            # Two solves more than for torques: the condition number once more.
            assert all(error(a, b) < 100 * RELATIVE for a, b in zip(ours, right, strict=True))
    assert "reference" not in robot.path


WITHOUT_CASADI = """
import sys
sys.modules["casadi"] = None
import numpy as np, sst_pin
robots = robot, _ = sst_pin.SST(), sst_pin.SST(kernels=False)
state = robot.home, [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]
d, right = (x.torque_derivatives(*state, sign_width=0.1) for x in robots)
assert all(np.allclose(a, b, rtol=1e-9, atol=1e-9) for a, b in zip(d, right))
print(robot.path)
"""


@pytest.mark.slow
@compiled
@pytest.mark.parametrize(("compiler", "path"), [({}, ""), ({"CC": "/no/cc"}, "CC names /no/cc")])
def test_derivatives_need_a_compiler_but_not_casadi(tmp_path, compiler, path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)} | compiler
    command = [sys.executable, "-c", WITHOUT_CASADI]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert ("by the reference path" in result.stdout) == bool(path)
    assert path in result.stdout


def test_torques_and_accelerations_equal_the_reference(case):
    """Random geometry, nine bodies, rotors, friction, moment on the star; all branches."""
    robot, q, va, aa = case
    reference, loads = on_reference_path(robot), np.zeros((40, 9, 6))
    loads[:, 2, :3] = moment = np.random.default_rng(0).normal(size=(40, 3))
    for name in ("compute_torques", "compute_accelerations"):
        ours, right = getattr(robot, name), getattr(reference, name)
        found = ours(q, va, aa, platform_moment=moment)
        assert error(found, right(q, va, aa, external_wrenches=loads)) < RELATIVE
        assert error(ours(q, va, aa), right(q, va, aa)) < RELATIVE


def test_reduced_terms_equal_those_of_the_long_form(case):
    """Inertia, Coriolis matrix (not only its product with the rates), gravity, friction."""
    robot, q, va, aa = case
    terms = robot.reduced_terms(q, va)
    for i in range(5):
        long = robot.noc(q[i], va[i])
        for name in ("inertia", "coriolis", "gravity", "friction"):
            assert error(getattr(terms, name)[i], getattr(long, name)) < RELATIVE, name
    tau = np.einsum("nij,nj->ni", terms.inertia, aa) + np.einsum("nij,nj->ni", terms.coriolis, va)
    assert error(tau - terms.gravity - terms.friction, robot.compute_torques(q, va, aa)) < RELATIVE
    expected = on_reference_path(robot).reduced_terms(q[:2], va[:2])
    assert all(error(a[:2], b) < RELATIVE for a, b in zip(terms, expected, strict=True))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 31, 32, 33, 1000, 5003])
def test_every_sample_has_the_same_bits_alone_and_in_any_batch(robot, count):
    rng = np.random.default_rng(count)
    q, va, aa = robot.joint_motion(*random_states(robot, rng, 10))
    pick = rng.integers(10, size=count)
    alone = np.array([robot.compute_torques(*sample) for sample in zip(q, va, aa, strict=True)])
    for threads in (1, 2, 5):
        tau = robot.compute_torques(q[pick], va[pick], aa[pick], threads=threads)
        assert np.array_equal(tau, alone[pick])
    state = q[pick], va[pick], alone[pick]
    accelerations = robot.compute_accelerations(*state, threads=2)
    assert np.array_equal(accelerations[0], robot.compute_accelerations(*(x[0] for x in state)))


@pytest.mark.parametrize("threads", [1, 3])
def test_samples_at_fault_are_found_wherever_they_stand(robot, threads):
    """Every hundredth of a batch that is large enough for several threads."""
    states = robot.joint_motion(*random_states(robot, np.random.default_rng(7), 10))
    q, va, aa = (x[np.arange(5003) % 10] for x in states)
    tau = robot.compute_torques(q, va, aa)
    q[::100, 1] += 0.1
    found = robot.compute_torques(q, va, aa, threads=threads, on_error="nan")
    tau[::100] = np.nan
    assert np.array_equal(found, tau, equal_nan=True)


SMALL_STACK = """
import threading
import numpy as np
import sst_pin

robot = sst_pin.SST()
q, rates = np.tile(robot.home, (2000, 1)), np.zeros((2000, 3))
robot.compute_torques(q, rates, rates)

def work():
    for threads in (1, 2, 300):
        robot.compute_torques(q, rates, rates, threads=threads)
        robot.compute_accelerations(q, rates, rates, threads=threads)
        robot.reduced_terms(q, rates, threads=threads)
        robot.rollout(np.zeros((2000, 2, 3)), q, rates, 1e-4, threads=threads)
    robot.compute_torques(q[0], rates[0], rates[0])
    print("done")

threading.stack_size(64 * 1024)
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


@compiled
def test_batches_run_in_a_thread_with_a_small_stack():
    """64 KiB, what a server gives each of many threads; in a process of its own, it may crash."""
    command = [sys.executable, "-c", SMALL_STACK]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "done\n"), result.stderr


@pytest.mark.parametrize("fast", [True, False])
def test_samples_at_fault_are_named_or_become_nan(fast):
    """Both paths; samples 1 and 6 are open, 3 is not finite in q, 4 in aa, the others are good."""
    robot = sst_pin.SST(kernels=fast)
    q, va, aa = robot.joint_motion(*random_states(robot, np.random.default_rng(6), 10))
    q[1, 4] += 1e-5
    q[3, 0] = np.nan
    aa[4, 2] = np.inf
    q[6, 2] += np.pi
    for method, arguments, bad in (
        (robot.compute_torques, (q, va, aa), [1, 3, 4, 6]),
        (robot.compute_accelerations, (q, va, aa), [1, 3, 4, 6]),
        (robot.reduced_terms, (q, va), [1, 3, 6]),
    ):
        with pytest.raises(sst_pin.ClosureError, match=r"2 of 10 samples \(index 1, 6\)") as caught:
            method(*arguments)
        assert caught.value.samples == ((1,), (6,))
        results = method(*arguments, on_error="nan")
        results = results.inertia if isinstance(results, tuple) else results
        rows = np.isnan(results.reshape(10, -1))
        assert np.array_equal(np.flatnonzero(rows.any(axis=1)), bad)
        assert rows[bad].all()
    with pytest.raises(sst_pin.InputError, match="q: not finite") as caught:
        robot.compute_torques(q[2:6], va[2:6], aa[2:6])
    assert caught.value.samples == ((1,), (2,))
    assert np.isnan(robot.compute_torques(q[1], va[1], aa[1], on_error="nan")).all()


def test_closures_are_judged_as_on_the_reference_path(robot):
    """Gaps from far below to far above the tolerance, in each joint: the same samples pass."""
    q = np.tile(robot.home, (9 * 60, 1)).reshape(9, 60, 9)
    for joint in range(9):
        q[joint, :, joint] += np.geomspace(1e-8, 1e-4, 60)
    zero = np.zeros(3)
    fast = np.isnan(robot.compute_torques(q, zero, zero, on_error="nan"))
    slow = np.isnan(on_reference_path(robot).compute_torques(q, zero, zero, on_error="nan"))
    assert np.array_equal(fast, slow)
    assert 0 < fast.mean() < 1


def test_angles_of_many_turns_are_angles(robot):
    """Up to a million radians by the kernels, beyond them by the reference path."""
    q, va, aa = robot.joint_motion(*random_state(robot, np.random.default_rng(7)))
    tau = robot.compute_torques(q, va, aa)
    for turns in (1, -100, 10**5, 10**6):
        away = 2 * np.pi * turns
        # An angle of so many turns is known to its last digit only.
        assert error(robot.compute_torques(q + away, va, aa), tau) < 1e-12 + 1e-14 * abs(away)


def test_the_committed_c_is_what_the_generator_makes():
    pytest.importorskip("casadi", reason="the generator computes with CasADi's expressions")
    script = ROOT / "scripts" / "kernels" / "make_kernels.py"
    subprocess.run([sys.executable, script, "--check"], check=True)


@compiled
@pytest.mark.parametrize("count", [1, 2, 64, 65, 150])
def test_a_moment_on_the_star_alone_loads_kernels_as_the_wrenches_of_all_bodies_do(count):
    """To the bit, in batches of any size, one moment for all or one for each, whatever strides."""
    robot, random = sst_pin.SST(), np.random.default_rng(4)
    q, va, aa = robot.joint_motion(*random_states(robot, random, count))
    moments = random.normal(size=(count, 6))[:, ::2]
    for moment in (moments, moments[0].copy()):
        wrenches = np.zeros((*moment.shape[:-1], 9, 6))
        wrenches[..., robot.joint_names.index("beta_1"), :3] = moment
        for f in (robot.compute_torques, robot.compute_accelerations):
            loaded = f(q, va, aa, platform_moment=moment)
            assert np.array_equal(loaded, f(q, va, aa, external_wrenches=wrenches))
            alone = f(q[-1], va[-1], aa[-1], platform_moment=moments[-1])
            assert np.array_equal(alone, f(q, va, aa, platform_moment=moments)[-1])


@compiled
def test_every_instruction_set_of_the_machine_computes_the_same(robot):
    """The package holds all; those that the processor has agree to rounding."""
    sets = ["avx512", "avx2", "avx2_one", "plain", "plain_one"]  # each has all after it
    arguments = robot.joint_motion(*random_states(robot, np.random.default_rng(8), 20))
    expected = robot.compute_torques(*arguments)
    mechanism = robot.engine.reference.mechanism
    numbers = kernels.open_numbers(mechanism).pack(mechanism, mechanism.friction)
    for target in sets[sets.index(_binding.INSTRUCTIONS) :]:
        code = kernels.code(Key("torques"), target)
        address, (_, size, *inputs) = code.address("run"), code.sizes("run")
        p = code.prepared(numbers)
        kernel = _binding.Kernel(address, address, tuple(inputs), size, p, code)
        tau = np.empty((20, 3))
        assert not len(kernel.many(arguments, tau))
        assert error(tau, expected) < RELATIVE


@pytest.mark.slow
@compiled
def test_all_of_the_dynamics_holds_without_the_kernels():
    tests = [ROOT / "tests" / "chain" / name for name in ("test_dynamics.py", "test_bad_input.py")]
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"SST_PIN_KERNELS": "off"}
    result = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, check=False)
    assert result.returncode == 0, result.stdout
