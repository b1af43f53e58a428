# SPDX-License-Identifier: BSD-2-Clause
"""Configurations that an assembly starts from: home, and random steps from a configuration."""

from functools import lru_cache
from zlib import crc32

import numpy as np

from ..arrays import Array
from ..errors import DescriptionError, InputError
from ..model.mechanism import Mechanism


def home_of(mechanism: Mechanism) -> Array | None:
    """The configuration named home, shape (nq,), even if its loops are open; or None."""
    model = mechanism.model
    known = model.referenceConfigurations
    if "home" not in known:
        return None
    home = np.array(known["home"])
    problem = f"home: {home.size} numbers; {model.nq} finite ones are needed"
    if home.shape == (model.nq,) and np.isfinite(home).all():
        try:
            return mechanism.space.normalised(home)
        except InputError as error:
            problem = f"home: {error.args[0].removeprefix('q: ')}"
    raise DescriptionError(f"model {model.name}", [problem])


def random_step(mechanism: Mechanism, width: float) -> Array:
    """A random step of all joints, at most 1.5 `width` for each rate, shape (nv,), [rad] or [m].

    The step of a joint depends on the width and on the joint's name only, so the result does not
    depend on the order of the joints. Widths that differ by 0.001 or more give other directions.
    `width` is in [rad], or in lengths of the loop.
    """
    step = np.zeros(mechanism.model.nv)
    for name, rates in mechanism.space.rates.items():
        step[rates] = width * np.array(_random(round(1000 * width), name, len(rates)))
    return step * mechanism.rate_scale


@lru_cache(maxsize=10_000)
def _random(seed: int, name: str, count: int) -> tuple[float, ...]:
    """Random numbers between -1.5 and 1.5, always the same for a seed and a name."""
    random = np.random.default_rng([seed, crc32(name.encode())])
    return tuple(random.uniform(-1.5, 1.5, count))
