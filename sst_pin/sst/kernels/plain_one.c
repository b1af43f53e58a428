/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for any processor, one sample. */
#define LANES 1
#define SUFFIX plain_one
#include "target.h"
