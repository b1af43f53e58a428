# SPDX-License-Identifier: BSD-2-Clause
"""Low-pass filters of samples at even times, without delay, and what they do to noise.

Frequencies are in periods per sample: half a period per sample is the most that samples can show.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array

#: Order of the Butterworth filter.
_ORDER = 4
#: Cut-off of the filter of `decimated`, in periods per sample of the result; below 0.5, so that
#: faster changes do not appear as slower ones.
_ANTI_ALIASING = 0.4
#: A sample affects this number of outputs of the filter of `decimated`.
_MEMORY = 20


def lowpass(values: Array, cutoff: float, ends: str = "odd") -> Array:
    """Values filtered forwards and backwards along axis 0; the cut-off is in periods per sample.

    `ends` says how the values are continued beyond their ends: "odd", reflected about the last
    value, or "even", mirrored.
    """
    from scipy.signal import butter, sosfiltfilt

    # The ends are continued by three periods of the cut-off: then the filter has almost settled.
    beyond = min(int(3 / cutoff), len(values) - 1)
    sections = butter(_ORDER, cutoff, fs=1.0, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0, padtype=ends, padlen=beyond))


def decimated(values: Array, every: int) -> Array:
    """One of `every` samples, after a low-pass filter for that rate.

    The filter mirrors the values at both ends. The first and the last sample, which have more
    noise, are left out.
    """
    if every == 1:
        return values
    return lowpass(values, _ANTI_ALIASING / every, "even")[::every][1:-1]


def noise_correlations(every: int) -> Array:
    """Correlations of filtered noise in samples of `decimated` that are 1, 2, ... apart."""
    if every == 1:
        return np.empty(0)
    # Filtered white noise has the autocorrelation of the filter's impulse response. In the result
    # of `correlate`, entry len(response) - 1 is that of lag 0.
    impulse = np.zeros(2 * _MEMORY * every + 1)
    impulse[_MEMORY * every] = 1.0
    response = lowpass(impulse, _ANTI_ALIASING / every)
    lags = np.correlate(response, response, "full")[len(response) - 1 :: every][:_MEMORY]
    return np.asarray(lags[1:] / lags[0])
