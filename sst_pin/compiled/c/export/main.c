/* ${meaning} of the robot ${robot}
 * for the motions on standard input: per line q[${nq}], va[${n}], aa[${n}].
 *
 *     cc -std=c99 -O2 -o dynamics main.c robot.c -lm
 *     ./dynamics < motions.txt
 *
 * For example, at rest: ${example}
 * It ends with 1 and a message at a motion without a result. */
#include <stdio.h>

#include "robot.h"

static int fail(const char *problem)
{
    fprintf(stderr, "%s\n", problem);
    return 1;
}

int main(void)
{
    static const char *const problems[] = {"", "the loops are open", "singular", "not finite"};
    ${type} x[${inputs}], y[${outputs}];
    for (;;) {
        for (int i = 0; i < ${inputs}; i++) {
            double number;
            if (scanf("%lf", &number) != 1) {
                if (!feof(stdin) || ferror(stdin))
                    return fail("not a number");
                if (i > 0)
                    return fail("the numbers end inside a motion");
                return fflush(stdout) ? fail("cannot write") : 0;
            }
            x[i] = (${type})number;
        }
        const int bad = robot_${name}(x, x + ${nq}, x + ${nq} + ${n}, y);
        if (bad)
            return fail(problems[bad]);
        for (int i = 0; i < ${outputs}; i++)
            if (printf("%.${digits}g%c", (double)y[i], i + 1 < ${outputs} ? ' ' : '\n') < 0)
                return fail("cannot write");
    }
}
