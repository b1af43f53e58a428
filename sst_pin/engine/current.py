# SPDX-License-Identifier: BSD-2-Clause
"""What a chain computes, and what computes it: one object that never changes.

`ClosedChain.refresh` and `ClosedChain.compile` replace it by another one, so a call in another
thread computes from the old one or from the new one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import pinocchio as pin
from numpy.typing import ArrayLike

from ..arrays import Array, as_array, single_array
from ..dynamics.reference import Reference
from ..errors import ClosureError, InputError, SSTError
from ..loops.assembly import home_of
from ..loops.coordinates import examples
from ..loops.loops import Loops
from ..loops.mobility import Mobility, judge
from ..model.mechanism import Friction, Mechanism
from ..states import ReferenceStates
from ..summaries import listed
from .backend import Answer, Backend, Key, NoKernel

#: Makes the backend of a mechanism.
Kernels = Callable[[Reference], Backend]


class ReferenceBackend:
    """A backend that leaves everything to the reference path; `why` there are no kernels."""

    def __init__(self, reference: Reference, why: str) -> None:
        self._reference, self._why = reference, why

    def __str__(self) -> str:
        return f"the reference path: {self._why}"

    def kernel(self, key: Key) -> NoKernel:
        """No kernel: it leaves all samples to the reference path."""
        return NoKernel()

    def states(self, friction: Friction) -> ReferenceStates:
        """The state space with this friction instead of the mechanism's."""
        return ReferenceStates(self._reference, friction)


class Current:
    """A mechanism, its reference path, and what makes its backend; None for the reference path."""

    def __init__(self, mechanism: Mechanism, kernels: Kernels | None = None) -> None:
        self.mechanism, self.kernels = mechanism, kernels
        self.reference = Reference(mechanism)

    def __reduce__(self) -> tuple[Callable[..., Current], tuple[Mechanism, Kernels | None]]:
        return _unpickled, (self.mechanism, self.kernels)

    # --- what computes ----------------------------------------------------------------------

    @cached_property
    def backend(self) -> Backend:
        """The kernels, or the reference path with the reason why there are none."""
        if self.kernels is None:
            return ReferenceBackend(self.reference, "no kernels yet; compile() makes them")
        try:
            return self.kernels(self.reference)
        except SSTError as error:
            return ReferenceBackend(self.reference, str(error))

    @cached_property
    def has_kernels(self) -> bool:
        """Whether the backend is anything but the reference path."""
        return not isinstance(self.backend, ReferenceBackend)

    @cached_property
    def torques_of(self) -> Callable[..., Answer]:
        """Inverse dynamics by the backend."""
        return self.backend.kernel(Key("torques")).answer

    @cached_property
    def accelerations_of(self) -> Callable[..., Answer]:
        """Direct dynamics by the backend."""
        return self.backend.kernel(Key("accelerations")).answer

    # --- arguments --------------------------------------------------------------------------

    def arguments(self, q: ArrayLike, **others: ArrayLike) -> list[Array]:
        """Arguments as arrays of the shapes that the mechanism has, q first, the others by name."""
        mechanism = self.mechanism
        mechanism.require_freedom()
        n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
        arrays = [self.configurations(q)]
        for name, value in others.items():
            try:
                arrays.append(as_array(name, value, (motors if name == "tau" else n,)))
            except InputError as error:
                if name != "tau" and n != motors:
                    error.args = (
                        f"{error.args[0]}: one for each rate of the coordinates "
                        f"{listed(mechanism.coordinate_rate_names)}; in another assembly make it "
                        "home, or give coordinates=",
                    )
                raise
        return arrays

    def configurations(self, q: ArrayLike) -> Array:
        """One or many configurations, shape (..., nq)."""
        return as_array("q", q, (self.mechanism.model.nq,))

    def single(self, q: ArrayLike) -> Array:
        """One configuration on the manifold, shape (nq,)."""
        array = single_array("q", q, (self.mechanism.model.nq,))
        self.mechanism.space.require_on_manifold(array)
        return array

    # --- configurations ---------------------------------------------------------------------

    def evaluated(self, q: ArrayLike) -> Loops:
        """This thread's loops at one configuration."""
        array = self.single(q)
        loops = self.reference.memory.loops
        loops.evaluate(array)
        return loops

    @cached_property
    def home(self) -> Array | None:
        """The home of the model with closed loops, shape (nq,); None without one."""
        mechanism = self.mechanism
        q = home_of(mechanism)
        if q is None:
            return None
        try:
            self.evaluated(q).require_closed(mechanism.row_scale)
        except ClosureError:
            return self.reference.memory.assembly.assemble(q, mechanism.dependent)
        return q

    def example(self) -> Array:
        """A configuration with closed loops and without symmetry, shape (nq,)."""
        if self.mechanism.example is None:
            return next(examples(self.reference.memory.assembly))
        return self.mechanism.example.copy()

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """Degrees of freedom and motors; see `ClosedChain.mobility`."""
        given = "a random assembled configuration" if q is None else "the configuration given"
        at = self.example() if q is None else self.single(q)
        return judge(self.mechanism, self.reference.memory.loops, at, given)


def _unpickled(mechanism: Mechanism, kernels: Kernels | None) -> Current:
    """With a copy of the model: mimic joints of an unpickled one end the process in `calc`.

    Arrays are read-only again.
    """
    parts = {name: replace(getattr(mechanism, name)) for name in ("friction", "springs")}
    return Current(replace(mechanism, model=pin.Model(mechanism.model), **parts), kernels)
