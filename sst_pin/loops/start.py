# SPDX-License-Identifier: BSD-2-Clause
"""The configuration where a robot starts, and closed configurations from positions by name.

- `start_of`: home, or a closed configuration near zero.
- `assemble`: closed configurations near guesses; it is behind `ClosedChain.assemble`.
- `placed`: a closed configuration with joints at positions, in the assembly mode of the start if
  only coordinates have positions.

Home is the configuration with the name "home" in the description. The example is a closed
configuration without symmetry that the robot finds itself, see `ClosedLoops.example`.
"""

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

#: A joint that misses its position by more than this is at another position, [rad] or parts of the
#: robot's length. It is a choice: positions in files are rounded or measured better than this, and
#: other assembly modes differ by more.
_FAR = 0.05


class LoopEngine(Protocol):
    """The part of an `Engine` that this module uses: it closes loops and moves robots."""

    @property
    def loops(self) -> ClosedLoops:
        """Evaluates and closes the loops."""

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""

    def moved(self, q: Array, step: Array) -> Array:
        """The configuration where the coordinates are a step further, in the same assembly mode."""


def _home_or_neutral(engine: LoopEngine) -> Array:
    """Home with closed loops if they can be closed; `pin.neutral` without a home; shape (nq,)."""
    mechanism = engine.loops.mechanism
    try:
        home = engine.loops.home
    except ClosureError:
        home = home_of(mechanism)
    return pin.neutral(mechanism.model) if home is None else home


def start_of(engine: LoopEngine, *, chosen: bool = False) -> Array:
    """The configuration where a robot starts, shape (nq,): home, else one near zero.

    A home with loops that cannot be closed is returned with open loops. Without a home the loops
    are closed near zero. If they cannot be closed there, the result is the example. If there is no
    example either, the result is zero, with open loops.

    Warns:
        DescriptionWarning: If there is no home and the loops had to be closed. Not if `chosen`: the
            caller chooses the assembly mode, so that the one of the start does not matter.
    """
    q = _home_or_neutral(engine)
    model = engine.loops.mechanism.model
    if engine.loops.are_closed(q) or "home" in model.referenceConfigurations:
        return q
    try:
        q = engine.loops.assembly.assemble(q, np.arange(model.nv))
    except ClosureError:
        try:
            q = engine.loops.example()
        except ClosureError:
            return q
    if not chosen:
        _warn(
            engine,
            "no configuration is named home",
            "name a configuration home (an SRDF beside the URDF, a keyframe of an MJCF, or "
            'model.referenceConfigurations["home"]), or give positions of dependent joints too, '
            "as in assemble(positions, fixed=[joints that stay there])",
        )
    return q


def assemble(
    engine: LoopEngine,
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
    mechanism = engine.loops.mechanism
    model = mechanism.model
    has_options = tries > 1 or limits
    brakes_hold = fixed is None  # also if `fixed` is set to the joints named in q below

    # The guesses, and the rates that may move. By default the coordinates stay where they are. If q
    # names other joints too, all joints that it names stay instead.
    if isinstance(q, Mapping):
        names_only_coordinates = set(q) <= set(mechanism.coordinate_names)
        if names_only_coordinates and fixed is None and not has_options:
            return placed(engine, q)
        if fixed is None and not names_only_coordinates:
            fixed = list(q)
        guesses = with_positions(mechanism.space, _home_or_neutral(engine), q)
    else:
        guesses = as_array("q", q, ())
    if fixed is None:
        free = mechanism.dependent
    else:
        free = _other_rates(mechanism, names("fixed", fixed))
    only_dependent_move = np.array_equal(free, mechanism.dependent)

    def assembled(guess: Array) -> Array:
        """The assembly of one guess, shape (nq,)."""
        start = _configuration(mechanism, guess)
        if only_dependent_move and not has_options:
            return engine.closed(start)  # by a kernel, if there is one
        assembly = engine.loops.assembly

        def from_starts(moving: Indices) -> Array:
            return assembly.try_starts(start, moving, tries, seed, limits=limits)

        if brakes_hold:
            return assembly.holding_brakes(free, from_starts)
        return from_starts(free)

    if guesses.ndim > 1 and guesses.shape[-1] in (model.nq, model.nv):
        return for_each_sample(assembled, [guesses], (1,), (model.nq,))
    return assembled(guesses)  # one guess; another shape is an error


def _configuration(mechanism: Mechanism, guess: Array) -> Array:
    """A guess as a configuration on the manifold, shape (nq,).

    Where nv differs from nq, as with quaternions, a guess of shape (nv,) is a displacement from
    `pin.neutral`.
    """
    model = mechanism.model
    if model.nv != model.nq and guess.shape == (model.nv,):
        step = single_array("q", guess, (model.nv,))
        guess = pin.integrate(model, pin.neutral(model), step)
    return mechanism.space.normalised(single_array("q", guess, (model.nq,)))


def placed(
    engine: LoopEngine, positions: Mapping[str, float], guess: ArrayLike | None = None
) -> Array:
    """A configuration with closed loops where some joints have given positions, shape (nq,).

    `positions`, [rad] or [m], have names of joints that turn or slide. The other joints start from
    `guess`, by default `start_of`. If only coordinates are named, they move from the start to their
    positions in its assembly mode. Otherwise the loops are closed near the positions, so that those
    of dependent joints, perhaps rounded or measured, choose the assembly mode.

    Warns:
        DescriptionWarning: If neither the description nor the caller chooses the assembly mode, if
            the coordinates cannot be moved there without leaving it, or if a dependent joint ends
            at another position.
    """
    mechanism = engine.loops.mechanism
    space = mechanism.space
    if guess is None:
        all_are_named = units_by_joint(space).keys() <= positions.keys()
        start = start_of(engine, chosen=all_are_named)
    else:
        start = finite_array("start", guess, (mechanism.model.nq,))
    with_positions(space, start, positions)  # raises an error for unknown names or bad numbers

    # If only coordinates are named, move them to their positions. A position and its rate have the
    # same name.
    why_not_moved: ClosureError | None = None
    if set(positions) <= set(mechanism.coordinate_rate_names) and engine.loops.are_closed(start):
        try:
            q = _moved_to(engine, start, positions)
            # The motion ends at the positions with rounding; set them exactly.
            return engine.closed(with_positions(space, q, positions))
        except ClosureError as error:
            why_not_moved = error

    # Otherwise assemble near the positions.
    if guess is None:
        q = _assembled_from_start_or_example(engine, start, positions)
    else:
        q = _assembled(engine, start, positions)
    if why_not_moved is not None:
        _warn(
            engine,
            f"{', '.join(positions)} cannot be moved from the start to their positions "
            f"({why_not_moved})",
            "give a configuration near them as start, or positions of dependent joints too, as "
            "assemble({joint: position, ...}, fixed=[joints whose positions hold])",
        )
        return q
    far = _joints_at_other_positions(mechanism, q, positions)
    if far:
        _warn(
            engine,
            f"no assembly was found with {listed(far)} at these coordinates",
            "correct these positions, or give those of other dependent joints",
        )
    return q


def _moved_to(engine: LoopEngine, start: Array, positions: Mapping[str, float]) -> Array:
    """The configuration, in the assembly mode of the start, with coordinates at positions.

    Joints without limits to their turns, whose entries of q are a cosine and a sine, take the
    shorter way.
    """
    mechanism = engine.loops.mechanism
    step = np.zeros(len(mechanism.coordinates))
    before = positions_of(mechanism.space, start, list(positions))
    for (name, wanted), position in zip(positions.items(), before, strict=True):
        distance = wanted - position
        is_endless = name not in mechanism.space.position_names
        if is_endless:
            distance -= 2 * np.pi * np.round(distance / (2 * np.pi))
        step[mechanism.coordinate_rate_names.index(name)] = distance
    return engine.moved(start, step)


def _assembled_from_start_or_example(
    engine: LoopEngine, start: Array, positions: Mapping[str, float]
) -> Array:
    """The assembly near the positions, with the other joints from the start, or the example.

    The example is used if the start leads to no assembly, or to one with other positions.
    """
    mechanism = engine.loops.mechanism
    try:
        q = _assembled(engine, start, positions)
    except ClosureError:
        return _assembled(engine, engine.loops.example(), positions)
    if _joints_at_other_positions(mechanism, q, positions):
        with suppress(ClosureError):
            other = _assembled(engine, engine.loops.example(), positions)
            if not _joints_at_other_positions(mechanism, other, positions):
                return other
    return q


def _assembled(engine: LoopEngine, start: Array, positions: Mapping[str, float]) -> Array:
    """The assembly near the positions, with the other joints near the start.

    First only the other joints move, to close the loops as far as they can. Then all dependent
    joints move.
    """
    guess = with_positions(engine.loops.mechanism.space, start, positions)
    others = _other_rates(engine.loops.mechanism, positions)
    assembly = engine.loops.assembly
    return assembly.holding_brakes(others, lambda free: engine.closed(assembly.closer(guess, free)))


def _other_rates(mechanism: Mechanism, joints: Iterable[str]) -> Indices:
    """Indices in v of the rates of all joints but these."""
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


def _warn(engine: LoopEngine, why: str, cure: str) -> None:
    """Warn that an assembly mode had to be chosen."""
    warn_caller(
        f"model {engine.loops.mechanism.model.name}: {why}, so an assembly mode was chosen. Other "
        f"modes need other torques. Check the start; to choose it, {cure}",
        DescriptionWarning,
    )
