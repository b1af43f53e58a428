/* SPDX-License-Identifier: BSD-2-Clause */
/* Motor torques of the motions on standard input: per line q[9], va[3], aa[3] in rad and s.
 *
 *     cc -O2 -o torques example.c sst_kernels.c
 *     ./torques < motions.txt
 *
 * It ends with 1 and a message at what has no torques or cannot be read. */
#include <stdio.h>

#include "sst_kernels.h"
#include "sst_robot.h"

static int fail(const char *problem)
{
    fprintf(stderr, "%s\n", problem);
    return 1;
}

int main(void)
{
    double x[15], tau[3], check[2];
    for (;;) {
        for (int i = 0; i < 15; i++) {
            if (scanf("%lf", &x[i]) != 1) {
                if (!feof(stdin) || ferror(stdin))
                    return fail("not a number");
                if (i > 0)
                    return fail("the numbers end inside a motion");
                return fflush(stdout) ? fail("cannot write") : 0;
            }
            if (!(x[i] - x[i] == 0))
                return fail("not a finite number");
            if (i < 9 && !(x[i] <= 1e6 && x[i] >= -1e6))
                return fail("an angle beyond 1e6 rad");
        }
        sst_inverse_dynamics(&sst_robot, x, x + 9, x + 12, NULL, tau, check);
        if (!(check[0] <= SST_CLOSED))
            return fail("the loops are open");
        if (!(check[1] >= SST_REGULAR || check[1] <= -SST_REGULAR))
            return fail("the motors do not hold the star");
        for (int i = 0; i < 3; i++)
            if (!(tau[i] - tau[i] == 0))
                return fail("the torques are not finite");
        if (printf("%.17g %.17g %.17g\n", tau[0], tau[1], tau[2]) < 0)
            return fail("cannot write");
    }
}
