# SPDX-License-Identifier: BSD-2-Clause
import numpy as np
import pytest

from sst_pin.dynamics.impulses import DRY, NORMAL, SIDE, STOP, Rows, impulses


def _random_rows(rng, contacts, stops, dry, n):
    kinds = np.array([SIDE, SIDE, NORMAL] * contacts + [STOP] * stops + [DRY] * dry)
    J, bias, bounds = rng.normal(size=(len(kinds), n)), np.zeros(len(kinds)), np.zeros(len(kinds))
    bias[2 : 3 * contacts : 3] = rng.uniform(0, 0.3, contacts)
    bounds[2 : 3 * contacts : 3] = rng.uniform(0, 1.2, contacts)
    bounds[len(kinds) - dry :] = rng.uniform(0, 1, dry)
    return Rows(J, bias, np.zeros(len(kinds)), kinds, bounds)


def test_impulses_obey_signorini_and_coulomb_also_where_contacts_are_redundant():
    """200 random problems with up to eight contacts on 2 to 13 coordinates, law by law."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        n, counts = int(rng.integers(2, 14)), rng.integers([1, 0, 0], [9, 4, 4])
        rows, root = _random_rows(rng, *counts, n), rng.normal(size=(n, n))
        inertia, free = root @ root.T + 0.1 * np.eye(n), rng.normal(size=n)
        rates, x, residual = impulses(inertia, free, rows, np.zeros(len(rows.kinds)))
        assert residual < 1e-9
        assert np.abs(inertia @ (rates - free) - rows.J.T @ x).max() <= 1e-9 * np.abs(x).max()
        w, fastest = rows.J @ rates + rows.bias, np.abs(free).max()
        size = np.abs(x).max()
        one_sided = (rows.kinds == STOP) | (rows.kinds == NORMAL)
        assert x[one_sided].min() >= 0
        assert w[one_sided].min() > -1e-7 * fastest
        assert np.abs((x * w)[one_sided]).max() <= 1e-7 * size * fastest
        for k in np.flatnonzero(rows.kinds == NORMAL):
            side, slip, largest = x[k - 2 : k], w[k - 2 : k], rows.bounds[k] * x[k]
            assert np.linalg.norm(side) <= largest + 1e-9 * size
            # Largest dissipation: the power is that of the largest friction against the slip.
            power = side @ slip + largest * np.linalg.norm(slip)
            assert abs(power) <= 1e-7 * size * fastest
        dry = rows.kinds == DRY
        assert (np.abs(x[dry]) <= rows.bounds[dry] * (1 + 1e-15)).all()
        power = x[dry] * w[dry] + rows.bounds[dry] * np.abs(w[dry])
        assert np.abs(power).max(initial=0) <= 1e-7 * size * fastest


def test_impulses_without_restitution_and_gaps_only_take_energy():
    rng = np.random.default_rng(1)
    for _ in range(50):
        rows, root, free = (
            _random_rows(rng, 3, 1, 2, 6),
            rng.normal(size=(6, 6)),
            rng.normal(size=6),
        )
        rows.bias[:] = 0
        inertia = root @ root.T + 0.1 * np.eye(6)
        rates, _, residual = impulses(inertia, free, rows, np.zeros(len(rows.kinds)))
        assert residual < 1e-9
        assert rates @ inertia @ rates <= free @ inertia @ free * (1 + 1e-12)


def test_impulses_do_not_depend_on_units_or_on_the_start():
    """Grams and millimetres instead of kilograms and metres; a start that is far away."""
    rng = np.random.default_rng(2)
    rows, root, free = _random_rows(rng, 2, 1, 1, 8), rng.normal(size=(8, 8)), rng.normal(size=8)
    inertia = root @ root.T + 0.1 * np.eye(8)
    rates, x, _ = impulses(inertia, free, rows, np.zeros(len(rows.kinds)))
    bounds = np.where(rows.kinds == DRY, 1e3 * rows.bounds, rows.bounds)
    scaled = rows._replace(J=1e3 * rows.J, bias=1e3 * rows.bias, bounds=bounds)
    start = 100 * rng.normal(size=len(rows.kinds))
    others, impulses_of_them, _ = impulses(1e6 * inertia, free, scaled, start)
    assert others == pytest.approx(rates, rel=1e-8, abs=1e-9)
    assert impulses_of_them / 1e3 == pytest.approx(x, rel=1e-7, abs=1e-9)


def test_rows_that_contradict_each_other_have_a_large_residual():
    J = np.array([[1.0], [-1.0]])
    rows = Rows(J, np.full(2, -1.0), np.zeros(2), np.array([STOP, STOP]), np.zeros(2))
    assert impulses(np.eye(1), np.zeros(1), rows, np.zeros(2)).residual > 1e-6


def test_free_rates_that_are_not_finite_have_an_infinite_residual():
    rows = Rows(np.eye(1), np.zeros(1), np.zeros(1), np.array([STOP]), np.zeros(1))
    assert impulses(np.eye(1), np.array([np.nan]), rows, np.zeros(1)).residual == np.inf
