/* SPDX-License-Identifier: BSD-2-Clause */
/* Nonsmooth motions of many robots, LANES at once. */
#include <stdlib.h>

/* The most series of sweeps and Newton's steps in a step. */
#define SERIES 30

/* Steps of many motions. `x` are the inputs q, va and load of the kernels, `start` has room for two
 * of q. Motion k ends where a check fails; `reached` gets its number of steps. */
static void nonsmooth_roll(const rows_of_robot *r, const bounds_of_step *bounds, const double *p,
    const double *numbers, double h, ptrdiff_t steps, ptrdiff_t count, const double *tau,
    const double *held, const double *load, double *q, double *va, double *forces, double *residual,
    double *impulses, ptrdiff_t *reached, real *x, real *y, real *start, double *work, int *flags,
    double *one)
{
    const int nq = r->q, n = r->n, m = r->m, motors = r->motors;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? (int)(count - first) : LANES;
        int alive[LANES], any = 1;
        for (int l = 0; l < LANES; l++) {
            const ptrdiff_t k = first + (l < lanes ? l : lanes - 1);
            alive[l] = l < lanes;
            for (int j = 0; j < nq; j++)
                LANE(x[j], l) = q[k * (steps + 1) * nq + j];
            for (int j = 0; j < n; j++)
                LANE(x[nq + j], l) = va[k * (steps + 1) * n + j];
            for (int j = 0; j < r->load; j++)
                LANE(x[nq + n + j], l) = load[k * r->load + j];
        }
        closing(x, p, y);
        real det = y[nq];
        for (ptrdiff_t s = 0; s < steps && any; s++) {
            nonsmooth_terms(x, p, y);
            const mask good = judge(x, nq, nq + n + r->load, y, r->outputs, r->checks);
            for (int l = 0; l < lanes; l++) {
                const ptrdiff_t k = first + l, step = k * steps + s;
                if (!alive[l])
                    continue;
                double *terms = one, *now = one + r->outputs, *rates = now + nq;
                for (int j = 0; j < r->outputs; j++)
                    terms[j] = LANE(y[j], l);
                for (int j = 0; j < nq; j++)
                    now[j] = LANE(x[j], l);
                for (int j = 0; j < n; j++)
                    rates[j] = LANE(x[nq + j], l);
                alive[l] = LANE(good, l) && (s || starts_free(r, terms, now, numbers, 1))
                    && nonsmooth_step(r, terms, now, rates, tau + step * motors,
                        held + step * motors, h, numbers, SERIES, impulses + k * m, residual + step,
                        work, flags);
                if (!alive[l])
                    continue;
                for (int j = 0; j < m; j++)
                    forces[step * m + j] = impulses[k * m + j] / h;
                for (int j = 0; j < n; j++)
                    LANE(x[nq + j], l) = rates[j];
            }
            const mask sound = move_and_close(bounds, p, h, x, y, start, &det);
            any = 0;
            for (int l = 0; l < lanes; l++) {
                const ptrdiff_t k = first + l;
                alive[l] = alive[l] && LANE(sound, l);
                if (!alive[l])
                    continue;
                any = 1;
                reached[k] = s + 1;
                for (int j = 0; j < nq; j++)
                    q[(k * (steps + 1) + s + 1) * nq + j] = LANE(x[j], l);
                for (int j = 0; j < n; j++)
                    va[(k * (steps + 1) + s + 1) * n + j] = LANE(x[nq + j], l);
            }
        }
    }
}
