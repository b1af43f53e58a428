/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for processors with AVX-512, eight samples at once. */
#if defined(__x86_64__)
#define LANES 8
#define NAME(x) x##_avx512
#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512dq,avx512vl"))), apply_to = function)
#else
#pragma GCC target("avx512dq,avx512vl")
#endif
#include "real.h"
#include "driver.h"
#include "kernels.c"
#if defined(__clang__)
#pragma clang attribute pop
#endif
#endif
