/* SPDX-License-Identifier: BSD-2-Clause */
/* Matrices of nonsmooth steps. The compiled rollout takes this file as C, kernels of Warp as C++ in a
 * class, in either precision; see real.h. Matrices are row-major. */
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

/* Pivots below LEAST_PIVOT times their diagonal entries are rounding. */
#ifdef SINGLE
#define SIZE(x) fabsf(x)
#define ROOT(x) sqrtf(x)
#define LEAST_PIVOT 1e-7f
#else
#define SIZE(x) fabs(x)
#define ROOT(x) sqrt(x)
#define LEAST_PIVOT 1e-12
#endif
#define IS_FINITE(x) ((x) * 0 == 0)

/* Rows of matrices are filled with zeros up to a multiple of WIDE numbers, so that vectors have no
 * rest; what stands left of a diagonal is not read. */
#define WIDE 8
#define FILLED(n) (((n) + WIDE - 1) / WIDE * WIDE)

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
