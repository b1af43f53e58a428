/* SPDX-License-Identifier: BSD-2-Clause */
/* From rates to the configuration at the end of a nonsmooth step, for LANES robots at once, in C and
 * in Warp. The generated kernels `advance` and `closing` stand before it. */

/* What bounds a step: factors that make q free of units, the largest correction that closes the
 * loops relative to the step, and beside it, the longest step, the largest change of det Phi_u, a
 * factor, and the least det Phi_u. */
typedef struct {
    int q;
    const number *units;
    number bend, tolerance, travel, change, least;
} bounds_of_step;

/* The inputs x = q, va of the kernels get the closed configuration after h seconds with these rates;
 * `det` is det Phi_u there, and was that at the start. Returns where the step is sound. `y` is room
 * for results of the kernels, `start` for two configurations. */
HELPER mask move_and_close(const bounds_of_step *f, parameters p, number h, real *x, real *y,
    real *start, real *det)
{
    const int nq = f->q;
    real *ahead = start + nq;
    advance(x, p, y);
    for (int j = 0; j < nq; j++) {
        start[j] = x[j];
        x[j] = ahead[j] = x[j] + h * y[j];
    }
    const real before = *det;
    mask open = before == before;
    for (int step = 0; step < 4 && some(open); step++) {
        closing(x, p, y);
        *det = choose(open, y[nq], *det);
        const mask far = longest_way(f->q, f->units, x, y) > LAST_STEP;
        for (int j = 0; j < nq; j++)
            x[j] = choose(open, y[j], x[j]);
        open &= far;
    }
    const real way = longest_way(f->q, f->units, start, x), ratio = *det / before;
    return (way <= f->travel) & (ratio < f->change) & (ratio > 1 / f->change)
        & (ABSOLUTE(*det) > f->least) & (longest_way(f->q, f->units, ahead, x) <= f->bend * way + f->tolerance);
}
