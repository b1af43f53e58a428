# SPDX-License-Identifier: BSD-2-Clause
"""What takes long shows a bar, or says what it does; what is quick is silent."""

import logging
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import sst_pin
from sst_pin import progress
from sst_pin.simulation import rollouts
from sst_pin.verification.verify import verify_chain


@pytest.fixture
def impatient(monkeypatch):
    """All takes longer than no time, on a terminal."""
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "_watched", lambda: True)
    progress.say_once.cache_clear()


def _simulated(chain):
    rest = np.zeros(chain.degrees_of_freedom)
    chain.simulate(lambda *_: 0 * rest, chain.home, rest, np.linspace(0, 0.05, 6))


def _circle(chain):
    t = np.linspace(0, 1, 5)
    home, _ = chain.frame_placement(chain.home, "platform")
    sst_pin.frame_motion(chain, t, "platform", home + 0.01 * np.outer(np.sin(t), [1, 0, 0]))


WAITS = {
    "simulating": _simulated,
    "samples": lambda c: c.compute_torques(np.tile(c.home, (5, 1)), [0, 0], [0, 0]),
    "frame_motion": _circle,
    "coordinates of a motion": lambda c: sst_pin.coordinate_motion(
        c, [0, 1, 2, 3], c.home[[0, 2]] + 0.01 * np.arange(4)[:, None], c.home
    ),
    "reach_map": lambda c: sst_pin.reach_map(c, "platform", 2.0, x=[-0.01, 0.01], y=[0.13, 0.14]),
    "rollout": lambda c: c.rollout(np.zeros((3, 4, 2)), c.home, [0, 0], 1e-3),
    "verifying": lambda c: list(verify_chain(c, 2, [])),
}


@pytest.mark.parametrize("what", WAITS)
def test_what_takes_long_shows_a_bar(what, impatient, capsys):
    chain = sst_pin.robots.five_bar()
    WAITS[what](chain)
    assert what in capsys.readouterr().err


def test_what_is_quick_is_silent(capsys, caplog):
    chain = sst_pin.robots.five_bar()
    _simulated(chain)
    _circle(chain)
    assert capsys.readouterr().err == ""
    assert not caplog.records


def test_a_log_has_no_bars(monkeypatch, impatient, capsys):
    monkeypatch.setattr(progress, "_watched", sys.stderr.isatty)  # pytest keeps what is written
    _simulated(sst_pin.robots.five_bar())
    assert "%" not in capsys.readouterr().err


def test_the_time_left_follows_from_the_time_since_the_beginning(monkeypatch, impatient, capsys):
    """After 10 s for 100 of 200 samples 10 s are left, though the bar has just appeared."""
    began = time.time() - 10
    monkeypatch.setattr(progress, "time", lambda: began)
    bar = progress.Bar(desc="samples", total=200)
    bar.reach(100)
    bar._bar.refresh()
    assert "00:10<00:10" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["simulating", "samples"])
def test_the_slow_path_says_once_that_kernels_are_faster(what, impatient, caplog):
    chain = sst_pin.robots.five_bar()
    for _ in range(2):
        WAITS[what](chain)
    (record,) = (r for r in caplog.records if "chain.compile()" in r.getMessage())
    assert "reference path" in record.getMessage()


def at_once(_, function, arguments):
    """A timer that has run out when it starts."""
    return SimpleNamespace(start=lambda: function(*arguments), cancel=lambda: None)


def test_a_large_rollout_says_what_it_does(impatient, monkeypatch, caplog):
    """By kernels nothing is heard of it meanwhile; a thread says it."""
    monkeypatch.setattr(rollouts, "_MANY", 1)
    monkeypatch.setattr(progress.threading, "Timer", at_once)
    with caplog.at_level(logging.WARNING, "sst_pin"):
        chain = sst_pin.robots.five_bar()
        chain.rollout(np.zeros((3, 4, 2)), chain.home, [0, 0], 1e-3)
    records = [record.getMessage() for record in caplog.records]
    assert "sst-pin: rollout of 3 motions" in records
    assert any("model five_bar: checking its closures" in text for text in records)


def test_no_bar_is_shown_to_a_process_without_standard_error(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(sys, "stderr", None)
    assert list(progress.counted([1, 2, 3], "samples")) == [1, 2, 3]
