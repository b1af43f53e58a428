/* Steps with constant torques: the classical Runge-Kutta method, then Newton's method onto the
 * closures, as in driver.h. A step that may leave the assembly mode makes the sample bad. Between
 * two modes, and near a singularity, det Phi_u changes much. So a step is sound only if det Phi_u
 * changes little from its start to its middle, and from its middle to its end.
 *
 * RUN, of warp.h, is the head of the function that computes sample i. Its arguments are Warp's
 * arrays of all samples (q, va, `last` with tau, p, out, va_out, status), and the number `steps` of
 * steps of length h. warp_code.py fills the blanks. A `number` is a float or a double, and in Warp
 * a `real` is the same: a thread computes one sample. Two generated kernels are called:
 *
 * - ${name}: from x = (q, va, tau, wrenches) to y: the rates of q and va, then its checks;
 * - ${close}: from q, the first numbers of x, to y: q after one step of Newton's method, det Phi_u
 *   before this step, a number for other callers, then its checks. The first check is that of
 *   closed loops. */
RUN
{
    /* sizes of q, of a state (q, va), and of the results of ${close} without its checks */
    const int nq = ${q}, states = ${outputs}, outputs = nq + 2;
    const number units[] = {${units}};
    const parameters own = column(p, i);
    real x[${inputs}], y[${y_size}], start[states], end[states];
    /* read the inputs of sample i into x */
    ${takes}
    ${close}(x, own, y);
    real det = y[nq]; /* at the start of the step */
    int bad = judge_numbers(x, nq, ${inputs});
    for (int s = 0; s < steps && !bad; s++) {
        /* The Runge-Kutta method; `end` becomes the state at the end, with open loops. The x after
         * the last stage is not used. */
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

        /* Newton's method. Call 0 is for det Phi_u in the middle, which is compared with that at
         * the start. Its step is not used: only its length is, which must be short, so that the
         * middle is close to a closed configuration. Calls 1, 2, 3 close the loops at the end. Call
         * 1 compares det Phi_u at the end with that in the middle; calls 2, 3 only refine `det`
         * for the next step. All share a loop, so that the code of the kernel, which is long,
         * stands here once. */
        real left = 1; /* length of the last step of Newton's method from the end */
        int sound = 1;
        for (int j = 0; j < states; j++)
            x[j] = j < nq ? (start[j] + end[j]) / 2 : end[j];
#pragma unroll 1
        for (int call = 0; call < 4 && left > LAST_STEP; call++) {
            ${close}(x, own, y);
            const real ratio = y[nq] / det, length = distance_between(nq, units, x, y);
            const int changes_little = ratio * ${change} > 1 && ratio < ${change};
            det = y[nq]; /* before the step of this call */
            if (call == 0)
                sound = changes_little && length < ${nearby};
            if (call == 1)
                sound = sound && changes_little;
            if (call > 0)
                left = length;
            for (int j = 0; j < nq; j++)
                x[j] = call == 0 ? end[j] : y[j];
        }
        /* x is closed now, up to rounding; `end` is still the end with open loops */
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
