# SPDX-License-Identifier: BSD-2-Clause
"""The compiled kernels.

Arrays are float64, aligned, of shape (core) or (n, core); without the first axis one goes with all
n samples. The answer of a method is None when an argument is anything else: no error, no numbers.
Otherwise it is (flags, results); flags, shape () or (n,), are True for samples whose results mean
nothing, and None when there are none such. Only a moment may be None: there is none then.
"""

from typing import final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Answer = tuple[NDArray[np.bool_] | None, _Array] | None

#: What the kernels are compiled for.
instructions: str

@final
class Kernels:
    """The kernels with the numbers of one robot, shape (146,), see `packing`.

    `gravity`, shape (3,), is the memory of the model in which its gravity stands, `model` keeps it
    alive: when it changes, `inverse_dynamics`, `direct_dynamics` and `reduced_terms` answer None.

    Results go to `out`, shape (core) or (n, core), which shares no memory with the inputs, or to a
    new array when it is None.
    """

    def __new__(cls, parameters: _Array, gravity: _Array, model: object, /) -> Kernels: ...
    def inverse_dynamics(
        self,
        q: object,
        va: object,
        aa: object,
        moment: object,
        out: object,
        threads: object,
        /,
    ) -> _Answer:
        """Torques, (3), of q (9), va (3), aa (3), moment on the star (3)."""

    def direct_dynamics(
        self,
        q: object,
        va: object,
        tau: object,
        moment: object,
        out: object,
        threads: object,
        /,
    ) -> _Answer:
        """Accelerations of the motors, (3), of q (9), va (3), tau (3), moment on the star (3)."""

    def reduced_terms(self, q: object, va: object, out: object, threads: object, /) -> _Answer:
        """Inertia and Coriolis matrices, gravity, friction, (24), of q (9) and va (3)."""

    def close(self, q: object, /) -> _Answer:
        """q (9) after a step of Newton's method towards the closures, flags of q before it."""

    def determinant(self, q: object, /) -> _Answer:
        """det A, (1), of q (9)."""

    def rate(self, state: object, tau: object, moment: object, /) -> _Answer:
        """Rates, (12), of states (q, va), (12), under tau (3) and the moment on the star (3)."""

    def rollout(
        self,
        dt: float,
        q0: _Array,
        va0: _Array,
        tau: _Array,
        moment: _Array | None,
        q: _Array,
        va: _Array,
        reached: NDArray[np.intp],
        threads: int,
        /,
    ) -> bool:
        """Fill the states of n motions of N steps; count those that hold.

        Args:
            dt: Step, [s].
            q0: Shape (n, 9).
            va0: Shape (n, 3).
            tau: Shape (n, N, 3), held over each step, or (n, 2 N + 1, 3), at the ends and in the
                middles of the steps.
            moment: On the star, shape (n, 3), or None.
            q: To be filled, shape (n, N + 1, 9).
            va: To be filled, shape (n, N + 1, 3).
            reached: Zeros to be filled, shape (n,).
            threads: How many share the motions.

        Returns:
            Whether any motion stopped early.

        Raises:
            TypeError: For what is no array.
            ValueError: For arrays that do not fit together.
        """
