# SPDX-License-Identifier: BSD-2-Clause
# cython: language_level=3
"""Has Cython compile `calls.py`."""

cdef extern from *:
    """
    const char made_of[] = MADE_OF;  /* the hash of the sources when they were compiled */
    """
