# SPDX-License-Identifier: BSD-2-Clause
"""`ClosedLoops`: configurations of a mechanism, and those that close its loops."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Flags, as_array, for_each_sample, single_array
from ..errors import ClosureError
from ..model.mechanism import Mechanism
from ..model.thresholds import CLOSURE_TOLERANCE
from ..model.tree import frame_id
from .assembly import Assembly
from .examples import examples
from .finite_motions import finite_motions
from .guesses import home_of
from .loops import Loops
from .mobility import Mobility, judge
from .ranks import condition_number, scaled_Phi


class ClosedLoops:
    """Evaluates and closes the loops of one mechanism; it may be used from several threads.

    Args:
        mechanism: The mechanism.
        assembly: Returns the `Assembly` of the thread that calls, with its loops.
    """

    def __init__(self, mechanism: Mechanism, assembly: Callable[[], Assembly]) -> None:
        self.mechanism = mechanism
        self._assembly = assembly

    @property
    def assembly(self) -> Assembly:
        """Newton's method on the closures, of this thread."""
        return self._assembly()

    def configurations(self, q: ArrayLike) -> Array:
        """One or many configurations, shape (..., nq)."""
        return as_array("q", q, (self.mechanism.model.nq,))

    def single(self, q: ArrayLike) -> Array:
        """One configuration on the manifold, shape (nq,)."""
        array = single_array("q", q, (self.mechanism.model.nq,))
        self.mechanism.space.require_on_manifold(array)
        return array

    # --- at configurations ------------------------------------------------------------------

    def at(self, q: ArrayLike) -> Loops:
        """This thread's loops, evaluated at one configuration; the next call moves them on."""
        array = self.single(q)
        loops = self.assembly.loops
        loops.evaluate(array)
        return loops

    def residuals(self, q: Array) -> Array:
        """f(q) of Eq. (2), shape (..., rows)."""
        rows = (sum(len(closure.rows) for closure in self.mechanism.closures),)
        return for_each_sample(lambda q: self.at(q).f, [q], (1,), rows)

    def are_closed(self, q: Array) -> Flags:
        """Whether the loops are closed as far as the dynamics needs, shape (...)."""
        gaps = np.abs(self.residuals(q) * self.mechanism.row_scale)
        return np.asarray(gaps.max(axis=-1, initial=0.0) <= CLOSURE_TOLERANCE)

    def placements(self, q: ArrayLike, frame: str) -> Array:
        """Placement of a frame in the base where the loops are closed, shape (..., 4, 4)."""
        index = frame_id(self.mechanism.model, frame)
        scale = self.mechanism.row_scale

        def of_sample(q: Array) -> Array:
            loops = self.at(q)
            loops.require_closed(scale)
            return np.asarray(loops.data.oMf[index].homogeneous)

        return for_each_sample(of_sample, [self.configurations(q)], (1,), (4, 4))

    def condition_numbers(self, q: Array) -> Array:
        """Condition numbers of the dependent part of Phi, shape (...)."""
        mechanism = self.mechanism
        loops = self.assembly.loops
        parts = loops.parts(mechanism.coordinates)  # which share no row and no dependent rate

        def of_sample(q: Array) -> Array:
            Phi = scaled_Phi(mechanism, loops, self.single(q))
            return np.asarray(condition_number(mechanism, Phi, parts))

        return for_each_sample(of_sample, [q], (1,), ())

    def mobility(self, q: ArrayLike | None = None) -> Mobility:
        """Degrees of freedom and motors; see `ClosedChain.mobility`."""
        if q is None:
            configuration = self.example()
            where = "a random assembled configuration"
        else:
            configuration = self.single(q)
            where = "the configuration given"
        self.at(configuration).require_closed(self.mechanism.row_scale)
        motions = finite_motions(self.assembly, configuration)
        return judge(self.mechanism, self.assembly.loops, configuration, where, motions)

    # --- closed configurations --------------------------------------------------------------

    @cached_property
    def home(self) -> Array | None:
        """The home of the model with closed loops, shape (nq,); None without one."""
        mechanism = self.mechanism
        q = home_of(mechanism)
        if q is None:
            return None
        try:
            self.at(q).require_closed(mechanism.row_scale)
        except ClosureError:
            return self.assembly.closed(q)
        return q

    def example(self) -> Array:
        """A configuration with closed loops and without symmetry, shape (nq,)."""
        if self.mechanism.example is None:
            return next(examples(self.assembly))
        return self.mechanism.example.copy()

    def closed(self, q: Array) -> Array:
        """The closed configuration near q with the coordinates fixed, shape (nq,)."""
        return self.assembly.closed(q)
