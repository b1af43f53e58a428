/* SPDX-License-Identifier: BSD-2-Clause */
/* Arithmetic of generated kernels. `number` is a double; with SINGLE defined, for one sample at
 * once, a float. `real` is a number, or a vector of LANES numbers, one for each sample; `mask` is
 * the result of comparing two of them. `turn` is a vector of angles whose sines are computed at
 * once: TURNS angles of one sample, or one angle of LANES samples. */
#ifndef LANES
#define LANES 1
#define TURNS 1
#elif LANES == 1
#define TURNS 4
#else
#define TURNS 1
#endif

#ifdef SINGLE
typedef float number;
typedef unsigned int bits;
#define N(x) x##f
#define LAST_TO_FIRST 31 /* shift that makes the last bit of a number its sign */
#define SQUARE_ROOT(x) sqrtf(x)
#define LARGEST_ANGLE 1e3f /* that sine_cosine takes */
#else
typedef double number;
typedef unsigned long long bits;
#define N(x) x
#define LAST_TO_FIRST 63 /* shift that makes the last bit of a number its sign */
#define SQUARE_ROOT(x) sqrt(x)
#define LARGEST_ANGLE 1e6 /* that sine_cosine takes */
#endif

#ifndef __cplusplus
typedef const number *parameters;
typedef number *constants; /* parameters, then what is computed from them alone */
#endif

#if defined(__GNUC__) && !defined(__cplusplus)
#define SEPARATE __attribute__((visibility("hidden"))) /* a function that another file calls */
#else
#define SEPARATE static
#endif

#ifdef __GNUC__
#define HELPER static inline __attribute__((unused))
#define PART static __attribute__((noinline)) void /* a part of a function that is too large */
#else
#define HELPER static inline
#define PART static void
#endif

#if LANES == 1
typedef number real;
typedef int mask;
#define LANE(x, l) (x)
#define REAL(x) (x)
#define SIGN(x) ((number)((x) > 0) - (number)((x) < 0))
#define ABSOLUTE(x) ((x) < 0 ? -(x) : (x))
#define AT_MOST(x, y) ((number)((x) <= (y)))
#else
typedef double real __attribute__((vector_size(8 * LANES), may_alias));
typedef long long mask __attribute__((vector_size(8 * LANES), may_alias));
#define LANE(x, l) (x)[l]
#define REAL(x) ((real){0} + (x))
#define SIGN(x) sign(x)
#define ABSOLUTE(x) ((real)((mask)(x) & 0x7fffffffffffffffLL))
#define AT_MOST(x, y) at_most((real){0} + (x), (real){0} + (y))
#undef SQUARE_ROOT
#define SQUARE_ROOT(x) square_root(x)

/* The sign of x: -1, 0 or 1. A comparison of vectors sets all bits of a lane, or none. */
HELPER real sign(real x)
{
    const real zero = x - x, one = zero + 1.0, minus_one = zero - 1.0;
    return (real)(((mask)one & (x > zero)) | ((mask)minus_one & (x < zero)));
}

/* 1 where x <= y, else 0. */
HELPER real at_most(real x, real y)
{
    return (real)((mask)(x - x + 1.0) & (x <= y));
}

HELPER real square_root(real x)
{
    for (int l = 0; l < LANES; l++)
        x[l] = __builtin_sqrt(x[l]);
    return x;
}
#endif

/* In each lane x where `first` is true, else y. */
HELPER real choose(mask first, real x, real y)
{
#if LANES == 1
    return first ? x : y;
#else
    return (real)((first & (mask)x) | (~first & (mask)y));
#endif
}

/* Whether x is true in some lane. */
HELPER int some(mask x)
{
    int found = 0;
    for (int l = 0; l < LANES; l++)
        found |= LANE(x, l) != 0;
    return found;
}

#if TURNS == 1
typedef real turn;
#else
typedef double turn __attribute__((vector_size(8 * TURNS), may_alias));
#endif

#if LANES == 1 && TURNS == 1
#define FLIP(x, t) flip(x, t)

/* x, or -x where the last bit of t is set. */
HELPER number flip(number x, number t)
{
    union {
        number value;
        bits bits;
    } a = {x}, b = {t};
    a.bits ^= b.bits << LAST_TO_FIRST;
    return a.value;
}
#else
typedef long long turn_bits __attribute__((vector_size(sizeof(turn)), may_alias));
#define FLIP(x, t) ((turn)((turn_bits)(x) ^ ((turn_bits)(t) << LAST_TO_FIRST)))
#endif

#ifdef SINGLE
/* The function below in single precision, to an absolute error of 2e-7 for |x| up to 1e3. The
 * polynomials are those of Cephes. */
HELPER void sine_cosine(const turn *x, turn *sine, turn *cosine)
{
    const float round = 12582912.0f; /* 1.5 * 2^23 */
    const float t = *x * 0.318309886f + round, n = t - round;
    const float y = 0.5f * (((*x - n * 3.140625f) - n * 9.67502593994140625e-4f)
        - n * 1.509957990978376432e-7f);
    const float z = y * y;
    const float s = y + y * z * (-1.6666654611e-1f + z * (8.3321608736e-3f
        + z * -1.9515295891e-4f));
    const float c = 1.0f - 0.5f * z + z * z * (4.166664568298827e-2f
        + z * (-1.388731625493765e-3f + z * 2.443315711809948e-5f));
    *sine = FLIP(2.0f * (s * c), t);
    *cosine = FLIP(1.0f - 2.0f * (s * s), t);
}
#else
/* Sine and cosine to an absolute error of 4e-16 for |x| up to 1e6, without a branch. x = n pi + 2 y
 * with a whole n and |y| <= pi / 4. The polynomials give sin y and cos y, doubling gives sin 2y and
 * cos 2y, and an odd n changes both signs. */
HELPER void sine_cosine(const turn *x, turn *sine, turn *cosine)
{
    /* 1.5 * 2^52: a sum with this number is whole, and its last bit is set if n is odd */
    const double round = 6755399441055744.0;
    const turn t = *x * 0.31830988618379067154 + round, n = t - round;
    /* pi in three parts; the first two have 33 bits, so that their products with n are exact */
    const turn y = 0.5 * (((*x - n * 3.14159265346825122833) - n * 1.21542010130123852870e-10)
        - n * 4.04453249759190126e-21);
    const turn z = y * y;
    /* the minimax polynomials of fdlibm */
    const turn s = y + y * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03
        + z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06
        + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
    const turn c = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02
        + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05
        + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
        + z * -1.13596475577881948265e-11)))));
    *sine = FLIP(2.0 * (s * c), t);
    *cosine = FLIP(1.0 - 2.0 * (s * s), t);
}
#endif

HELPER void sines_cosines(int n, const real *x, real *sines, real *cosines)
{
#if TURNS == 1
    for (int k = 0; k < n; k++)
        sine_cosine(&x[k], &sines[k], &cosines[k]);
#else
    for (int k = 0; k < n; k += TURNS) {
        turn angles, s, c;
        for (int l = 0; l < TURNS; l++)
            angles[l] = x[k + l < n ? k + l : k];
        sine_cosine(&angles, &s, &c);
        for (int l = 0; l < TURNS && k + l < n; l++)
            sines[k + l] = s[l], cosines[k + l] = c[l];
    }
#endif
}

/* The hyperbolic tangent, to a few roundings: tanh x = -sign(x) z / (z + 2) with z = exp(-2 |x|) -
 * 1. Taylor's series gives exp(y) - 1 for y = -2 |x| / 128. Seven doublings of the exponent follow:
 * if z = exp(y) - 1, then exp(2 y) - 1 = z (z + 2). Beyond 20, where tanh x is 1 up to rounding,
 * |x| counts as 20. */
HELPER real tangent(real x)
{
    const real side = SIGN(x), far = N(0.5) * (SIGN(side * x - N(20.0)) + N(1.0));
    const real y = N(-0.015625) * (side * x * (N(1.0) - far) + N(20.0) * far);
    real z = y - y + N(1.0);
    for (int i = 13; i > 1; i--)
        z = N(1.0) + y * z / (number)i;
    z = y * z;
    for (int i = 0; i < 7; i++)
        z = z * (z + N(2.0));
    return -side * z / (z + N(2.0));
}

/* The direction of Coulomb friction at a rate x: tanh(x / width) if the width is positive.
 * Otherwise it is the sign of x, or zero if |x| <= rest. */
HELPER real direction(real x, number width, number rest)
{
    if (width > 0)
        return tangent(x / width);
    return SIGN(x) * (N(1.0) - AT_MOST(ABSOLUTE(x), rest));
}

/* Coulomb friction at a rate x, in the direction of the rate; callers subtract it. Most joints have
 * none. */
HELPER real rubbing(real x, number coulomb, number width, number rest)
{
    const real zero = {0};
    if (coulomb == 0)
        return zero;
    return coulomb * direction(x, width, rest);
}
