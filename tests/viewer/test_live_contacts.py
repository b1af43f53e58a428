# SPDX-License-Identifier: BSD-2-Clause
"""The live page of robots with contacts: they step as in the package, stand, and are pushed."""

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from sst_pin.viewer import Viewer
from tests.gallery.on_feet import RADIUS, biped
from tests.support.browser import LATER, PHONE, opened
from tests.viewer.test_live import Engine

#: States of the page's engine after steps of dt, and the forces of contacts in them.
STEPS = """([q, va, dt, count, way]) => {
  const r = engine(sst_functions, data), states = [];
  Object.assign(r, { q, va, way });
  r.start();
  for (let k = 0, left = 0; k <= count && typeof left !== "string"; k++) {
    states.push({ q: r.q, va: r.va, forces: r.contactForces, unsolved: r.unsolved });
    left = r.advance(dt);
  }
  return states;
}"""


def ball_and_rope():
    """A ball that bounces on a table, and another that falls into its rope."""
    model = pin.Model()
    contacts = []
    for name in ("ball", "lamp"):
        joint = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}_centre", joint, pin.SE3.Identity(), pin.OP_FRAME))
    place = pin.SE3(np.eye(3), np.array([0, 0, 0.2]))
    model.addFrame(pin.Frame("table", 0, place, pin.OP_FRAME))
    contacts = [
        sst_pin.Contact("ball_centre", radius=0.1, friction=0.4, restitution=0.6, ground="table"),
        sst_pin.Rope("table", "lamp_centre", 0.5),
    ]
    return sst_pin.ClosedChain(model, [], [], contacts=contacts)


def standing_biped():
    """The biped, and a configuration with level soles 10 mm above the floor: it can stand."""
    chain = biped()
    q = chain.home.copy()
    for side in "lr":
        hip, knee, pitch, roll = (
            chain.position_names.index(f"{side}_{name}")
            for name in ("hip", "knee", "ankle_pitch", "ankle_roll")
        )
        q[pitch] = -q[hip] - q[knee]
        q[roll] = 0.0
    fixed = [name for name in chain.joint_names if "rod" not in name and "motor" not in name]
    return chain, chain.assemble(q, fixed=fixed)


def soles(chain, q):
    """Lowest points of the spheres under the soles at configurations (n, nq), shape (n, 8)."""
    return np.column_stack(
        [chain.frame_placement(q, x.frame)[0][:, 2] - RADIUS for x in chain.contacts]
    )


@pytest.fixture(scope="module")
def page(chromium):
    return chromium.new_page()


def test_balls_bounce_and_hang_as_in_the_package(page):
    chain = ball_and_rope()
    engine = Engine(page, chain)
    q, va = [0, 0, 0.4, 0.3, 0, 0.3], [0.5, 0, 0, 0, 0, 0]
    states = page.evaluate(STEPS, [q, va, 1e-3, 500, "none"])
    wanted = chain.rollout(np.zeros((500, 0)), q, va, 1e-3, nonsmooth=True)
    assert engine.q.shape == (6,)
    on_page = np.array([state["q"] for state in states])
    assert on_page == pytest.approx(wanted.q, abs=1e-9)
    forces = np.array([state["forces"] for state in states[1:]])
    assert forces == pytest.approx(wanted.contact_forces, abs=1e-6)
    assert wanted.contact_forces[..., 2].max() > 100  # it hits
    assert wanted.tensions.max() > 1


@pytest.mark.slow
def test_a_biped_steps_as_in_the_package(page):
    """Held by its motors, whose gains are those of the page, and falling onto its knees."""
    chain, q = standing_biped()
    engine = Engine(page, chain, q)
    data = engine.viewer._panel["live"]
    stiffness = 20 * data["weight"] * data["size"] * np.ones(12)
    gains = {
        "motor_stiffness": stiffness,
        "motor_damping": 0.3 * np.sqrt(data["size"] / data["fall"]) * stiffness,
    }
    rest = np.zeros(chain.degrees_of_freedom)
    for way, given in (("hold", gains), ("none", {})):
        states = page.evaluate(STEPS, [q.tolist(), rest.tolist(), 5e-4, 200, way])
        wanted = chain.rollout(np.zeros((200, 12)), q, rest, 5e-4, nonsmooth=True, **given)
        on_page = np.array([state["q"] for state in states])
        assert on_page == pytest.approx(wanted.q, abs=1e-7)
        assert wanted.contact_forces[..., 2].sum(axis=1).max() > data["weight"]


@pytest.mark.slow
def test_a_biped_stands_on_the_floor_of_its_page_is_pushed_and_does_not_sink(chromium, tmp_path):
    chain, q = standing_biped()
    viewer = Viewer(chain, live=True)
    viewer.show(q)
    with opened(chromium, viewer, tmp_path / "page.html", PHONE) as page:
        page.locator("#control").select_option("hold")
        page.locator("#go").click()
        page.evaluate(LATER, 0.5)
        standing = np.array(page.evaluate("live.robot.q"))
        forces = np.array(page.evaluate("live.robot.contactForces"))
        weight = viewer._panel["live"]["weight"]
        assert forces[:, 2].sum() == pytest.approx(weight, rel=0.02)
        assert np.abs(soles(chain, standing[None])).max() < 1e-5
        # A push to the side by a tenth of its weight.
        push = [0, weight / 10, 0]
        grip = {"body": 1, "at": [0, 0, 0], "force": push, "until": 0.9}
        page.evaluate("grip => { live.robot.grip = grip; }", grip)
        page.evaluate(LATER, 0.8)
        pushed = np.array(page.evaluate("live.robot.q"))
        page.evaluate(LATER, 1.6)
        after = np.array(page.evaluate("live.robot.q"))
        assert pushed[1] - standing[1] > 1e-3
        assert np.abs(after[:3] - standing[:3]).max() < 0.5 * (pushed[1] - standing[1])
        assert soles(chain, np.stack([standing, pushed, after])).min() > -1e-5
        assert np.abs(chain.residual(after)).max() < 1e-6
        assert page.evaluate("live.running")
        page.screenshot(path=tmp_path / "stands.png")
