/* SPDX-License-Identifier: BSD-2-Clause */
/* Impulses of stops, dry friction, ropes, cables and contacts in one step of one robot, as
 * dynamics/impulses.py computes them; that file says why. It needs dense_solvers.h. */

/* What counts as solved, and as exact, relative to the impulses. In single precision rounding leaves
 * residuals of some 3e-7. */
#ifdef SINGLE
#define SOLVED 1e-5f
#define ROUNDING 1e-6f
#else
#define SOLVED 1e-9
#define ROUNDING 1e-11
#endif

enum { STOP, DRY, SIDE, NORMAL };
#define SWEEPS 10
#define STEPS 20
#define REFINED 3
#define LARGEST N(1e3)
/* Steps of Newton's method from the impulses of the step before, without sweeps. */
#define WARM_STEPS 6

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

INLINED number length_of(number a, number b)
{
    return ROOT(a * a + b * b);
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
        largest = MAGNITUDE(p->F[i]) > largest || p->F[i] != p->F[i] ? MAGNITUDE(p->F[i]) : largest;
        size = MAGNITUDE(x[i]) > size ? MAGNITUDE(x[i]) : size;
        rates = MAGNITUDE(p->u[i]) > rates ? MAGNITUDE(p->u[i]) : rates;
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
            p->inside[i] = MAGNITUDE(y) <= p->bounds[i];
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
