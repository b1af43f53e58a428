/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for processors with AVX2, four samples at once. */
#ifdef __x86_64__
#define TARGET "avx2,fma"
#define LANES 4
#define SUFFIX avx2
#include "target.h"
#endif
