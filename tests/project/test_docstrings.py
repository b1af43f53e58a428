# SPDX-License-Identifier: BSD-2-Clause
"""Every public function shows an example, and the examples print what they show."""

import doctest
import inspect
import re

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.figure import Figure

import sst_pin
from sst_pin import plots
from sst_pin.viewer import Viewer
from tests.support.shown_output import Checker, same_output

#: What each example may use; the pages of the reference say so.
GIVEN = {"np": np, "pin": pin, "sst_pin": sst_pin}
#: Robots that an example may use.
MADE = {"robot": sst_pin.SST, "chain": sst_pin.robots.four_bar}
CLASSES = ("ClosedChain", "SST", "Trajectory")


def public():
    """Each public function, method and class, by its name."""
    for name in sst_pin.__all__:
        if callable(getattr(sst_pin, name)):
            yield name, getattr(sst_pin, name)
    for name in sst_pin.robots.__all__:
        if inspect.isfunction(getattr(sst_pin.robots, name)):
            yield f"robots.{name}", getattr(sst_pin.robots, name)
    for name in sst_pin.identification.__all__:
        yield f"identification.{name}", getattr(sst_pin.identification, name)
    owners = [*(getattr(sst_pin, name) for name in CLASSES), sst_pin.robots.GalleryRobot]
    for owner in owners:
        for name, member in vars(owner).items():
            if not name.startswith("_") and (callable(member) or hasattr(member, "__get__")):
                yield f"{owner.__name__}.{name}", member


def pictures():
    """Each public function and class that draws; their extras are those of the tests."""
    for name in plots.__all__:
        if callable(getattr(plots, name)):
            yield f"plots.{name}", getattr(plots, name)
    yield "Viewer", Viewer
    for name, member in vars(Viewer).items():
        if not name.startswith("_"):
            yield f"Viewer.{name}", member


PICTURES = dict(pictures())
THINGS = dict(public()) | PICTURES


def words(thing):
    """The docstring of a thing; None for a plain attribute."""
    if not (callable(thing) or isinstance(thing, property | classmethod | staticmethod)):
        return None
    return inspect.getdoc(thing) or ""


def test_every_public_function_shows_an_example():
    missing = [
        name
        for name, thing in THINGS.items()
        if words(thing) is not None and not re.search(r"^Example:$", words(thing), re.MULTILINE)
    ]
    assert not missing, f"their docstrings want a section `Example:`: {', '.join(missing)}"


def drawn(name, chain):
    """What an example of a picture may use besides; the pages of the reference say so."""
    given = {"motion": chain.simulate([0], chain.home, [0], np.linspace(0, 0.1, 11))}
    if name.startswith("plots."):
        return given | {"plots": plots, "Figure": Figure, "ax": Figure().add_subplot()}
    return given | {"Viewer": Viewer, "viewer": Viewer(chain)}


# Most of them take milliseconds; a compiler, other engines and fits take seconds.
LONG = {
    *(f"ClosedChain.{name}" for name in ("compile", "from_mjcf", "show", "rollout")),
    *("SST.from_mjcf", "energy_error", "SimulationError", "SingularityWarning", "time_optimal"),
    "Trajectory.to_dataframe",
    *(name for name in THINGS if name.startswith("identification.")),
}


@pytest.mark.filterwarnings("default::sst_pin.errors.SingularityWarning")
@pytest.mark.parametrize(
    "names",
    [
        pytest.param(sorted(set(THINGS) - LONG - set(PICTURES)), id="quick"),
        pytest.param(sorted(PICTURES), id="pictures", marks=pytest.mark.slow),
        pytest.param(sorted(LONG), id="long", marks=pytest.mark.slow),
    ],
)
def test_examples_print_what_they_show(names, tmp_path, monkeypatch):
    """In an empty folder; numbers may differ by one in the last place shown."""
    monkeypatch.chdir(tmp_path)
    parser, told = doctest.DocTestParser(), []
    runner = doctest.DocTestRunner(Checker(), optionflags=doctest.ELLIPSIS)
    for name in names:
        text = words(THINGS[name]) or ""
        drawing = name in PICTURES
        given = GIVEN | {n: made() for n, made in MADE.items() if drawing or f"{n}." in text}
        if drawing:
            given |= drawn(name, given["chain"])
        test = parser.get_doctest(text, given, name, name, 0)
        runner.run(test, out=told.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(told)


@pytest.mark.parametrize(
    ("wanted", "got", "same"),
    [
        ("array([1.234])", "array([1.235])", True),
        ("array([1.234])", "array([1.236])", False),
        ("array([-0. , 1.])", "array([0., 1.])", True),
        ("3 joints", "4 joints", False),
        ("(3, 4) m", "(3, 4) rad", False),
        ("open by ... m", "open by 0.02 m", True),
    ],
)
def test_numbers_may_differ_in_the_last_place_shown(wanted, got, same):
    assert same_output(wanted, got) == same
