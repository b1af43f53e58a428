/* Newton's method onto the closures. If its first step is short and the others shrink fast, it
 * leads to the one solution nearby; otherwise the loops count as open. */
RUN
{
    const int nq = ${q};
    const number units[] = {${units}};
    real x[${inputs}], y[${y_size}], length = 1;
    ${takes}
    int bad = judge_numbers(x, nq, nq);
#pragma unroll 1
    for (int step = 0; step < 6 && length > LAST_STEP && !bad; step++) {
        const real longest =
            step == 0 ? ${longest_first_step} : ${largest_ratio} * length + LAST_STEP;
        ${name}(x, column(p, i), y);
        length = distance_between(nq, units, x, y);
        bad = length <= longest ? 0 : OPEN;
        for (int j = 0; j < nq; j++)
            x[j] = y[j];
    }
    /* y has q, two numbers for other callers, checks */
    if (!bad)
        bad = judge(x, nq, nq, y, nq, 0) ? NOT_FINITE : judge_checks(y + nq + 2, ${checks});
    give(x, out, i, nq, bad);
    tell(status, i, bad);
}
