/* SPDX-License-Identifier: BSD-2-Clause */
/* Loops over samples for a generated kernel: LANES samples are packed into vectors, the kernel
 * computes them at once, and its results are unpacked. A sample is valid if its numbers are finite
 * and its checks pass. In this order:
 *
 *     take, give          pack and unpack arrays of samples
 *     run                 a kernel that takes whole samples
 *     run_by_directions   a kernel that computes a matrix for one direction after the other
 *     roll                rollouts
 *
 * Two files come before this one: distances.h, and real.h with `real`, `mask`, LANES, LANE,
 * `choose`, `some`, N and LARGEST_ANGLE. */
#include <stddef.h>
#include <string.h>

/* An array of samples. Both strides are in bytes: from one sample to the next, and from one number
 * of a sample to the next. Without data, all numbers are zero. */
typedef struct {
    char *data;
    ptrdiff_t sample_stride, number_stride;
} sample_array;

#define INLINE static inline __attribute__((always_inline))

/* Newton steps that close the loops. Each one squares the error: three reduce 0.01 rad, or 0.01
 * robot lengths, to 1e-16, which is rounding. */
#define CLOSING_STEPS 3

/* A kernel: from the inputs x of LANES samples and the parameters p to its outputs y, then its
 * checks. */
typedef void kernel_function(const real *x, const double *p, real *y);

/* `take`, with the stride of the numbers as an argument. */
INLINE void take_with_stride(
    real *x, const sample_array *from, ptrdiff_t first, int lanes, int size, ptrdiff_t stride)
{
    if (!from->data || lanes == 1) { /* the same number in all lanes */
        const char *sample = from->data + first * from->sample_stride;
        for (int j = 0; j < size; j++)
            x[j] = (real){0} + (from->data ? *(const double *)(sample + j * stride) : 0.0);
        return;
    }
    const char *samples[LANES];
    for (int l = 0; l < LANES; l++)
        samples[l] = from->data + (first + (l < lanes ? l : lanes - 1)) * from->sample_stride;
    for (int j = 0; j < size; j++) {
        real numbers;
        for (int l = 0; l < LANES; l++)
            LANE(numbers, l) = *(const double *)(samples[l] + j * stride);
        x[j] = numbers;
    }
}

/* Pack `lanes` samples, from `first` on, into x; each has `size` numbers. Lanes without a sample
 * repeat the last one. */
INLINE void take(real *x, const sample_array *from, ptrdiff_t first, int lanes, int size)
{
    if (from->number_stride == sizeof(double)) /* with a constant, the compiler unrolls the loops */
        take_with_stride(x, from, first, lanes, size, sizeof(double));
    else
        take_with_stride(x, from, first, lanes, size, from->number_stride);
}

/* Unpack y to `lanes` samples, from `first` on. */
INLINE void give(const real *y, const sample_array *to, ptrdiff_t first, int lanes, int size)
{
    for (int l = 0; l < lanes; l++) {
        char *sample = to->data + (first + l) * to->sample_stride;
        for (int j = 0; j < size; j++)
            *(double *)(sample + j * to->number_stride) = LANE(y[j], l);
    }
}

/* The lanes where x is false. */
INLINE mask opposite(mask x)
{
    return x == (mask){0};
}

/* The lanes whose samples are valid. x has `inputs` numbers; the first `angles` of them, which are
 * q, have to be small enough for `sine_cosine`. y has the outputs, then the checks, which pass up
 * to 1. */
INLINE mask judge(const real *x, int angles, int inputs, const real *y, int outputs, int checks)
{
    real squares = {0}, zero = {0}; /* x * 0 is NaN, not zero, if x is not finite */
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

/* --- kernels that take whole samples ---------------------------------------------------------- */

/* Run the kernel f for `count` samples. `in` are its inputs: `arrays` of them, with these sizes, of
 * `inputs` numbers in all. The first `nq` numbers are q. If there is a kernel `close`, which makes
 * a step of Newton's method, it closes the loops first: integrators ask for states inside their
 * steps, whose loops are open. `bad` gets a 1 for each sample that is not valid. Returns whether
 * there is one. x and y are workspace. */
INLINE int run(kernel_function *f, kernel_function *close, int arrays, const int *sizes, int nq,
    int inputs, int outputs, int checks, real *x, real *y, const sample_array *in,
    const sample_array *out, const double *p, ptrdiff_t count, unsigned char *bad)
{
    int any_bad = 0;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        const int lanes = count - first < LANES ? (int)(count - first) : LANES;
        int start = 0;
        for (int a = 0; a < arrays; a++) {
            take(x + start, &in[a], first, lanes, sizes[a]);
            start += sizes[a];
        }
        for (int step = 0; close && step < CLOSING_STEPS; step++) {
            close(x, p, y);
            for (int j = 0; j < nq; j++)
                x[j] = y[j];
        }
        f(x, p, y);
        const mask good = judge(x, nq, inputs, y, outputs, checks);
        give(y, out, first, lanes, outputs);
        for (int l = 0; l < lanes; l++)
            if (!LANE(good, l)) {
                bad[first + l] = 1;
                any_bad = 1;
            }
    }
    return any_bad;
}

/* --- kernels along directions -----------------------------------------------------------------
 *
 * These kernels compute a matrix that has a column, or a row, for each coordinate;
 * along_directions.py generates them. For each sample, a function `once` computes what all columns
 * share. The coordinates are divided into groups, and a pass for each group computes LANES of its
 * columns at once: the lanes are columns here, not samples. For some quantities the result is A^-1
 * times this matrix, with A = L D L^T; the rows of L are in an order of their own. */

/* The pass of a group of coordinates. */
typedef struct {
    /* For the unit vectors d of some coordinates of the group, one in each lane, y gets the
     * results, then the checks. `once` has the results of the function `once`. */
    void (*compute)(const double *x, const double *p, const double *once, const real *d, real *y);
    int count;             /* of coordinates in the group */
    int results, checks;   /* for each coordinate */
    const int *directions; /* the indices of these coordinates */
    /* result k for coordinate j has the index places[k] + j * strides[k] in the matrix */
    const int *places, *strides;
} direction_pass;

typedef struct {
    /* y gets, in this order: entries of the matrix that are the same for all directions ("known"),
     * 1 / D, the entries of L below its unit diagonal, checks */
    void (*once)(const double *x, const double *p, double *y);
    int inputs, angles; /* sizes of all inputs, and of q, which is the first one */
    int known, checks;  /* numbers of known entries, and of checks of `once` */
    int size, width;    /* of the matrix, and of one of its rows */
    int pass_count;
    const int *known_at; /* index in the matrix of each known entry */
    const direction_pass *passes;
    int rank, entries;   /* size of A, 0 for none; number of entries of L below its diagonal */
    const int *order;    /* row of the matrix for each row of L */
    const int *entry_at; /* row and column in L of each entry, column by column of L */
} directional_kernel;

/* Compute the columns of a group. Returns whether all checks pass. */
INLINE int compute_pass(const direction_pass *g, const double *x, const double *p,
    const double *once, double *matrix, real *y)
{
    mask good = (real){0} == 0.0; /* in all lanes */
    for (int first = 0; first < g->count; first += LANES) {
        const int lanes = g->count - first < LANES ? g->count - first : LANES;
        real d[g->count]; /* zero in lanes without a column: their results are zero, checks pass */
        for (int j = 0; j < g->count; j++)
            for (int l = 0; l < LANES; l++)
                LANE(d[j], l) = j == first + l;
        g->compute(x, p, once, d, y);
        for (int l = 0; l < lanes; l++) {
            const int j = g->directions[first + l];
            for (int k = 0; k < g->results; k++)
                matrix[g->places[k] + j * g->strides[k]] = LANE(y[k], l);
        }
        for (int k = 0; k < g->checks; k++)
            good &= y[g->results + k] <= 1.0;
    }
    return !some(opposite(good));
}

/* Multiply the matrix by A^-1, LANES of its columns at once. `inverses` are those of D. */
INLINE void solve(
    const directional_kernel *f, const double *inverses, const double *L, double *matrix)
{
    real x[f->rank]; /* its rows are those of L; lanes without a column are not read */
    for (int first = 0; first < f->width; first += LANES) {
        const int lanes = f->width - first < LANES ? f->width - first : LANES;
        for (int i = 0; i < f->rank; i++)
            memcpy(&x[i], matrix + f->order[i] * f->width + first, lanes * sizeof(double));
        for (int k = 0; k < f->entries; k++) { /* x := L^-1 x */
            const int row = f->entry_at[2 * k], column = f->entry_at[2 * k + 1];
            x[row] -= L[k] * x[column];
        }
        for (int i = 0; i < f->rank; i++)
            x[i] *= inverses[i];
        for (int k = f->entries - 1; k >= 0; k--) { /* x := L^-T x */
            const int row = f->entry_at[2 * k], column = f->entry_at[2 * k + 1];
            x[column] -= L[k] * x[row];
        }
        for (int i = 0; i < f->rank; i++)
            memcpy(matrix + f->order[i] * f->width + first, &x[i], lanes * sizeof(double));
    }
}

/* `judge` for one sample: its inputs, the checks of `once`, and the whole matrix. */
INLINE int judge_matrix(
    const directional_kernel *f, const double *x, const double *checks, const double *matrix)
{
    double squares = 0, zero = 0;
    int good = 1;
    for (int j = 0; j < f->angles; j++)
        squares += x[j] * x[j];
    for (int j = f->angles; j < f->inputs; j++)
        zero += x[j] * 0.0;
    for (int j = 0; j < f->size; j++)
        zero += matrix[j] * 0.0;
    for (int k = 0; k < f->checks; k++)
        good &= checks[k] <= 1.0;
    return good && squares < LARGEST_ANGLE * LARGEST_ANGLE && zero == 0.0;
}

/* Compute the matrix of one sample. Returns whether it is valid. */
INLINE int compute_matrix(const directional_kernel *f, const double *x, const double *p,
    double *once, double *matrix, real *y)
{
    const double *inverses = once + f->known, *L = inverses + f->rank, *checks = L + f->entries;
    int good = 1;
    f->once(x, p, once);
    memset(matrix, 0, f->size * sizeof(double));
    for (int k = 0; k < f->known; k++)
        matrix[f->known_at[k]] = once[k];
    for (int i = 0; i < f->pass_count; i++)
        good &= compute_pass(&f->passes[i], x, p, once, matrix, y);
    if (f->rank)
        solve(f, inverses, L, matrix);
    return good & judge_matrix(f, x, checks, matrix);
}

/* `run` for a kernel along directions. x, once, matrix and y are workspace. */
INLINE int run_by_directions(const directional_kernel *f, int arrays, const int *sizes, double *x,
    double *once, double *matrix, real *y, const sample_array *in, const sample_array *out,
    const double *p, ptrdiff_t count, unsigned char *bad)
{
    int any_bad = 0;
    for (ptrdiff_t sample = 0; sample < count; sample++) {
        double *to = x;
        for (int a = 0; a < arrays; a++)
            for (int j = 0; j < sizes[a]; j++) {
                const char *numbers = in[a].data + sample * in[a].sample_stride;
                *to++ = in[a].data ? *(const double *)(numbers + j * in[a].number_stride) : 0.0;
            }
        if (!compute_matrix(f, x, p, once, matrix, y)) {
            bad[sample] = 1;
            any_bad = 1;
        }
        char *result = out->data + sample * out->sample_stride;
        for (int j = 0; j < f->size; j++)
            *(double *)(result + j * out->number_stride) = matrix[j];
    }
    return any_bad;
}

/* --- rollouts ---------------------------------------------------------------------------------
 *
 * A step of length h from the state z = (q, va), with the torques tau(t), is the classical
 * Runge-Kutta method on z_dot = f(z, tau),
 *
 *     k1 = f(z, tau(t)),                    k2 = f(z + h/2 k1, tau(t + h/2)),
 *     k3 = f(z + h/2 k2, tau(t + h/2)),     k4 = f(z + h k3, tau(t + h)),
 *     z_next = z + h (k1 + 2 k2 + 2 k3 + k4) / 6,
 *
 * and then Newton's method onto the closures, with the coordinates held. Phi_u are the columns of
 * Phi for the dependent rates. A step is sound, which means that it stays in its assembly mode, if
 * it is short and det Phi_u changes little to its middle and to its end. Other steps may stay in it
 * too: the caller judges them by slower means. */

/* An array of many motions. `at` are the samples of step 0. From the samples of a step to the
 * samples of the next step it is `step_stride` bytes. */
typedef struct {
    sample_array at;
    ptrdiff_t step_stride;
} motion_array;

/* Newton's method ends after a step up to this length, free of units: the error that is left is
 * about the square of the length, which is rounding. */
#define LAST_STEP N(1e-8)

/* A rollout of one robot. A length of a step is the largest change of an entry of q, times its
 * factor in `units`, which makes it free of units (`distance_between`). */
typedef struct {
    int q, va, tau, load; /* sizes */
    int checks, close_checks;
    kernel_function *rate; /* of (q, va, tau, load): rates of q and va */
    /* of q: q after a step of Newton's method, det Phi_u at q, and a sum of squares for other
     * callers */
    kernel_function *close;
    const double *units;
    /* A step is bent if closing the loops after it moves q by more than bend times the length of
     * the step + tolerance: h is then too long for the curvature of the motion, which ends. */
    double bend, tolerance;
    double travel; /* length of the longest sound step */
    double nearby; /* longest step of Newton's method that closes the loops in the middle of it */
    double change; /* largest factor by which det Phi_u changes in half a sound step */
} stepper;

/* The samples of step s. */
INLINE sample_array at_step(const motion_array *all, ptrdiff_t s)
{
    sample_array result = all->at;
    result.data += s * all->step_stride;
    return result;
}

/* Take the torques of step s, or those `later` bytes after them, as inputs of `rate` in x. */
INLINE void take_torques(const stepper *f, real *x, const motion_array *tau, ptrdiff_t s,
    ptrdiff_t later, ptrdiff_t first, int lanes)
{
    sample_array from = at_step(tau, s);
    from.data += later;
    take(x + f->q + f->va, &from, first, lanes, f->tau);
}

/* The Runge-Kutta method from the state in x, at which y are the rates. Afterwards `start` is this
 * state, and x and `end` are the state at the end of the step. In the array of torques, the middle
 * of step s is `half` bytes after its beginning, and its end is 2 `half` bytes after its beginning.
 * If `half` is 0, the torques are constant in a step. */
INLINE void runge_kutta(const stepper *f, real *x, real *y, real *start, real *end, const double *p,
    double h, const motion_array *tau, ptrdiff_t half, ptrdiff_t s, ptrdiff_t first, int lanes)
{
    static const double weights[] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    /* The time of the next stage, as a part of h, and in halves of a step. */
    static const double ahead[] = {0.5, 0.5, 1};
    static const int halves[] = {1, 1, 2};
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
        if (half && stage != 1) /* after stage 1 the time, and so the torques, stay the same */
            take_torques(f, x, tau, s, halves[stage] * half, first, lanes);
        f->rate(x, p, y);
    }
    for (int j = 0; j < states; j++)
        x[j] = end[j];
}

/* Newton's method onto the closures from q in x, in each lane until it ends. Returns det Phi_u
 * before the last step of each lane, which is at most LAST_STEP long where the loops close. */
INLINE real close_loops(const stepper *f, real *x, const double *p, real *y)
{
    real det = {0};
    mask open = det == det; /* in all lanes */
    for (int step = 0; step < CLOSING_STEPS && some(open); step++) {
        f->close(x, p, y);
        det = choose(open, y[f->q], det);
        const mask is_long = distance_between(f->q, f->units, x, y) > LAST_STEP;
        for (int j = 0; j < f->q; j++)
            x[j] = choose(open, y[j], x[j]);
        open &= is_long;
    }
    return det;
}

/* det Phi_u at q in x. In lanes whose loops are open, one step of Newton's method moves q first.
 * The result is NaN if this step is longer than `nearby`, or if the loops are open after it. */
INLINE real determinant(const stepper *f, real *x, const double *p, real *y)
{
    const int outputs = f->q + 2; /* of `close` */
    f->close(x, p, y);
    const mask closed = judge(x, f->q, f->q, y, outputs, f->close_checks);
    const mask open = opposite(closed);
    real det = y[f->q];
    if (some(open)) {
        const mask near = distance_between(f->q, f->units, x, y) < f->nearby;
        for (int j = 0; j < f->q; j++)
            x[j] = choose(open, y[j], x[j]);
        f->close(x, p, y);
        const mask good = near & judge(x, f->q, f->q, y, outputs, f->close_checks);
        const real nan = y[f->q] + __builtin_nan("");
        det = choose(closed, det, choose(good, y[f->q], nan));
    }
    return det;
}

/* The lanes where det Phi_u changes little: to / from is between 1 / change and `change`. */
INLINE mask changes_little(const stepper *f, real from, real to)
{
    const real ratio = to / from, least = (real){0} + 1 / f->change;
    return (ratio > least) & (ratio < f->change);
}

/* Make step s from the state in x, at which y are the rates. x becomes the state at its end. `det`
 * is det Phi_u at the start, and becomes that at the end. `sound` becomes the lanes whose step is
 * sound. Returns the lanes whose step is not bent. */
INLINE mask make_step(const stepper *f, real *x, real *y, real *start, real *end, const double *p,
    double h, const motion_array *tau, ptrdiff_t half, ptrdiff_t s, ptrdiff_t first, int lanes,
    real *det, mask *sound)
{
    runge_kutta(f, x, y, start, end, p, h, tau, half, s, first, lanes);
    const real det_at_end = close_loops(f, x, p, y);
    const real length = distance_between(f->q, f->units, start, x);
    const mask unbent = distance_between(f->q, f->units, end, x) <= f->bend * length + f->tolerance;
    real *middle = end; /* `end` is not needed any more */
    for (int j = 0; j < f->q; j++)
        middle[j] = 0.5 * (start[j] + x[j]);
    const real det_in_middle = determinant(f, middle, p, y);
    *sound = changes_little(f, *det, det_in_middle) & changes_little(f, det_in_middle, det_at_end)
        & (length <= f->travel);
    *det = det_at_end;
    return unbent;
}

/* Overwrite with NaN the states that a motion has not reached. Returns whether there are any. */
INLINE int erase_invalid(const motion_array *out, const int *sizes, ptrdiff_t steps,
    ptrdiff_t first, int lanes, const ptrdiff_t *reached)
{
    int any = 0;
    for (ptrdiff_t k = first; k < first + lanes; k++)
        for (ptrdiff_t s = reached[k]; s <= steps; s++) {
            any = 1;
            for (int i = 0; i < 3; i++) {
                const sample_array *at = &out[i].at;
                char *sample = at->data + k * at->sample_stride + s * out[i].step_stride;
                for (int j = 0; j < sizes[i]; j++)
                    *(double *)(sample + j * at->number_stride) = __builtin_nan("");
            }
        }
    return any;
}

/* Rollouts of `count` motions. `in` are q, va and load at the start; `tau` and `half` are those of
 * `runge_kutta`. `out` are q, va and two numbers for each state: det Phi_u, and 1 where the step
 * from this state is sound, else 0. `reached` must be zero before the call; it gets the number of
 * valid states of each motion. A motion ends before a state whose checks fail, whose det Phi_u has
 * another sign than at the start, or which a bent step leads to. Returns whether a motion ends
 * early. x, y, start and end are workspace. */
INLINE int roll(const stepper *f, real *x, real *y, real *start, real *end, const sample_array *in,
    const motion_array *tau, ptrdiff_t half, const motion_array *out, const double *p, double h,
    ptrdiff_t steps, ptrdiff_t count, ptrdiff_t *reached)
{
    const int states = f->q + f->va, inputs = states + f->tau + f->load;
    const int sizes[] = {f->q, f->va, 2};
    const real zero = {0}, one = zero + 1.0;
    int any_ends = 0;
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
        mask is_valid = zero == zero; /* in all lanes */
        for (ptrdiff_t s = 0; s <= steps; s++) {
            /* the state */
            const sample_array to_q = at_step(&out[0], s), to_va = at_step(&out[1], s);
            const sample_array to_verdict = at_step(&out[2], s);
            give(x, &to_q, first, lanes, f->q);
            give(x + f->q, &to_va, first, lanes, f->va);
            if (s < steps) /* the last state is checked with the torques of the step before */
                take_torques(f, x, tau, s, 0, first, lanes);
            f->rate(x, p, y);
            is_valid &= det_at_start * det > 0.0;
            is_valid &= judge(x, f->q, inputs, y, states, f->checks);
            for (int l = 0; l < lanes; l++)
                if (LANE(is_valid, l))
                    reached[first + l] = s + 1;

            /* the step from it */
            const real det_of_state = det;
            mask sound = zero == zero; /* the last state has no step */
            if (s < steps)
                is_valid &= make_step(
                    f, x, y, start, end, p, h, tau, half, s, first, lanes, &det, &sound);
            const real verdict[] = {det_of_state, choose(sound, one, zero)};
            give(verdict, &to_verdict, first, lanes, 2);
        }
        any_ends |= erase_invalid(out, sizes, steps, first, lanes, reached);
    }
    return any_ends;
}
