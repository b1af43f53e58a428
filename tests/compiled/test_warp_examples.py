# SPDX-License-Identifier: BSD-2-Clause
"""Arrays of PyTorch and JAX go to Warp's kernels without copies; the examples do what they say."""

import numpy as np
import pytest

from sst_pin import robots
from tests.support import any_chain
from tests.support.files import load

pytest.importorskip("warp", reason="needs the extra 'gpu'")
NO_EXTRA = "in no extra; pip install it to run this test"


@pytest.fixture(scope="module")
def four_bar():
    return robots.four_bar()


@pytest.mark.parametrize("name", ["torques", "step"])
def test_pytorch_differentiates_torques_and_steps(four_bar, name):
    """Central differences along closed motions agree to their rounding, 1e-16 / 1e-5, and more."""
    torch = pytest.importorskip("torch", reason=NO_EXTRA)
    robot, random = (
        load("examples/gpu_gradients.py").Robot(four_bar, "cpu"),
        np.random.default_rng(0),
    )
    q, va, aa = any_chain.states(four_bar, 4, 0)
    last = aa if name == "torques" else four_bar.compute_torques(q, va, aa)
    weights, way = torch.tensor(random.normal(size=(2, 4, 1))), random.normal(size=(4, 1))
    places = robot.coordinates.numpy()

    def value(*states):
        if name == "torques":
            return (robot.torques(*states) * weights[0]).sum()
        q, va = robot.step(*states, 0.01)
        return (q[:, places] * weights[0] + va * weights[1]).sum()

    def moved(k, length):
        states = [q.copy(), va.copy(), last.copy()]
        if k == 0:
            states[0][:, places] += length * way
            states[0] = np.array([four_bar.assemble(x) for x in states[0]])
        else:
            states[k] += length * way
        return float(value(*map(torch.tensor, states)))

    tensors = [torch.tensor(x).requires_grad_() for x in (q, va, last)]
    value(*tensors).backward()
    for k, tensor in enumerate(tensors):
        gradient = tensor.grad.numpy()[:, places] if k == 0 else tensor.grad.numpy()
        slope = (moved(k, 1e-5) - moved(k, -1e-5)) / 2e-5
        assert (gradient * way).sum() == pytest.approx(slope, rel=1e-7)


def test_arrays_of_jax_are_taken_without_copies(four_bar):
    pytest.importorskip("jax", reason=NO_EXTRA).config.update("jax_enable_x64", True)
    numbers = pytest.importorskip("jax.numpy", reason=NO_EXTRA)
    states = any_chain.states(four_bar, 6, 0)
    result = four_bar.warp("cpu").torques(*map(numbers.asarray, states)).numpy()
    assert result == pytest.approx(four_bar.compute_torques(*states), rel=1e-12)


@pytest.mark.slow
def test_the_ankles_follow_their_targets():
    """The best gains of 48 do better than the mean, and no step is bad."""
    gains, cost, fallen, _ = load("examples/gpu_ankle.py").search(48, 0.2, "cpu")
    assert gains.shape == (48, 2)
    assert np.sort(cost)[:5].mean() < 0.3 * cost.mean()
    assert fallen == 0
