# SPDX-License-Identifier: BSD-2-Clause
"""The paper's method on one page, `examples/noc_in_one_page.py`, is a referee of the package."""

import runpy

import numpy as np
import pinocchio as pin
import pytest

import sst_pin
from tests.gallery import EVERY_ROBOT
from tests.support.files import ROOT

PATH = ROOT / "examples" / "noc_in_one_page.py"
PAGE = runpy.run_path(str(PATH))
ROWS = {"3d": 3, "6d": 6}
#: Loops by points and welds, redundant ones too; joints of one, two, three and six freedoms.
ROBOTS = ("sst", "delta", "hexaglide", "scissor_lift")


def drawn(name, rng):
    """A robot with random bodies, friction in all joints and tilted gravity."""
    plain = sst_pin.SST() if name == "sst" else EVERY_ROBOT[name]()
    model = plain.model.copy()
    for i in range(1, model.njoints):
        model.inertias[i] = pin.Inertia.Random()
    model.damping, model.friction = rng.uniform(0, 1, (2, model.nv))
    model.gravity.linear = rng.normal(size=3) * 6
    return sst_pin.ClosedChain(
        model, plain.closures, plain.motor_names, coordinates=plain.coordinates
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_the_method_on_one_page_gives_the_generalized_forces(name):
    pin.seed(7)
    rng = np.random.default_rng(7)
    chain = drawn(name, rng)
    closures = [(c.frame_a, c.frame_b, ROWS[c.kind]) for c in chain.closures]
    coordinates, q = chain.mechanism.coordinates, chain.generic_configuration()
    for va, aa in rng.normal(size=(3, 2, chain.degrees_of_freedom)):
        wanted = chain.generalized_forces(q, va, aa)
        forces = PAGE["torques"](chain.model, closures, coordinates, q, va, aa)
        # Differences of fourth order: rounding over the step of 1e-4 s, times condition numbers.
        assert np.abs(forces - wanted).max() < 1e-8 * np.abs(wanted).max()


def test_the_page_is_a_page():
    text = PATH.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert "sst_pin" not in text
