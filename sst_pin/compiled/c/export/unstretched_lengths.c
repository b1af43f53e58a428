${head}
{
    static const ${type} push[${motors}] = {${factors}}; /* of each line, for a torque of 1 */
    ${type} most = 0, finite = 0; /* largest force; NaN if a number is not finite */
    const int bad = robot_line_lengths(q, lengths);
    if (bad)
        return bad;
    for (int i = 0; i < ${motors}; i++) {
        const ${type} size = tau[i] * push[i];
        finite += size * 0 + stiffness[i] * 0;
        if (!(stiffness[i] > 0))
            return ROBOT_NOT_FINITE;
        most = size > most ? size : -size > most ? -size : most;
    }
    if (!(finite <= 0))
        return ROBOT_NOT_FINITE;
    for (int i = 0; i < ${motors}; i++) {
        const ${type} tension = -tau[i] * push[i];
        if (tension < -${slack} * most)
            return ROBOT_LIMITS;
        lengths[i] *= stiffness[i] / (stiffness[i] + tension);
    }
    return 0;
}
