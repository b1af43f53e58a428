/* SPDX-License-Identifier: BSD-2-Clause */
/* Impulses of stops, dry friction, ropes, cables and contacts in one step of one robot, as
 * dynamics/impulses.py and dynamics/nonsmooth_step.py compute them; those files say why. The compiled
 * rollout takes this file as C, kernels of Warp as C++ in a class, in either precision; see real.h.
 * Matrices are row-major. */
#ifdef __cplusplus
#define SMALL HELPER
/* Not inline: with a copy at each call, the compiler for GPUs takes minutes. */
#define FAST static __attribute__((noinline))
#else
#include <math.h>
#include <string.h>
#define FAST static __attribute__((optimize("O3", "associative-math", "no-signed-zeros"), unused))
#define SMALL FAST
#endif

/* What counts as solved, and as exact, relative to the impulses; pivots below LEAST_PIVOT times their
 * diagonal entries are rounding. In single precision rounding leaves residuals of some 3e-7. */
#ifdef SINGLE
#define SIZE(x) fabsf(x)
#define ROOT(x) sqrtf(x)
#define SOLVED 1e-5f
#define ROUNDING 1e-6f
#define LEAST_PIVOT 1e-7f
#define HELD_BY_LOOPS 1e-5f
#else
#define SIZE(x) fabs(x)
#define ROOT(x) sqrt(x)
#define SOLVED 1e-9
#define ROUNDING 1e-11
#define LEAST_PIVOT 1e-12
#define HELD_BY_LOOPS 1e-10 /* as in thresholds.py */
#endif
#define IS_FINITE(x) ((x) * 0 == 0)

enum { STOP, DRY, SIDE, NORMAL };
#define SWEEPS 10
#define STEPS 20
#define REFINED 3
#define LARGEST N(1e3)
/* Steps of Newton's method from the impulses of the step before, without sweeps. */
#define WARM_STEPS 6

/* Rows of matrices are filled with zeros up to a multiple of WIDE numbers, so that vectors have no
 * rest; what stands left of a diagonal is not read. */
#define WIDE 8
#define FILLED(n) (((n) + WIDE - 1) / WIDE * WIDE)

/* The rows of a robot; the numbers are those of nonsmooth_kernel.Layout. */
typedef struct {
    int n, q, load, motors, m, contacts, ropes, cables, stops, dry, implicit;
    int at_inertia, at_forces, at_gaps, at_lengths, at_positions, at_entries, outputs, checks;
    const int *row_start, *row_column, *impulse_row, *impulse_sign, *implicit_row, *stop_position;
    const number *coordinate_scale, *gap_scale; /* make coordinates, and gaps, free of units */
} rows_of_robot;

/* A problem x = P(x - w), w = A x + u, with the diagonal of A at most 1. */
typedef struct {
    int m, wide; /* wide is FILLED(m), the length of rows of A */
    const number *A, *u, *bounds;
    const int *kinds;
    number *w, *F, *y, *dx, *D, *right, *row; /* workspace: m each, D m * m */
    int *inside;
    /* Factors in D: of the rows of `factorized`, which are as `inside`, with this proximal term; 0 if
     * there are none. */
    int *factorized;
    number factors_for;
} problem;

SMALL number length_of(number a, number b)
{
    return ROOT(a * a + b * b);
}

/* y += a x from number `first` of rows of `wide` numbers on, or from a few before it. */
SMALL void add_row(number *restrict y, number a, const number *restrict x, int first, int wide)
{
    for (int i = first / WIDE * WIDE; i < wide; i += WIDE)
        for (int j = 0; j < WIDE; j++)
            y[i + j] += a * x[i + j];
}

/* A = U^T D U in place: U above the diagonal, which is 1, and reciprocals of D on it; false if a pivot
 * is too small. `least` is workspace. */
FAST int factorize(number *A, int n, int wide, number *least)
{
    for (int k = 0; k < n; k++)
        least[k] = LEAST_PIVOT * A[k * wide + k];
    for (int k = 0; k < n; k++) {
        number *row = A + k * wide;
        if (!(row[k] > least[k]))
            return 0;
        const number inverse = 1 / row[k];
        for (int i = k + 1; i < n; i++)
            if (row[i] != 0)
                add_row(A + i * wide, -row[i] * inverse, row, i, wide);
        row[k] = inverse;
        for (int j = k + 1; j < n; j++)
            row[j] *= inverse;
    }
    return 1;
}

/* U x = b, in place. */
FAST void solve_upper(const number *restrict U, number *restrict b, int n, int wide)
{
    for (int k = n - 1; k >= 0; k--) {
        number sum = b[k];
        for (int j = k + 1; j < n; j++)
            sum -= U[k * wide + j] * b[j];
        b[k] = sum;
    }
}

/* U^T D U x = b, in place. */
FAST void solve_symmetric(const number *restrict U, number *restrict b, int n, int wide)
{
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++)
            b[i] -= U[k * wide + i] * b[k];
    for (int k = 0; k < n; k++)
        b[k] *= U[k * wide + k];
    solve_upper(U, b, n, wide);
}

/* U^T D^(1/2) Z = b, in place, for many right sides in rows of `many` numbers, a multiple of WIDE. */
FAST void solve_many(const number *U, number *b, int n, int wide, int many)
{
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++)
            if (U[k * wide + i] != 0)
                add_row(b + i * many, -U[k * wide + i], b + k * many, 0, many);
    for (int k = 0; k < n; k++) {
        const number root = ROOT(U[k * wide + k]);
        for (int j = 0; j < many; j++)
            b[k * many + j] *= root;
    }
}

/* D x = right by elimination with pivots, in place; false if a pivot is zero. */
FAST int solve_general(number *D, number *right, int n, int wide)
{
    for (int k = 0; k < n; k++) {
        int largest = k;
        for (int i = k + 1; i < n; i++)
            if (SIZE(D[i * wide + k]) > SIZE(D[largest * wide + k]))
                largest = i;
        if (!(SIZE(D[largest * wide + k]) > 0))
            return 0;
        if (largest != k) {
            for (int j = k; j < n; j++) {
                const number kept = D[k * wide + j];
                D[k * wide + j] = D[largest * wide + j];
                D[largest * wide + j] = kept;
            }
            const number kept = right[k];
            right[k] = right[largest];
            right[largest] = kept;
        }
        const number inverse = 1 / D[k * wide + k];
        for (int j = k; j < n; j++)
            D[k * wide + j] *= inverse;
        right[k] *= inverse;
        for (int i = k + 1; i < n; i++) {
            const number factor = D[i * wide + k];
            if (factor != 0) {
                add_row(D + i * wide, -factor, D + k * wide, k, wide);
                right[i] -= factor * right[k];
            }
        }
    }
    solve_upper(D, right, n, wide);
    return 1;
}

/* w = A x + u, F = x - P(x - w), and the largest |F| relative to the impulses. */
FAST number residual_at(problem *p, const number *x)
{
    const int m = p->m;
    number largest = 0, size = 0, rates = 0;
    memcpy(p->w, p->u, m * sizeof(number));
    memset(p->w + m, 0, (p->wide - m) * sizeof(number));
    for (int i = 0; i < m; i++)
        if (x[i] != 0)
            add_row(p->w, x[i], p->A + i * p->wide, 0, p->wide);
    for (int i = 0; i < m; i++)
        p->y[i] = x[i] - p->w[i];
    for (int i = 0; i < m; i++) {
        const number y = p->y[i], bound = p->bounds[i];
        if (p->kinds[i] == STOP)
            p->F[i] = x[i] - (y > 0 ? y : 0);
        else if (p->kinds[i] == DRY)
            p->F[i] = x[i] - (y > bound ? bound : y < -bound ? -bound : y);
        else if (p->kinds[i] == NORMAL) {
            const number normal = y > 0 ? y : 0, most = bound * normal;
            const number side = length_of(p->y[i - 2], p->y[i - 1]);
            const number factor = side > most ? most / side : 1;
            p->F[i] = x[i] - normal;
            p->F[i - 1] = x[i - 1] - factor * p->y[i - 1];
            p->F[i - 2] = x[i - 2] - factor * p->y[i - 2];
        }
    }
    for (int i = 0; i < m; i++) {
        largest = SIZE(p->F[i]) > largest || p->F[i] != p->F[i] ? SIZE(p->F[i]) : largest;
        size = SIZE(x[i]) > size ? SIZE(x[i]) : size;
        rates = SIZE(p->u[i]) > rates ? SIZE(p->u[i]) : rates;
    }
    size = size < LARGEST * rates ? size : LARGEST * rates;
    return largest == 0 ? 0 : largest / size;
}

/* One step of Newton's method on F, from x and what `residual_at` left; false if it fails. */
FAST int newton_step(problem *p, number *x, number proximal)
{
    const int m = p->m, wide = p->wide;
    int k = 0, slides = 0;
    for (int i = 0; i < m; i++) {
        const number y = p->y[i];
        p->inside[i] = 0;
        if (p->kinds[i] == STOP)
            p->inside[i] = y > 0;
        else if (p->kinds[i] == DRY)
            p->inside[i] = SIZE(y) <= p->bounds[i];
        else if (p->kinds[i] == NORMAL && y > 0) {
            const int slips = length_of(p->y[i - 2], p->y[i - 1]) > p->bounds[i] * y;
            p->inside[i] = 1;
            p->inside[i - 1] = p->inside[i - 2] = 1 + slips;
            slides |= slips;
        }
        p->dx[i] = -p->F[i];
    }
    int fits = p->factors_for == proximal; /* the matrix is that of an earlier step */
    for (int i = 0; i < m; i++) {
        k += p->inside[i] > 0;
        fits &= p->inside[i] == p->factorized[i];
        p->factorized[i] = p->inside[i];
    }
    const int filled = FILLED(k);
    int at = 0;
    for (int i = 0; i < m; i++) {
        if (!p->inside[i])
            continue;
        if (fits) {
            number right = -p->F[i];
            for (int j = 0; j < m; j++)
                if (!p->inside[j])
                    right -= p->A[i * wide + j] * p->dx[j];
            p->right[at++] = right;
            continue;
        }
        number *row = p->row;
        memcpy(row, p->A + i * wide, wide * sizeof(number));
        row[i] += proximal;
        if (p->inside[i] == 2) {
            const int normal = p->kinds[i + 1] == NORMAL ? i + 1 : i + 2, first = normal - 2;
            const number a = p->y[first], b = p->y[first + 1], side = length_of(a, b);
            const number way[2] = {a / side, b / side};
            const number mu = p->bounds[normal], share = mu * p->y[normal] / side;
            memset(row, 0, wide * sizeof(number));
            row[i] = 1;
            for (int c = 0; c < 3; c++) {
                number slope = mu * way[i - first];
                if (c < 2)
                    slope = share * ((c == i - first) - way[i - first] * way[c]);
                add_row(row, slope, p->A + (first + c) * wide, 0, wide);
                row[first + c] -= slope * (1 - proximal);
            }
        }
        number right = -p->F[i];
        int column = 0;
        for (int j = 0; j < m; j++) {
            if (p->inside[j])
                p->D[at * filled + column++] = row[j];
            else
                right -= row[j] * p->dx[j];
        }
        while (column < filled)
            p->D[at * filled + column++] = 0;
        p->right[at++] = right;
    }
    if (slides) { /* the matrix depends on y */
        p->factors_for = 0;
        if (!solve_general(p->D, p->right, k, filled))
            return 0;
    } else {
        if (!fits && !factorize(p->D, k, filled, p->w)) {
            p->factors_for = 0;
            return 0;
        }
        p->factors_for = proximal;
        solve_symmetric(p->D, p->right, k, filled);
    }
    at = 0;
    for (int i = 0; i < m; i++) {
        x[i] += p->inside[i] ? p->right[at++] : p->dx[i];
        if (!IS_FINITE(x[i]))
            return 0;
    }
    return 1;
}

/* The best of some steps of Newton's method from x, in `best`; its residual. */
FAST number newton(problem *p, number *x, number *best, number proximal, int steps)
{
    number least = INFINITY;
    for (int step = 0; step < steps; step++) {
        const number error = residual_at(p, x);
        if (!(error < least) && least < SOLVED)
            break;
        if (error < least) {
            least = error;
            memcpy(best, x, p->m * sizeof(number));
        }
        if (least < ROUNDING || !newton_step(p, x, proximal))
            break;
    }
    return least;
}

/* One sweep of projected Gauss-Seidel; p->w is A x + u before and after. */
FAST void sweep(problem *p, number *x)
{
    const int m = p->m, wide = p->wide;
    for (int i = 0; i < m; i++) {
        const number *row = p->A + i * wide;
        if (p->kinds[i] == SIDE)
            continue;
        number next = x[i] - p->w[i] / row[i], change;
        if (p->kinds[i] == DRY)
            next = next > p->bounds[i] ? p->bounds[i] : next < -p->bounds[i] ? -p->bounds[i] : next;
        else
            next = next > 0 ? next : 0;
        if ((change = next - x[i]) != 0) {
            x[i] = next;
            add_row(p->w, change, row, 0, wide);
        }
        if (p->kinds[i] == NORMAL) {
            const int a = i - 2, b = i - 1;
            const number trace = p->A[a * wide + a] + p->A[b * wide + b], most = p->bounds[i] * x[i];
            number sides[2] = {0, 0};
            if (trace > 0) {
                sides[0] = x[a] - p->w[a] / trace;
                sides[1] = x[b] - p->w[b] / trace;
                const number size = length_of(sides[0], sides[1]);
                const number factor = size > most ? most / size : 1;
                sides[0] *= factor;
                sides[1] *= factor;
            }
            for (int c = 0; c < 2; c++)
                if ((change = sides[c] - x[a + c]) != 0) {
                    x[a + c] = sides[c];
                    add_row(p->w, change, p->A + (a + c) * wide, 0, wide);
                }
        }
    }
}

/* The solution near x, in x, and its residual, by at most some series of sweeps and Newton's steps.
 * `swept`, `near` and `best` are workspace. */
FAST number solve_rows(
    problem *p, number *x, int series, number *swept, number *near, number *best)
{
    static const number proximal[] = {N(1e-6), N(1e-8), N(1e-3), N(1e-7), N(1e-5), N(1e-2)};
    const size_t size = p->m * sizeof(number);
    memcpy(swept, x, size);
    memcpy(best, x, size);
    number least = newton(p, x, best, proximal[0], WARM_STEPS);
    for (int k = 0; k < series; k++) {
        if (least < ROUNDING || (least < SOLVED && k >= REFINED))
            break;
        const int alone = k % 3 == 0;
        memcpy(x, alone ? swept : best, size);
        residual_at(p, x);
        for (int turn = 0; turn < (alone ? SWEEPS * (1 + k) : SWEEPS); turn++)
            sweep(p, x);
        if (alone)
            memcpy(swept, x, size);
        const number error = newton(p, x, near, proximal[k % 6], STEPS);
        if (error < least) {
            least = error;
            memcpy(best, near, size);
        }
    }
    memcpy(x, best, size);
    return least;
}

/* Lengths of the workspaces `work` and `flags` of `nonsmooth_step`. */
#define WORKSPACE(n, m, motors) ((n) * FILLED(n) + 2 * FILLED(n) + (n) * FILLED(m) \
    + 2 * (m) * FILLED(m) + 16 * FILLED(m) + (motors))
#define FLAGS(m) (5 * (m) + 1)

/* Rate of the row of impulse i for rates v of the coordinates. */
SMALL number rate_of(const rows_of_robot *f, const number *entries, const number *v, int i)
{
    const int row = f->impulse_row[i];
    number sum = 0;
    for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
        sum += entries[a] * v[f->row_column[a]];
    return f->impulse_sign[i] * sum;
}

/* Whether the row of impulse i can change its gap, number g: whether it is more than rounding. */
SMALL int can_move(const rows_of_robot *f, const number *entries, int i, int g)
{
    const int row = f->impulse_row[i];
    for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
        if (SIZE(entries[a]) * f->coordinate_scale[f->row_column[a]] > HELD_BY_LOOPS * f->gap_scale[g])
            return 1;
    return 0;
}

/* One step: rates `va` become those at its end, `x` the impulses, from those of the step before.
 * y are the terms at q, `series` bounds the iterations. False if the inertia is not positive definite or a number is not finite. */
FAST int nonsmooth_step(const rows_of_robot *f, const number *y, const number *q, number *va,
    const number *tau, const number *held, number h, const number *numbers, int series, number *x,
    number *residual, number *work, int *flags)
{
    const int n = f->n, m = f->m, wide = FILLED(n), c = f->contacts, gaps = c + f->ropes, k = f->cables;
    const number *friction = numbers, *restitution = friction + c, *offsets = restitution + c;
    const number *line_k = offsets + gaps, *rest = line_k + k, *line_d = rest + k;
    const number *preload = line_d + k, *on_cables = preload + k;
    const number *limits = on_cables + k * f->motors, *coulomb = limits + f->stops;
    const number *damping = coulomb + f->dry, *stiffness = damping + f->implicit;
    const int first_motor = f->implicit - f->motors;
    const number *entries = y + f->at_entries;
    const int most_rows = FILLED(m);
    number *A = work, *free = A + n * wide, *change = free + wide, *Z = change + wide;
    number *G = Z + n * most_rows, *D = G + m * most_rows, *bias = D + m * most_rows;
    number *compliance = bias + most_rows, *bounds = compliance + most_rows;
    number *vectors = bounds + most_rows, *effort = vectors + 13 * most_rows;
    int *acting = flags, *index = flags + m, *kinds = flags + 2 * m, *inside = flags + 3 * m;
    int *factorized = flags + 4 * m;

    /* the inertia, with damping and stiffness at the end of the step */
    memset(A, 0, n * wide * sizeof(number));
    for (int i = 0, at = f->at_inertia; i < n; i++)
        for (int j = i; j < n; j++)
            A[i * wide + j] = y[at++];
    for (int i = 0; i < n; i++)
        free[i] = h * y[f->at_forces + i];
    for (int i = 0; i < n; i++) {
        free[i] += A[i * wide + i] * va[i];
        for (int j = i + 1; j < n; j++) {
            free[i] += A[i * wide + j] * va[j];
            free[j] += A[i * wide + j] * va[i];
        }
    }
    for (int i = 0; i < f->motors; i++)
        effort[i] = tau[i] - stiffness[first_motor + i] * (y[f->at_positions + i] - held[i]);
    for (int i = 0; i < f->implicit; i++) {
        const int row = f->implicit_row[i], begin = f->row_start[row], end = f->row_start[row + 1];
        const number factor = h * damping[i] + h * h * stiffness[i];
        for (int a = begin; a < end; a++) {
            if (i >= first_motor)
                free[f->row_column[a]] += h * effort[i - first_motor] * entries[a];
            if (factor != 0)
                for (int b = a; b < end; b++)
                    A[f->row_column[a] * wide + f->row_column[b]] += factor * entries[a] * entries[b];
        }
    }

    /* cables: w = J va + bias + compliance x; one of constant tension is a force */
    for (int i = 0; i < m; i++) {
        acting[i] = 0;
        bias[i] = compliance[i] = bounds[i] = 0;
    }
    const int first_cable = 3 * c + f->ropes, first_stop = first_cable + k;
    for (int i = 0; i < k; i++) {
        const number length = y[f->at_lengths + i], *share = on_cables + i * f->motors;
        number tension = preload[i] + line_k[i] * (length - rest[i]);
        number hard = line_k[i], soft = line_d[i];
        for (int j = 0; j < f->motors; j++) {
            tension -= share[j] * effort[j];
            hard += share[j] * share[j] * stiffness[first_motor + j];
            soft += share[j] * share[j] * damping[first_motor + j];
        }
        const int at = first_cable + i, row = f->impulse_row[at];
        if (hard + soft > 0) {
            bias[at] = -tension / (soft + h * hard);
            compliance[at] = 1 / (h * (soft + h * hard));
            continue;
        }
        acting[at] = -1; /* never acts as a row */
        bounds[at] = tension > 0 ? h * tension : 0;
        for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
            free[f->row_column[a]] += bounds[at] * entries[a];
    }
    if (!factorize(A, n, wide, change))
        return 0;
    solve_symmetric(A, free, n, wide);

    for (int i = 0; i < c; i++) {
        const int at = 3 * i + 2;
        const number gap = y[f->at_gaps + i] - offsets[i];
        bias[at] = gap / h;
        bounds[at] = friction[i];
        if (restitution[i] > 0) {
            const number before = rate_of(f, entries, va, at), ahead = rate_of(f, entries, free, at);
            if (before < 0 && gap + h * (before < ahead ? before : ahead) <= 0)
                bias[at] = restitution[i] * before;
        }
    }
    for (int i = 0; i < f->ropes; i++)
        bias[3 * c + i] = (y[f->at_gaps + c + i] - offsets[c + i]) / h;
    for (int i = 0; i < f->stops; i++)
        bias[first_stop + i] = f->impulse_sign[first_stop + i]
            * (q[f->stop_position[i]] - limits[i]) / h;
    for (int i = 0; i < f->dry; i++) {
        const int at = first_stop + f->stops + i;
        bounds[at] = h * coulomb[i];
        acting[at] = bounds[at] > 0 ? 1 : -1;
    }

    /* contacts, ropes and stops that the loops hold never act */
    for (int i = 0; i < c; i++)
        if (!can_move(f, entries, 3 * i + 2, i))
            acting[3 * i] = acting[3 * i + 1] = acting[3 * i + 2] = -1;
    for (int i = 0; i < f->ropes; i++)
        if (!can_move(f, entries, 3 * c + i, c + i))
            acting[3 * c + i] = -1;
    for (int i = 0; i < f->stops; i++)
        if (!can_move(f, entries, first_stop + i, gaps + i))
            acting[first_stop + i] = -1;

    /* rows that act, until the others are not violated */
    const number *rates = free;
    number worst = 0;
    for (;;) {
        int more = 0, count = 0;
        for (int i = 0; i < first_stop + f->stops; i++) {
            const int contact = i < 3 * c;
            const int at = contact ? i + 2 : i;
            if (acting[at] == 0 && rate_of(f, entries, rates, at) + bias[at] < 0) {
                more = acting[at] = 1;
                if (contact)
                    acting[i] = acting[i + 1] = 1;
            }
            i = at;
        }
        for (int i = 0; i < m; i++)
            if (acting[i] == 1)
                index[count++] = i;
        if (rates == free && count)
            more = 1;
        if (!more)
            break;
        const int filled = FILLED(count);
        memset(Z, 0, n * filled * sizeof(number));
        for (int a = 0; a < count; a++) {
            const int row = f->impulse_row[index[a]], sign = f->impulse_sign[index[a]];
            for (int b = f->row_start[row]; b < f->row_start[row + 1]; b++)
                Z[f->row_column[b] * filled + a] = sign * entries[b];
        }
        solve_many(A, Z, n, wide, filled);
        number *unit = vectors, *u = unit + most_rows, *most = u + most_rows;
        number *now = most + most_rows;
        for (int a = 0; a < count; a++)
            unit[a] = compliance[index[a]];
        for (int b = 0; b < n; b++)
            for (int a = 0; a < count; a++)
                unit[a] += Z[b * filled + a] * Z[b * filled + a];
        int kept = 0;
        for (int a = 0; a < count; a++) {
            const int at = index[a];
            kinds[a] = at >= first_stop + f->stops ? DRY : at >= 3 * c ? STOP : SIDE;
            if (at < 3 * c && at % 3 == 2) {
                kinds[a] = NORMAL;
                if (!(unit[a] > 0)) /* it cannot be changed */
                    acting[at] = acting[at - 1] = acting[at - 2] = -1;
                const number larger = unit[a - 1] > unit[a - 2] ? unit[a - 1] : unit[a - 2];
                unit[a] = unit[a] > larger ? unit[a] : larger;
                unit[a - 1] = unit[a - 2] = unit[a];
            } else if (kinds[a] != SIDE && !(unit[a] > 0))
                acting[at] = -1;
        }
        for (int a = 0; a < count; a++)
            kept += acting[index[a]] == 1;
        if (kept < count) {
            rates = free;
            continue;
        }
        for (int a = 0; a < count; a++) {
            const int at = index[a];
            unit[a] = ROOT(unit[a]);
            u[a] = (rate_of(f, entries, free, at) + bias[at]) / unit[a];
            most[a] = kinds[a] == DRY ? bounds[at] * unit[a] : bounds[at];
            now[a] = x[at] * unit[a];
        }
        for (int a = 0; a < count; a++) {
            const number inverse = 1 / unit[a];
            for (int b = 0; b < n; b++)
                Z[b * filled + a] *= inverse;
        }
        memset(G, 0, count * filled * sizeof(number));
        for (int b = 0; b < n; b++)
            for (int a = 0; a < count; a++)
                if (Z[b * filled + a] != 0)
                    add_row(G + a * filled, Z[b * filled + a], Z + b * filled, 0, filled);
        for (int a = 0; a < count; a++)
            G[a * filled + a] += compliance[index[a]] / (unit[a] * unit[a]);
        number *room[9];
        for (int a = 0; a < 9; a++)
            room[a] = now + (a + 1) * most_rows;
        problem p = {count, filled, G, u, most, kinds, room[0], room[1], room[2], room[3], D, room[4],
            room[5], inside, factorized, 0};
        worst = solve_rows(&p, now, series, room[6], room[7], room[8]);
        for (int b = 0; b < n; b++) {
            change[b] = 0;
            for (int a = 0; a < count; a++)
                change[b] += Z[b * filled + a] * now[a];
            change[b] *= ROOT(A[b * wide + b]); /* Z = D^(-1/2) U^(-T) times the rows */
        }
        solve_upper(A, change, n, wide);
        for (int b = 0; b < n; b++)
            change[b] += free[b];
        memset(x, 0, m * sizeof(number));
        for (int a = 0; a < count; a++)
            x[index[a]] = now[a] / unit[a];
        rates = change;
    }
    if (rates == free)
        memset(x, 0, m * sizeof(number));
    number sum = 0;
    for (int i = 0; i < n; i++)
        sum += va[i] = rates[i];
    for (int i = 0; i < k; i++)
        if (acting[first_cable + i] == -1)
            x[first_cable + i] = bounds[first_cable + i];
    *residual = worst;
    return IS_FINITE(sum);
}

/* Whether contacts, ropes and stops are violated at most by the bounds for a start, `times` so much. */
FAST int starts_free(const rows_of_robot *f, const number *y, const number *q,
    const number *numbers, number times)
{
    const int gaps = f->contacts + f->ropes, first_stop = 3 * f->contacts + f->ropes + f->cables;
    const number *offsets = numbers + 2 * f->contacts;
    const number *limits = offsets + gaps + (4 + f->motors) * f->cables;
    const number *least = limits + f->stops + f->dry + 2 * f->implicit;
    for (int i = 0; i < gaps; i++)
        if (!(y[f->at_gaps + i] - offsets[i] >= times * least[i]))
            return 0;
    for (int i = 0; i < f->stops; i++) {
        const number gap = q[f->stop_position[i]] - limits[i];
        if (!(f->impulse_sign[first_stop + i] * gap >= times * least[gaps + i]))
            return 0;
    }
    return 1;
}
