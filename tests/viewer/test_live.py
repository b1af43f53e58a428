# SPDX-License-Identifier: BSD-2-Clause
"""The live page's engine in Chromium, against the package: torques, motions, energies, refusals."""

import json
import sys
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.errors import ClosureError, MissingExtraError, SSTError
from sst_pin.viewer import Viewer
from tests.support.browser import with_slow
from tests.support.motor_cases import elbows, held_not
from tests.support.named_robots import OTHERS, robot_named

#: Values at some states of the page's engine.
VALUES = """states => states.map(({q, va, aa, tau}) => {
  const r = engine(sst_functions, data);
  Object.assign(r, { q, va });
  return { torques: r.holds ? r.torques(q, va, aa) : [], accelerations: r.accelerations(q, va, tau),
    energies: r.energies(), condition: r.condition(), wrong: r.wrong((x) => String(x), []) };
})"""

#: The configuration after a way of the coordinates, and what ends the way.
MOVE = "x => { const r = engine(sst_functions, data), said = r.move(x); return [r.q, said] }"

#: A motion in frames of 1/60 s, as the page computes them: times, states, energies, and its end.
MOTION = """([q, va, seconds, way, efforts, grip]) => {
  const r = engine(sst_functions, data), found = [];
  Object.assign(r, { q, va, way, efforts });
  r.start();
  r.grip = grip;
  for (let k = 0, left = 0; k <= 60 * seconds && typeof left !== "string"; k++) {
    found.push({ t: r.time, q: r.q, va: r.va, energies: r.energies() });
    left = r.advance(1 / 60);
    if (typeof left === "string") found.end = left;
  }
  return { states: found, end: found.end || "" };
}"""


def on_springs(name):
    """A robot without friction whose coordinates have springs, so that it swings about its home."""
    chain = sst_pin.SST() if name == "sst" else robot_named(name)
    mechanism, home = chain.mechanism, chain.home
    inertia = chain.reduced_terms(home, np.zeros(chain.degrees_of_freedom)).inertia
    stiffness = np.zeros(mechanism.model.nv)
    stiffness[mechanism.coordinates] = 400.0 * np.diag(inertia)
    model = chain.model.copy()
    model.damping[:] = model.friction[:] = 0
    springs = {"stiffness": stiffness, "spring_reference": home}
    return sst_pin.ClosedChain(model, chain.closures, chain.motor_names, **springs)


class Engine:
    """The engine of a robot in a page, in the place of the one before."""

    def __init__(self, page, chain, q=None):
        self.viewer = Viewer(chain, pin.GeometryModel(), live=True)
        if q is not None:
            self.viewer.show(q)
        self.q = np.array(self.viewer._panel["live"]["q"])
        self.page = page
        page.goto("about:blank")
        self.page.add_script_tag(content=self.viewer._functions)
        data = json.dumps(self.viewer._panel["live"])
        self.page.add_script_tag(content=f"const data = {data};")

    def values(self, states):
        return self.page.evaluate(VALUES, [{k: x.tolist() for k, x in s.items()} for s in states])

    def motion(self, q, va, seconds, way="none", efforts=(), grip=None):
        state = np.asarray(q).tolist(), np.asarray(va).tolist()
        arguments = [*state, seconds, way, list(efforts), grip]
        result = self.page.evaluate(MOTION, arguments)
        return {k: np.array([s[k] for s in result["states"]]) for k in result["states"][0]}, result


@pytest.fixture(scope="module")
def page(chromium):
    return chromium.new_page()


def states_of(chain, q):
    """Six closed configurations near one, with rates, accelerations and torques."""
    random = np.random.default_rng(5)
    n, motors = chain.degrees_of_freedom, len(chain.motor_names)
    for _ in range(6):
        way = chain.joint_rates(q, 0.02 * random.standard_normal(n))
        with suppress(ClosureError):
            q = chain.assemble(pin.integrate(chain.mechanism.model, q, way), fixed=())
        va, aa, tau = (random.standard_normal(k) for k in (n, n, motors))
        yield {"q": q, "va": va, "aa": aa, "tau": tau}


SLOW = [
    "sst",
    "bennett",
    "delta",
    "stewart",
    "five_bar",
    "planar_4rrr",
    "excavator",
    "cassie",
    *OTHERS,
]
#: Joints that differ in what the page knows of them: how many numbers of q and rates they have, and
#: in which units. `compiled/test_equations.py` has each type of joint.
SLOW += ["RY", "PX", "helical", "continuous", "spherical", "planar", "free-flyer", "composite"]


@pytest.mark.parametrize(
    "name", ["four_bar", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_the_page_computes_what_the_package_computes(page, name):
    chain = robot_named(name)
    engine = Engine(page, chain)
    states = list(states_of(chain, engine.q))
    smooth = None
    if chain.mechanism.friction.coulomb.any():  # smoothed for an integrator on the page
        smooth = chain.casadi(engine.q, sign_width=0.01)
    for state, result in zip(states, engine.values(states), strict=True):
        q, va = state["q"], state["va"]
        if result["torques"]:
            tau = chain.compute_torques(q, va, state["aa"])
            np.testing.assert_allclose(result["torques"], tau, rtol=1e-9, atol=1e-9)
        aa = chain.compute_accelerations(q, va, state["tau"])
        if smooth is not None:
            aa = smooth.accelerations(q, va, state["tau"]).full().ravel()
        assert np.abs(np.array(result["accelerations"]) - aa).max() < 1e-8 * (1 + np.abs(aa).max())
        energies = [chain.kinetic_energy(q, va), chain.potential_energy(q)]
        np.testing.assert_allclose(result["energies"], energies, rtol=1e-9, atol=1e-12)
        assert result["condition"] == pytest.approx(chain.condition_number(q), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "speed"),
    with_slow(("four_bar", 3.0), sst=[2.0], delta=[2.0], stewart=[0.3], five_bar=[2.0]),
)
def test_a_swing_of_ten_seconds_keeps_its_energy(page, name, speed):
    """To 0.1 % of the largest kinetic energy, with springs that hold the robot about its home."""
    chain = on_springs(name)
    home = chain.home
    engine = Engine(page, chain, home)
    motion, result = engine.motion(home, speed * (-1.0) ** np.arange(chain.degrees_of_freedom), 10)
    assert result["end"] == ""
    kinetic, potential = motion["energies"].T
    assert np.ptp(motion["q"], axis=0).max() > 0.05
    assert np.ptp(kinetic + potential) < 1e-3 * kinetic.max()


def test_the_sst_moves_as_in_the_package_and_its_way_ends_in_words(page):
    """Let go from home: 0.3 s against `simulate`, tolerance of the page's steps."""
    robot = sst_pin.SST()
    engine = Engine(page, robot)
    motion, _ = engine.motion(robot.home, [0.0] * 3, 0.3)
    wanted = robot.simulate([0] * 3, robot.home, [0] * 3, motion["t"])
    assert np.abs(motion["q"] - wanted.q).max() < 1e-5
    q, said = page.evaluate(MOVE, [0.3, -0.2, 0.1])
    assert said == ""
    assert np.abs(robot.residual(q)).max() < 1e-9
    assert np.abs(np.array(q)[::3] - robot.home[::3] - (0.3, -0.2, 0.1)).max() < 1e-9
    q, said = page.evaluate(MOVE, [3.0, 3.0, 3.0])
    assert "singularity" in said or "closed" in said or "assembly" in said
    assert np.abs(robot.residual(q)).max() < 1e-9


def test_a_push_on_a_body_is_an_external_wrench_of_the_package(page):
    """A constant force at a point of the coupler, beside its mass centre."""
    chain = sst_pin.robots.four_bar()
    body, force, at = chain.joint_names.index("coupler") + 1, [0.3, -0.2, 0.0], [0.05, 0.1, 0.0]
    push = {"body": body, "at": at, "force": force, "until": 1.0}
    motion, result = Engine(page, chain).motion(chain.home, [0.0], 0.3, grip=push)
    model, data = chain.model, chain.model.createData()

    def load(t, q, va):
        pin.forwardKinematics(model, data, q)
        arm = data.oMi[body].rotation @ (at - model.inertias[body].lever)
        wrenches = np.zeros((model.njoints - 1, 6))
        wrenches[body - 1] = [*force, *np.cross(arm, force)]
        return wrenches

    wanted = chain.simulate([0], chain.home, [0], motion["t"], external_wrenches=load)
    assert result["end"] == ""
    assert np.abs(motion["q"] - wanted.q).max() < 1e-5  # the tolerance of the page's steps
    still = chain.simulate([0], chain.home, [0], motion["t"])
    assert np.abs(still.q - wanted.q).max() > 1e-2


@pytest.mark.parametrize(("limited", "side"), [("crank", -1), ("rocker", 1)])
def test_a_joint_of_the_page_ends_at_its_stop_and_stays_there(page, limited, side):
    """A coordinate or a dependent joint; the motor presses the four-bar onto the stop."""
    bar = sst_pin.robots.four_bar()
    model = bar.model.copy()
    i = bar.joint_names.index(limited)
    limits = model.upperPositionLimit if side > 0 else model.lowerPositionLimit
    limits[i] = bar.home[i] + side * 0.2
    damped = {"viscous_friction": 0.02 * np.ones(model.nv)}
    chain = sst_pin.ClosedChain(model, bar.closures, bar.motor_names, **damped)
    driven = {"way": "sliders", "efforts": [-0.3]}
    motion, result = Engine(page, chain, bar.home).motion(bar.home, [0.0], 3, **driven)
    beyond = side * (motion["q"][:, i] - limits[i])
    assert result["end"] == ""
    assert beyond.max() < 0.03  # the spring of the stop
    assert -0.005 < beyond[-1] <= 0
    assert np.abs(motion["q"][-1] - motion["q"][-30]).max() < 1e-4


def test_what_a_page_cannot_compute_is_named(monkeypatch):
    bars = robot_named("four_bar")
    model = bars.model
    for body in range(1, model.njoints):
        model.inertias[body] = pin.Inertia.Zero()
    weightless = sst_pin.ClosedChain(model, bars.closures, ["crank"])
    with pytest.raises(SSTError, match="mass"):
        weightless.show(bars.home, live=True, open_browser=False)
    with pytest.raises(ClosureError, match="assemble"):
        bars.show(np.ones(model.nq), live=True, open_browser=False)
    for name in [x for x in sys.modules if x.startswith("sst_pin.compiled.page_code")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(MissingExtraError, match=r"casadi.*\[viz\]"):
        sst_pin.robots.five_bar().show(live=True, open_browser=False)


@pytest.mark.slow
def test_the_page_says_where_the_motors_do_not_hold_the_robot(page):
    chain = elbows()
    bad, good = held_not(chain)
    engine, rest = Engine(page, chain, good), np.zeros(2)
    held, lost = engine.values([{"q": q, "va": rest, "aa": rest, "tau": rest} for q in (good, bad)])
    assert held["wrong"] == []
    assert held["torques"] == pytest.approx(chain.compute_torques(good, rest, rest), rel=1e-9)
    assert np.isnan(np.array(lost["torques"], dtype=float)).all()
    assert lost["wrong"] == ["the motors do not hold this pose"]


@pytest.mark.slow
def test_a_strut_of_the_page_stays_in_its_barrel(page):
    chain = sst_pin.robots.stewart()
    Engine(page, chain)
    q, said = page.evaluate(MOVE, [1.0, 0, 0, 0, 0, 0])
    assert said == "stroke_1 is at its limit"
    place = chain.position_names.index("stroke_1")
    least, most = chain.model.lowerPositionLimit[place], chain.model.upperPositionLimit[place]
    assert least <= q[place] <= most + 1e-9
    assert q[place] == pytest.approx(most, abs=0.05)  # a step of the page


@pytest.mark.slow
def test_the_page_names_a_motor_beyond_its_effort_limit_and_a_robot_that_rests(page):
    chain = sst_pin.robots.five_bar()
    weak = chain.model.copy()
    weak.effortLimit[:] = 0.5
    weak = sst_pin.ClosedChain(weak, chain.closures, chain.motor_names)
    words = "t => { const r = engine(sst_functions, data); return [r.wrong(String, t), r.rests()] }"
    Engine(page, weak, chain.home)
    assert page.evaluate(words, [0.4, -0.6]) == [
        [f"{chain.motor_names[1]} is beyond its effort limit of 0.5 N m"],
        True,  # its plane is level
    ]
    Engine(page, sst_pin.SST())
    assert page.evaluate(words, [9.0, 9.0, 9.0]) == [[], False]
