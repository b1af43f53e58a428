/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for processors with AVX-512, eight samples at once. */
#ifdef __x86_64__
#define TARGET "avx512dq,avx512vl,fma"
#define LANES 8
#define SUFFIX avx512
#include "target.h"
#endif
