/* SPDX-License-Identifier: BSD-2-Clause */
/* Nonsmooth motions of many robots. The generated kernels compute LANES of them at once, the solver
 * of the impulses computes one after the other. */
#include <stdlib.h>

/* The most series of the solver in a step. */
#define SERIES 30

/* Motions of `count` robots in `steps` steps of length h, [s]; arrays are row-major. */
typedef struct {
    double h;
    ptrdiff_t steps, count;
    const double *tau, *held;  /* torques, and positions that gains hold: (count, steps, motors) */
    const double *load;        /* external wrenches, (count, load) */
    double *q, *va;            /* states, (count, steps + 1, nq or n); first the starts */
    double *forces, *residual; /* results, (count, steps, m) and (count, steps) */
    double *impulses;          /* (count, m): where the solver starts, then of the last step */
    ptrdiff_t *reached;        /* number of steps that each motion has made, (count,) */
} motions;

/* Workspace. Of LANES robots: the inputs x = (q, va, load) of the kernels, their results y, and two
 * configurations `ends`. Of one robot: its terms, q and va; `work` and `flags` of
 * `nonsmooth_step`. */
typedef struct {
    real *x, *y, *ends;
    double *terms, *q, *va;
    double *work;
    int *flags;
} workspace;

/* Pack the starts of motions from `first` on into x. */
static void take_starts(
    const robot_tables *r, const motions *all, ptrdiff_t first, int lanes, real *x)
{
    const ptrdiff_t states = all->steps + 1, number_size = sizeof(double);
    const sample_array q = {(char *)all->q, states * r->q * number_size, number_size};
    const sample_array va = {(char *)all->va, states * r->n * number_size, number_size};
    const sample_array load = {(char *)all->load, r->load * number_size, number_size};
    take(x, &q, first, lanes, r->q);
    take(x + r->q, &va, first, lanes, r->n);
    take(x + r->q + r->n, &load, first, lanes, r->load);
}

/* Make step s of motion k, which is in lane l: its rates in x become those at the end of the step.
 * Returns false if the motion must not start there, or if the step fails. */
static int step_one(const robot_tables *r, const motions *all, const double *numbers, ptrdiff_t k,
    ptrdiff_t s, int l, const workspace *w)
{
    const ptrdiff_t step = k * all->steps + s;
    const double *tau = all->tau + step * r->motors, *held = all->held + step * r->motors;
    double *impulses = all->impulses + k * r->m, *residual = all->residual + step;
    for (int j = 0; j < r->outputs; j++)
        w->terms[j] = LANE(w->y[j], l);
    for (int j = 0; j < r->q; j++)
        w->q[j] = LANE(w->x[j], l);
    for (int j = 0; j < r->n; j++)
        w->va[j] = LANE(w->x[r->q + j], l);
    if (s == 0 && !may_start(r, w->terms, w->q, numbers, 1))
        return 0;
    if (!nonsmooth_step(r, w->terms, w->q, w->va, tau, held, all->h, numbers, SERIES, impulses,
            residual, w->work, w->flags))
        return 0;
    for (int j = 0; j < r->m; j++)
        all->forces[step * r->m + j] = impulses[j] / all->h;
    for (int j = 0; j < r->n; j++)
        LANE(w->x[r->q + j], l) = w->va[j];
    return 1;
}

/* Save the state of lane l as that of motion k after step s. */
static void save_state(
    const robot_tables *r, const motions *all, ptrdiff_t k, ptrdiff_t s, int l, const real *x)
{
    const ptrdiff_t state = k * (all->steps + 1) + s + 1;
    for (int j = 0; j < r->q; j++)
        all->q[state * r->q + j] = LANE(x[j], l);
    for (int j = 0; j < r->n; j++)
        all->va[state * r->n + j] = LANE(x[r->q + j], l);
    all->reached[k] = s + 1;
}

/* Make the steps of all motions; a motion ends where a check fails. `numbers` are the physical
 * parameters that nonsmooth_step.h lists, p the parameters of the kernels. */
static void nonsmooth_roll(const robot_tables *r, const bounds_of_step *bounds, const double *p,
    const double *numbers, const motions *all, const workspace *w)
{
    real *x = w->x, *y = w->y;
    for (ptrdiff_t first = 0; first < all->count; first += LANES) {
        const int lanes = all->count - first < LANES ? (int)(all->count - first) : LANES;
        int alive[LANES], any_alive = 1; /* motions that have not ended */
        for (int l = 0; l < LANES; l++)
            alive[l] = l < lanes;
        take_starts(r, all, first, lanes, x);
        closing(x, p, y);
        real det = y[r->q];
        for (ptrdiff_t s = 0; s < all->steps && any_alive; s++) {
            nonsmooth_terms(x, p, y);
            const mask good = judge(x, r->q, r->q + r->n + r->load, y, r->outputs, r->checks);
            for (int l = 0; l < lanes; l++)
                alive[l] = alive[l] && LANE(good, l)
                    && step_one(r, all, numbers, first + l, s, l, w);
            const mask sound = move_and_close(bounds, p, all->h, x, y, w->ends, &det);
            any_alive = 0;
            for (int l = 0; l < lanes; l++) {
                alive[l] = alive[l] && LANE(sound, l);
                any_alive |= alive[l];
                if (alive[l])
                    save_state(r, all, first + l, s, l, x);
            }
        }
    }
}
