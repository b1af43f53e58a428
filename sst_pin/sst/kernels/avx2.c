/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for processors with AVX2, four samples at once. */
#if defined(__x86_64__)
#define LANES 4
#define NAME(x) x##_avx2
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx2,fma")
#endif
#include "real.h"
#include "driver.h"
#include "kernels.c"
#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
