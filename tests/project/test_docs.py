# SPDX-License-Identifier: BSD-2-Clause
"""The page about the paper is current, and its check sees it when it is not."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import sst_pin
from tests.support.files import ROOT, load

markdown_tables = load("scripts/pages/markdown_tables.py")
read_table = markdown_tables.read_table
stale = markdown_tables.stale
script = load("scripts/pages/make_paper_docs.py")


@pytest.fixture(scope="module")
def page():
    return script.PAGE.read_text(encoding="utf-8")


def missing_names(page):
    """Functions and tests that a page links and that are not in their files."""
    for name, target in re.findall(r"\[`?([\w.]+)`?\]\(\.\./([\w/]+)\.py\)", page):
        module, *parts = name.split(".")
        if target.startswith("tests") and module != Path(target).name:
            text = (ROOT / f"{target}.py").read_text(encoding="utf-8")
            there = re.search(rf"^def {name}\(", text, re.MULTILINE)
        elif target.startswith("sst_pin") and parts:
            thing = import_module(target.replace("/", "."))
            for part in parts:
                thing = getattr(thing, part, None)
            there = thing is not None and module == Path(target).name
        else:
            there = True
        if not there:
            yield name


def test_functions_and_tests_that_the_page_names_exist(page):
    assert list(missing_names(page)) == []
    for old in ("test_momenta_change_by_the_wrenches", "noc.body_jacobians"):
        assert set(missing_names(page.replace(old, old[:-1]))) == {old[:-1]}


def test_page_about_the_paper_has_the_table_of_referees(page):
    assert list(stale(page, {}, script.SLOW)) == []


def test_page_covers_every_equation(page):
    """(1) to (96), none left out."""
    covered = set()
    for numbers, *_ in read_table(page, "equations")[1:]:
        for part in numbers.replace("(", "").replace(")", "").split(", "):
            ends = [end.rstrip("b") for end in part.split("-")]
            if all(end.isdigit() for end in ends):
                covered |= set(range(int(ends[0]), int(ends[-1]) + 1))
    assert covered == set(range(1, 97))


def test_reading_about_the_centre_is_the_printed_inertia():
    """Same inertia about O, same mass times distance; as printed it would be no body."""
    star = script.readings()["star: inertia about O"].star
    x = star.center_of_mass
    about_O = star.inertia + star.mass * (x @ x * np.eye(3) - np.outer(x, x))
    # Six printed digits and sixteen of arithmetic.
    assert np.abs(about_O - np.diag((0.224, 0.224, 0.150))).max() < 1e-15
    assert star.mass * x[0] == pytest.approx(2.6 * 0.8 / np.pi, rel=1e-15)
    shift = 2.6 * (0.8 / np.pi) ** 2
    about_centre = np.diag((0.224, 0.224 - shift, 0.150 - shift))
    impossible = sst_pin.sst.RigidBody(2.6, (0.8 / np.pi, 0, 0), about_centre)
    with pytest.raises(sst_pin.errors.ParametersError, match="not all positive"):
        sst_pin.Parameters(star=impossible)


def test_three_thin_arcs_have_the_inertia_that_the_page_tells(page):
    """About s and across it, about the mass centre; by the midpoint rule."""
    records = re.search(r"have ([\d.]+) kg m\^2 about s and ([\d.]+) normal to it", page)
    about, across = map(float, records.groups())
    angles = (np.arange(1000) + 0.5) / 1000 * np.pi / 2
    points = [
        0.4 * np.stack([np.cos(angles), np.sin(angles) * np.cos(k), np.sin(angles) * np.sin(k)])
        for k in 2 * np.pi / 3 * np.arange(3)
    ]
    x = np.concatenate(points, axis=1)
    x = x - x.mean(axis=1, keepdims=True)
    second = 2.6 * x @ x.T / x.shape[1]
    inertia = np.trace(second) * np.eye(3) - second
    assert np.abs(inertia - np.diag((about, across, across))).max() < 5e-4  # its last digit
