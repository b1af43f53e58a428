${head}
{
    static const int at[${n}] = {${places}}; /* index in q of each coordinate */
    static const int turns[${n}] = {${turns}}; /* 1 for an angle */
    const ${type} turn = ${turn}; /* one turn, [rad] */
    ${type} aa[${n}];
    for (int i = 0; i < ${n}; i++) {
        ${type} error = x[i] - q[at[i]];
        if (!(error <= LARGEST_ANGLE && error >= -LARGEST_ANGLE))
            return ROBOT_NOT_FINITE;
        if (turns[i]) /* subtract whole turns; the conversion to long rounds towards zero */
            error -= turn * (${type})(long)(error / turn + (error < 0 ? -${half} : ${half}));
        aa[i] = a[i] + kd[i] * (v[i] - va[i]) + kp[i] * error;
    }
    ${torques}
    for (int i = 0; i < ${motors}; i++)
        tau[i] = tau[i] > limits[i] ? limits[i] : tau[i] < -limits[i] ? -limits[i] : tau[i];
    return bad;
}
