/* SPDX-License-Identifier: BSD-2-Clause */
/* From rates to the configuration at the end of a nonsmooth step, for LANES robots at once, in C
 * and in Warp. The generated kernels `advance` (rates of q) and `closing` (a step of Newton's
 * method onto the closures) come before it. */

/* When a step is sound. Distances of configurations are free of units, see distances.h. */
typedef struct {
    int q;
    const number *units;
    number bend, tolerance; /* closing the loops moves q by at most bend * step + tolerance */
    number travel;          /* longest step */
    number change, least;   /* largest factor by which |det Phi_u| changes, and its least value */
} bounds_of_step;

/* The most steps of Newton's method onto the closures. */
#define MOVE_CLOSING_STEPS 4

/* The inputs x = (q, va) of the kernels have q at the start of a step and va at its end; q becomes
 * that at the end: q + h q_dot, then Newton's method onto the closures with the coordinates held.
 * `det` is det Phi_u at the start, and becomes that at the end. Returns the lanes whose step is
 * sound. `y` is workspace for results of the kernels, `ends` for two configurations. */
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
    const real det_at_start = *det;
    mask open = det_at_start == det_at_start; /* in all lanes but those that have failed */
    for (int step = 0; step < MOVE_CLOSING_STEPS && some(open); step++) {
        closing(x, p, y);
        *det = choose(open, y[nq], *det);
        const mask is_long = distance_between(nq, f->units, x, y) > LAST_STEP;
        for (int j = 0; j < nq; j++)
            x[j] = choose(open, y[j], x[j]);
        open &= is_long;
    }
    const real length = distance_between(nq, f->units, start, x);
    const real correction = distance_between(nq, f->units, ahead, x);
    const real ratio = *det / det_at_start;
    return (length <= f->travel) & (correction <= f->bend * length + f->tolerance)
        & (ratio < f->change) & (ratio > 1 / f->change) & (ABSOLUTE(*det) > f->least);
}
