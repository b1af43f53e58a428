# SPDX-License-Identifier: BSD-2-Clause
"""Robots and their terms print as a few lines; what is computed cannot be assigned."""

import numpy as np
import pytest

import sst_pin
from tests.gallery import ladder

ROBOTS = {
    "SST": sst_pin.SST,
    "four-bar": sst_pin.robots.four_bar,
    "ladder": lambda: ladder(12),
}


@pytest.fixture(scope="module", params=ROBOTS, name="chain")
def made(request):
    return ROBOTS[request.param]()


def things(chain):
    va = np.ones(chain.degrees_of_freedom)
    yield chain
    yield chain.mobility(chain.home)
    yield chain.noc(chain.home, va)
    yield chain.reduced_terms(chain.home, va)


def test_what_is_printed_has_one_to_ten_lines(chain):
    for thing in things(chain):
        lines = repr(thing).splitlines()
        assert 1 <= len(lines) <= 10
        assert max(map(len, lines)) < 250
        table = thing._repr_html_()
        assert all(line.split()[0] in table for line in lines)


def test_a_robot_says_its_class_its_sizes_and_what_computes():
    text = repr(sst_pin.SST())
    assert text.startswith("SST ")
    for part in ("gamma_1, mu_1", "nq = 9, nv = 9", "closedloop1_A - closedloop1_B"):
        assert part in text
    assert "the reference path: no kernels yet" in text


@pytest.mark.parametrize("name", ["motor_indices", "coordinates", "friction", "home", "model"])
def test_what_is_computed_from_the_model_cannot_be_assigned(name):
    with pytest.raises(AttributeError):
        setattr(sst_pin.robots.four_bar(), name, None)
