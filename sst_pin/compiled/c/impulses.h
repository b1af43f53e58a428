/* SPDX-License-Identifier: BSD-2-Clause */
/* The impulses x of the m rows that act in one step. It needs dense_solvers.h; the main function,
 * `solve_rows`, is at the end.
 *
 * The rates of the rows after the impulses are w = A x + u. A row i is of one of these kinds:
 *
 *     STOP    0 <= x_i,  0 <= w_i,  x_i w_i = 0
 *     DRY     |x_i| <= bound_i;  w_i = 0, or x_i = -bound_i sign w_i
 *     SIDE, SIDE, NORMAL of a contact: the normal row i as a stop; the impulse s = (x_i-2, x_i-1)
 *             in the plane has |s| <= mu x_i;  w_s = 0, or s = -mu x_i w_s / |w_s|
 *
 * The rows with STOP alone are a linear complementarity problem; Coulomb's cone makes it nonlinear.
 * All kinds together are the equation of Alart and Curnier
 *
 *     F(x) = x - P(y) = 0,  y = x - w,
 *
 * in which P clips y to the bounds, and the sides of a contact to the circle with the radius mu
 * P_i. For instance for a stop: x = max(x - w, 0) holds if x = 0 and w >= 0, or if x > 0 and w = 0.
 *
 * The solver tries a few steps of Newton's method on F from the impulses of the step before, which
 * is enough in most steps. If not, sweeps of projected Gauss-Seidel come near the solution, and
 * Newton's method finishes. `_Problem` of dynamics/impulses.py is the same solver without the first
 * steps; that file cites the sources and gives the reasons for the constants. */

/* The residual is the largest |F|, relative to the largest impulse. x is a solution if its residual
 * is below SOLVED, and an exact one, up to rounding, if it is below ROUNDING. In single precision
 * rounding leaves residuals of some 3e-7. */
#ifdef SINGLE
#define SOLVED 1e-5f
#define ROUNDING 1e-6f
#else
#define SOLVED 1e-9
#define ROUNDING 1e-11
#endif
/* Where no impulses solve the step, they grow without bound, and the residual would seem small. So
 * the residual is relative to at most this multiple of the largest rate |u|. */
#define LARGEST N(1e3)
/* The most steps of Newton's method from the impulses of the step before. */
#define WARM_STEPS 6
/* A series is this number of sweeps, then at most this number of steps of Newton's method. */
#define SWEEPS 10
#define STEPS 20
/* The most series that improve a solution which is not exact up to rounding. */
#define REFINED 3

/* Kinds of rows. */
enum { STOP, DRY, SIDE, NORMAL };

/* P has a different formula in each region of y. The cases for a row i:
 *
 *     AT_BOUND   P_i is constant
 *     INSIDE     P_i = y_i
 *     SLIDING    a side: P_i = mu y_n y_i / |s|, with the normal row n and s = (y_n-2, y_n-1) */
enum { AT_BOUND, INSIDE, SLIDING };

typedef struct {
    int m, wide;     /* number of rows; length of the rows of A */
    const number *A; /* symmetric, shape (m, wide), diagonal entries at most 1 */
    const number *u;
    const int *kinds;
    const number *bounds; /* largest impulse of a DRY row, coefficient mu of a NORMAL row */
    /* results of `residual_at`; `newton_step` overwrites w */
    number *w, *y, *F;
    /* workspace of `newton_step`: the formula of each row; the step; matrix and right side of the
     * equations of the rows that are not AT_BOUND; a row of dF / dx */
    int *formula;
    number *dx, *D, *right, *row;
    /* D holds factors of the matrix for these formulas and this proximal term. If the term is 0, D
     * holds no factors. */
    int *formula_of_factors;
    number proximal_of_factors;
} problem;

INLINED number length_of(number a, number b)
{
    return ROOT(a * a + b * b);
}

INLINED number not_negative(number x)
{
    return x > 0 ? x : 0;
}

INLINED number clipped(number x, number bound)
{
    return x > bound ? bound : x < -bound ? -bound : x;
}

/* The factor that puts the vector (a, b) into a circle about the origin: 1 if it is inside. */
INLINED number into_circle(number a, number b, number radius)
{
    const number length = length_of(a, b);
    return length > radius ? radius / length : 1;
}

/* Compute w, y and F at x. Returns the residual; 0 if F is zero. */
FAST number residual_at(problem *p, const number *x)
{
    const int m = p->m;
    memcpy(p->w, p->u, m * sizeof(number));
    memset(p->w + m, 0, (p->wide - m) * sizeof(number));
    for (int i = 0; i < m; i++)
        if (x[i] != 0) /* A is symmetric: its row i is its column i */
            add_row(p->w, x[i], p->A + i * p->wide, 0, p->wide);
    for (int i = 0; i < m; i++)
        p->y[i] = x[i] - p->w[i];

    for (int i = 0; i < m; i++) {
        const number *y = p->y + i;
        if (p->kinds[i] == STOP)
            p->F[i] = x[i] - not_negative(*y);
        else if (p->kinds[i] == DRY)
            p->F[i] = x[i] - clipped(*y, p->bounds[i]);
        else if (p->kinds[i] == NORMAL) {
            const number normal = not_negative(*y);
            const number factor = into_circle(y[-2], y[-1], p->bounds[i] * normal);
            p->F[i] = x[i] - normal;
            p->F[i - 1] = x[i - 1] - factor * y[-1];
            p->F[i - 2] = x[i - 2] - factor * y[-2];
        }
    }

    number largest = 0, impulse = 0, rate = 0;
    for (int i = 0; i < m; i++) {
        const number error = MAGNITUDE(p->F[i]);
        largest = error > largest || error != error ? error : largest; /* NaN stays */
        impulse = MAGNITUDE(x[i]) > impulse ? MAGNITUDE(x[i]) : impulse;
        rate = MAGNITUDE(p->u[i]) > rate ? MAGNITUDE(p->u[i]) : rate;
    }
    impulse = impulse < LARGEST * rate ? impulse : LARGEST * rate;
    return largest == 0 ? 0 : largest / impulse;
}

/* Find the formula of P for each row at y. Returns whether a contact slides. */
INLINED int find_formulas(problem *p)
{
    int slides = 0;
    for (int i = 0; i < p->m; i++) {
        const number *y = p->y + i;
        p->formula[i] = AT_BOUND; /* a side keeps it, unless its normal row changes it */
        if (p->kinds[i] == STOP)
            p->formula[i] = *y > 0 ? INSIDE : AT_BOUND;
        else if (p->kinds[i] == DRY)
            p->formula[i] = MAGNITUDE(*y) <= p->bounds[i] ? INSIDE : AT_BOUND;
        else if (p->kinds[i] == NORMAL && *y > 0) {
            const int contact_slides = length_of(y[-2], y[-1]) > p->bounds[i] * *y;
            p->formula[i] = INSIDE;
            p->formula[i - 1] = p->formula[i - 2] = contact_slides ? SLIDING : INSIDE;
            slides |= contact_slides;
        }
    }
    return slides;
}

/* Whether D holds the factors for the formulas and this proximal term already. */
INLINED int has_factors(const problem *p, number proximal)
{
    int same = p->proximal_of_factors == proximal;
    for (int i = 0; i < p->m; i++)
        same &= p->formula[i] == p->formula_of_factors[i];
    return same;
}

/* Put row i of the matrix of `newton_step`, 1 - S + S (A + proximal 1), into p->row, for a side
 * that is SLIDING. With the direction e = s / |s| and the radius mu y_n, its row of S = dP / dy
 * has, for the sides j and the normal row n,
 *
 *     S_ij = mu y_n / |s| (delta_ij - e_i e_j),    S_in = mu e_i. */
INLINED void sliding_row(problem *p, int i, number proximal)
{
    const int normal = p->kinds[i + 1] == NORMAL ? i + 1 : i + 2;
    const int first = normal - 2, side = i - first; /* first side; 0 or 1, which of them i is */
    const number *s = p->y + first, length = length_of(s[0], s[1]);
    const number e[2] = {s[0] / length, s[1] / length};
    const number mu = p->bounds[normal], ratio = mu * p->y[normal] / length;
    memset(p->row, 0, p->wide * sizeof(number));
    p->row[i] = 1;
    for (int j = 0; j < 3; j++) { /* of the sides and the normal row: add S_ij times their rows */
        const number slope = j < 2 ? ratio * ((j == side) - e[side] * e[j]) : mu * e[side];
        add_row(p->row, slope, p->A + (first + j) * p->wide, 0, p->wide);
        p->row[first + j] -= slope * (1 - proximal);
    }
}

/* Copy the entries of a row in the columns that are not AT_BOUND, and fill the rest with zeros. */
INLINED void copy_unknown(const problem *p, number *to, const number *row, int filled)
{
    int column = 0;
    for (int j = 0; j < p->m; j++)
        if (p->formula[j] != AT_BOUND)
            to[column++] = row[j];
    while (column < filled)
        to[column++] = 0;
}

/* One step of Newton's method on F, from x and the results of `residual_at`. False if it fails.
 * With S = dP / dy and dy = dx - A dx, dF = (1 - S + S A) dx. The step solves
 *
 *     (1 - S + S (A + proximal 1)) dx = -F.
 *
 * The proximal term makes the matrix regular if rows are redundant, with which A is singular; it
 * does not change the solution. Rows AT_BOUND have S = 0, so that dx_i = -F_i. The others are the
 * unknown rows. If no contact slides, S = 1 for them: their matrix is their part of A + proximal 1,
 * which is symmetric, and its factors are used again while the same rows are unknown. If a contact
 * slides, D keeps no factors, so that `factorized` is false while the contact slides. */
FAST int newton_step(problem *p, number *x, number proximal)
{
    const int m = p->m, wide = p->wide;
    const int slides = find_formulas(p), factorized = has_factors(p, proximal);
    int unknown = 0;
    for (int i = 0; i < m; i++) {
        p->formula_of_factors[i] = p->formula[i];
        unknown += p->formula[i] != AT_BOUND;
        p->dx[i] = -p->F[i]; /* of the unknown rows, it is replaced below */
    }

    const int filled = FILLED(unknown);
    for (int i = 0, k = 0; i < m; i++) {
        if (p->formula[i] == AT_BOUND)
            continue;
        const number *row = p->A + i * wide;
        if (p->formula[i] == SLIDING) {
            sliding_row(p, i, proximal);
            row = p->row;
        }
        number right = -p->F[i];
        for (int j = 0; j < m; j++)
            if (p->formula[j] == AT_BOUND)
                right -= row[j] * p->dx[j];
        p->right[k] = right;
        if (!factorized) {
            copy_unknown(p, p->D + k * filled, row, filled);
            if (p->formula[i] == INSIDE)
                p->D[k * filled + k] += proximal;
        }
        k++;
    }

    p->proximal_of_factors = 0; /* until D holds factors */
    if (slides) {
        if (!solve_general(p->D, p->right, unknown, filled))
            return 0;
    } else {
        if (!factorized && !factorize(p->D, unknown, filled, p->w))
            return 0;
        p->proximal_of_factors = proximal;
        solve_symmetric(p->D, p->right, unknown, filled);
    }

    for (int i = 0, k = 0; i < m; i++) {
        x[i] += p->formula[i] == AT_BOUND ? p->dx[i] : p->right[k++];
        if (!IS_FINITE(x[i]))
            return 0;
    }
    return 1;
}

/* Make at most `steps` steps of Newton's method from x, which changes. `best` gets the x with the
 * least residual, which is returned. */
FAST number newton(problem *p, number *x, number *best, number proximal, int steps)
{
    number least = INFINITY;
    for (int step = 0; step < steps; step++) {
        const number error = residual_at(p, x);
        if (!(error < least) && least < SOLVED)
            break; /* a solution that does not become better */
        if (error < least) {
            least = error;
            memcpy(best, x, p->m * sizeof(number));
        }
        if (least < ROUNDING || !newton_step(p, x, proximal))
            break;
    }
    return least;
}

/* Set x_i, and change w = A x + u accordingly. */
INLINED void set_impulse(problem *p, number *x, int i, number impulse)
{
    const number change = impulse - x[i];
    if (change != 0) {
        x[i] = impulse;
        add_row(p->w, change, p->A + i * p->wide, 0, p->wide);
    }
}

/* One sweep of projected Gauss-Seidel: each x_i in turn becomes the solution of its own row, while
 * the others are held. w = A x + u holds before and after. */
FAST void sweep(problem *p, number *x)
{
    const int wide = p->wide;
    for (int i = 0; i < p->m; i++) {
        if (p->kinds[i] == SIDE) /* sides are set after their normal row */
            continue;
        const number impulse = x[i] - p->w[i] / p->A[i * wide + i];
        const int is_dry = p->kinds[i] == DRY;
        set_impulse(p, x, i, is_dry ? clipped(impulse, p->bounds[i]) : not_negative(impulse));
        if (p->kinds[i] != NORMAL)
            continue;
        /* Both sides have one divisor: the trace of their block of A. It is not less than the
         * eigenvalues of the block, so that the change is never too large. */
        const int first = i - 2, second = i - 1;
        const number trace = p->A[first * wide + first] + p->A[second * wide + second];
        number a = 0, b = 0;
        if (trace > 0) {
            a = x[first] - p->w[first] / trace;
            b = x[second] - p->w[second] / trace;
            const number factor = into_circle(a, b, p->bounds[i] * x[i]);
            a *= factor;
            b *= factor;
        }
        set_impulse(p, x, first, a);
        set_impulse(p, x, second, b);
    }
}

/* Solve F = 0 from x, in x; returns the residual. After the first steps of Newton's method there
 * are at most `series` series, each of sweeps and then Newton's steps. Series 0 and every third one
 * after it continue the sweeps of the third series before (series 0: the start), as if there had
 * been no Newton's steps in between, and make more of them each time. The other series start from
 * the best impulses so far. Neither start is best for all problems. `after_sweeps`, `near` and
 * `best` are workspace. */
FAST number solve_rows(
    problem *p, number *x, int series, number *after_sweeps, number *near, number *best)
{
    /* the proximal terms of the series in turn */
    static const number proximal[] = {N(1e-6), N(1e-8), N(1e-3), N(1e-7), N(1e-5), N(1e-2)};
    const size_t size = p->m * sizeof(number);
    memcpy(after_sweeps, x, size);
    memcpy(best, x, size);
    number least = newton(p, x, best, proximal[0], WARM_STEPS);
    for (int k = 0; k < series; k++) {
        if (least < ROUNDING || (least < SOLVED && k >= REFINED))
            break;
        const int from_sweeps = k % 3 == 0;
        const int sweeps = from_sweeps ? SWEEPS * (1 + k) : SWEEPS;
        memcpy(x, from_sweeps ? after_sweeps : best, size);
        residual_at(p, x); /* for w */
        for (int count = 0; count < sweeps; count++)
            sweep(p, x);
        if (from_sweeps)
            memcpy(after_sweeps, x, size);
        const number error = newton(p, x, near, proximal[k % 6], STEPS);
        if (error < least) {
            least = error;
            memcpy(best, near, size);
        }
    }
    memcpy(x, best, size);
    return least;
}
