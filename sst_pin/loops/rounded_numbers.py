# SPDX-License-Identifier: BSD-2-Clause
"""To how many digits the numbers of a file are rounded."""

import numpy as np

from ..arrays import Array

#: A number is rounded if it has fewer digits after the point than this.
_DIGITS = 9
#: Numbers count as rounded to k digits if more than this part of them have at most k digits after
#: the point. The other numbers may be products of rounded ones. A choice: also with 0.1 or 0.5, all
#: robots of tests/loops/test_rounded_numbers.py are corrected.
_MANY = 0.25
#: A number counts as whole if it differs by less than this from a whole number. A random number
#: does so with a probability of 2e-4.
_WHOLE = 1e-4


def half_a_digit(numbers: Array) -> float:
    """Half a unit of the last digit of rounded numbers; 0 if they are not rounded.

    Exact short numbers, such as 0.25, count as rounded, as they look the same in a file.
    """
    numbers = np.abs(numbers[np.abs(numbers) > 10.0**-_DIGITS])
    for digits in range(1, _DIGITS):
        shifted = numbers * 10.0**digits  # whole, if the numbers have at most `digits` digits
        # Numbers that are almost 0, such as pi - 3.14159, would count as whole.
        shifted = shifted[shifted > _WHOLE]
        is_whole = np.abs(shifted - shifted.round()) < _WHOLE
        if len(shifted) and np.mean(is_whole) > _MANY:
            return 0.5 * 10.0**-digits
    return 0.0
