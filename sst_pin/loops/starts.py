# SPDX-License-Identifier: BSD-2-Clause
"""Where a robot stands first, and where it stands when some joints are put elsewhere."""

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, finite_array
from ..errors import ClosureError, DescriptionError, DescriptionWarning
from ..model.mechanism import Mechanism
from ..model.named_positions import angles_and_lengths, put, taken
from ..summaries import listed
from .assembly import home_of

#: A joint this far from where it was given stands elsewhere, [rad] or of the robot's length.
_FAR = 0.05


class _Reference(Protocol):
    def moved(self, q: Array, step: Array) -> Array: ...


class _Engine(Protocol):
    @property
    def reference(self) -> _Reference: ...

    def are_closed(self, q: Array) -> Flags: ...


class _Chain(Protocol):
    """What is asked of a `ClosedChain` here."""

    @property
    def mechanism(self) -> Mechanism: ...

    @property
    def home(self) -> Array: ...

    def residual(self, q: ArrayLike) -> Array: ...

    def assemble(self, q: ArrayLike, fixed: Sequence[str] | None = None) -> Array: ...

    def generic_configuration(self) -> Array: ...

    def _closer(self, q: Array, held: Iterable[str]) -> Array: ...

    @property
    def engine(self) -> _Engine: ...


def pose_of(chain: _Chain) -> Array:
    """Home, open if its loops cannot be closed; `pin.neutral` without one, shape (nq,)."""
    try:
        return chain.home
    except (ClosureError, DescriptionError):
        home = home_of(chain.mechanism)
        return pin.neutral(chain.mechanism.model) if home is None else home


def start_of(chain: _Chain, *, chosen: bool = False) -> Array:
    """The configuration where a chain stands first, shape (nq,): home, else as it is drawn.

    Otherwise its loops are closed near zero, or else it is a generic configuration. A home that
    cannot be closed is open here, and so is a chain of which no configuration is found.

    Warns:
        DescriptionWarning: If neither the description nor, by `chosen`, the caller chooses the
            assembly mode.
    """
    q, model = pose_of(chain), chain.mechanism.model
    if chain.engine.are_closed(q) or "home" in model.referenceConfigurations:
        return q
    try:
        q = chain.assemble(q, fixed=())
    except ClosureError:
        try:
            q = chain.generic_configuration()
        except ClosureError:
            return q
    if not chosen:
        _warn(
            chain,
            "no configuration is named home",
            "name a configuration home (an SRDF beside the URDF, a keyframe of an MJCF, or "
            'model.referenceConfigurations["home"]), or give positions of dependent joints too',
        )
    return q


def placed(chain: _Chain, positions: Mapping[str, float], guess: ArrayLike | None = None) -> Array:
    """A configuration with closed loops where some joints stand as given.

    `positions`, [rad] or [m], are by the names of joints that turn or slide; `guess` has the other
    joints, by default those of `start_of`. If coordinates alone are given, they are moved there in
    the assembly mode of the start. Otherwise they are held, and the dependent joints that are
    given, perhaps rounded or measured, choose the assembly.

    Warns:
        DescriptionWarning: If neither the description nor the caller chooses the assembly mode, if
            the coordinates cannot be moved there without leaving it, or if a dependent joint stands
            elsewhere than given.
    """
    mechanism, space = chain.mechanism, chain.mechanism.space
    if guess is None:
        start = start_of(chain, chosen=angles_and_lengths(space).keys() <= positions.keys())
    else:
        start = finite_array("start", guess, (mechanism.model.nq,))
    follows = set(positions) <= set(mechanism.coordinate_rate_names) and bool(
        chain.engine.are_closed(start)
    )
    if follows:
        try:
            return chain.assemble(put(space, _moved(chain, start, positions), positions))
        except ClosureError as error:
            why = f"{', '.join(positions)} cannot be moved from the start to their positions"
            why += f" ({error})"
    try:
        q = _assembled(chain, start, positions)
        far = _far(chain, q, positions)
    except ClosureError:
        if guess is not None:
            raise
        q = _assembled(chain, chain.generic_configuration(), positions)
        far = _far(chain, q, positions)
    if far and guess is None:
        with suppress(ClosureError):
            other = _assembled(chain, chain.generic_configuration(), positions)
            if not _far(chain, other, positions):
                return other
    if follows:
        _warn(
            chain,
            why,
            "give a configuration near them as start, or positions of dependent joints too",
        )
    elif far:
        _warn(
            chain,
            f"no assembly was found with {listed(far)} and the coordinates as given",
            "correct these positions, or give those of other dependent joints",
        )
    return q


def _assembled(chain: _Chain, start: Array, positions: Mapping[str, float]) -> Array:
    """The assembly nearest to the start in which joints stand at positions, or near these."""
    return chain.assemble(chain._closer(put(chain.mechanism.space, start, positions), positions))


def _far(chain: _Chain, q: Array, positions: Mapping[str, float]) -> list[str]:
    """Which joints stand far from their positions, and where, in words."""
    space, found = chain.mechanism.space, list[str]()
    units = angles_and_lengths(space)
    stands = taken(space, q, list(positions))
    for (name, given), x in zip(positions.items(), stands, strict=True):
        turns = units[name] == "rad"
        off = math.remainder(x - given, 2 * math.pi) if turns else x - given
        if not abs(off) <= _FAR * (1.0 if turns else chain.mechanism.length):
            found.append(f"{name} at {given:.4g} (it stands at {x:.4g})")
    return found


def _moved(chain: _Chain, start: Array, positions: Mapping[str, float]) -> Array:
    """The configuration, in the assembly mode of the start, where coordinates are at positions."""
    mechanism, names = chain.mechanism, list(positions)
    step = np.zeros(len(mechanism.coordinates))
    ways = np.array([positions[name] for name in names]) - taken(mechanism.space, start, names)
    for name, way in zip(names, ways, strict=True):
        endless = name not in mechanism.space.position_names
        turns = np.round(way / (2 * np.pi)) if endless else 0.0
        step[mechanism.coordinate_rate_names.index(name)] = way - 2 * np.pi * turns
    return chain.engine.reference.moved(start, step)


def _warn(chain: _Chain, why: str, cure: str) -> None:
    warnings.warn(
        f"model {chain.mechanism.model.name}: {why}, so the loops were closed in an assembly mode "
        f"chosen here; other modes need other torques. Check the start; to choose it, {cure}",
        DescriptionWarning,
        stacklevel=4,
    )
