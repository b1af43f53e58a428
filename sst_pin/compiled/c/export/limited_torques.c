${head}
{
    /* The smallest torques within limits are z = J p, cut to the limits, where p makes the gradient
     * g = J^T tau - f of a convex, piecewise quadratic function zero: Newton's method with an exact
     * search along each step. J is free of the units of the rates. */
    static const ${type} unit[${n}] = {${units}};
    ${type} J[${motors} * ${n}], f[${n}], g[${n}], p[${n}], H[${n}][${n}], z[${motors}], dz[${motors}];
    ${type} least[${motors}], largest[${motors}], whole = 0;
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
            whole += J[${n} * k + i] * J[${n} * k + i];
        }
        g[i] = -f[i];
    }
    for (int k = 0; k < ${motors}; k++)
        z[k] = 0;
    for (int step = 0; step < 60; step++) {
        for (int i = 0; i < ${n}; i++)
            for (int j = 0; j <= i; j++) {
                ${type} sum = i == j ? ${least_pivot} * whole : 0;
                for (int k = 0; k < ${motors}; k++)
                    if (step == 0 || (z[k] > least[k] && z[k] < largest[k]))
                        sum += J[${n} * k + i] * J[${n} * k + j];
                for (int k = 0; k < j; k++)
                    sum -= H[i][k] * H[j][k];
                if (i == j && !(sum > 0))
                    return ROBOT_SINGULAR;
                H[i][j] = i == j ? SQUARE_ROOT(sum) : sum / H[j][j]; /* Cholesky's factor */
            }
        for (int i = 0; i < ${n}; i++) {
            g[i] = -g[i];
            for (int k = 0; k < i; k++)
                g[i] -= H[i][k] * g[k];
            g[i] /= H[i][i];
        }
        for (int i = ${n} - 1; i >= 0; i--) {
            for (int k = i + 1; k < ${n}; k++)
                g[i] -= H[k][i] * g[k];
            g[i] /= H[i][i];
        }
        for (int k = 0; k < ${motors}; k++) {
            dz[k] = 0;
            for (int i = 0; i < ${n}; i++)
                dz[k] += J[${n} * k + i] * g[i];
        }
        ${type} low = 0, part = 1, high = 1;
        for (int halving = 0; step > 0 && halving < ${halvings}; halving++) {
            ${type} slope = 0;
            for (int i = 0; i < ${n}; i++)
                slope -= f[i] * g[i];
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
        int done = 1;
        for (int i = 0; i < ${n}; i++)
            p[i] += part * g[i];
        for (int k = 0; k < ${motors}; k++) {
            z[k] = 0;
            for (int i = 0; i < ${n}; i++)
                z[k] += J[${n} * k + i] * p[i];
            tau[k] = z[k] < least[k] ? least[k] : z[k] > largest[k] ? largest[k] : z[k];
        }
        for (int i = 0; i < ${n}; i++) {
            ${type} size = f[i] < 0 ? -f[i] : f[i];
            g[i] = -f[i];
            for (int k = 0; k < ${motors}; k++) {
                const ${type} given = J[${n} * k + i] * tau[k];
                g[i] += given;
                size += given < 0 ? -given : given;
            }
            if (!(g[i] <= ${tolerance} * size && -g[i] <= ${tolerance} * size))
                done = 0;
        }
        if (done)
            return 0;
    }
    return ROBOT_LIMITS;
}
