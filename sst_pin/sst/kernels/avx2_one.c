/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for processors with AVX2, one sample. */
#ifdef __x86_64__
#define TARGET "avx2,fma"
#define LANES 1
#define SUFFIX avx2_one
#include "target.h"
#endif
