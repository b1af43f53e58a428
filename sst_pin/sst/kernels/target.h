/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for the instructions in TARGET, LANES samples at once, their names ending in SUFFIX. */
#define PRAGMA(x) _Pragma(#x)
#define JOINED(x, suffix) x##_##suffix
#define WITH(x, suffix) JOINED(x, suffix)
#define NAME(x) WITH(x, SUFFIX)
#ifdef TARGET
#ifdef __clang__
#define FOR_TARGET(x) PRAGMA(clang attribute push(__attribute__((target(x))), apply_to = function))
#else
#define FOR_TARGET(x) PRAGMA(GCC target(x))
#endif
FOR_TARGET(TARGET)
#endif
#include "real.h"
#include "driver.h"
#include "kernels.c"
/* The hash of the sources, which `extensions.py` compares. */
const char made_of[] = MADE_OF;
#if defined(TARGET) && defined(__clang__)
#pragma clang attribute pop
#endif
