/* SPDX-License-Identifier: BSD-2-Clause */
/* Arithmetic on `real`: a double, or a vector of LANES of them, one for each sample. */
#ifndef REAL_H
#define REAL_H

#ifndef LANES
#define LANES 1
#endif

#ifdef __GNUC__
#define HELPER static inline __attribute__((unused))
#else
#define HELPER static inline
#endif

#if LANES == 1
typedef double real;
#define FLIP(x, t) flip(x, t)
#define SIGN(x) ((double)((x) > 0) - (double)((x) < 0))
#define ABSOLUTE(x) ((x) < 0 ? -(x) : (x))

/* x, or -x where the last bit of t is set. */
HELPER double flip(double x, double t)
{
    union {
        double number;
        unsigned long long bits;
    } a = {x}, b = {t};
    a.bits ^= b.bits << 63;
    return a.number;
}

HELPER double square_root(double x)
{
    return sqrt(x);
}
#else
typedef double real __attribute__((vector_size(8 * LANES), may_alias));
typedef long long mask __attribute__((vector_size(8 * LANES), may_alias));
#define FLIP(x, t) ((real)((mask)(x) ^ ((mask)(t) << 63)))
#define SIGN(x) sign(x)
#define ABSOLUTE(x) ((real)((mask)(x) & 0x7fffffffffffffffLL))

/* -1, 0 or 1: a comparison gives all bits or none. */
HELPER real sign(real x)
{
    const real zero = x - x, one = zero + 1.0, minus_one = zero - 1.0;
    return (real)(((mask)one & (x > zero)) | ((mask)minus_one & (x < zero)));
}

HELPER real square_root(real x)
{
    for (int l = 0; l < LANES; l++)
        x[l] = __builtin_sqrt(x[l]);
    return x;
}
#endif

/* Sine and cosine to an absolute error of 4e-16 for |x| up to 1e6, without a branch. */
HELPER void sine_cosine(real x, real *sine, real *cosine)
{
    /* 1.5 * 2^52: what is added to it becomes whole, and its last bit tells odd from even. */
    const double round = 6755399441055744.0;
    const real t = x * 0.31830988618379067154 + round, n = t - round;
    /* pi in three parts, the first two of 33 bits; y is half of what is left, |y| <= pi / 4. */
    const real y = 0.5 * (((x - n * 3.14159265346825122833) - n * 1.21542010130123852870e-10)
        - n * 4.04453249759190126e-21);
    const real z = y * y;
    /* The minimax polynomial of fdlibm; then sin 2y = 2 sin y cos y, cos 2y = 1 - 2 sin^2 y. */
    const real s = y + y * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03
        + z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06
        + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
    const real c = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02
        + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05
        + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
        + z * -1.13596475577881948265e-11)))));
    *sine = FLIP(2.0 * (s * c), t);
    *cosine = FLIP(1.0 - 2.0 * (s * s), t);
}

/* The hyperbolic tangent to an absolute error of 1e-14: Taylor's series of exp(2 |x| / 128), seven
 * times squared; beyond 20 it is the sign. */
HELPER real tangent(real x)
{
    const real side = SIGN(x), far = 0.5 * (SIGN(side * x - 20.0) + 1.0);
    const real y = -2.0 / 128.0 * (side * x * (1.0 - far) + 20.0 * far);
    real e = 1.0 + y / 13.0;
    for (int i = 12; i > 0; i--)
        e = 1.0 + y * e / (double)i;
    for (int i = 0; i < 7; i++)
        e = e * e;
    return side * ((1.0 - e) / (1.0 + e));
}

/* The sign of a rate in Coulomb friction: tanh(x / width) where the width is not zero. */
HELPER real direction(real x, double width)
{
    return width > 0 ? tangent(x / width) : SIGN(x);
}

/* Coulomb friction; most joints have none. */
HELPER real rubbing(real x, double coulomb, double width)
{
    const real zero = {0};
    if (coulomb == 0)
        return zero;
    return coulomb * direction(x, width);
}

#endif
