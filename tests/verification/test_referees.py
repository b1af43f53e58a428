# SPDX-License-Identifier: BSD-2-Clause
"""The referees agree with the natural orthogonal complement, and see it when it is wrong."""

from dataclasses import replace
from functools import partial
from types import FunctionType

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import sst_pin
from sst_pin.dynamics import dynamics, noc
from sst_pin.loops import loops
from sst_pin.loops.loops import Loops
from sst_pin.model.mechanism import Friction
from sst_pin.sst import paper
from sst_pin.verification import verify
from tests.referees import exudyn_engine, mujoco_motion
from tests.referees.virtual_work import VirtualWork
from tests.support.files import load
from tests.support.sampling import random_parameters, random_state

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


def test_a_referee_agrees_along_the_papers_circle(referee, robot):
    motion = sst_pin.paper_circle(np.linspace(0, np.pi / 6, 25))
    judge = referee(sst_pin.Parameters())
    tau = [judge.torques(*state) for state in zip(*motion, strict=True)]
    close(tau, noc_torques(robot, motion))


@pytest.mark.parametrize("friction", [None, True])
def test_a_referee_agrees_in_random_states_under_loads(referee, friction):
    """The paper's robot, and odd triangles and arcs, nine bodies, tilted gravity."""
    loaded = referee in OF_THE_STAR
    rng = np.random.default_rng(2)
    for _ in range(2):
        parameters = sst_pin.Parameters() if friction is None else random_parameters(rng, friction)
        robot, judge = sst_pin.SST(parameters), referee(parameters)
        for _ in range(5):
            R, omega, alpha = state = random_state(robot, rng)
            moment = rng.normal(scale=5, size=3)
            tau = noc_torques(robot, state, platform_moment=moment)
            close(judge.torques(*state), noc_torques(robot, state))
            if loaded:
                close(judge.torques(*state, moment), tau)
            if referee is VirtualWork:  # the condition number of the inertia comes in
                close(judge.accelerations(R, omega, tau, moment), alpha, 1e-9)


def _flip_closure_rate(patch):
    right = Loops.Phi_dot
    patch.setattr(Loops, "Phi_dot", lambda self, v: -right(self, v))


def _changed(name, change):
    """What puts a change into the results of a function of the dynamics."""

    def inject(patch):
        right = getattr(dynamics, name)
        patch.setattr(dynamics, name, lambda *args: change(right(*args)))

    return inject


def _forget_passive_friction(patch):
    right = Friction.forces
    actuated = np.tile([1, 0, 0], 3)
    patch.setattr(Friction, "forces", lambda self, v: actuated * right(self, v))


def _turn_inertia(bodies):
    """The inertia of star_1 with two of its axes exchanged."""
    M, exchange = bodies.M.copy(), np.eye(3)[[2, 1, 0]]
    rows = slice(6 * 2, 6 * 2 + 3)
    M[rows, rows] = exchange @ M[rows, rows] @ exchange.T
    return bodies._replace(M=M)


MUTATIONS = {
    "flipped sign in Phi_dot": _flip_closure_rate,
    "flipped sign in K_dot": _changed("bodies", lambda b: b._replace(K_dot=-b.K_dot)),
    "flipped sign in T_dot": _changed(
        "terms", lambda t: replace(t, coriolis=t.coriolis - 2 * t.T.T @ t.M @ t.T_dot)
    ),
    "no gyroscopic moments": _changed("bodies", lambda b: b._replace(Omega=0 * b.Omega)),
    "no Coriolis terms": _changed("terms", lambda t: replace(t, coriolis=0 * t.coriolis)),
    "wrong axis of an inertia": _changed("bodies", _turn_inertia),
    "flipped gravity": _changed("bodies", lambda b: b._replace(gravity=-b.gravity)),
    "no friction in passive joints": _forget_passive_friction,
}


@pytest.mark.parametrize("mutation", [None, *MUTATIONS])
def test_a_referee_sees_an_error_in_the_noc(referee, mutation, monkeypatch):
    """Eq. (92) in its long form differs from every referee once an error is put into it."""
    rng = np.random.default_rng(6)
    parameters = random_parameters(rng)
    robot = sst_pin.SST(parameters)
    states = [random_state(robot, rng) for _ in range(2)]
    if mutation:
        MUTATIONS[mutation](monkeypatch)
    judge = referee(parameters)
    differences = []
    for state in states:
        q, va, aa = robot.joint_motion(*state)
        terms = robot.noc(q, va)
        tau = terms.inertia @ aa + terms.coriolis @ va - terms.gravity - terms.friction
        verdict = judge.torques(*state)
        differences.append(np.abs(tau - verdict).max() / np.abs(verdict).max())
    if mutation:
        assert max(differences) > 1e-3  # of the torques: far beyond any tolerance
    else:
        assert max(differences) < TOLERANCE


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


def errors_by(numbers, error):
    """Errors, and the orders in which they fall with these numbers."""
    errors = np.array([error(number) for number in numbers])
    return errors, -np.diff(np.log(errors)) / np.diff(np.log(numbers))


@pytest.mark.slow
def test_exudyns_steps_tend_to_the_torques_and_to_the_path_of_the_paper(robot):
    """Its generalised-alpha method is of second order."""
    parameters, (R, omega, _) = sst_pin.Parameters(), sst_pin.paper_circle(0.0)
    quarter, run_in = paper.PERIOD / 4, 30
    expected = paper.example_1(robot, np.linspace(0, quarter, 61)).tau

    def torque_error(steps):
        _, tau = exudyn_engine.stepped_torques(parameters, sst_pin.paper_circle, quarter, steps)
        late = slice(run_in, None)  # its first torques miss the motors' accelerations
        return np.abs(tau[:: steps // 60] - expected)[late].max()

    torque = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001)).torque()

    def path_error(steps):
        motion = exudyn_engine.stepped_motion(parameters, R, omega, torque, paper.PERIOD, steps)
        t, path = motion
        return np.abs(path - sst_pin.paper_circle(t).R).max()

    for error, steps in ((torque_error, (120, 240, 480)), (path_error, (250, 500, 1000))):
        _, orders = errors_by(steps, error)
        assert np.abs(orders - 2).max() < 0.2


@pytest.mark.slow
def test_mujocos_welded_robot_tends_to_the_path_of_the_paper(robot):
    """In proportion to the give of its welds."""
    parameters, (R, omega, _) = sst_pin.Parameters(), sst_pin.paper_circle(0.0)
    torque = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001)).torque()

    def path_error(stiffness):
        t, path = mujoco_motion.welded_motion(
            parameters, R, omega, torque, paper.PERIOD / 8, stiffness=stiffness
        )
        return np.abs(path - sst_pin.paper_circle(t).R).max()

    errors, orders = errors_by((1e4, 1e5, 1e6), path_error)
    assert np.abs(orders - 1).max() < 0.2
    assert errors[-1] < 1e-7


@pytest.mark.slow
def test_virtual_work_integrates_the_torques_to_the_path_of_the_paper(robot):
    R, omega, _ = sst_pin.paper_circle(0.0)
    torque = paper.example_1(robot, np.linspace(0, paper.PERIOD, 1001)).torque()
    t = np.linspace(0, paper.PERIOD, 21)
    judge = VirtualWork(sst_pin.Parameters())
    path, _ = judge.simulate(lambda t, R, omega: torque(t), R, omega, t)
    # The spline of the torques through 1001 samples, in an open loop that doubles errors.
    assert np.abs(path - sst_pin.paper_circle(t).R).max() < 1e-9
