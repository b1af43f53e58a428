/* SPDX-License-Identifier: BSD-2-Clause */
/* Nonsmooth motions of many robots. The generated kernels take LANES of them at once, the solver of the
 * impulses takes them one by one. */
#include <stdlib.h>

/* The most series of the solver in a step. */
#define SERIES 30

/* Motions of `count` robots in `steps` steps of length h, [s]; arrays are row-major. */
typedef struct {
    double h;
    ptrdiff_t steps, count;
    const double *tau, *held;  /* torques, and positions that gains hold: (count, steps, motors) */
    const double *load;        /* external wrenches, (count, load) */
    double *q, *va;            /* states, (count, steps + 1, nq or n); the first ones are the starts */
    double *forces, *residual; /* results, (count, steps, m) and (count, steps) */
    double *impulses;          /* of the last step, where the next one starts, (count, m) */
    ptrdiff_t *reached;        /* the steps that each motion has made, (count,) */
} motions;

/* Workspace: x are the inputs q, va and load of the kernels, y is for their results, `ends` for two
 * configurations, `one` for terms, q and va of one robot, `work` and `flags` for `nonsmooth_step`. */
typedef struct {
    real *x, *y, *ends;
    double *one, *work;
    int *flags;
} workspace;

/* Take the starts of motions from `first` on into the lanes; the last one fills lanes that are left. */
static void take_starts(
    const rows_of_robot *r, const motions *all, ptrdiff_t first, int lanes, real *x)
{
    for (int l = 0; l < LANES; l++) {
        const ptrdiff_t k = first + (l < lanes ? l : lanes - 1);
        for (int j = 0; j < r->q; j++)
            LANE(x[j], l) = all->q[k * (all->steps + 1) * r->q + j];
        for (int j = 0; j < r->n; j++)
            LANE(x[r->q + j], l) = all->va[k * (all->steps + 1) * r->n + j];
        for (int j = 0; j < r->load; j++)
            LANE(x[r->q + r->n + j], l) = all->load[k * r->load + j];
    }
}

/* Make step s of motion k, which is in lane l: its rates in x become those at the end of the step.
 * Returns false if the start of the motion is violated, or the step fails. */
static int step_one(const rows_of_robot *r, const motions *all, const double *numbers, ptrdiff_t k,
    ptrdiff_t s, int l, const workspace *w)
{
    const ptrdiff_t step = k * all->steps + s;
    double *terms = w->one, *q = terms + r->outputs, *va = q + r->q;
    double *impulses = all->impulses + k * r->m;
    for (int j = 0; j < r->outputs; j++)
        terms[j] = LANE(w->y[j], l);
    for (int j = 0; j < r->q; j++)
        q[j] = LANE(w->x[j], l);
    for (int j = 0; j < r->n; j++)
        va[j] = LANE(w->x[r->q + j], l);
    if (s == 0 && !starts_free(r, terms, q, numbers, 1))
        return 0;
    if (!nonsmooth_step(r, terms, q, va, all->tau + step * r->motors, all->held + step * r->motors,
            all->h, numbers, SERIES, impulses, all->residual + step, w->work, w->flags))
        return 0;
    for (int j = 0; j < r->m; j++)
        all->forces[step * r->m + j] = impulses[j] / all->h;
    for (int j = 0; j < r->n; j++)
        LANE(w->x[r->q + j], l) = va[j];
    return 1;
}

/* Keep the state of lane l as that of motion k after step s. */
static void keep_state(
    const rows_of_robot *r, const motions *all, ptrdiff_t k, ptrdiff_t s, int l, const real *x)
{
    const ptrdiff_t state = k * (all->steps + 1) + s + 1;
    for (int j = 0; j < r->q; j++)
        all->q[state * r->q + j] = LANE(x[j], l);
    for (int j = 0; j < r->n; j++)
        all->va[state * r->n + j] = LANE(x[r->q + j], l);
    all->reached[k] = s + 1;
}

/* Steps of many motions; a motion ends where a check fails. `numbers` are those of nonsmooth_step.h. */
static void nonsmooth_roll(const rows_of_robot *r, const bounds_of_step *bounds, const double *p,
    const double *numbers, const motions *all, const workspace *w)
{
    real *x = w->x, *y = w->y;
    for (ptrdiff_t first = 0; first < all->count; first += LANES) {
        const int lanes = all->count - first < LANES ? (int)(all->count - first) : LANES;
        int alive[LANES], any = 1;
        for (int l = 0; l < LANES; l++)
            alive[l] = l < lanes;
        take_starts(r, all, first, lanes, x);
        closing(x, p, y);
        real det = y[r->q];
        for (ptrdiff_t s = 0; s < all->steps && any; s++) {
            nonsmooth_terms(x, p, y);
            const mask good = judge(x, r->q, r->q + r->n + r->load, y, r->outputs, r->checks);
            for (int l = 0; l < lanes; l++)
                alive[l] = alive[l] && LANE(good, l)
                    && step_one(r, all, numbers, first + l, s, l, w);
            const mask sound = move_and_close(bounds, p, all->h, x, y, w->ends, &det);
            any = 0;
            for (int l = 0; l < lanes; l++) {
                alive[l] = alive[l] && LANE(sound, l);
                any |= alive[l];
                if (alive[l])
                    keep_state(r, all, first + l, s, l, x);
            }
        }
    }
}
