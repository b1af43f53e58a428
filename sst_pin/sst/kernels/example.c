/* SPDX-License-Identifier: BSD-2-Clause */
/* Motor torques of the motions on standard input: per line q[9], va[3], aa[3] in rad and s.
 *
 *     cc -O2 -o torques example.c sst_kernels.c
 *     ./torques < motions.txt */
#include <stdio.h>

#include "sst_kernels.h"
#include "sst_robot.h"

int main(void)
{
    double x[15], tau[3], check[2];
    for (;;) {
        for (int i = 0; i < 15; i++)
            if (scanf("%lf", &x[i]) != 1)
                return i > 0; /* the numbers end inside a motion */
        sst_inverse_dynamics(&sst_robot, x, x + 9, x + 12, NULL, tau, check);
        if (!(check[0] <= SST_CLOSED)) {
            fprintf(stderr, "the loops are open\n");
            return 1;
        }
        if (!(check[1] >= SST_REGULAR || check[1] <= -SST_REGULAR)) {
            fprintf(stderr, "the motors do not hold the star\n");
            return 1;
        }
        printf("%.17g %.17g %.17g\n", tau[0], tau[1], tau[2]);
    }
}
