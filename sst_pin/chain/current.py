# SPDX-License-Identifier: BSD-2-Clause
"""What a chain computes now: the mechanism of a model that its owner may change.

The model is compared with the copy in use at each call. Coordinates are settled at the first
configuration that is known, and what computes the dynamics is made for them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..arrays import as_array, names, single_array
from ..errors import ActuationError, ClosureError, DescriptionError, InputError, SSTError
from .assembly import generic_configuration, home_of
from .backend import Answer, Backend
from .closures import Constraint
from .draft import Motor, draft
from .loops import Loops
from .mechanism import Mechanism
from .mobility import Mobility, judge
from .reference import Reference, ReferenceBackend

Array = NDArray[np.float64]
#: Makes what computes a mechanism; the tree is the owner's, whose gravity kernels watch.
Kernels = Callable[[Reference, pin.Model], Backend]
_MOVE = (
    "check kinds and axes of the closures; if another assembly moves, make it "
    'model.referenceConfigurations["home"]'
)


class CurrentMechanism:
    """The mechanism of a model as it stands now, and what computes its dynamics.

    Args:
        model: The tree; it stays its owner's.
        closures: What closes it.
        motors: What drives it.
        coordinates: Names of the independent joints; None to choose them.
        numbers: Friction and springs, as `draft` takes them.
        examine: Called with each model that is taken in; it raises an error for one that will not
            do.

    Attributes:
        model: The owner's tree.
        closures: What closes it.
        kernels: Makes the backend; None for the reference path.
        unseen: Whether the model was given away since it was looked at last.
        draft: The mechanism before its coordinates are settled.
        reference: Of the mechanism, or of its draft before.
        backend: What computes.
        has_kernels: Whether that is anything but the reference path.
        torques_of, accelerations_of: Of the backend.
        examined: What `examine` returned.

    Raises:
        DescriptionError, UnknownNameError, InputError: As `ClosedChain`.
    """

    def __init__(
        self,
        model: pin.Model,
        closures: tuple[Constraint, ...],
        motors: Sequence[Motor],
        coordinates: Sequence[str] | None,
        numbers: Mapping[str, ArrayLike | None],
        examine: Callable[[pin.Model], Any],
    ) -> None:
        self.model, self.closures = model, closures
        self._motors = motors
        self._wanted = None if coordinates is None else names("coordinates", coordinates)
        self._numbers, self._examine = numbers, examine
        self.kernels: Kernels | None = None
        self._inherited: tuple[str, ...] = ()  # coordinates that a copied chain has settled on
        self._lock = threading.Lock()
        self.take_in()

    def __getstate__(self) -> dict[str, Any]:
        of_the_model = ("draft", "reference", "backend", "torques_of", "accelerations_of")
        dropped = (*of_the_model, "_lock", "_generic", "_settled", "examined")
        state = {name: x for name, x in self.__dict__.items() if name not in dropped}
        if self._settled_by_caller and self.model == self.draft.model:
            state["_inherited"] = self._settled_names()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = threading.Lock()
        self.take_in()
        self._inherited = tuple(state["_inherited"])

    # --- the model --------------------------------------------------------------------------

    def take_in(self) -> None:
        """Compute from what stands in the model now."""
        self.examined = self._examine(self.model)
        self.draft = draft(
            pin.Model(self.model), self.closures, self._motors, self._wanted, **self._numbers
        )
        self._generic: Array | ClosureError | None = None
        self._settled: Mechanism | None = None
        self._settled_by_caller = False
        self._inherited = ()
        self.unseen = False
        self._use(Reference(self.draft))
        self.reference.workspace  # noqa: B018  (finds the frames, or says which is unknown)

    def look(self) -> None:
        """Take in a model that has changed."""
        self.unseen = False
        if self.model != self.draft.model:
            self.unseen = True  # until it is taken in: one that is refused stays so
            self.take_in()

    # --- coordinates ------------------------------------------------------------------------

    def mechanism(self, q: ArrayLike | None = None) -> Mechanism:
        """What is computed, its coordinates settled.

        They are settled once: at the first configuration of the caller's that closes the loops, or
        at a generic one while there was none.

        Raises:
            ClosureError: When there is neither.
            ActuationError: When the coordinates asked for do not describe the motion.
            DescriptionError: When nothing can move.
        """
        self.look()
        if self._settled is None or not (self._settled_by_caller or q is None):
            with self._lock:
                self._settle(q)
        assert self._settled is not None
        return self._settled

    def _settle(self, q: ArrayLike | None) -> None:
        if self._inherited and self._settled is None:
            self._adopt(self.draft.space.rates_of(self._inherited), by_caller=True)
            return
        own = None if q is None else self.first_closed(q)
        if own is None and self._settled is not None:
            return
        if own is None:
            report = self.mobility()
        else:
            try:
                aside = self.reference.workspace.assembly.aside(own, seed=0)
            except ClosureError:
                aside = own
            report = self._report(aside, "a configuration close to the first one in use")
        if report.degrees_of_freedom == 0:
            raise DescriptionError(
                f"model {self.draft.model.name}", [f"nothing can move; {_MOVE}:\n{report}"]
            )
        chosen = self.draft.space.rates_of(report.coordinates)
        if self._wanted is not None and set(chosen) != set(self.draft.coordinates):
            raise ActuationError(
                f"the coordinates {', '.join(self._wanted)} do not describe the motion, "
                f"use for example {', '.join(report.coordinates)}:\n{report}"
            )
        if self._wanted is not None:
            chosen = self.draft.coordinates
        self._adopt(chosen, by_caller=own is not None)

    def _adopt(self, chosen: NDArray[np.intp], *, by_caller: bool) -> None:
        if self._settled is None or not np.array_equal(chosen, self._settled.coordinates):
            settled = replace(self.draft, coordinates=chosen)
            self._use(Reference(settled))
            self._install(self._made(self.reference))
            self._settled = settled  # last: other threads read it without the lock
        self._settled_by_caller = by_caller

    def _settled_names(self) -> tuple[str, ...]:
        """Of the coordinates that are settled, or those that will be without a further look."""
        if self._settled is None:
            return self._inherited
        return self.draft.space.names_of(self._settled.coordinates.tolist())

    def first_closed(self, q: ArrayLike) -> Array | None:
        """The first of configurations, where its loops are closed."""
        array = np.asarray(q, dtype=float)
        if not array.size:
            return None
        first: Array = array[(0,) * (array.ndim - 1)]
        if not (np.isfinite(first).all() and self.draft.space.on_manifold(first)):
            return None
        loops = self.reference.workspace.loops
        loops.evaluate(first)
        try:
            loops.require_closed(self.draft.row_scale)
        except ClosureError:
            return None
        return first

    # --- what computes ----------------------------------------------------------------------

    def compute_by(self, kernels: Kernels, prepare: Callable[[Any], None]) -> None:
        """Put kernels in the place of what computes.

        Args:
            kernels: Makes them.
            prepare: Called with them before they are used.
        """
        backend = kernels(self.reference, self.model)
        prepare(backend)
        with self._lock:
            self.kernels = kernels
            self._install(backend)

    @property
    def settled(self) -> bool:
        """Whether the coordinates are settled."""
        return self._settled is not None

    def path(self) -> str:
        """What computes, and why."""
        with suppress(ClosureError):
            self.mechanism()
        return str(self.backend)

    def _made(self, reference: Reference) -> Backend:
        if self.kernels is None:
            return ReferenceBackend(reference, "no kernels yet; compile() makes them")
        try:
            return self.kernels(reference, self.model)
        except SSTError as error:
            return ReferenceBackend(reference, str(error))

    def _use(self, reference: Reference) -> None:
        self.reference = reference
        self.backend: Backend = ReferenceBackend(reference, "nothing was asked for yet")
        self.has_kernels = False
        self.torques_of: Callable[..., Answer] = _nothing
        self.accelerations_of: Callable[..., Answer] = _nothing

    def _install(self, backend: Backend) -> None:
        self.backend = backend
        self.has_kernels = not isinstance(backend, ReferenceBackend)
        self.torques_of, self.accelerations_of = backend.torques_of, backend.accelerations_of

    # --- configurations ---------------------------------------------------------------------

    def arguments(self, q: ArrayLike, **others: ArrayLike) -> tuple[Mechanism, list[Array]]:
        """Arguments of the shapes that the mechanism has; it is settled on the way.

        Args:
            q: Configurations, shape (..., nq).
            others: By name: `tau`, shape (..., motors), the others, shape (..., n).

        Raises:
            InputError: For another shape.
        """
        array = self.configurations(q)
        mechanism = self._settled
        if mechanism is None or not self._settled_by_caller:
            mechanism = self.mechanism(array)
        n, motors = len(mechanism.coordinates), mechanism.motors.shape[1]
        arrays = [array]
        for name, value in others.items():
            try:
                arrays.append(as_array(name, value, (motors if name == "tau" else n,)))
            except InputError as error:
                if name != "tau" and n != motors:
                    error.args = (
                        f"{error.args[0]}: one for each rate of the coordinates "
                        f"{', '.join(mechanism.coordinate_rate_names)}",
                    )
                raise
        return mechanism, arrays

    def configurations(self, q: ArrayLike) -> Array:
        """One or many, shape (..., nq), of the shape that the model has now."""
        self.look()
        return as_array("q", q, (self.draft.model.nq,))

    def single(self, q: ArrayLike) -> Array:
        """One configuration, on the manifold that the model has now."""
        self.look()
        array = single_array("q", q, (self.draft.model.nq,))
        self.draft.space.require_on_manifold(array)
        return array

    def guess(self, q: ArrayLike) -> Array:
        """A configuration to start from, or the way to it from `pin.neutral`, shape (nv,)."""
        self.look()
        model = self.draft.model
        if model.nv != model.nq and as_array("q", q, ()).shape == (model.nv,):
            q = pin.integrate(model, pin.neutral(model), single_array("q", q, (model.nv,)))
        return self.draft.space.normalised(single_array("q", q, (model.nq,)))

    def evaluated(self, q: ArrayLike) -> Loops:
        """This thread's loops at one configuration."""
        array = self.single(q)
        loops = self.reference.workspace.loops
        loops.evaluate(array)
        return loops

    def scaled_Phi(self, q: ArrayLike) -> Array:
        """Phi at one configuration, free of units, shape (rows, nv)."""
        return self.evaluated(q).Phi() * self.draft.row_scale[:, None] * self.draft.rate_scale

    def home(self) -> Array | None:
        """What the model calls home, with loops as open as they are there, shape (nq,)."""
        self.look()
        return home_of(self.draft)

    def call_home(self, q: Array) -> None:
        """Let the model call a configuration its home."""
        for model in (self.model, self.draft.model):
            model.referenceConfigurations["home"] = q

    def generic_configuration(self) -> Array:
        """As `ClosedChain.generic_configuration`."""
        self.look()
        found = self._generic
        if found is None:
            try:
                found = generic_configuration(self.reference.workspace.assembly)
            except ClosureError as error:
                found = error
            self._generic = found
        if isinstance(found, ClosureError):
            raise found
        return found.copy()

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """As `ClosedChain.mobility`."""
        if q is None:
            return self._report(self.generic_configuration(), "a random assembled configuration")
        return self._report(self.single(q), "the configuration given")

    def _report(self, q: Array, where: str) -> Mobility:
        loops, draft = self.evaluated(q), self.draft
        loops.require_closed(draft.row_scale)
        names = self._settled_names() or self._wanted or ()  # they stay, if they can
        wanted = [draft.space.rates_of([name]) for name in names]
        in_loops = np.flatnonzero(loops.touched.any(axis=0))
        return judge(draft, self.scaled_Phi(q), q, where, in_loops, wanted)


def _nothing(*_: object) -> None:
    return None
