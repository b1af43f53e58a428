/* Newton steps that start short and shrink fast lead to the one solution nearby. */
RUN
{
    const int nq = ${q};
    const number units[] = {${units}};
    real x[${inputs}], y[${room}], length = 1;
    ${takes}
    int bad = judge_numbers(x, nq, nq);
#pragma unroll 1
    for (int step = 0; step < 6 && length > LAST_STEP && !bad; step++) {
        const real most = step == 0 ? ${longest_first_step} : ${largest_ratio} * length + LAST_STEP;
        ${name}(x, column(p, i), y);
        length = longest_way(nq, units, x, y);
        bad = length <= most ? 0 : OPEN;
        for (int j = 0; j < nq; j++)
            x[j] = y[j];
    }
    if (!bad)
        bad = judge(x, nq, nq, y, nq, 0) ? NOT_FINITE : judge_checks(y + nq + 2, ${checks});
    give(x, out, i, nq, bad);
    tell(status, i, bad);
}
