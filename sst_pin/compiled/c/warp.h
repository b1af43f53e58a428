/* SPDX-License-Identifier: BSD-2-Clause */
/* Helpers of the functions for Warp, which are C++: each is a class that holds real.h, this file,
 * the generated kernels and one of entries/warp_*.h. One thread computes one sample i. */

/* The parameters of a sample. Two of them are `step` numbers apart: in between are the same
 * parameters of the other samples, so that neighbouring threads read neighbouring numbers. */
struct strided {
    number *data;
    unsigned step;
    number &operator[](unsigned k) const { return data[(size_t)k * step]; }
};
typedef strided parameters;
typedef strided constants;
typedef wp::array_t<number> rows;
typedef wp::array_t<int> flags;

#define RUN \
    static void run(int i, const rows &q, const rows &va, const rows &last, \
        const rows &external_wrenches, const rows &p, const rows &out, const rows &va_out, \
        number h, int steps, const flags &status)

/* The parameters of sample i: column i of p, or its only column, which is that of all samples. */
HELPER strided column(const rows &p, int i)
{
    const unsigned samples = p.shape[1];
    return {p.data + (samples > 1 ? i : 0), samples};
}

/* x, hidden from the optimiser of a GPU: it computes what follows from x anew, instead of keeping
 * earlier results in registers. recomputation.py says where this pays. */
HELPER real again(real x)
{
#ifdef __CUDA_ARCH__
#ifdef SINGLE
    asm volatile("" : "+f"(x));
#else
    asm volatile("" : "+d"(x));
#endif
#endif
    return x;
}

/* p, hidden from the optimiser of a GPU. Otherwise it would compute the addresses of all parameters
 * before the loops of a step, and keep them on the stack. */
HELPER strided located(strided p)
{
#ifdef __CUDA_ARCH__
    asm volatile("" : "+r"(p.step));
#endif
    return p;
}

/* Entry (i, j) of an array; strides are in bytes. */
HELPER number &at(const rows &a, int i, int j)
{
    return *(number *)((char *)a.data + i * (size_t)a.strides[0] + j * (size_t)a.strides[1]);
}

/* Read sample i into x. */
HELPER void take(real *x, const rows &from, int i, int size)
{
    for (int j = 0; j < size; j++)
        x[j] = at(from, i, j);
}

/* `take` for the wrenches of bodies, six numbers each: an array with three axes. */
HELPER void take_wrenches(real *x, const rows &from, int i, int size)
{
    for (int j = 0; j < size; j++)
        x[j] = *(number *)((char *)&at(from, i, j / 6) + (j % 6) * (size_t)from.strides[2]);
}

/* Write sample i; a bad one becomes NaN. */
HELPER void give(const real *y, const rows &to, int i, int size, int bad)
{
    for (int j = 0; j < size; j++)
        at(to, i, j) = bad ? (number)NAN : y[j];
}

/* Write the status of sample i, if it is wanted. */
HELPER void tell(const flags &status, int i, int bad)
{
    if (status.data)
        *(int *)((char *)status.data + i * (size_t)status.strides[0]) = bad;
}

/* Why a sample is bad; 0 if it is not. The first three are those of the exported C too. */
enum {
    OPEN = 1,   /* the loops are open */
    SINGULAR,   /* the pose is singular, or another check fails */
    NOT_FINITE, /* a number is not finite, or an angle is too large */
    MODE,       /* a step may leave the assembly mode */
    UNSOLVED,   /* the impulses of a nonsmooth step are not solved */
    VIOLATED    /* a contact, rope or stop is violated at the start */
};

/* The first check is that of closed loops. */
HELPER int judge_checks(const real *checks, int count)
{
    int bad = 0;
    for (int j = 1; j < count; j++)
        bad = checks[j] <= 1 ? bad : SINGULAR;
    return checks[0] <= 1 ? bad : OPEN;
}

/* x has `count` numbers; the first ones are angles. */
HELPER int judge_numbers(const real *x, int angles, int count)
{
    real squares = 0, zero = 0; /* x * 0 is NaN, not zero, if x is not finite */
    for (int j = 0; j < angles; j++)
        squares += x[j] * x[j];
    for (int j = angles; j < count; j++)
        zero += x[j] * 0;
    return squares < LARGEST_ANGLE * LARGEST_ANGLE && zero == 0 ? 0 : NOT_FINITE;
}

/* x are inputs, y are outputs and checks. */
HELPER int judge(const real *x, int angles, int inputs, const real *y, int outputs, int checks)
{
    if (const int bad = judge_numbers(x, angles, inputs))
        return bad;
    const int bad = judge_checks(y + outputs, checks);
    return bad ? bad : judge_numbers(y, 0, outputs);
}
