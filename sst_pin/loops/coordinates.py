# SPDX-License-Identifier: BSD-2-Clause
"""The choice of the coordinates, when a robot is made.

It does not depend on the order of the joints or on units: the random displacement of a joint
depends on its name, and names decide ties.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, DescriptionWarning, SingularConfigurationError, warn_caller
from ..model.closures import Brake, Closure
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT, MAX_CONDITION_NUMBER, RESTS
from ..progress import announced
from ..summaries import listed
from .assembly import Assembly
from .continuity import Continuity
from .coordinate_choice import choose_coordinates
from .finite_motions import finite_motions, has_accelerations
from .guesses import displacement, home_of
from .line_kinematics import LineKinematics
from .loops import Loops
from .mobility import motor_rates
from .ranks import free_motions, rank_of, scaled_Phi

#: Widths of the random displacements from home or `pin.neutral`, [rad] or lengths of the loop.
_AROUND_HOME, _AROUND_NEUTRAL = (0.1, 0.03, 0.01), np.linspace(0.1, 2.0, 20)
#: Largest condition number near home, in multiples of that at home.
_POORER = 10.0
#: Configurations to look at if the motors are too few.
_FEW = 3
#: Most configurations on the path from home.
_LOOKS = 30
#: Home is singular if Phi has a higher rank at this distance, [rad] or lengths of the loop. Its
#: singular values that vanish at home are of about this size there; those that vanish there too are
#: at most the square root of rounding, by which the closures fix such a pose.
_BESIDE, _REGULAR = 1e-3, 1e-5
#: The cure if no guess can be assembled.
_GIVE_ONE = 'give q, a closed configuration, or make it model.referenceConfigurations["home"]'
#: A coordinate with a smaller part of the inertia of its bodies moves no mass.
_NO_MASS = 1e-8


def examples(assembly: Assembly) -> Iterator[Array]:
    """Assembled configurations without symmetry, the same at each call.

    They are near `home`; near `pin.neutral` if there is no home or no loops close near it. The
    error is that of the best guess.
    """
    mechanism = assembly.mechanism
    model, home = mechanism.model, home_of(mechanism)
    starts = [(pin.neutral(model), width) for width in _AROUND_NEUTRAL]
    if home is not None:
        starts = [(home, width) for width in _AROUND_HOME] + starts
    failures, any_example = [], False
    for start, width in starts:
        if any_example and home is not None and start is not home:
            return
        guess = pin.integrate(model, start, displacement(mechanism, width))
        try:  # with the motors fixed, assemblies are found in which they hold the robot
            q = assembly.near(guess, mechanism.driven)
        except ClosureError as error:
            failures.append(error)
        else:
            any_example = True
            yield q
    if not any_example:
        nearest = min(failures, key=lambda error: error.residual)
        open_by, _, _ = nearest.args[0].partition(";")
        raise ClosureError(f"{open_by}; {_GIVE_ONE}", nearest.residual)


def _home(assembly: Assembly, fixed: Indices) -> tuple[Array, Array] | None:
    """Home with closed loops and the motions from it; None without a regular home.

    There is none if it is missing, cannot be closed, or if motions branch at home, so that Phi has
    a lower rank there than beside it.
    """
    mechanism = assembly.mechanism
    q = home_of(mechanism)
    if q is None:
        return None
    try:
        q = assembly.near(q, fixed)
    except ClosureError:
        return None
    motions = finite_motions(assembly, q)
    if motions.shape[1]:
        only_here = _rates_only_at(assembly, q, fixed)
        if only_here.shape[1]:
            _warn_of_singular_home(mechanism, only_here)
            return None
    return q, motions


def _rates_only_at(assembly: Assembly, q: Array, fixed: Indices) -> Array:
    """Rates that Phi allows at a closed q but not beside it, as motions branch, shape (nv, k)."""
    mechanism, loops = assembly.mechanism, assembly.loops
    _, here, Vt = np.linalg.svd(Phi := scaled_Phi(mechanism, loops, q))
    rank, none = rank_of(here), Vt[:0].T
    if has_accelerations(assembly, Phi, Vt[rank:].T):
        return none
    try:
        guess = pin.integrate(mechanism.model, q, displacement(mechanism, _BESIDE))
        beside = assembly.near(guess, fixed)
    except ClosureError:
        return none
    there = np.linalg.svd(scaled_Phi(mechanism, loops, beside), compute_uv=False)
    return Vt[rank : np.count_nonzero(there > _REGULAR * there.max(initial=1.0))].T


def _warn_of_singular_home(mechanism: Mechanism, motions: Array) -> None:
    """Name the joints that can move only at home, by motions of shape (nv, k)."""
    names, count = _moving_names(mechanism, motions), motions.shape[1]
    warn_caller(
        f"model {mechanism.model.name}: home is singular, with {count} more degrees of "
        f"freedom than poses beside it, in the joints {names}; the coordinates are chosen beside "
        "home. Make another pose home",
        DescriptionWarning,
    )


def _moving_names(mechanism: Mechanism, motions: Array) -> str:
    """The rates that take part in motions, shape (nv, k), in words."""
    moving = np.flatnonzero(np.abs(motions).max(axis=1, initial=0.0) > INDEPENDENT)
    return listed([mechanism.space.rate_names[k] for k in moving])


def _without_symmetry(assembly: Assembly, home: Array, coordinates: Indices) -> Array:
    """A configuration near home in the same assembly mode, or home if none is found."""
    if not len(coordinates):
        return home
    mechanism = replace(assembly.mechanism, coordinates=coordinates)
    for width, fixed in product(_AROUND_HOME, (mechanism.driven, coordinates)):
        along = partial(_along, assembly, home, displacement(mechanism, width), fixed)
        continuity = Continuity(mechanism, assembly.loops)
        poor = min(_POORER * continuity.condition_number(home), MAX_CONDITION_NUMBER)
        with suppress(ClosureError):
            done, q = continuity.follow(home, along, poor, looks=_LOOKS)
            if done == 1:
                return q
    return home


def _along(
    assembly: Assembly, home: Array, step: Array, fixed: Indices, q: Array, low: float, high: float
) -> Array:
    """A `Path` of assembled configurations from home."""
    return assembly.near(pin.integrate(assembly.mechanism.model, home, high * step), fixed)


def settled(mechanism: Mechanism) -> Mechanism:
    """The mechanism with its coordinates chosen, and an example.

    The coordinates that it has are kept.

    Warns:
        DescriptionWarning: If home is singular, or if motors cannot move.
    """
    wanted = mechanism.coordinates if len(mechanism.coordinates) else None
    name = mechanism.model.name
    with announced(f"model {name}: choosing coordinates"):
        loops = Loops(mechanism.model, mechanism.closures)
        assembly = Assembly(mechanism, loops)
        coordinates, q = _choose(assembly, wanted)
    if q is None:
        return replace(mechanism, coordinates=coordinates)
    motions = finite_motions(assembly, q)
    Phi = scaled_Phi(mechanism, loops, q)
    rates = free_motions(Phi)
    if rates.shape[1] > motions.shape[1]:
        _warn_of_shaking(mechanism, rates, motions)
    else:
        _warn_of_rigid_motors(mechanism, free_motions(Phi[~_of_brakes(mechanism)]))
    return replace(
        mechanism,
        coordinates=coordinates,
        example=q,
        row_sizes=_row_sizes(loops, Phi),
        without_mass=_without_mass(mechanism, loops, coordinates, q, motions),
    )


def _choose(assembly: Assembly, wanted: Indices | None) -> tuple[Indices, Array | None]:
    """Indices in v of the coordinates, and a configuration of their assembly mode, or None.

    The order of preference: the coordinates `wanted`; the motors' joints, as many as are
    independent; other joints by rank. They are judged at home. If home is missing or singular,
    nearby configurations are tried, and the one where the motors hold most degrees of freedom is
    used. If nothing can be assembled, the coordinates are the motors' joints.
    """
    mechanism = assembly.mechanism
    preferred = mechanism.driven if wanted is None else wanted
    home = _home(assembly, preferred)
    if home is not None:
        q, motions = home
        Phi = scaled_Phi(mechanism, assembly.loops, q)
        chosen = choose_coordinates(mechanism, Phi, motions=motions) if wanted is None else wanted
        return chosen, _without_symmetry(assembly, q, chosen)
    best: tuple[tuple[bool, int, int], Array, Array] | None = None
    try:
        for count, q in enumerate(examples(assembly), start=1):
            motions = finite_motions(assembly, q)
            rates = motor_rates(mechanism, q, motions) if wanted is None else motions[wanted]
            controlled, n = int(np.linalg.matrix_rank(rates, RESTS)), motions.shape[1]
            if best is None or (n > 0, controlled - n, controlled) > best[0]:
                best = (n > 0, controlled - n, controlled), motions, q
            too_few = controlled == len(rates) < n
            if 0 < n == controlled or (too_few and count >= _FEW):
                break
            if n == 0 and mechanism.brakes:
                break  # as was to be expected
    except ClosureError:
        return preferred, None
    assert best is not None
    _, motions, q = best
    if wanted is not None:
        return wanted, q
    Phi = scaled_Phi(mechanism, assembly.loops, q)
    return choose_coordinates(mechanism, Phi, motions=motions), q


def _warn_of_shaking(mechanism: Mechanism, rates: Array, motions: Array) -> None:
    """Name the joints of rates that do not belong to motions, both of shape (nv, k)."""
    names = _moving_names(mechanism, rates - motions @ (motions.T @ rates))
    warn_caller(
        f"model {mechanism.model.name}: the closures allow rates of the joints {names} that lead "
        f"to no other pose, so degrees of freedom are {motions.shape[1]} instead of "
        f"{rates.shape[1]}; correct lengths, make another pose home, or lock joints that cannot "
        "move: locked=[...]",
        DescriptionWarning,
    )


def _warn_of_rigid_motors(mechanism: Mechanism, motions: Array) -> None:
    moving = np.linalg.norm(motions, axis=1) > RESTS
    names, B = mechanism.motor_names, mechanism.motors
    if rigid := [x for x, b in zip(names, B.T, strict=True) if b.any() and not b[moving].any()]:
        text = (
            f"model {mechanism.model.name}: the closures hold the joints of the motors "
            f"{listed(rigid)}, which cannot move; check kinds, axes and digits of the closures"
        )
        if any(isinstance(c, Closure) and c.kind == "hinge" for c in mechanism.closures):
            text += "; a hinge turns about z of its frames"
        warn_caller(text, DescriptionWarning)


def _of_brakes(mechanism: Mechanism) -> Flags:
    """Which rows of Phi are those of brakes, shape (rows,)."""
    rows = [isinstance(c, Brake) for c in mechanism.closures for _ in c.rows]
    return np.array(rows, dtype=bool)


def _row_sizes(loops: Loops, Phi: Array) -> Array:
    """Lengths of the rows of Phi, which is free of units; 0 for rows that are constant."""
    sizes = np.linalg.norm(Phi, axis=1)
    for coupling in loops.couplings:
        if not coupling.curved.any():
            sizes[coupling.at] = 0.0
    return sizes


def _without_mass(
    mechanism: Mechanism, loops: Loops, coordinates: Indices, q: Array, motions: Array
) -> tuple[str, ...]:
    """Names of rates that move no mass, such as the spin of a thin rod between two balls.

    They are coordinates, or rates that describe the motion where the coordinates fail. The mass
    matrix is singular there to rounding, at every configuration. The motions, without units, are
    those from the configuration q.
    """
    Phi, unit = scaled_Phi(mechanism, loops, q), mechanism.rate_scale
    chosen = choose_coordinates(mechanism, Phi, [coordinates], motions)
    if not len(chosen):
        return ()
    L = unit[:, None] * motions @ np.linalg.inv(motions[chosen] * unit[chosen, None])
    tree, L_tree = loops.tree.model, loops.tree.S @ L
    on_lines = np.zeros((len(chosen), len(chosen)))
    if mechanism.lines.masses.any():
        with suppress(SingularConfigurationError):  # where the ends of a line coincide
            on_lines = L.T @ LineKinematics(mechanism).inertia(q) @ L
    inertia = L_tree.T @ pin.crba(tree, loops.data, loops.q) @ L_tree + on_lines
    # The inertia that a coordinate would move if each body turned about its heaviest axis.
    heaviest = pin.Model(tree)
    for j, body in enumerate(tree.inertias):
        moments = abs(np.trace(body.inertia)) * np.eye(3)
        heaviest.inertias[j] = pin.Inertia(abs(body.mass), body.lever, moments)
    most = (L_tree * (pin.crba(heaviest, loops.data, loops.q) @ L_tree)).sum(axis=0)
    most = most + np.diag(on_lines)
    scale = 1 / np.sqrt(np.maximum(np.abs(most), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * inertia * scale)
    idle = np.abs(vectors[:, np.abs(values) < _NO_MASS]).max(axis=1, initial=0.0) > INDEPENDENT
    return tuple(np.array(mechanism.space.rate_names)[chosen[idle]].tolist())
