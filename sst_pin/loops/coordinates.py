# SPDX-License-Identifier: BSD-2-Clause
"""The choice of the coordinates, when a robot is made.

1. `_choose` finds a closed configuration, home if possible, and chooses independent rates there.
2. It then finds the *example*: a closed configuration without symmetry, near home and in its
   assembly mode, where ranks and sizes that hold in general are judged. Without a regular home, the
   configuration of step 1 is the example.
3. `with_chosen_coordinates` stores both in the mechanism, and warns of what cannot move.

The choice does not depend on the order of the joints or on units: random steps depend on the names
of the joints, and names decide ties.
"""

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..arrays import Array, Flags, Indices
from ..errors import ClosureError, DescriptionWarning, warn_caller
from ..model.closures import Brake, Closure
from ..model.mechanism import Mechanism
from ..model.thresholds import INDEPENDENT, MAX_CONDITION_NUMBER, RESTS
from ..progress import announced
from ..summaries import listed
from .assembly import Assembly
from .continuity import Continuity, Path
from .coordinate_choice import choose_coordinates
from .examples import AROUND_HOME, examples
from .finite_motions import finite_motions, has_accelerations
from .guesses import home_of, random_step
from .loops import Loops
from .massless_rates import massless_rates
from .mobility import motor_rates
from .ranks import free_motions, scaled_Phi

#: Largest condition number at the example, in multiples of that at home.
_POORER = 10.0
#: Number of configurations that are examined if the motors are too few everywhere.
_FEW = 3
#: Largest number of configurations on the path from home to the example. These three numbers are
#: choices. If no path is found, home itself is the example, and symmetry may hide what holds in
#: general.
_MOST_STEPS = 30
#: Home is singular if Phi has a higher rank at this distance, [rad] or lengths of the loop.
_BESIDE = 1e-3
#: Singular values of Phi beside home below this part of the largest, or of one, count as zero.
#: Those that vanish only at home are about `_BESIDE` there. Those that vanish everywhere are
#: rounding, or at most its square root, 1e-8, where the closures hold a joint at second order.
_REGULAR = 1e-5


class _Choice(NamedTuple):
    """Indices in v of the coordinates, and the example, shape (nq,), or None."""

    coordinates: Indices
    example: Array | None


class _Pose(NamedTuple):
    """A closed configuration, shape (nq,), and the motions from it, shape (nv, freedoms).

    The motions are those of `finite_motions`: orthonormal rates, free of units.
    """

    q: Array
    motions: Array


def with_chosen_coordinates(mechanism: Mechanism) -> Mechanism:
    """The mechanism with coordinates, the example, and what is judged there.

    Coordinates that it has already are kept. Judged at the example are the sizes of the rows of Phi
    and the rates that move no mass. If no loops can be closed, only the coordinates are added.

    Warns:
        DescriptionWarning: If home is singular, if motors cannot move, or if joints are shaking:
            the closures allow their rates, which lead to no other pose.
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
    allowed = free_motions(Phi)  # rates with Phi v = 0, which may lead to no other pose
    if allowed.shape[1] > motions.shape[1]:
        _warn_of_shaking(mechanism, allowed, motions)
    else:
        motions_without_brakes = free_motions(Phi[~_are_of_brakes(mechanism)])
        _warn_of_rigid_motors(mechanism, motions_without_brakes)
    return replace(
        mechanism,
        coordinates=coordinates,
        example=q,
        row_sizes=_row_sizes(loops, Phi),
        without_mass=massless_rates(mechanism, loops, coordinates, q, motions),
    )


def _choose(assembly: Assembly, wanted: Indices | None) -> _Choice:
    """The coordinates and the example.

    The coordinates are those wanted, if there are any; else the motors' joints, as many as are
    independent, and other joints if these are too few. They are judged at home. If home is missing
    or singular, they are judged at the configuration among several where the motors hold most
    degrees of freedom. If nothing can be assembled, they are the motors' joints.
    """
    mechanism = assembly.mechanism
    preferred = mechanism.driven if wanted is None else wanted
    home = _home(assembly, preferred)
    if home is not None:
        coordinates = _coordinates_at(assembly, home, wanted)
        return _Choice(coordinates, _without_symmetry(assembly, home.q, coordinates))
    try:
        best = _best_example(assembly, wanted)
    except ClosureError:
        return _Choice(preferred, None)
    return _Choice(_coordinates_at(assembly, best, wanted), best.q)


def _coordinates_at(assembly: Assembly, pose: _Pose, wanted: Indices | None) -> Indices:
    """The coordinates wanted, else those that describe the motions from a pose."""
    if wanted is not None:
        return wanted
    Phi = scaled_Phi(assembly.mechanism, assembly.loops, pose.q)
    return choose_coordinates(assembly.mechanism, Phi, motions=pose.motions)


def _are_of_brakes(mechanism: Mechanism) -> Flags:
    """Which rows of Phi are those of brakes, shape (rows,)."""
    result = list[bool]()
    for closure in mechanism.closures:
        for _ in closure.rows:
            result.append(isinstance(closure, Brake))
    return np.array(result, dtype=bool)


def _row_sizes(loops: Loops, Phi: Array) -> Array:
    """Lengths of the rows of Phi, free of units, shape (rows,); 0 for rows that are constant."""
    sizes = np.linalg.norm(Phi, axis=1)
    for coupling in loops.couplings:
        if not coupling.curved.any():
            sizes[coupling.at] = 0.0
    return sizes


# --- at home ------------------------------------------------------------------------------------


def _home(assembly: Assembly, fixed: Indices) -> _Pose | None:
    """Home with closed loops; None if it is missing, cannot be closed, or is singular.

    Home is singular if motions branch there, so that Phi has a lower rank than beside it. The rates
    `fixed` are held while the loops are closed.
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
    return _Pose(q, motions)


def _rates_only_at(assembly: Assembly, q: Array, fixed: Indices) -> Array:
    """Rates that Phi allows at a closed q but not beside it, where motions branch, shape (nv, k).

    The rates are free of units. The rates `fixed` are held on the way to the pose beside q.
    """
    mechanism = assembly.mechanism
    loops = assembly.loops
    no_rates = np.zeros((mechanism.model.nv, 0))
    Phi = scaled_Phi(mechanism, loops, q)
    allowed_here = free_motions(Phi)
    # Where motions branch, random rates that Phi allows are sums of rates of several branches. No
    # motion begins with such a sum: accelerations that keep the loops closed do not exist.
    if has_accelerations(assembly, Phi, allowed_here):
        return no_rates
    guess = pin.integrate(mechanism.model, q, random_step(mechanism, _BESIDE))
    try:
        beside = assembly.near(guess, fixed)
    except ClosureError:
        return no_rates
    _, sizes, Vt = np.linalg.svd(scaled_Phi(mechanism, loops, beside))
    rank = np.count_nonzero(sizes > _REGULAR * sizes.max(initial=1.0))
    allowed_beside = Vt[rank:].T
    # The singular values are the cosines of the angles between both spaces of rates, in decreasing
    # order (Bjorck and Golub 1973). The first directions are allowed in both poses, as many as are
    # allowed beside q. The other directions are allowed here only.
    _, _, directions = np.linalg.svd(allowed_beside.T @ allowed_here)
    only_here = directions[allowed_beside.shape[1] :]
    return np.asarray(allowed_here @ only_here.T)


def _without_symmetry(assembly: Assembly, home: Array, coordinates: Indices) -> Array:
    """The example: a configuration near home in the same assembly mode; home if none is found.

    After a random step of all joints, the loops are closed with the motors held, or else with the
    coordinates held.
    """
    if not len(coordinates):
        return home
    mechanism = replace(assembly.mechanism, coordinates=coordinates)
    continuity = Continuity(mechanism, assembly.loops)
    limit = min(_POORER * continuity.condition_number(home), MAX_CONDITION_NUMBER)
    for width in AROUND_HOME:
        for fixed in (mechanism.driven, coordinates):
            path = _path_from(assembly, home, random_step(mechanism, width), fixed)
            with suppress(ClosureError):
                fraction, q = continuity.follow(home, path, limit, most_steps=_MOST_STEPS)
                if fraction == 1:
                    return q
    return home


def _path_from(assembly: Assembly, home: Array, step: Array, fixed: Indices) -> Path:
    """Assembled configurations on the straight way from home to home + step."""

    def path(_q: Array, _earlier: float, fraction: float) -> Array:
        return assembly.near(pin.integrate(assembly.mechanism.model, home, fraction * step), fixed)

    return path


# --- without a regular home ---------------------------------------------------------------------


class _Example(NamedTuple):
    """A pose that may become the example.

    Attributes:
        pose: The pose.
        drives: Number of motors, or of the coordinates wanted.
        controlled: Number of degrees of freedom that they hold.
    """

    pose: _Pose
    drives: int
    controlled: int

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom."""
        return self.pose.motions.shape[1]

    @property
    def quality(self) -> tuple[bool, int, int]:
        """The largest is the best: it moves, few freedoms are not held, and many are held.

        Of these three, the first one that differs decides.
        """
        moves = self.freedoms > 0
        minus_loose = self.controlled - self.freedoms
        return moves, minus_loose, self.controlled

    @property
    def drives_are_too_few(self) -> bool:
        """Whether the drives do not suffice, although each holds a freedom of its own."""
        return self.controlled == self.drives < self.freedoms


def _best_example(assembly: Assembly, wanted: Indices | None) -> _Pose:
    """The pose where the motors, or the coordinates wanted, hold most degrees of freedom.

    The search ends where they hold all degrees of freedom. It also ends where no better pose is
    expected: after `_FEW` poses if each motor holds a freedom of its own, but the motors are too
    few; and at once if nothing moves because of brakes.
    """
    mechanism = assembly.mechanism
    best: _Example | None = None
    for count, q in enumerate(examples(assembly), start=1):
        motions = finite_motions(assembly, q)
        if wanted is None:
            rates = motor_rates(mechanism, q, motions)
        else:
            rates = motions[wanted]
        controlled = int(np.linalg.matrix_rank(rates, RESTS))
        example = _Example(_Pose(q, motions), drives=len(rates), controlled=controlled)
        if best is None or example.quality > best.quality:
            best = example
        if 0 < example.freedoms == example.controlled:
            break
        if example.drives_are_too_few and count >= _FEW:
            break
        if example.freedoms == 0 and mechanism.brakes:
            break
    assert best is not None  # `examples` gives one, or an error
    return best.pose


# --- warnings -----------------------------------------------------------------------------------


def _warn_of_singular_home(mechanism: Mechanism, motions: Array) -> None:
    """Name the joints that can move only at home, by motions of shape (nv, k)."""
    names = _moving_names(mechanism, motions)
    count = motions.shape[1]
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


def _warn_of_shaking(mechanism: Mechanism, rates: Array, motions: Array) -> None:
    """Name the joints that shake: their rates lead to no other pose.

    `rates` are those that Phi allows, a space that contains the motions; shapes (nv, k).
    """
    without_motions = rates - motions @ (motions.T @ rates)
    names = _moving_names(mechanism, without_motions)
    warn_caller(
        f"model {mechanism.model.name}: the closures allow rates of the joints {names} that lead "
        f"to no other pose, so degrees of freedom are {motions.shape[1]} instead of "
        f"{rates.shape[1]}; correct lengths, make another pose home, or lock joints that cannot "
        f"move: locked=[...]{_hint_of_hinges(mechanism)}",
        DescriptionWarning,
    )


def _warn_of_rigid_motors(mechanism: Mechanism, motions: Array) -> None:
    """Name the motors whose joints do not take part in motions, shape (nv, k).

    Motors on lines only are not judged.
    """
    moving = np.linalg.norm(motions, axis=1) > RESTS
    rigid = list[str]()
    for name, acts_on in zip(mechanism.motor_names, mechanism.actuation.T, strict=True):
        if acts_on.any() and not acts_on[moving].any():
            rigid.append(name)
    if not rigid:
        return
    warn_caller(
        f"model {mechanism.model.name}: the closures hold the joints of the motors "
        f"{listed(rigid)}, which cannot move; check kinds, axes and digits of the closures"
        f"{_hint_of_hinges(mechanism)}",
        DescriptionWarning,
    )


def _hint_of_hinges(mechanism: Mechanism) -> str:
    """The end of a warning that says about which axis hinges turn; empty without hinges."""
    if any(isinstance(c, Closure) and c.kind == "hinge" for c in mechanism.closures):
        return "; a hinge turns about z of its frames"
    return ""
