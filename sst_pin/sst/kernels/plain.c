/* SPDX-License-Identifier: BSD-2-Clause */
/* The kernels for any processor, two samples at once. */
#define LANES 2
#define NAME(x) x##_plain
#include "real.h"
#include "driver.h"
#include "kernels.c"
const char made_of[] = MADE_OF;
