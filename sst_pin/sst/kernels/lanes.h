/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for LANES samples at once, in code for TARGET, called SET. Included once for each
 * instruction set, with SST_NAME to tell the copies apart. */

typedef double SST_NAME(real) __attribute__((vector_size(8 * LANES), may_alias));
typedef long long SST_NAME(mask) __attribute__((vector_size(8 * LANES), may_alias));

#define SST_REAL SST_NAME(real)
#define SST_FUNCTION TARGET static
#define SST_HELPER TARGET static inline
#define SST_RARELY TARGET __attribute__((noinline, cold)) static
#define SST_SIGN(x) SST_NAME(sign_of)(x)
#define SST_FIRST(x) (x)[0]
#define SST_FLIP(x, t) \
    ((SST_REAL)((SST_NAME(mask))(x) ^ ((SST_NAME(mask))(t) << 63)))

typedef struct {
    SST_PARAMETERS(SST_REAL)
} SST_NAME(parameters);

/* -1, 0 or 1: a comparison gives all bits or none. */
TARGET static inline SST_REAL SST_NAME(sign_of)(SST_REAL x)
{
    const SST_REAL zero = x - x, one = zero + 1.0, minus_one = zero - 1.0;
    return (SST_REAL)(((SST_NAME(mask))one & (x > zero)) | ((SST_NAME(mask))minus_one & (x < zero)));
}

#include "sst_kernels.c"

/* The parameters in all lanes, where they serve as operands. */
TARGET static void SST_NAME(prepare)(const double *parameters, double *wide)
{
    for (size_t i = 0; i < PARAMETERS; i++)
        for (int l = 0; l < LANES; l++)
            wide[i * LANES + l] = parameters[i];
}

/* Rows of samples into vectors; the last sample fills the lanes that are left. */
TARGET static inline void SST_NAME(gather_numbers)(SST_REAL *x, const rows *from, ptrdiff_t first,
    int count, int size, ptrdiff_t column)
{
    for (int i = 0; i < count; i += LANES, x += WIDTH) {
        const char *at[LANES];
        for (int l = 0; l < LANES; l++)
            at[l] = from->data + (first + (i + l < count ? i + l : count - 1)) * from->row;
        for (int j = 0; j < size; j++) {
            SST_REAL lanes;
            for (int l = 0; l < LANES; l++)
                lanes[l] = *(const double *)(at[l] + j * column);
            x[j] = lanes;
        }
    }
}

TARGET static inline void SST_NAME(scatter_numbers)(const SST_REAL *x, const rows *to,
    ptrdiff_t first, int count, int size)
{
    for (int i = 0; i < count; i += LANES, x += WIDTH)
        for (int l = 0; l < LANES && i + l < count; l++) {
            char *at = to->data + (first + i + l) * to->row;
            for (int j = 0; j < size; j++)
                *(double *)(at + j * to->column) = x[j][l];
        }
}

/* With sizes and strides known, the loops above unroll. */
TARGET static void SST_NAME(gather)(double *block, int position, const rows *from, ptrdiff_t first,
    int count)
{
    SST_REAL *x = (SST_REAL *)block + position;
    if (from->column == sizeof(double) && from->size == 9)
        SST_NAME(gather_numbers)(x, from, first, count, 9, sizeof(double));
    else if (from->column == sizeof(double) && from->size == 3)
        SST_NAME(gather_numbers)(x, from, first, count, 3, sizeof(double));
    else
        SST_NAME(gather_numbers)(x, from, first, count, from->size, from->column);
}

TARGET static void SST_NAME(scatter)(const double *block, int position, const rows *to,
    ptrdiff_t first, int count)
{
    const SST_REAL *x = (const SST_REAL *)block + position;
    if (to->size == 9)
        SST_NAME(scatter_numbers)(x, to, first, count, 9);
    else if (to->size == 3)
        SST_NAME(scatter_numbers)(x, to, first, count, 3);
    else
        SST_NAME(scatter_numbers)(x, to, first, count, to->size);
}

/* A kernel on a block: vectors of samples, each a row of WIDTH vectors as `layouts` says, with a
 * moment on the star or without one. Gives whether all samples are good. `parameters` are
 * SST_NAME(parameters). */
TARGET static int SST_NAME(run)(int kernel, const void *parameters, double h, int loaded,
    double *block, int count)
{
    const SST_NAME(parameters) *p = parameters;
    const layout at = layouts[kernel];
    SST_REAL *x = (SST_REAL *)block;
    SST_NAME(mask) all_good = x[0] == x[0];
    for (int i = 0; i < count; i += LANES, x += WIDTH) {
        const SST_REAL *moment = loaded ? x + (kernel == STEP ? 21 : 15) : NULL;
        SST_REAL *y = x + at.out, *check = x + at.check, squares = x[0] * x[0], zero = x[0] - x[0];
        for (int j = 1; j < 9; j++)
            squares += x[j] * x[j];
        for (int j = 0; j < at.state; j++)
            zero += x[j] * 0.0; /* NaN where a number is not finite */
        switch (kernel) {
        case INVERSE_DYNAMICS:
            SST_NAME(inverse_dynamics)(p, x, x + 9, x + 12, moment, y, check);
            check[2] = check[0] + 1.0;
            break;
        case DIRECT_DYNAMICS:
            SST_NAME(direct_dynamics)(p, x, x + 9, x + 12, moment, y, y + 9, check);
            break;
        case REDUCED_TERMS:
            SST_NAME(reduced_terms)(p, x, x + 9, y, y + 9, y + 18, y + 21, check);
            check[2] = check[0] + 1.0;
            break;
        case CLOSE:
            SST_NAME(close)(p, x, check);
            check[2] = check[0] + 1.0;
            break;
        case RATE:
            SST_NAME(rate)(p, x, x + 9, x + 12, moment, y, y + 9, check);
            break;
        case STEP:
            SST_NAME(step)(p, h, x, x + 9, x + 12, moment, check);
            break;
        }
        for (int j = 0; j < at.check - at.out; j++)
            zero += y[j] * 0.0;
        const SST_NAME(mask) good = (squares < LARGEST_ANGLE * LARGEST_ANGLE)
            & (check[0] <= SST_CLOSED) & (check[1] * check[1] >= SST_REGULAR * SST_REGULAR)
            & (check[2] > SST_DEFINITE) & (zero == 0.0);
        *(SST_NAME(mask) *)(x + at.good) = good;
        all_good &= good;
    }
    int yes = 1;
    for (int l = 0; l < LANES; l++)
        yes &= all_good[l] != 0;
    return yes;
}

#undef SST_REAL
#undef SST_FUNCTION
#undef SST_HELPER
#undef SST_RARELY
#undef SST_SIGN
#undef SST_FIRST
#undef SST_FLIP

static const instruction_set SST_NAME(set) = {
    LANES, SET, SST_NAME(prepare), SST_NAME(gather), SST_NAME(run), SST_NAME(scatter)
};
