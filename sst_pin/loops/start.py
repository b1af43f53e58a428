# SPDX-License-Identifier: BSD-2-Clause
"""The configuration where a robot starts, and closed configurations from positions by name."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import (
    Array,
    Indices,
    as_array,
    finite_array,
    for_each_sample,
    names,
    require_flags,
    single_array,
    whole_number,
)
from ..errors import ClosureError, DescriptionWarning, warn_caller
from ..model.mechanism import Mechanism
from ..model.named_positions import positions_of, units_by_joint, with_positions
from ..summaries import listed
from .closed_loops import ClosedLoops
from .guesses import home_of

#: A joint that differs by more is at another position, [rad] or parts of the robot's length.
_FAR = 0.05


class Closer(Protocol):
    """What this module needs of an engine: it closes loops and moves robots."""

    @property
    def loops(self) -> ClosedLoops:
        """Evaluates and closes the loops."""

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode."""


def _home_or_neutral(closer: Closer) -> Array:
    """Home, even if its loops cannot be closed; `pin.neutral` without a home; shape (nq,)."""
    try:
        home = closer.loops.home
    except ClosureError:
        home = home_of(closer.loops.mechanism)
    return pin.neutral(closer.loops.mechanism.model) if home is None else home


def start_of(closer: Closer, *, chosen: bool = False) -> Array:
    """The configuration where a robot starts, shape (nq,): home, else one near zero.

    Without a home the loops are closed near zero. If they cannot be closed there, the result is a
    generic configuration. If no configuration closes them, the result has open loops.

    Warns:
        DescriptionWarning: If there is no home and the loops had to be closed; not with `chosen`,
            which says that the caller has chosen the assembly mode.
    """
    q = _home_or_neutral(closer)
    model = closer.loops.mechanism.model
    if closer.loops.are_closed(q) or "home" in model.referenceConfigurations:
        return q
    try:
        q = closer.loops.assembly.assemble(q, np.arange(model.nv))
    except ClosureError:
        try:
            q = closer.loops.example()
        except ClosureError:
            return q
    if not chosen:
        _warn(
            closer,
            "no configuration is named home",
            "name a configuration home (an SRDF beside the URDF, a keyframe of an MJCF, or "
            'model.referenceConfigurations["home"]), or give positions of dependent joints too, '
            "as in assemble(positions, fixed=[joints that stay there])",
        )
    return q


def assemble(
    closer: Closer,
    q: ArrayLike | Mapping[str, float],
    fixed: Sequence[str] | None = None,
    tries: int = 1,
    seed: int = 0,
    limits: bool = False,
) -> Array:
    """Configurations with closed loops near a guess; see `ClosedChain.assemble`."""
    tries = whole_number("tries", tries, 1)
    seed = whole_number("seed", seed, 0)
    require_flags(limits=limits)
    mechanism = closer.loops.mechanism
    model = mechanism.model
    space = mechanism.space
    has_options = tries > 1 or limits
    brakes_hold = fixed is None
    if isinstance(q, Mapping):
        names_only_coordinates = set(q) <= set(mechanism.coordinate_names)
        if names_only_coordinates and fixed is None and not has_options:
            return placed(closer, q)
        if fixed is None and not names_only_coordinates:
            fixed = list(q)
        guess = with_positions(space, _home_or_neutral(closer), q)
    else:
        guess = as_array("q", q, ())
    if fixed is None:
        free = mechanism.dependent
    else:
        free = _other_rates(mechanism, names("fixed", fixed))

    def one(guess: Array) -> Array:
        if model.nv != model.nq and guess.shape == (model.nv,):
            # Joint angles instead of quaternions: a displacement from neutral.
            step = single_array("q", guess, (model.nv,))
            guess = pin.integrate(model, pin.neutral(model), step)
        start = space.normalised(single_array("q", guess, (model.nq,)))
        if not has_options and np.array_equal(free, mechanism.dependent):
            return closer.closed(start)
        assembly = closer.loops.assembly

        def closed(free: Indices) -> Array:
            return assembly.try_starts(start, free, tries, seed, limits=limits)

        return assembly.holding_brakes(free, closed) if brakes_hold else closed(free)

    if guess.ndim > 1 and guess.shape[-1] in (model.nq, model.nv):
        return for_each_sample(one, [guess], (1,), (model.nq,))
    return one(guess)


def placed(closer: Closer, positions: Mapping[str, float], guess: ArrayLike | None = None) -> Array:
    """A configuration with closed loops where some joints have given positions, shape (nq,).

    `positions`, [rad] or [m], have names of joints that turn or slide. The other joints start from
    `guess`, by default `start_of`. If only coordinates are named, they move there in the assembly
    mode of the start. Otherwise the positions of dependent joints, perhaps rounded or measured,
    choose the assembly.

    Warns:
        DescriptionWarning: If neither the description nor the caller chooses the assembly mode, if
            the coordinates cannot be moved there without leaving it, or if a dependent joint ends
            at another position.
    """
    mechanism = closer.loops.mechanism
    space = mechanism.space
    if guess is None:
        all_are_named = units_by_joint(space).keys() <= positions.keys()
        start = start_of(closer, chosen=all_are_named)
    else:
        start = finite_array("start", guess, (mechanism.model.nq,))
    with_positions(space, start, positions)  # refuses unknown names, and what is no number

    # Move the coordinates there, if only coordinates are named.
    why_not_moved: ClosureError | None = None
    if set(positions) <= set(mechanism.coordinate_rate_names) and closer.loops.are_closed(start):
        try:
            q = _moved_to(closer, start, positions)
            return closer.closed(with_positions(space, q, positions))  # without rounding
        except ClosureError as error:
            why_not_moved = error

    # Otherwise assemble near the positions.
    if guess is None:
        q = _assembled_from_start_or_example(closer, start, positions)
    else:
        q = _assembled(closer, start, positions)
    if why_not_moved is not None:
        _warn(
            closer,
            f"{', '.join(positions)} cannot be moved from the start to their positions "
            f"({why_not_moved})",
            "give a configuration near them as start, or positions of dependent joints too, as "
            "assemble({joint: position, ...}, fixed=[joints whose positions hold])",
        )
        return q
    far = _joints_at_other_positions(mechanism, q, positions)
    if far:
        _warn(
            closer,
            f"no assembly was found with {listed(far)} at these coordinates",
            "correct these positions, or give those of other dependent joints",
        )
    return q


def _moved_to(closer: Closer, start: Array, positions: Mapping[str, float]) -> Array:
    """The configuration, in the assembly mode of the start, where coordinates are at positions.

    Joints that turn without end take the shorter way.
    """
    mechanism = closer.loops.mechanism
    step = np.zeros(len(mechanism.coordinates))
    before = positions_of(mechanism.space, start, list(positions))
    for (name, wanted), position in zip(positions.items(), before, strict=True):
        distance = wanted - position
        is_endless = name not in mechanism.space.position_names
        if is_endless:
            distance -= 2 * np.pi * np.round(distance / (2 * np.pi))
        step[mechanism.coordinate_rate_names.index(name)] = distance
    return closer.moved(start, step)


def _assembled_from_start_or_example(
    closer: Closer, start: Array, positions: Mapping[str, float]
) -> Array:
    """The assembly nearest to the start, or to the example if only that one is at the positions."""
    mechanism = closer.loops.mechanism
    try:
        q = _assembled(closer, start, positions)
    except ClosureError:
        return _assembled(closer, closer.loops.example(), positions)
    if _joints_at_other_positions(mechanism, q, positions):
        with suppress(ClosureError):
            other = _assembled(closer, closer.loops.example(), positions)
            if not _joints_at_other_positions(mechanism, other, positions):
                return other
    return q


def _assembled(closer: Closer, start: Array, positions: Mapping[str, float]) -> Array:
    """The assembly nearest to the start in which joints are at positions, or near these."""
    guess = with_positions(closer.loops.mechanism.space, start, positions)
    others = _other_rates(closer.loops.mechanism, positions)
    assembly = closer.loops.assembly
    return assembly.holding_brakes(others, lambda free: closer.closed(assembly.closer(guess, free)))


def _other_rates(mechanism: Mechanism, joints: Iterable[str]) -> Indices:
    """Rates of all joints but these."""
    return np.setdiff1d(np.arange(mechanism.model.nv), mechanism.space.rates_of(list(joints)))


def _joints_at_other_positions(
    mechanism: Mechanism, q: Array, positions: Mapping[str, float]
) -> list[str]:
    """Joints that are far from their positions, with both positions, in words."""
    units = units_by_joint(mechanism.space)
    reached = positions_of(mechanism.space, q, list(positions))
    far = list[str]()
    for (name, wanted), position in zip(positions.items(), reached, strict=True):
        if units[name] == "rad":
            distance = math.remainder(position - wanted, 2 * math.pi)
            limit = _FAR
        else:
            distance = position - wanted
            limit = _FAR * mechanism.length
        if not abs(distance) <= limit:
            far.append(f"{name} at {wanted:.4g} (it is at {position:.4g})")
    return far


def _warn(closer: Closer, why: str, cure: str) -> None:
    warn_caller(
        f"model {closer.loops.mechanism.model.name}: {why}, so an assembly mode was chosen. Other "
        f"modes need other torques. Check the start; to choose it, {cure}",
        DescriptionWarning,
    )
