# SPDX-License-Identifier: BSD-2-Clause
"""Replaces outliers in a log of positions and torques.

An outlier is a sample that is far from the smooth curve through the log, by far more than is usual
in its part of the log. A torque must also be far from the median of its neighbours, so that jumps
of the torques stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Flags
from ..errors import InputError
from .filters import lowpass

#: Deviations from the smooth curve are compared with their median in parts of the log. A part has
#: at least this number of periods of the cut-off, and of samples: of 141 samples, the median gives
#: the standard deviation of normal noise to 10 %.
_PART_PERIODS = 10
_PART_SAMPLES = 141
#: An outlier is farther from the smooth curve than this multiple of the usual deviation. Of normal
#: noise, no sample in 10^14 is so far away.
_OUTLIER = 8.0
#: Standard deviation of normal noise, in units of the median of its absolute values.
_DEVIATION_OF_MEDIAN = 1.4826
#: Deviations below this fraction of the range of a column are no outliers, however small its noise.
_LEAST_DEVIATION = 1e-3
#: In each pass at most one outlier in this number of samples is replaced: a bad sample bends the
#: curve at its neighbours too.
_NEIGHBOURS = 7
#: Most passes.
_PASSES = 60
#: A torque is compared with the median of this number of samples. The log is interpolated at even
#: times: one bad sample spoils up to three of seven, so that the median is still good.
_MEDIAN_SAMPLES = 7
#: Largest fraction of the samples that may be outliers; more would spoil the smooth curve.
_MOST_OUTLIERS = 0.05


class CleanedLog(NamedTuple):
    """A log without outliers, each array of shape (N, columns)."""

    #: The samples; outliers are replaced.
    values: Array
    #: The smooth curve through them.
    smooth: Array
    #: Which samples were outliers.
    replaced: Flags


def without_outliers(log: Array, positions: int, cutoff: float) -> CleanedLog:
    """Replace outliers, positions by the smooth curve and torques by the median.

    They are replaced in passes: a bad sample bends the curve at its neighbours too, so in each pass
    only the sample that is farthest from the curve among its neighbours is replaced.

    Args:
        log: Samples, shape (N, columns).
        positions: How many columns are positions; the others are torques.
        cutoff: Cut-off of the smooth curve, in periods per sample.
    """
    from scipy.ndimage import maximum_filter1d, median_filter

    values = log.copy()
    replaced = np.zeros(values.shape, bool)
    parts = max(1, int(len(values) / max(_PART_SAMPLES, _PART_PERIODS / cutoff)))
    for _ in range(_PASSES):
        curve = lowpass(values, cutoff)
        deviations = np.abs(values - curve)
        usual = _DEVIATION_OF_MEDIAN * _medians(deviations, parts)
        # Positions are replaced by the curve, torques by the median, which keeps jumps.
        substitutes = curve.copy()
        torques = values[:, positions:]
        substitutes[:, positions:] = median_filter(torques, (_MEDIAN_SAMPLES, 1), mode="nearest")
        # A torque must be far from both, the curve and the median.
        deviations = np.minimum(deviations, np.abs(values - substitutes))

        least = _LEAST_DEVIATION * np.ptp(curve, axis=0)
        outliers = deviations > _OUTLIER * np.maximum(usual, least)
        outliers &= deviations >= maximum_filter1d(deviations, _NEIGHBOURS, axis=0)
        if not outliers.any():
            break
        values[outliers] = substitutes[outliers]
        replaced |= outliers
    return CleanedLog(values, curve, replaced)


def _medians(deviations: Array, parts: int) -> Array:
    """The median of each column in each part of the samples, repeated for all its samples."""
    medians = np.empty(deviations.shape)
    for rows in np.array_split(np.arange(len(deviations)), parts):
        medians[rows] = np.median(deviations[rows], axis=0)
    return medians


def require_few_replaced(
    names: Sequence[str], is_torque: Sequence[bool], t: Array, replaced: Flags, longest: float
) -> None:
    """Check that few samples are replaced, and for short times only.

    Args:
        names: Names of the columns.
        is_torque: Which of them are torques; the others are positions.
        t: Times of the samples, shape (N,), [s].
        replaced: Which samples were replaced, shape (N, columns).
        longest: Samples in a row may be replaced for less than this time, [s].
    """
    from scipy.ndimage import find_objects, label

    for k, name in enumerate(names):
        column = replaced[:, k]
        argument = "tau" if is_torque[k] else "x"
        for (run,) in find_objects(label(column)[0]):
            if t[run.stop - 1] - t[run.start] >= longest:
                problem = f"{name} jumps, or is faster than the cut-off frequency"
                cure = "clean the log or split it there"
                raise InputError(argument, f"{problem}, at {t[run.start]:.6g} s; {cure}")
        count = int(column.sum())
        if count > _MOST_OUTLIERS * len(t):
            problem = f"{count} of {len(t)} samples of {name} are outliers"
            cure = "clean the log, or choose a higher cut-off frequency"
            raise InputError(argument, f"{problem}: {cure}")
