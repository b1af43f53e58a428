${head}
{
    static const int at[${n}] = {${places}}, turns[${n}] = {${turns}};
    const ${type} turn = ${turn};
    ${type} aa[${n}];
    for (int i = 0; i < ${n}; i++) {
        ${type} error = x[i] - q[at[i]];
        if (!(error <= LARGEST_ANGLE && error >= -LARGEST_ANGLE))
            return ROBOT_NOT_FINITE;
        if (turns[i])
            error -= turn * (${type})(long)(error / turn + (error < 0 ? -${half} : ${half}));
        aa[i] = a[i] + kd[i] * (v[i] - va[i]) + kp[i] * error;
    }
    ${torques}
    for (int i = 0; i < ${motors}; i++)
        tau[i] = tau[i] > limits[i] ? limits[i] : tau[i] < -limits[i] ? -limits[i] : tau[i];
    return bad;
}
