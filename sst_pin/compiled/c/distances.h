/* SPDX-License-Identifier: BSD-2-Clause */
/* The distance of two configurations, for LANES robots at once, in C and in Warp: the largest
 * change of an entry of q, times its unit. It is NaN if a change is. */
HELPER real distance_between(int nq, const number *units, const real *from, const real *to)
{
    real largest = {0};
    for (int j = 0; j < nq; j++) {
        const real change = ABSOLUTE(to[j] - from[j]) * units[j];
        largest = choose(change <= largest, largest, change); /* NaN is taken */
    }
    return largest;
}
