/* Nonsmooth steps of one robot, as nonsmooth.h makes them. The arguments are those of `NONSMOOTH`
 * in warp_code.py. If the impulses of a step are not solved, the status is UNSOLVED, and the
 * results are those of the best impulses; results of other bad samples are NaN. The arrays are
 * local: in local memory of a GPU the same number of neighbouring threads stands side by side. */
static void run(int i, const rows &q, const rows &va, const rows &tau,
    const rows &external_wrenches, const rows &p, const rows &numbers, const rows &held,
    const rows &start, const rows &q_out, const rows &va_out, const rows &contact_forces,
    const rows &tensions, const rows &joint_forces, const rows &line_friction,
    const rows &residual, const rows &impulses, number h, int steps, int series, number violation,
    const flags &status)
{
    ${tables}
    static const int joint_rate[] = {${joint_rate}};
    const int nq = ${q}, n = ${n}, m = ${m}, motors = ${motors}, outputs = ${outputs};
    const int tension_count = robot.ropes + robot.cables;
    const int first_joint_row = first_stop(&robot); /* stops, dry joints */
    const int first_dry_line = m - ${dry_lines};
    const parameters own = column(p, i);
    const number *own_numbers = &at(numbers, numbers.shape[0] > 1 ? i : 0, 0);
    number x[${inputs}], y[${y_size}], ends[2 * ${q}], work[WORKSPACE(${n}, ${m}, ${motors})];
    number torque[${motors} + 1], position[${motors} + 1], impulse[${m} + 1], force[${m} + 1];
    int workspace_flags[FLAGS(${m})];
    number worst = 0; /* the largest residual of a step */

    /* the arguments of this robot */
    ${takes}
    for (int j = 0; j < motors; j++) {
        torque[j] = at(tau, i, j);
        position[j] = held.data ? at(held, i, j) : 0;
    }
    for (int j = 0; j < m; j++) {
        impulse[j] = start.data && IS_FINITE(at(start, i, j)) ? at(start, i, j) : 0;
        force[j] = 0;
    }

    /* the steps; y has the results of each kernel in turn */
    closing(x, own, y);
    number det = y[nq];
    int bad = 0;
#pragma unroll 1
    for (int s = 0; s < steps && !bad; s++) {
        nonsmooth_terms(x, own, y);
        bad = judge(x, nq, ${inputs}, y, outputs, ${checks});
        if (!bad && s == 0 && !may_start(&robot, y, x, own_numbers, violation))
            bad = VIOLATED;
        if (bad)
            break;
        number error = 0;
        const int good = nonsmooth_step(&robot, y, x, x + nq, torque, position, h, own_numbers,
            series, impulse, &error, work, workspace_flags);
        worst = error > worst || error != error ? error : worst; /* NaN stays */
        for (int j = 0; j < m; j++)
            force[j] += impulse[j] / (h * steps); /* the mean over all steps */
        if (!good)
            bad = judge_numbers(x + nq, 0, n) ? NOT_FINITE : SINGULAR;
        else if (!move_and_close(&bounds, own, h, x, y, ends, &det))
            bad = MODE;
    }

    /* the results */
    give(x, q_out, i, nq, bad);
    give(x + nq, va_out, i, n, bad);
    give(force, contact_forces, i, 3 * robot.contacts, bad);
    give(force + first_rope(&robot), tensions, i, tension_count, bad);
    give(force + first_dry_line, line_friction, i, ${dry_lines}, bad);
    give(&worst, residual, i, 1, bad);
    for (int j = 0; j < ${rates}; j++)
        at(joint_forces, i, j) = bad ? (number)NAN : 0;
    for (int j = first_joint_row; j < first_dry_line; j++) {
        const int rate = joint_rate[j - first_joint_row];
        at(joint_forces, i, rate) += robot.impulse_sign[j] * force[j];
    }
    for (int j = 0; j < m; j++) /* where the solver of the next step starts */
        at(impulses, i, j) = bad ? 0 : impulse[j];
    tell(status, i, bad || worst <= SOLVED ? bad : UNSOLVED);
}
