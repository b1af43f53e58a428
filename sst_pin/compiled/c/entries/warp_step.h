/* Steps with constant torques: the classical Runge-Kutta method, then Newton's method onto the
 * closures, as in driver.h. A step that may leave the assembly mode makes the sample bad. Between
 * two modes, and near a singularity, det Phi_u changes much. So a step is sound only if det Phi_u
 * changes little from its start to its middle, and from its middle to its end. */
RUN
{
    /* sizes of q, of the results of ${name}, and of the results of ${close} */
    const int nq = ${q}, states = ${outputs}, outputs = nq + 2;
    const number units[] = {${units}};
    const parameters own = column(p, i);
    real x[${inputs}], y[${y_size}], start[states], end[states];
    ${takes}
    ${close}(x, own, y);
    real det = y[nq];
    int bad = judge_numbers(x, nq, ${inputs});
    for (int s = 0; s < steps && !bad; s++) {
        /* the Runge-Kutta method; `end` becomes the state at the end, with open loops */
        for (int j = 0; j < states; j++)
            end[j] = start[j] = x[j];
#pragma unroll 1
        for (int stage = 0; stage < 4; stage++) {
            ${name}(x, own, y);
            if (stage == 0)
                bad = judge(x, nq, ${inputs}, y, states, ${checks});
            const number weight = h / (stage == 0 || stage == 3 ? 6 : 3);
            const number ahead = stage == 2 ? h : h / 2; /* to the next stage */
            for (int j = 0; j < states; j++) {
                end[j] += weight * y[j];
                x[j] = start[j] + ahead * y[j];
            }
        }

        /* Newton's method. Call 0 makes one step from the middle; calls 1, 2, 3 close the loops at
         * the end. They share a loop, so that the code of the kernel, which is long, stands here
         * once. The kernel returns det Phi_u before its step: call 0 compares the middle with the
         * start, call 1 compares the end with the middle. */
        real left = 1; /* length of the last step of Newton's method from the end */
        int sound = 1;
        for (int j = 0; j < states; j++)
            x[j] = j < nq ? (start[j] + end[j]) / 2 : end[j];
#pragma unroll 1
        for (int call = 0; call < 4 && left > LAST_STEP; call++) {
            ${close}(x, own, y);
            const real ratio = y[nq] / det, length = distance_between(nq, units, x, y);
            const int changes_little = ratio * ${change} > 1 && ratio < ${change};
            det = y[nq];
            if (call == 0)
                sound = changes_little && length < ${nearby};
            if (call == 1)
                sound = sound && changes_little;
            if (call > 0)
                left = length;
            for (int j = 0; j < nq; j++)
                x[j] = call == 0 ? end[j] : y[j];
        }
        const real length = distance_between(nq, units, start, x);
        const real correction = distance_between(nq, units, end, x);
        sound = sound && length <= ${travel} && correction <= ${bend} * length + ${tolerance};

        if (!bad)
            bad = judge_numbers(x, nq, states);
        if (!bad) {
            bad = judge_checks(y + outputs, ${close_checks});
            if (bad == OPEN || (!bad && !sound)) /* a long step leaves loops open, too */
                bad = MODE;
        }
    }
    give(x, out, i, nq, bad);
    give(x + nq, va_out, i, states - nq, bad);
    tell(status, i, bad);
}
