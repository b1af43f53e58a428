/* SPDX-License-Identifier: BSD-2-Clause */
/* The longest way of a joint between two configurations, free of units, for LANES robots at once, in
 * C and in Warp; NaN stays. */
HELPER real longest_way(int q, const number *units, const real *from, const real *to)
{
    real longest = {0};
    for (int j = 0; j < q; j++) {
        const real way = ABSOLUTE(to[j] - from[j]) * units[j];
        longest = choose(way <= longest, longest, way);
    }
    return longest;
}
