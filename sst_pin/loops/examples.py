# SPDX-License-Identifier: BSD-2-Clause
"""Closed configurations without symmetry, from which ranks are judged."""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from ..arrays import Array
from ..errors import ClosureError
from .assembly import Assembly
from .guesses import home_of, random_step

#: Widths of the random steps from home, [rad] or lengths of the loop.
AROUND_HOME = (0.1, 0.03, 0.01)
#: Widths of the random steps from `pin.neutral`, [rad] or lengths of the loop.
_AROUND_NEUTRAL = np.linspace(0.1, 2.0, 20).tolist()
#: The cure if no guess can be assembled.
_GIVE_ONE = 'give q, a closed configuration, or make it model.referenceConfigurations["home"]'


def examples(assembly: Assembly) -> Iterator[Array]:
    """Assembled configurations without symmetry, the same at each call.

    They are near `home`, or near `pin.neutral` if there is no home or the loops do not close near
    it. If no guess can be assembled, the error is that of the guess with the smallest gap.
    """
    mechanism = assembly.mechanism
    home = home_of(mechanism)
    starts: list[tuple[Array, Sequence[float]]] = []
    if home is not None:
        starts.append((home, AROUND_HOME))
    starts.append((pin.neutral(mechanism.model), _AROUND_NEUTRAL))
    failures = list[ClosureError]()
    for start, widths in starts:
        any_example = False
        for q in _assembled(assembly, start, widths, failures):
            any_example = True
            yield q
        if any_example:
            return
    nearest = min(failures, key=lambda error: error.residual)
    # The message of an assembly ends with its cures, after a semicolon. They do not help here.
    problem, _, _ = nearest.args[0].partition(";")
    raise ClosureError(f"{problem}; {_GIVE_ONE}", nearest.residual)


def _assembled(
    assembly: Assembly, start: Array, widths: Sequence[float], failures: list[ClosureError]
) -> Iterator[Array]:
    """Configurations assembled near a start, one for each width; adds errors to `failures`."""
    mechanism = assembly.mechanism
    for width in widths:
        guess = pin.integrate(mechanism.model, start, random_step(mechanism, width))
        try:
            # The motors stay at the guess if the loops close so.
            q = assembly.near(guess, mechanism.driven)
        except ClosureError as error:
            failures.append(error)
            continue
        yield q
