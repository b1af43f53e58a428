/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for any processor, two samples at once. */
#define LANES 2
#define SUFFIX plain
#include "target.h"
