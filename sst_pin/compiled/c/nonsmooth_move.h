/* SPDX-License-Identifier: BSD-2-Clause */
/* From rates to the configuration at the end of a nonsmooth step, for LANES robots at once, in C and
 * in Warp. The generated kernels `advance` and `closing` stand before it. */

/* What bounds a step; numbers of q times `units` are free of units. */
typedef struct {
    int q;
    const number *units;
    number bend, tolerance; /* the loops are closed by at most bend times the step + tolerance */
    number travel;          /* longest step */
    number change, least;   /* largest factor by which det Phi_u changes, and its least value */
} bounds_of_step;

/* The most steps of Newton's method onto the closures. */
#define MOVE_CLOSING_STEPS 4

/* q at the end of a step with the rates va at its end, in the inputs x = q, va of the kernels:
 * q + h q_dot, then Newton's method onto the closures with the coordinates held. `det` is det Phi_u at
 * the start, and becomes that at the end. Returns where the step is sound. `y` is room for results of
 * the kernels, `ends` for two configurations. */
HELPER mask move_and_close(const bounds_of_step *f, parameters p, number h, real *x, real *y,
    real *ends, real *det)
{
    const int nq = f->q;
    real *start = ends, *ahead = ends + nq; /* q before the step, and before the loops are closed */
    advance(x, p, y);
    for (int j = 0; j < nq; j++) {
        start[j] = x[j];
        x[j] = ahead[j] = x[j] + h * y[j];
    }
    const real before = *det;
    mask open = before == before;
    for (int step = 0; step < MOVE_CLOSING_STEPS && some(open); step++) {
        closing(x, p, y);
        *det = choose(open, y[nq], *det);
        const mask far = longest_way(nq, f->units, x, y) > LAST_STEP;
        for (int j = 0; j < nq; j++)
            x[j] = choose(open, y[j], x[j]);
        open &= far;
    }
    const real way = longest_way(nq, f->units, start, x), opened = longest_way(nq, f->units, ahead, x);
    const real ratio = *det / before;
    return (way <= f->travel) & (opened <= f->bend * way + f->tolerance)
        & (ratio < f->change) & (ratio > 1 / f->change) & (ABSOLUTE(*det) > f->least);
}
