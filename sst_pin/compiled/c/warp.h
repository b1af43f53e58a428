/* SPDX-License-Identifier: BSD-2-Clause */
/* Beside real.h in a class of a function of Warp, in C++: one thread computes one sample. */

/* The parameters of a sample are `step` numbers apart, so that neighbours in memory are those of
 * neighbouring samples. */
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

/* Samples along the first axis of p; one column is for all of them. */
HELPER strided column(const rows &p, int i)
{
    const unsigned samples = p.shape[1];
    return {p.data + (samples > 1 ? i : 0), samples};
}

/* x; the compiler for a GPU does not know that it is x, so that it keeps no result for it. */
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

/* p; the compiler for a GPU does not know that it has the same addresses as before. Otherwise it
 * computes all of them before the loops of a step, and keeps them in the stack. */
HELPER strided located(strided p)
{
#ifdef __CUDA_ARCH__
    asm volatile("" : "+r"(p.step));
#endif
    return p;
}

HELPER number &at(const rows &a, int i, int j)
{
    return *(number *)((char *)a.data + i * (size_t)a.strides[0] + j * (size_t)a.strides[1]);
}

HELPER void take(real *x, const rows &from, int i, int size)
{
    for (int j = 0; j < size; j++)
        x[j] = at(from, i, j);
}

/* Wrenches of bodies, six numbers each. */
HELPER void take_wrenches(real *x, const rows &from, int i, int size)
{
    for (int j = 0; j < size; j++)
        x[j] = *(number *)((char *)&at(from, i, j / 6) + (j % 6) * (size_t)from.strides[2]);
}

/* A bad sample is NaN. */
HELPER void give(const real *y, const rows &to, int i, int size, int bad)
{
    for (int j = 0; j < size; j++)
        at(to, i, j) = bad ? (number)NAN : y[j];
}

HELPER void tell(const flags &status, int i, int bad)
{
    if (status.data)
        *(int *)((char *)status.data + i * (size_t)status.strides[0]) = bad;
}

/* As in the exported C: 1 open, 2 singular, 3 not finite; and 4, a step that is too long. Nonsmooth
 * steps: 5, the impulses are not solved; 6, the start is violated. */
enum { OPEN = 1, SINGULAR, NOT_FINITE, MODE, UNSOLVED, VIOLATED };

HELPER int judge_checks(const real *checks, int count)
{
    int bad = 0;
    for (int j = 1; j < count; j++)
        bad = checks[j] <= 1 ? bad : SINGULAR;
    return checks[0] <= 1 ? bad : OPEN;
}

HELPER int judge_numbers(const real *x, int angles, int count)
{
    real squares = 0, zero = 0;
    for (int j = 0; j < angles; j++)
        squares += x[j] * x[j];
    for (int j = angles; j < count; j++)
        zero += x[j] * 0;
    return squares < LARGEST_ANGLE * LARGEST_ANGLE && zero == 0 ? 0 : NOT_FINITE;
}

HELPER int judge(const real *x, int angles, int inputs, const real *y, int outputs, int checks)
{
    if (const int bad = judge_numbers(x, angles, inputs))
        return bad;
    const int bad = judge_checks(y + outputs, checks);
    return bad ? bad : judge_numbers(y, 0, outputs);
}
