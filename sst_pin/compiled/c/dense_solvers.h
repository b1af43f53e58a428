/* SPDX-License-Identifier: BSD-2-Clause */
/* Linear equations of nonsmooth steps, with full matrices of a few dozen rows. The compiled rollout
 * takes this file as C, kernels of Warp as C++ in a class, in either precision; see real.h.
 *
 * A matrix is stored row by row. The length of a row, `wide`, is a multiple of WIDE, and the
 * numbers behind the last column are zero: so a loop over a row consists of whole vectors of WIDE
 * numbers. */

/* FAST marks a function that is compiled for speed; INLINED one that is also short, or has one
 * call. */
#ifdef __cplusplus
/* A copy of a large function at each call would keep the compiler for GPUs busy for minutes. */
#define FAST static __attribute__((noinline))
#define INLINED HELPER
#else
#include <math.h>
#include <string.h>
/* To add up a row in vectors, the compiler must be allowed to change the order of the sum. */
#define FAST static __attribute__((optimize("O3", "associative-math", "no-signed-zeros"), unused))
#define INLINED FAST inline
#endif

/* LEAST_PIVOT: a pivot below this part of its diagonal entry is rounding, so that the matrix is not
 * positive definite. */
#ifdef SINGLE
#define MAGNITUDE(x) fabsf(x)
#define ROOT(x) sqrtf(x)
#define LEAST_PIVOT 1e-7f
#else
#define MAGNITUDE(x) fabs(x)
#define ROOT(x) sqrt(x)
#define LEAST_PIVOT 1e-12
#endif
#define IS_FINITE(x) ((x) * 0 == 0)

/* Eight doubles are the largest vector of processors, of 512 bits. */
#define WIDE 8
/* The length of a row for n columns. */
#define FILLED(n) (((n) + WIDE - 1) / WIDE * WIDE)

/* y += a x for rows, from column `first` on. It begins with the vector that contains this column,
 * so that up to WIDE - 1 columns before it change too: callers do not read them again. */
INLINED void add_row(number *restrict y, number a, const number *restrict x, int first, int wide)
{
    for (int i = first / WIDE * WIDE; i < wide; i += WIDE)
        for (int j = 0; j < WIDE; j++)
            y[i + j] += a * x[i + j];
}

/* Factorise a symmetric matrix in place, A = U^T D U, where U has a unit diagonal. The result has U
 * above the diagonal and 1 / D on it; numbers below the diagonal are not read and mean nothing.
 * False if A is not positive definite. `least` is workspace for the least pivots, shape (n,). */
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

/* Solve U x = b in place; U has a unit diagonal. */
FAST void solve_upper(const number *restrict U, number *restrict b, int n, int wide)
{
    for (int k = n - 1; k >= 0; k--) {
        number sum = b[k];
        for (int j = k + 1; j < n; j++)
            sum -= U[k * wide + j] * b[j];
        b[k] = sum;
    }
}

/* Solve U^T D U x = b in place, with the result of `factorize`. */
FAST void solve_symmetric(const number *restrict U, number *restrict b, int n, int wide)
{
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++)
            b[i] -= U[k * wide + i] * b[k];
    for (int k = 0; k < n; k++)
        b[k] *= U[k * wide + k];
    solve_upper(U, b, n, wide);
}

/* Solve U^T D^(1/2) Z = B in place, with the result of `factorize`: so Z^T Z = B^T A^-1 B. B has n
 * rows of `many` numbers, a multiple of WIDE. */
FAST void solve_many(const number *U, number *B, int n, int wide, int many)
{
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++)
            if (U[k * wide + i] != 0)
                add_row(B + i * many, -U[k * wide + i], B + k * many, 0, many);
    for (int k = 0; k < n; k++) {
        const number root = ROOT(U[k * wide + k]); /* 1 / D stands there */
        for (int j = 0; j < many; j++)
            B[k * many + j] *= root;
    }
}

INLINED void exchange(number *a, number *b)
{
    const number first = *a;
    *a = *b;
    *b = first;
}

/* Solve D x = right in place, for any regular D, by elimination with pivots. False if D is
 * singular. */
FAST int solve_general(number *D, number *right, int n, int wide)
{
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (MAGNITUDE(D[i * wide + k]) > MAGNITUDE(D[pivot * wide + k]))
                pivot = i;
        if (!(MAGNITUDE(D[pivot * wide + k]) > 0)) /* NaN too */
            return 0;
        if (pivot != k) {
            for (int j = k; j < n; j++)
                exchange(&D[k * wide + j], &D[pivot * wide + j]);
            exchange(&right[k], &right[pivot]);
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
