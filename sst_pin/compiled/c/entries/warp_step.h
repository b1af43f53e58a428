/* The classical Runge-Kutta method with constant torques, and Newton's method onto the closures
 * after each step, as in driver.h. Between two assembly modes, and near a singularity, a block of
 * Phi_u is almost singular: so det Phi_u may change little to the middle of a step and to its end. */
RUN
{
    const int nq = ${q}, states = ${outputs}, outputs = nq + 2;
    const number units[] = {${units}};
    const parameters own = column(p, i);
    real x[${inputs}], y[${room}], start[states], sum[states];
    ${takes}
    ${close}(x, own, y);
    real det = y[nq];
    int bad = judge_numbers(x, nq, ${inputs});
    for (int s = 0; s < steps && !bad; s++) {
        for (int j = 0; j < states; j++)
            sum[j] = start[j] = x[j];
#pragma unroll 1
        for (int stage = 0; stage < 4; stage++) {
            ${name}(x, own, y);
            if (stage == 0)
                bad = judge(x, nq, ${inputs}, y, states, ${checks});
            const number weight = h / (stage == 0 || stage == 3 ? 6 : 3);
            const number ahead = stage == 2 ? h : h / 2;
            for (int j = 0; j < states; j++) {
                sum[j] += weight * y[j];
                x[j] = start[j] + ahead * y[j];
            }
        }
        real before = det, gap = 1;
        int sound = 1;
        for (int j = 0; j < states; j++)
            x[j] = j < nq ? (start[j] + sum[j]) / 2 : sum[j];
#pragma unroll 1
        for (int step = 0; step < 4 && gap > LAST_STEP; step++) { /* the middle, then the end */
            ${close}(x, own, y);
            const real ratio = y[nq] / before;
            sound &= step > 1 || (ratio * ${change} > 1 && ratio < ${change});
            before = step == 0 ? y[nq] : before;
            det = y[nq];
            const real length = longest_way(nq, units, x, y);
            sound &= step > 0 || length < ${nearby};
            gap = step == 0 ? 1 : length;
            for (int j = 0; j < nq; j++)
                x[j] = step == 0 ? sum[j] : y[j];
        }
        const real way = longest_way(nq, units, start, x), opened = longest_way(nq, units, sum, x);
        sound &= way <= ${travel} && opened <= ${bend} * way + ${tolerance};
        if (!bad)
            bad = judge_numbers(x, nq, states);
        if (!bad && (bad = judge_checks(y + outputs, ${close_checks})) != SINGULAR)
            bad = bad || !sound ? MODE : 0;
    }
    give(x, out, i, nq, bad);
    give(x + nq, va_out, i, states - nq, bad);
    tell(status, i, bad);
}
