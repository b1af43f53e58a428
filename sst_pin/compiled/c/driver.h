/* SPDX-License-Identifier: BSD-2-Clause */
/* Rows of samples in, LANES samples at once through a kernel, rows out, with a verdict on each. */
#include <stddef.h>
#include <string.h>

/* An array of samples, its numbers `column` bytes apart, its samples `row` bytes. */
typedef struct {
    char *data;
    ptrdiff_t row, column;
} rows;

#define INLINE static inline __attribute__((always_inline))

/* The last sample fills the lanes that are left; an array that is not there is zeros. */
INLINE void gather(real *x, const rows *from, ptrdiff_t first, int lanes, int size, ptrdiff_t column)
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
    if (from->column == sizeof(double)) /* known, so that the loops above unroll */
        gather(x, from, first, lanes, size, sizeof(double));
    else
        gather(x, from, first, lanes, size, from->column);
}

INLINE void give(const real *y, const rows *to, ptrdiff_t first, int lanes, int size)
{
    for (int l = 0; l < lanes; l++) {
        char *at = to->data + (first + l) * to->row;
        for (int j = 0; j < size; j++)
            *(double *)(at + j * to->column) = LANE(y[j], l);
    }
}

/* Where the angles are in reach, all numbers finite and all checks at most 1. */
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

/* Returns whether a sample is bad; `bad` gets a 1 for each of these. Where there is a `close`, three
 * steps of Newton's method come first. */
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

/* Results along directions of the coordinates, whose numbers are in `directions`. Result k of coordinate
 * j is number places[k] + j * strides[k] of the whole result. Behind `results` are checks. */
typedef struct {
    void (*compute)(const double *x, const double *p, const double *once, const real *d, real *y);
    int count, results, checks;
    const int *directions, *places, *strides;
} pass;

/* A kernel whose results are computed along directions. `once` computes what is the same for all of
 * them: `known` numbers of the result, which are at `known_at`, then factors of a matrix A, then
 * checks. */
typedef struct {
    void (*once)(const double *x, const double *p, double *y);
    int inputs, angles, known, checks, size, width, passes;
    const int *known_at;
    const pass *pass;
    /* the result is A^-1 times what was computed: rows of the result by rows of L, places in L */
    int rank, entries;
    const int *order, *entry_at;
} columns;

/* A^-1 times the result, A = L D L^T, from 1 / D and the entries of L; LANES columns at once. */
INLINE void solve(const columns *f, const double *factors, double *result)
{
    const double *L = factors + f->rank;
    real x[f->rank];
    for (int first = 0; first < f->width; first += LANES) {
        const int lanes = f->width - first < LANES ? f->width - first : LANES;
        for (int i = 0; i < f->rank; i++)
            memcpy(&x[i], result + f->order[i] * f->width + first, lanes * sizeof(double));
        for (int k = 0; k < f->entries; k++)
            x[f->entry_at[2 * k]] -= L[k] * x[f->entry_at[2 * k + 1]];
        for (int i = 0; i < f->rank; i++)
            x[i] *= factors[i];
        for (int k = f->entries - 1; k >= 0; k--)
            x[f->entry_at[2 * k + 1]] -= L[k] * x[f->entry_at[2 * k]];
        for (int i = 0; i < f->rank; i++)
            memcpy(result + f->order[i] * f->width + first, &x[i], lanes * sizeof(double));
    }
}

/* The result of one sample; returns whether it is good. */
INLINE int compute_columns(
    const columns *f, const double *x, const double *p, double *once, double *result, real *y)
{
    double squares = 0, zero = 0;
    mask good = (real){0} == 0.0;
    const double *factors = once + f->known, *checks = factors + f->rank + f->entries;
    int bad = 0;
    f->once(x, p, once);
    memset(result, 0, f->size * sizeof(double));
    for (int k = 0; k < f->known; k++)
        result[f->known_at[k]] = once[k];
    for (int i = 0; i < f->passes; i++) {
        const pass *g = &f->pass[i];
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
    }
    if (f->rank)
        solve(f, factors, result);
    for (int j = 0; j < f->angles; j++)
        squares += x[j] * x[j];
    for (int j = f->angles; j < f->inputs; j++)
        zero += x[j] * 0.0;
    for (int j = 0; j < f->size; j++)
        zero += result[j] * 0.0;
    for (int k = 0; k < f->checks; k++)
        bad |= !(checks[k] <= 1.0);
    return !bad && !some(~good) && squares < LARGEST_ANGLE * LARGEST_ANGLE && zero == 0.0;
}

/* As `run`, for a kernel with columns. */
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

/* Where the states of many motions stand: one step after the other, `step` bytes apart. */
typedef struct {
    rows at;
    ptrdiff_t step;
} courses;

/* Newton's method ends with a step up to this length: the square of it is what is left. */
#define LAST_STEP N(1e-8)

/* The classical Runge-Kutta method on q and va, and Newton's method onto the closures after each
 * step. `rate` takes (q, va, tau, load) and gives the rates of q and va; `close` takes q
 * and gives it nearer to the closures, then a determinant that is zero at singularities. Torques are
 * those at the beginning of each step, in its middle (`half` bytes later) and at its end; where
 * `half` is 0, that of the beginning. A step that misses a bend of its way ends the motion.
 * `reached` gets the number of states that hold. The third output gets the determinant of each
 * state, and 1 where the step from it is sound, else 0: the determinant changes by at most a factor
 * `change` to the middle and on to the end, and no joint moves further than `travel`. */
typedef struct {
    int q, va, tau, load, checks, close_checks;
    body *rate, *close;
    const double *units; /* numbers of q times these are free of units */
    double bend, tolerance, travel, nearby, change;
} stepper;

/* The determinant at x, without units; NaN where checks fail also after a short step of Newton's
 * method, which closes loops that are open. */
INLINE real determinant(const stepper *f, real *x, const double *p, real *y)
{
    const int outputs = f->q + 2;
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

INLINE mask is_sound(const stepper *f, real before, real middle, real after, real way)
{
    const real first = middle / before, second = after / middle, least = (real){0} + 1 / f->change;
    return (first > least) & (first < f->change) & (second > least) & (second < f->change)
        & (way <= f->travel);
}

INLINE int roll(const stepper *f, real *x, real *y, real *start, real *sum, const rows *in,
    const courses *tau, ptrdiff_t half, const courses *out, const double *p, double h,
    ptrdiff_t steps, ptrdiff_t count, ptrdiff_t *reached)
{
    static const double weights[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, ahead[] = {0.5, 0.5, 1};
    const int states = f->q + f->va, inputs = states + f->tau + f->load;
    const int sizes[] = {f->q, f->va, 2};
    int any = 0;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? (int)(count - first) : LANES;
        const real zero = {0}, one = zero + 1.0;
        mask holds = zero == zero;
        real side, look[2] = {zero, one}; /* the determinant of the state, whether a step is sound */
        take(x, &in[0], first, lanes, f->q);
        take(x + f->q, &in[1], first, lanes, f->va);
        take(x + states + f->tau, &in[2], first, lanes, f->load);
        f->close(x, p, y);
        side = look[0] = y[f->q];
        for (ptrdiff_t s = 0; s <= steps; s++) {
            rows to[3];
            for (int i = 0; i < 3; i++) {
                to[i] = out[i].at;
                to[i].data += s * out[i].step;
            }
            give(x, &to[0], first, lanes, f->q);
            give(x + f->q, &to[1], first, lanes, f->va);
            holds &= side * look[0] > 0.0;
            for (int j = 0; j < states; j++)
                sum[j] = start[j] = x[j];
            for (int stage = 0; stage < (s < steps ? 4 : 1); stage++) {
                rows from = tau->at;
                /* at the last state any torque serves to judge it */
                if (s < steps && (stage == 0 || (half && stage != 2))) {
                    from.data += s * tau->step + (stage == 0 ? 0 : stage == 3 ? 2 : 1) * half;
                    take(x + states, &from, first, lanes, f->tau);
                }
                f->rate(x, p, y);
                if (stage == 0) {
                    holds &= judge(x, f->q, inputs, y, states, f->checks);
                    for (int l = 0; l < lanes; l++)
                        if (LANE(holds, l))
                            reached[first + l] = s + 1;
                }
                for (int j = 0; j < states; j++) {
                    sum[j] += h * weights[stage] * y[j];
                    x[j] = start[j] + (stage < 3 ? h * ahead[stage] : 0.0) * y[j];
                }
            }
            if (s == steps) {
                look[1] = one;
                give(look, &to[2], first, lanes, 2);
                break;
            }
            for (int j = 0; j < states; j++)
                x[j] = sum[j];
            mask open = zero == zero;
            real det = zero;
            for (int step = 0; step < 3 && some(open); step++) {
                real squares = {0};
                f->close(x, p, y);
                det = choose(open, y[f->q], det);
                for (int j = 0; j < f->q; j++) {
                    squares += (y[j] - x[j]) * (y[j] - x[j]);
                    x[j] = choose(open, y[j], x[j]);
                }
                open &= squares > LAST_STEP * LAST_STEP;
            }
            const real way = longest_way(f->q, f->units, start, x);
            holds &= longest_way(f->q, f->units, sum, x) <= f->bend * way + f->tolerance;
            for (int j = 0; j < f->q; j++) {
                sum[j] = x[j];
                x[j] = 0.5 * (start[j] + sum[j]);
            }
            const real middle = determinant(f, x, p, y);
            look[1] = choose(is_sound(f, look[0], middle, det, way), one, zero);
            give(look, &to[2], first, lanes, 2);
            look[0] = det;
            for (int j = 0; j < f->q; j++)
                x[j] = sum[j];
        }
        for (int l = 0; l < lanes; l++) {
            if (reached[first + l] > steps)
                continue;
            any = 1;
            for (ptrdiff_t s = reached[first + l]; s <= steps; s++)
                for (int i = 0; i < 3; i++) {
                    char *at = out[i].at.data + (first + l) * out[i].at.row + s * out[i].step;
                    for (int j = 0; j < sizes[i]; j++)
                        *(double *)(at + j * out[i].at.column) = __builtin_nan("");
                }
        }
    }
    return any;
}
