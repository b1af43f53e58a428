# SPDX-License-Identifier: BSD-2-Clause
"""Statements in which cheap results are computed again: the same results, fewer kept."""

import re

import numpy as np
import pytest

from sst_pin.compiled import recomputation
from sst_pin.compiled.recomputation import with_cheap_results_again

NAME = re.compile(r"\bti?\d\w*")


def random_statements(count, outputs, seed):
    """Sums and products of inputs and of earlier results, quotients too; outputs at the end."""
    random = np.random.default_rng(seed)
    lines = []
    for k in range(count):
        names = [f"x[{i}]" for i in range(4)] + [f"t{i}" for i in range(k)]
        a, b = random.choice(names[-40:] if random.random() < 0.5 else names, 2)
        operator = random.choice(list("++--***/"))
        if operator == "/":
            lines.append(f"const real t{k} = 1 / {a};")
        else:
            lines.append(f"const real t{k} = {a} {operator} {b};")
    last = random.choice(count, outputs, replace=False)
    return [*lines, *(f"y[{i}] = REAL(t{k});" for i, k in enumerate(last))]


def results_of(lines, x, outputs):
    """What the statements compute, each result rounded as in C."""
    names = {"x": x, "y": np.zeros(outputs), "REAL": lambda a: a, "again": lambda a: a}
    with np.errstate(all="ignore"):
        exec("\n".join(lines).replace("const real ", ""), names)
    return names["y"]


def most_alive(lines):
    """The largest number of results that are computed and still to be used."""
    last = {name: i for i, line in enumerate(lines) for name in NAME.findall(line)}
    alive, most = set(), 0
    for i, line in enumerate(lines):
        alive = {name for name in alive | set(NAME.findall(line)) if last[name] > i}
        most = max(most, len(alive))
    return most


@pytest.mark.parametrize("seed", range(5))
def test_results_are_the_same_to_the_last_bit(seed, monkeypatch):
    monkeypatch.setattr(recomputation, "_NEAR", 20)
    lines = random_statements(400, 30, seed)
    x = np.random.default_rng(seed).uniform(1, 2, 4)
    again = with_cheap_results_again(lines)
    assert len(again) > len(lines)
    np.testing.assert_array_equal(results_of(again, x, 30), results_of(lines, x, 30))


def test_what_is_used_far_away_is_computed_again_from_the_inputs():
    between = [f"y[{k}] = REAL(x[{k}]);" for k in range(300)]
    lines = [
        "const real t0 = x[0] * x[1];",
        "const real ti0 = 1 / t0;",
        "const real t1 = SQUARE_ROOT(t0);",
        "y[300] = REAL(ti0);",
        *between,
        "const real t2 = t1 * ti0;",
        "y[301] = REAL(t2);",
    ]
    assert with_cheap_results_again(lines)[-4:] == [
        "const real t3 = again(x[0]) * x[1];",
        "const real t4 = 1 / again(t3);",
        "const real t2 = t1 * t4;",  # a root is not cheap
        "y[301] = REAL(t2);",
    ]


def test_products_of_inputs_are_not_kept():
    """Products that are added in the opposite order: all are alive after the last one."""
    products = [f"const real t{k} = x[{k}] * x[{k + 1}];" for k in range(1000)]
    sums = [f"const real t{1000 + k} = t{999 + k} + t{999 - k};" for k in range(1, 1000)]
    sums = ["const real t1000 = x[0] + t999;", *sums, "y[0] = REAL(t1999);"]
    lines = [*products, *sums]
    assert most_alive(lines) >= 1000
    assert most_alive(with_cheap_results_again(lines)) < 250
