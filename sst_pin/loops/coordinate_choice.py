# SPDX-License-Identifier: BSD-2-Clause
"""Chooses independent rates that describe all motions, by Gram-Schmidt's method."""

from collections.abc import Iterable, Sequence

import numpy as np

from ..arrays import Array, Indices
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT, RESTS
from .ranks import free_motions

#: Rates are equally good if their independent parts differ by less than this fraction. Those of
#: equal legs differ by the rounding of placements and of the configuration only, so that their
#: names must decide.
_EQUAL = 1e-6


def choose_coordinates(
    mechanism: Mechanism,
    Phi: Array,
    wanted: Sequence[Indices] = (),
    motions: Array | None = None,
) -> Indices:
    """Indices of independent rates that describe all motions, those wanted first.

    In this order, rates are chosen if they are independent of those chosen before:

    1. the groups `wanted`, each as a whole;
    2. rates of motors;
    3. joints outside the loops, each as a whole, such as the base of a floating robot;
    4. the rate with the largest part that is independent of those chosen, again and again. Names
       decide between equal ones.

    Args:
        mechanism: The mechanism.
        Phi: The result of `scaled_Phi`.
        wanted: Groups of indices in v.
        motions: Orthonormal motions, free of units, shape (nv, n); by default all that Phi allows.
    """
    space = mechanism.space
    choice = _Choice(free_motions(Phi) if motions is None else motions)
    for rates in wanted:
        choice.add(rates)
    for rate in mechanism.driven:
        choice.add([rate])
    for name in sorted(space.rates):
        rates_of_joint = list(space.rates[name])
        if not Phi[:, rates_of_joint].any():
            choice.add(rates_of_joint)
    while not choice.complete:
        best = min(choice.equally_best, key=lambda rate: space.rate_names[rate])
        if not choice.add([best]):
            break  # no rate is independent enough: there are fewer rates than motions
    return np.array(choice.rates, dtype=np.intp)


class _Choice:
    """Independent rates, chosen one group after the other by Gram-Schmidt's method.

    Args:
        motions: Orthonormal motions, free of units, shape (nv, n).

    Attributes:
        rates: The rates chosen so far.
    """

    def __init__(self, motions: Array) -> None:
        self.rates = list[int]()
        #: As v = motions @ x, row k of the motions is the gradient of rate k by x. Rates are
        #: independent if their gradients are. The parts along the gradients of the rates that are
        #: chosen have been subtracted, shape (nv, n).
        self._gradients = motions
        #: Lengths of the whole gradients, shape (nv,).
        self._sizes = np.linalg.norm(motions, axis=1)

    @property
    def complete(self) -> bool:
        """Whether the rates describe all motions."""
        return len(self.rates) == self._gradients.shape[1]

    @property
    def equally_best(self) -> list[int]:
        """The rates with the largest independent parts; several if these are equal."""
        sizes = np.linalg.norm(self._gradients, axis=1)
        best: list[int] = np.flatnonzero(sizes > (1 - _EQUAL) * sizes.max()).tolist()
        return best

    def add(self, group: Iterable[int]) -> bool:
        """Choose a group of rates, if they are independent of each other and of those chosen."""
        rates = [int(rate) for rate in group]
        if len(self.rates) + len(rates) > self._gradients.shape[1]:
            return False
        gradients = self._gradients
        for rate in rates:
            size = float(np.linalg.norm(gradients[rate]))
            if self._sizes[rate] < RESTS or size < INDEPENDENT * self._sizes[rate]:
                return False  # the rate is always zero, or follows from those already chosen
            direction = gradients[rate] / size
            gradients = gradients - np.outer(gradients @ direction, direction)
        self._gradients = gradients
        self.rates.extend(rates)
        return True
