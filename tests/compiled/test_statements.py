# SPDX-License-Identifier: BSD-2-Clause
"""Statements of generated C, computed here by Python."""

import re

import numpy as np

from sst_pin.compiled.statements import with_results_in_memory

NUMBERS, INPUTS, OUTPUTS = 1000, 8, 20


def straight_line(seed: int) -> list[str]:
    """Statements that use results close to them and far away."""
    random = np.random.default_rng(seed)
    known = [f"x[{i}]" for i in range(INPUTS)]
    lines = []
    for k in range(NUMBERS):
        far = known[random.integers(len(known))]
        close = known[-1 - random.integers(min(30, len(known)))]
        lines.append(f"const real t{k} = 0.7 * {far} - 0.6 * {close};")
        known.append(f"t{k}")
    return lines + [f"y[{i}] = {known[random.integers(len(known))]};" for i in range(OUTPUTS)]


class Pointer:
    """A pointer into a list."""

    def __init__(self, numbers: list[float], at: int) -> None:
        self.numbers, self.at = numbers, at

    def __getitem__(self, k: int) -> float:
        return self.numbers[self.at + k]

    def __setitem__(self, k: int, number: float) -> None:
        self.numbers[self.at + k] = number


def computed(lines: list[str]) -> list[float]:
    """y for some x."""
    names = {"x": [0.1 * i - 0.4 for i in range(INPUTS)], "y": [0.0] * OUTPUTS, "Pointer": Pointer}
    code = "\n".join(line for line in lines if not line.startswith("__asm__"))
    code = re.sub(r"\breal (\w+)\[(\d+)\];", r"\1 = [None] * \2", code)
    code = re.sub(r"\breal \*(\w+) = (\w+) \+ (\d+);", r"\1 = Pointer(\2, \3)", code)
    exec(code.replace("const real ", ""), names)
    return names["y"]


def test_results_that_wait_in_an_array_are_the_same():
    """To the last bit; places that are free are taken again."""
    lines = straight_line(0)
    kept = with_results_in_memory(lines)
    stored = sum(bool(re.match(r"w\d+\[", line)) for line in kept)
    places = int(re.fullmatch(r"real room\[(\d+)\];", kept[0])[1])
    assert 0 < places < stored < NUMBERS
    assert computed(kept) == computed(lines)


def test_results_that_are_used_soon_stay_where_they_are():
    lines = [f"const real t{k} = x[{k % INPUTS}] + t{max(k - 50, 0)};" for k in range(NUMBERS)]
    lines[0] = "const real t0 = x[0];"
    assert with_results_in_memory(lines[50:]) == lines[50:]
    assert with_results_in_memory(straight_line(0)[:300]) == straight_line(0)[:300]
