${head}
{
    /* For the force f = J^T tau of the motion, this computes the smallest torques within the
     * limits, tau = clip(J p), where clip cuts each torque to its limits and p solves J^T clip(J p)
     * = f. The left side minus f is the gradient g of a convex, piecewise quadratic function of p:
     * Newton's method finds its minimum, with an exact search along each step. J is free of the
     * units of the rates. */
    static const ${type} unit[${n}] = {${units}};
    ${type} J[${motors} * ${n}], f[${n}], g[${n}], H[${n}][${n}];
    ${type} p[${n}], dp[${n}], z[${motors}], dz[${motors}]; /* z = J p */
    ${type} least[${motors}], largest[${motors}], squares = 0; /* squares: of the entries of J */
    int bad = robot_actuator_jacobian(q, J);
    if (bad)
        return bad;
    for (int k = 0; k < ${motors}; k++) {
        least[k] = limits[2 * k];
        largest[k] = limits[2 * k + 1];
        if (!(least[k] < largest[k]))
            return ROBOT_NOT_FINITE;
    }
    bad = robot_torques(q, va, aa, tau);
    if (bad)
        return bad;
    for (int i = 0; i < ${n}; i++) {
        f[i] = 0;
        p[i] = 0;
        for (int k = 0; k < ${motors}; k++) {
            J[${n} * k + i] *= unit[i];
            f[i] += J[${n} * k + i] * tau[k];
            squares += J[${n} * k + i] * J[${n} * k + i];
        }
        g[i] = -f[i];
    }
    for (int k = 0; k < ${motors}; k++)
        z[k] = 0;
    for (int step = 0; step < 60; step++) {
        /* The Hessian J^T J of the motors that are not at a limit, and its Cholesky factor H. In
         * the first step it is of all motors: this step leads to the smallest torques without
         * limits. A small number on the diagonal keeps it regular if too few motors are left. */
        for (int i = 0; i < ${n}; i++)
            for (int j = 0; j <= i; j++) {
                ${type} sum = i == j ? ${least_pivot} * squares : 0;
                for (int k = 0; k < ${motors}; k++)
                    if (step == 0 || (z[k] > least[k] && z[k] < largest[k]))
                        sum += J[${n} * k + i] * J[${n} * k + j];
                for (int k = 0; k < j; k++)
                    sum -= H[i][k] * H[j][k];
                if (i == j && !(sum > 0))
                    return ROBOT_SINGULAR;
                H[i][j] = i == j ? SQUARE_ROOT(sum) : sum / H[j][j];
            }

        /* Newton's step: H H^T dp = -g, dz = J dp */
        for (int i = 0; i < ${n}; i++) {
            dp[i] = -g[i];
            for (int k = 0; k < i; k++)
                dp[i] -= H[i][k] * dp[k];
            dp[i] /= H[i][i];
        }
        for (int i = ${n} - 1; i >= 0; i--) {
            for (int k = i + 1; k < ${n}; k++)
                dp[i] -= H[k][i] * dp[k];
            dp[i] /= H[i][i];
        }
        for (int k = 0; k < ${motors}; k++) {
            dz[k] = 0;
            for (int i = 0; i < ${n}; i++)
                dz[k] += J[${n} * k + i] * dp[i];
        }

        /* Find by bisection the part of the step where the slope along it, g(p + part dp) . dp, is
         * zero. If the slope is negative at the end, make the whole step, as always the first. */
        ${type} low = 0, part = 1, high = 1;
        for (int halving = 0; step > 0 && halving < ${halvings}; halving++) {
            ${type} slope = 0;
            for (int i = 0; i < ${n}; i++)
                slope -= f[i] * dp[i];
            for (int k = 0; k < ${motors}; k++) {
                const ${type} x = z[k] + part * dz[k];
                slope += dz[k] * (x < least[k] ? least[k] : x > largest[k] ? largest[k] : x);
            }
            if (slope > 0)
                high = part;
            else
                low = part;
            if (low == 1)
                break;
            part = (low + high) / 2;
        }
        for (int i = 0; i < ${n}; i++)
            p[i] += part * dp[i];
        for (int k = 0; k < ${motors}; k++) {
            z[k] = 0;
            for (int i = 0; i < ${n}; i++)
                z[k] += J[${n} * k + i] * p[i];
            tau[k] = z[k] < least[k] ? least[k] : z[k] > largest[k] ? largest[k] : z[k];
        }

        /* g = J^T tau - f, which is zero up to the rounding of its terms at the solution */
        int done = 1;
        for (int i = 0; i < ${n}; i++) {
            ${type} size = f[i] < 0 ? -f[i] : f[i];
            g[i] = -f[i];
            for (int k = 0; k < ${motors}; k++) {
                const ${type} term = J[${n} * k + i] * tau[k];
                g[i] += term;
                size += term < 0 ? -term : term;
            }
            if (!(g[i] <= ${tolerance} * size && -g[i] <= ${tolerance} * size))
                done = 0;
        }
        if (done)
            return 0;
    }
    return ROBOT_LIMITS;
}
