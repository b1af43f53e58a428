${head}
{
    ${type} x[${inputs}], y[${y_size}], p[${p_size}], finite = 0; /* NaN if one is not finite */
    int bad = 0;
${copies}
    for (int i = 0; i < ${inputs}; i++)
        finite += x[i] * 0;
    for (int i = 0; i < ${angles}; i++)
        if (!(x[i] <= LARGEST_ANGLE && x[i] >= -LARGEST_ANGLE))
            return ROBOT_NOT_FINITE;
    if (!(finite <= 0))
        return ROBOT_NOT_FINITE;
    for (int i = 0; i < ${parameters}; i++)
        p[i] = robot_parameters[i];
    ${name}_constants(p);
    ${name}(x, p, y);
    for (int i = 0; i < ${outputs}; i++) {
        ${output}[i] = y[i];
        finite += y[i] * 0;
    }
    /* y has the outputs, then the checks, which pass up to 1; the first one is of closed loops */
    for (int i = ${checks} + 1; i < ${total}; i++)
        if (!(y[i] <= 1))
            bad = ROBOT_SINGULAR;
    if (!(y[${checks}] <= 1))
        bad = ROBOT_OPEN;
    return bad ? bad : finite <= 0 ? 0 : ROBOT_NOT_FINITE;
}
