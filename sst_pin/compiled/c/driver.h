/* SPDX-License-Identifier: BSD-2-Clause */
/* Rows of samples in, LANES samples at once through a kernel, rows out, with a verdict on each. real.h
 * and ways.h stand before it. */
#include <stddef.h>
#include <string.h>

/* An array of samples, its numbers `column` bytes apart, its samples `row` bytes. */
typedef struct {
    char *data;
    ptrdiff_t row, column;
} rows;

#define INLINE static inline __attribute__((always_inline))

/* Take samples from `first` on into the lanes of x. The last sample fills lanes that are left; an array
 * that is not there is zeros. */
INLINE void take_at_distance(
    real *x, const rows *from, ptrdiff_t first, int lanes, int size, ptrdiff_t column)
{
    const char *at[LANES];
    if (!from->data || lanes == 1) {
        const char *sample = from->data + first * from->row;
        for (int j = 0; j < size; j++)
            x[j] = (real){0} + (from->data ? *(const double *)(sample + j * column) : 0.0);
        return;
    }
    for (int l = 0; l < LANES; l++)
        at[l] = from->data + (first + (l < lanes ? l : lanes - 1)) * from->row;
    for (int j = 0; j < size; j++) {
        real numbers;
        for (int l = 0; l < LANES; l++)
            LANE(numbers, l) = *(const double *)(at[l] + j * column);
        x[j] = numbers;
    }
}

INLINE void take(real *x, const rows *from, ptrdiff_t first, int lanes, int size)
{
    if (from->column == sizeof(double)) /* a constant, with which the compiler unrolls the loops */
        take_at_distance(x, from, first, lanes, size, sizeof(double));
    else
        take_at_distance(x, from, first, lanes, size, from->column);
}

/* Give the lanes of y to samples from `first` on. */
INLINE void give(const real *y, const rows *to, ptrdiff_t first, int lanes, int size)
{
    for (int l = 0; l < lanes; l++) {
        char *at = to->data + (first + l) * to->row;
        for (int j = 0; j < size; j++)
            *(double *)(at + j * to->column) = LANE(y[j], l);
    }
}

/* Where the results y are valid: the angles in x are small enough for sines, all numbers are finite,
 * and all checks, which are behind the outputs, are at most 1. */
INLINE mask judge(const real *x, int angles, int inputs, const real *y, int outputs, int checks)
{
    real squares = {0}, zero = {0};
    for (int j = 0; j < angles; j++)
        squares += x[j] * x[j];
    for (int j = angles; j < inputs; j++)
        zero += x[j] * 0.0;
    for (int j = 0; j < outputs; j++)
        zero += y[j] * 0.0;
    mask good = (squares < LARGEST_ANGLE * LARGEST_ANGLE) & (zero == 0.0);
    for (int j = 0; j < checks; j++)
        good &= y[outputs + j] <= 1.0;
    return good;
}

typedef void body(const real *x, const double *p, real *y);

/* Run a kernel f for `count` samples. `in` are its inputs, `arrays` of them with these sizes. The first
 * one is q; if there is a `close`, three steps of Newton's method close the loops first. `bad` gets a 1
 * for each sample that is not valid; returns whether there is one. x and y are workspace. */
INLINE int run(body *f, body *close, int arrays, const int *sizes, int q, int inputs, int outputs,
    int checks, real *x, real *y, const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{
    int any = 0;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? (int)(count - first) : LANES;
        int at = 0;
        for (int a = 0; a < arrays; at += sizes[a++])
            take(x + at, &in[a], first, lanes, sizes[a]);
        for (int step = 0; close && step < 3; step++) {
            close(x, p, y);
            for (int j = 0; j < q; j++)
                x[j] = y[j];
        }
        f(x, p, y);
        const mask good = judge(x, q, inputs, y, outputs, checks);
        give(y, out, first, lanes, outputs);
        for (int l = 0; l < lanes; l++)
            if (!LANE(good, l))
                bad[first + l] = 1, any = 1;
    }
    return any;
}

/* --- kernels along directions ------------------------------------------------------------------- */

/* A function for any directions of a group of coordinates; see along_directions.py. Result k for
 * coordinate j has the index places[k] + j * strides[k] in the whole result. */
typedef struct {
    /* d are directions, one in each lane; y gets the results, then the checks */
    void (*compute)(const double *x, const double *p, const double *once, const real *d, real *y);
    int count;             /* of coordinates in the group */
    int results, checks;
    const int *directions; /* the indices of these coordinates */
    const int *places, *strides;
} pass;

/* A kernel along directions. Its whole result is A^-1 times what its functions compute if it has a
 * `rank`, with A = L D L^T; rows of the result then have another order in L. */
typedef struct {
    /* what is the same for all directions: known results, 1 / D, the entries of L, checks */
    void (*once)(const double *x, const double *p, double *y);
    int inputs, angles; /* sizes of all inputs, and of q, which is the first one */
    int known, checks;  /* numbers of known results and of checks of `once` */
    int size, width;    /* of the whole result, and of its rows */
    int passes;
    const int *known_at; /* indices of the known results in the whole one */
    const pass *pass;
    int rank, entries;   /* size of A, 0 for none; number of entries of L below its diagonal */
    const int *order;    /* row of the result by row of L */
    const int *entry_at; /* row and column of each entry of L, column by column */
} columns;

/* Compute the results of a pass for all its directions; returns whether all checks pass. */
INLINE int compute_pass(
    const pass *g, const double *x, const double *p, const double *once, double *result, real *y)
{
    mask good = (real){0} == 0.0;
    for (int first = 0; first < g->count; first += LANES) {
        const int lanes = g->count - first < LANES ? g->count - first : LANES;
        real d[g->count];
        for (int j = 0; j < g->count; j++)
            for (int l = 0; l < LANES; l++)
                LANE(d[j], l) = j == first + l;
        g->compute(x, p, once, d, y);
        for (int l = 0; l < lanes; l++) {
            const int j = g->directions[first + l];
            for (int k = 0; k < g->results; k++)
                result[g->places[k] + j * g->strides[k]] = LANE(y[k], l);
        }
        for (int k = 0; k < g->checks; k++)
            good &= y[g->results + k] <= 1.0;
    }
    return !some(good == (mask){0});
}

/* Multiply the result by A^-1, LANES of its columns at once. */
INLINE void solve(const columns *f, const double *factors, double *result)
{
    const double *inverses = factors, *L = factors + f->rank; /* of D */
    real x[f->rank];
    for (int first = 0; first < f->width; first += LANES) {
        const int lanes = f->width - first < LANES ? f->width - first : LANES;
        for (int i = 0; i < f->rank; i++)
            memcpy(&x[i], result + f->order[i] * f->width + first, lanes * sizeof(double));
        for (int k = 0; k < f->entries; k++) /* L */
            x[f->entry_at[2 * k]] -= L[k] * x[f->entry_at[2 * k + 1]];
        for (int i = 0; i < f->rank; i++)
            x[i] *= inverses[i];
        for (int k = f->entries - 1; k >= 0; k--) /* L^T */
            x[f->entry_at[2 * k + 1]] -= L[k] * x[f->entry_at[2 * k]];
        for (int i = 0; i < f->rank; i++)
            memcpy(result + f->order[i] * f->width + first, &x[i], lanes * sizeof(double));
    }
}

/* As `judge`, for the whole result of a kernel along directions and the checks of its `once`. */
INLINE int judge_columns(const columns *f, const double *x, const double *checks, const double *result)
{
    double squares = 0, zero = 0;
    int good = 1;
    for (int j = 0; j < f->angles; j++)
        squares += x[j] * x[j];
    for (int j = f->angles; j < f->inputs; j++)
        zero += x[j] * 0.0;
    for (int j = 0; j < f->size; j++)
        zero += result[j] * 0.0;
    for (int k = 0; k < f->checks; k++)
        good &= checks[k] <= 1.0;
    return good && squares < LARGEST_ANGLE * LARGEST_ANGLE && zero == 0.0;
}

/* The whole result for one sample; returns whether it is valid. */
INLINE int compute_columns(
    const columns *f, const double *x, const double *p, double *once, double *result, real *y)
{
    const double *factors = once + f->known, *checks = factors + f->rank + f->entries;
    int good = 1;
    f->once(x, p, once);
    memset(result, 0, f->size * sizeof(double));
    for (int k = 0; k < f->known; k++)
        result[f->known_at[k]] = once[k];
    for (int i = 0; i < f->passes; i++)
        good &= compute_pass(&f->pass[i], x, p, once, result, y);
    if (f->rank)
        solve(f, factors, result);
    return good & judge_columns(f, x, checks, result);
}

/* As `run`, for a kernel along directions. */
INLINE int run_columns(const columns *f, int arrays, const int *sizes, double *x, double *once,
    double *result, real *y, const rows *in, const rows *out, const double *p, ptrdiff_t count,
    unsigned char *bad)
{
    int any = 0;
    for (ptrdiff_t sample = 0; sample < count; sample++) {
        double *to = x;
        for (int a = 0; a < arrays; a++)
            for (int j = 0; j < sizes[a]; j++) {
                const char *row = in[a].data + sample * in[a].row;
                *to++ = in[a].data ? *(const double *)(row + j * in[a].column) : 0.0;
            }
        if (!compute_columns(f, x, p, once, result, y))
            bad[sample] = 1, any = 1;
        for (int j = 0; j < f->size; j++)
            *(double *)(out->data + sample * out->row + j * out->column) = result[j];
    }
    return any;
}

/* --- rollouts -----------------------------------------------------------------------------------
 *
 * A step of length h from the state z = (q, va), with the torques tau(t), is the classical
 * Runge-Kutta method on z_dot = f(z, tau),
 *
 *     k1 = f(z, tau(t)),                    k2 = f(z + h/2 k1, tau(t + h/2)),
 *     k3 = f(z + h/2 k2, tau(t + h/2)),     k4 = f(z + h k3, tau(t + h)),
 *     z_next = z + h (k1 + 2 k2 + 2 k3 + k4) / 6,
 *
 * and then Newton's method onto the closures, with the coordinates held. A step is near to leaving its
 * assembly mode where det Phi_u changes much; Phi_u are the columns of Phi for the dependent rates. */

/* Arrays of many motions: the samples `at` are those of step 0, those of the next are `step` bytes
 * behind. */
typedef struct {
    rows at;
    ptrdiff_t step;
} courses;

/* Newton's method has found the closed configuration after a step up to this length, free of units:
 * the square of it is what is left. */
#define LAST_STEP N(1e-8)
/* Its most steps after a step of a rollout. */
#define CLOSING_STEPS 3

/* A rollout of one robot; numbers of q times `units` are free of units. */
typedef struct {
    int q, va, tau, load; /* sizes */
    int checks, close_checks;
    body *rate;  /* of (q, va, tau, load): rates of q and va */
    body *close; /* of q: q after a step of Newton's method, det Phi_u and a number for other callers */
    const double *units;
    double bend, tolerance; /* a step of the length `way` is closed by at most bend way + tolerance */
    double travel;          /* longest sound step */
    double nearby;          /* longest step of Newton's method that closes the middle of a sound step */
    double change;          /* largest factor by which det Phi_u changes in half a sound step */
} stepper;

/* The states or torques of step s. */
INLINE rows at_step(const courses *all, ptrdiff_t s)
{
    rows result = all->at;
    result.data += s * all->step;
    return result;
}

/* Take torques for the kernel in x: those of step s, or so many bytes later. */
INLINE void take_torques(const stepper *f, real *x, const courses *tau, ptrdiff_t s, ptrdiff_t later,
    ptrdiff_t first, int lanes)
{
    rows from = at_step(tau, s);
    from.data += later;
    take(x + f->q + f->va, &from, first, lanes, f->tau);
}

/* The Runge-Kutta method from the state in x, at which y are the rates. Then x and `end` are the state
 * at the end, and `start` is that of before. The torques in the middle of step s are `half` bytes
 * behind those at its beginning, those at its end twice as many; where half is 0, the torques are the
 * same in the whole step. */
INLINE void runge_kutta(const stepper *f, real *x, real *y, real *start, real *end, const double *p,
    double h, const courses *tau, ptrdiff_t half, ptrdiff_t s, ptrdiff_t first, int lanes)
{
    static const double weights[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, ahead[] = {0.5, 0.5, 1};
    static const int halves[] = {1, 1, 2}; /* time of the next stage */
    const int states = f->q + f->va;
    for (int j = 0; j < states; j++)
        end[j] = start[j] = x[j];
    for (int stage = 0; stage < 4; stage++) {
        for (int j = 0; j < states; j++)
            end[j] += h * weights[stage] * y[j];
        if (stage == 3)
            break;
        for (int j = 0; j < states; j++)
            x[j] = start[j] + h * ahead[stage] * y[j];
        if (half && stage != 1)
            take_torques(f, x, tau, s, halves[stage] * half, first, lanes);
        f->rate(x, p, y);
    }
    for (int j = 0; j < states; j++)
        x[j] = end[j];
}

/* Newton's method onto the closures from q in x, lane by lane until it ends; returns det Phi_u. */
INLINE real close_loops(const stepper *f, real *x, const double *p, real *y)
{
    real det = {0};
    mask open = det == det;
    for (int step = 0; step < CLOSING_STEPS && some(open); step++) {
        f->close(x, p, y);
        det = choose(open, y[f->q], det);
        const mask far = longest_way(f->q, f->units, x, y) > LAST_STEP;
        for (int j = 0; j < f->q; j++)
            x[j] = choose(open, y[j], x[j]);
        open &= far;
    }
    return det;
}

/* det Phi_u at q in x. Where its checks fail, a step of Newton's method moves q in x; det is NaN where
 * this step is not short, or where the checks still fail. */
INLINE real determinant(const stepper *f, real *x, const double *p, real *y)
{
    const int outputs = f->q + 2; /* see `stepper.close` */
    f->close(x, p, y);
    const mask closed = judge(x, f->q, f->q, y, outputs, f->close_checks);
    const mask open = closed == (mask){0};
    real det = y[f->q];
    if (some(open)) {
        const mask near = longest_way(f->q, f->units, x, y) < f->nearby;
        for (int j = 0; j < f->q; j++)
            x[j] = choose(open, y[j], x[j]);
        f->close(x, p, y);
        const mask good = near & judge(x, f->q, f->q, y, outputs, f->close_checks);
        det = choose(closed, det, choose(good, y[f->q], y[f->q] + __builtin_nan("")));
    }
    return det;
}

/* Whether det Phi_u changes by at most `change`, or 1 / change, from one configuration to another. */
INLINE mask changes_little(const stepper *f, real from, real to)
{
    const real ratio = to / from, least = (real){0} + 1 / f->change;
    return (ratio > least) & (ratio < f->change);
}

/* Write NaN in place of the states that do not hold; returns whether there are any. */
INLINE int erase_invalid(const courses *out, const int *sizes, ptrdiff_t steps, ptrdiff_t first,
    int lanes, const ptrdiff_t *reached)
{
    int any = 0;
    for (ptrdiff_t k = first; k < first + lanes; k++)
        for (ptrdiff_t s = reached[k]; s <= steps; s++) {
            any = 1;
            for (int i = 0; i < 3; i++) {
                char *at = out[i].at.data + k * out[i].at.row + s * out[i].step;
                for (int j = 0; j < sizes[i]; j++)
                    *(double *)(at + j * out[i].at.column) = __builtin_nan("");
            }
        }
    return any;
}

/* Rollouts of `count` motions. `in` are q, va and load at the start; `tau` and `half` as in
 * `runge_kutta`. `out` are q, va and two numbers for each state: det Phi_u, and 1 where the step from
 * there is sound, else 0. `reached` gets the number of states that hold: their checks pass, det Phi_u
 * has the sign that it had at the start, and the step to them is not bent; it must be zero before the
 * call. Returns whether a motion ends early. x, y, start and end are workspace. */
INLINE int roll(const stepper *f, real *x, real *y, real *start, real *end, const rows *in,
    const courses *tau, ptrdiff_t half, const courses *out, const double *p, double h,
    ptrdiff_t steps, ptrdiff_t count, ptrdiff_t *reached)
{
    const int states = f->q + f->va, inputs = states + f->tau + f->load;
    const int sizes[] = {f->q, f->va, 2};
    const real zero = {0}, one = zero + 1.0;
    int any = 0;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? (int)(count - first) : LANES;
        take(x, &in[0], first, lanes, f->q);
        take(x + f->q, &in[1], first, lanes, f->va);
        take(x + states + f->tau, &in[2], first, lanes, f->load);
        for (int j = 0; j < f->tau; j++) /* for a rollout without steps */
            x[states + j] = zero;
        f->close(x, p, y);
        const real det_at_start = y[f->q];
        real det = det_at_start;
        mask holds = zero == zero;
        for (ptrdiff_t s = 0; s <= steps; s++) {
            /* the state */
            const rows to_q = at_step(&out[0], s), to_va = at_step(&out[1], s);
            const rows to_verdict = at_step(&out[2], s);
            give(x, &to_q, first, lanes, f->q);
            give(x + f->q, &to_va, first, lanes, f->va);
            if (s < steps) /* the last state is checked with the torques before it, or with none */
                take_torques(f, x, tau, s, 0, first, lanes);
            f->rate(x, p, y);
            holds &= det_at_start * det > 0.0;
            holds &= judge(x, f->q, inputs, y, states, f->checks);
            for (int l = 0; l < lanes; l++)
                if (LANE(holds, l))
                    reached[first + l] = s + 1;
            if (s == steps) {
                const real verdict[] = {det, one};
                give(verdict, &to_verdict, first, lanes, 2);
                break;
            }

            /* the step from there */
            runge_kutta(f, x, y, start, end, p, h, tau, half, s, first, lanes);
            const real det_at_end = close_loops(f, x, p, y);
            const real way = longest_way(f->q, f->units, start, x);
            holds &= longest_way(f->q, f->units, end, x) <= f->bend * way + f->tolerance;
            real *middle = end; /* which is not needed any more */
            for (int j = 0; j < f->q; j++)
                middle[j] = 0.5 * (start[j] + x[j]);
            const real det_in_middle = determinant(f, middle, p, y);
            const mask sound = changes_little(f, det, det_in_middle)
                & changes_little(f, det_in_middle, det_at_end) & (way <= f->travel);
            const real verdict[] = {det, choose(sound, one, zero)};
            give(verdict, &to_verdict, first, lanes, 2);
            det = det_at_end;
        }
        any |= erase_invalid(out, sizes, steps, first, lanes, reached);
    }
    return any;
}
