# SPDX-License-Identifier: BSD-2-Clause
"""The referees agree with the natural orthogonal complement, and use nothing of it."""

from functools import partial
from types import FunctionType

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import sst_pin
from sst_pin.dynamics import dynamics, noc
from sst_pin.loops import loops
from sst_pin.sst import paper
from sst_pin.verification import verify
from tests.referees import exudyn_engine, mujoco_motion
from tests.referees.virtual_work import VirtualWork
from tests.support.files import load
from tests.support.sampling import random_parameters, random_state, random_states

EXAMPLE_1 = load("scripts/pages/example_1.py").EXAMPLE_1

#: Relative to the largest torque. The worst of a thousand random states is 1e-12, with all referees
#: alike: near singularities rounding grows with the condition number.
TOLERANCE = 1e-10
#: Referees that are built from `Parameters` and take motions of the star, loads on it too.
OF_THE_STAR = (VirtualWork, exudyn_engine.ExudynInstant)


class OfAnyChain:
    """A referee of any chain, asked as those of the star are."""

    def __init__(self, kind, parameters):
        self._robot = sst_pin.SST(parameters)
        self._judge = kind(self._robot)

    def torques(self, R, omega, alpha):
        return self._judge.torques(*self._robot.joint_motion(R, omega, alpha))


REFEREES = {kind.name: kind for kind in OF_THE_STAR}
REFEREES |= {f"{kind.name}, any chain": partial(OfAnyChain, kind) for kind in verify.REFEREES}


@pytest.fixture(scope="module", params=REFEREES)
def referee(request):
    """What makes a referee from `Parameters`."""
    return REFEREES[request.param]


def close(actual, expected, tolerance=TOLERANCE):
    """Equality relative to the largest entry."""
    assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def noc_torques(robot, state, **loads):
    return robot.compute_torques(*robot.joint_motion(*state), **loads)


@pytest.mark.parametrize("t", EXAMPLE_1)
def test_a_referee_finds_the_torques_of_example_1(referee, t):
    tau = referee(sst_pin.Parameters()).torques(*sst_pin.paper_circle(t))
    assert_allclose(tau, EXAMPLE_1[t], rtol=0, atol=1e-11)  # the references end at 1e-12


@pytest.mark.parametrize("friction", [None, True])
def test_a_referee_agrees_in_random_states_under_loads(referee, friction):
    """The paper's robot, and odd triangles and arcs, nine bodies, tilted gravity."""
    loaded = referee in OF_THE_STAR
    rng = np.random.default_rng(2)
    for _ in range(2):
        parameters = sst_pin.Parameters() if friction is None else random_parameters(rng, friction)
        robot, judge = sst_pin.SST(parameters), referee(parameters)
        for _ in range(5):
            state = random_state(robot, rng)
            moment = rng.normal(scale=5, size=3)
            close(judge.torques(*state), noc_torques(robot, state))
            if loaded:
                tau = noc_torques(robot, state, platform_moment=moment)
                close(judge.torques(*state, moment), tau)


@pytest.mark.parametrize("seed", range(8))
def test_torques_and_accelerations_of_any_robot_agree(seed):
    """By virtual work: odd geometry, nine different bodies, tilted gravity, loads, friction.

    On every branch: the antipodal choice of R_k moves the links to the other side.
    """
    rng, branch = np.random.default_rng(100 + seed), sst_pin.sst.BRANCHES[seed]
    parameters = random_parameters(rng, friction=seed % 2 == 0)
    robot, judge = sst_pin.SST(parameters), VirtualWork(parameters, branch)
    for R, omega, alpha in zip(*random_states(robot, rng, 10), strict=True):
        moment, torques = rng.normal(scale=5, size=3), rng.normal(scale=20, size=3)
        motion = robot.joint_motion(R, omega, alpha, branch=branch)
        tau = robot.compute_torques(*motion, platform_moment=moment)
        # Rounding times the square of the condition number, which random_states keeps below 30; the
        # worst of 4500 motions of 150 robots was 2e-12.
        close(tau, judge.torques(R, omega, alpha, moment), 2e-11)
        driven = judge.accelerations(R, omega, torques, moment)
        q, va, aa = robot.joint_motion(R, omega, driven, branch=branch)
        close(robot.compute_accelerations(q, va, torques, platform_moment=moment), aa, 2e-11)


def test_a_referee_uses_nothing_of_what_it_judges(referee, monkeypatch):
    rng = np.random.default_rng(7)
    parameters = random_parameters(rng)
    state = random_state(sst_pin.SST(parameters), rng)
    judge = referee(parameters)
    expected = judge.torques(*state)

    def gone(*args, **kwargs):
        raise AssertionError("a referee called what it judges")

    for module in (loops, dynamics, noc):
        for name, value in list(vars(module).items()):
            if getattr(value, "__module__", "") != module.__name__:
                continue  # what the module imports belongs to others
            if isinstance(value, FunctionType):
                monkeypatch.setattr(module, name, gone)
            for method in [m for m, f in vars(value).items() if isinstance(f, FunctionType)]:
                monkeypatch.setattr(value, method, gone)
    assert_array_equal(judge.torques(*state), expected)


@pytest.fixture(scope="module")
def torque(robot):
    """A spline of the torques of the paper's circle."""
    return paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001)).torque()


def off_the_circle(t, path):
    return np.abs(path - sst_pin.paper_circle(t).R).max()


def errors_by(numbers, error):
    """Errors, and the orders in which they fall with these numbers."""
    errors = np.array([error(number) for number in numbers])
    return errors, -np.diff(np.log(errors)) / np.diff(np.log(numbers))


@pytest.mark.slow
def test_exudyns_steps_tend_to_the_torques_and_to_the_path_of_the_paper(robot, torque):
    """Its generalised-alpha method is of second order."""
    parameters, (R, omega, _) = sst_pin.Parameters(), sst_pin.paper_circle(0.0)
    quarter, run_in = paper.PERIOD / 4, 30
    expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

    def torque_error(steps):
        _, tau = exudyn_engine.stepped_torques(parameters, sst_pin.paper_circle, quarter, steps)
        late = slice(run_in, None)  # its first torques miss the motors' accelerations
        return np.abs(tau[:: steps // 60] - expected)[late].max()

    def path_error(steps):
        start = parameters, R, omega, torque, paper.PERIOD
        return off_the_circle(*exudyn_engine.stepped_motion(*start, steps))

    for error, steps in ((torque_error, (120, 240, 480)), (path_error, (250, 500, 1000))):
        _, orders = errors_by(steps, error)
        assert np.abs(orders - 2).max() < 0.2


@pytest.mark.slow
def test_mujocos_welded_robot_tends_to_the_path_of_the_paper(torque):
    """In proportion to the give of its welds."""
    parameters, (R, omega, _) = sst_pin.Parameters(), sst_pin.paper_circle(0.0)

    def path_error(stiffness):
        start = parameters, R, omega, torque, paper.PERIOD / 8
        return off_the_circle(*mujoco_motion.welded_motion(*start, stiffness=stiffness))

    errors, orders = errors_by((1e4, 1e5, 1e6), path_error)
    assert np.abs(orders - 1).max() < 0.2
    assert errors[-1] < 1e-7


@pytest.mark.slow
def test_virtual_work_integrates_the_torques_to_the_path_of_the_paper(torque):
    R, omega, _ = sst_pin.paper_circle(0.0)
    t = np.linspace(0, paper.PERIOD, 21)
    judge = VirtualWork(sst_pin.Parameters())
    path, _ = judge.simulate(lambda t, R, omega: torque(t), R, omega, t)
    # The spline of the torques through 1001 samples, in an open loop that doubles errors.
    assert off_the_circle(t, path) < 1e-9
