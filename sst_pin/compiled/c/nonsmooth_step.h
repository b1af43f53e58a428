/* SPDX-License-Identifier: BSD-2-Clause */
/* One nonsmooth step of one robot, as dynamics/nonsmooth_step.py makes it; that file says why. It needs
 * dense_solvers.h and impulses.h. */

#ifdef SINGLE
#define HELD_BY_LOOPS 1e-5f
#else
#define HELD_BY_LOOPS 1e-10 /* as in thresholds.py */
#endif

/* The rows of a robot; the numbers are those of nonsmooth_kernel.Layout. */
typedef struct {
    int n, q, load, motors, m, contacts, ropes, cables, stops, dry, implicit;
    int at_inertia, at_forces, at_gaps, at_lengths, at_positions, at_entries, outputs, checks;
    const int *row_start, *row_column, *impulse_row, *impulse_sign, *implicit_row, *stop_position;
    const number *coordinate_scale, *gap_scale; /* make coordinates, and gaps, free of units */
} rows_of_robot;

/* Lengths of the workspaces `work` and `flags` of `nonsmooth_step`. */
#define WORKSPACE(n, m, motors) ((n) * FILLED(n) + 2 * FILLED(n) + (n) * FILLED(m) \
    + 2 * (m) * FILLED(m) + 16 * FILLED(m) + (motors))
#define FLAGS(m) (5 * (m) + 1)

/* Rate of the row of impulse i for rates v of the coordinates. */
INLINED number rate_of(const rows_of_robot *f, const number *entries, const number *v, int i)
{
    const int row = f->impulse_row[i];
    number sum = 0;
    for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
        sum += entries[a] * v[f->row_column[a]];
    return f->impulse_sign[i] * sum;
}

/* Whether the row of impulse i can change its gap, number g: whether it is more than rounding. */
INLINED int can_move(const rows_of_robot *f, const number *entries, int i, int g)
{
    const int row = f->impulse_row[i];
    for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
        if (MAGNITUDE(entries[a]) * f->coordinate_scale[f->row_column[a]] > HELD_BY_LOOPS * f->gap_scale[g])
            return 1;
    return 0;
}

/* One step: rates `va` become those at its end, `x` the impulses, from those of the step before.
 * y are the terms at q, `series` bounds the iterations. False if the inertia is not positive definite or a number is not finite. */
FAST int nonsmooth_step(const rows_of_robot *f, const number *y, const number *q, number *va,
    const number *tau, const number *held, number h, const number *numbers, int series, number *x,
    number *residual, number *work, int *flags)
{
    const int n = f->n, m = f->m, wide = FILLED(n), c = f->contacts, gaps = c + f->ropes, k = f->cables;
    const number *friction = numbers, *restitution = friction + c, *offsets = restitution + c;
    const number *line_k = offsets + gaps, *rest = line_k + k, *line_d = rest + k;
    const number *preload = line_d + k, *on_cables = preload + k;
    const number *limits = on_cables + k * f->motors, *coulomb = limits + f->stops;
    const number *damping = coulomb + f->dry, *stiffness = damping + f->implicit;
    const int first_motor = f->implicit - f->motors;
    const number *entries = y + f->at_entries;
    const int most_rows = FILLED(m);
    number *A = work, *free = A + n * wide, *change = free + wide, *Z = change + wide;
    number *G = Z + n * most_rows, *D = G + m * most_rows, *bias = D + m * most_rows;
    number *compliance = bias + most_rows, *bounds = compliance + most_rows;
    number *vectors = bounds + most_rows, *effort = vectors + 13 * most_rows;
    int *acting = flags, *index = flags + m, *kinds = flags + 2 * m, *inside = flags + 3 * m;
    int *factorized = flags + 4 * m;

    /* the inertia, with damping and stiffness at the end of the step */
    memset(A, 0, n * wide * sizeof(number));
    for (int i = 0, at = f->at_inertia; i < n; i++)
        for (int j = i; j < n; j++)
            A[i * wide + j] = y[at++];
    for (int i = 0; i < n; i++)
        free[i] = h * y[f->at_forces + i];
    for (int i = 0; i < n; i++) {
        free[i] += A[i * wide + i] * va[i];
        for (int j = i + 1; j < n; j++) {
            free[i] += A[i * wide + j] * va[j];
            free[j] += A[i * wide + j] * va[i];
        }
    }
    for (int i = 0; i < f->motors; i++)
        effort[i] = tau[i] - stiffness[first_motor + i] * (y[f->at_positions + i] - held[i]);
    for (int i = 0; i < f->implicit; i++) {
        const int row = f->implicit_row[i], begin = f->row_start[row], end = f->row_start[row + 1];
        const number factor = h * damping[i] + h * h * stiffness[i];
        for (int a = begin; a < end; a++) {
            if (i >= first_motor)
                free[f->row_column[a]] += h * effort[i - first_motor] * entries[a];
            if (factor != 0)
                for (int b = a; b < end; b++)
                    A[f->row_column[a] * wide + f->row_column[b]] += factor * entries[a] * entries[b];
        }
    }

    /* cables: w = J va + bias + compliance x; one of constant tension is a force */
    for (int i = 0; i < m; i++) {
        acting[i] = 0;
        bias[i] = compliance[i] = bounds[i] = 0;
    }
    const int first_cable = 3 * c + f->ropes, first_stop = first_cable + k;
    for (int i = 0; i < k; i++) {
        const number length = y[f->at_lengths + i], *share = on_cables + i * f->motors;
        number tension = preload[i] + line_k[i] * (length - rest[i]);
        number hard = line_k[i], soft = line_d[i];
        for (int j = 0; j < f->motors; j++) {
            tension -= share[j] * effort[j];
            hard += share[j] * share[j] * stiffness[first_motor + j];
            soft += share[j] * share[j] * damping[first_motor + j];
        }
        const int at = first_cable + i, row = f->impulse_row[at];
        if (hard + soft > 0) {
            bias[at] = -tension / (soft + h * hard);
            compliance[at] = 1 / (h * (soft + h * hard));
            continue;
        }
        acting[at] = -1; /* never acts as a row */
        bounds[at] = tension > 0 ? h * tension : 0;
        for (int a = f->row_start[row]; a < f->row_start[row + 1]; a++)
            free[f->row_column[a]] += bounds[at] * entries[a];
    }
    if (!factorize(A, n, wide, change))
        return 0;
    solve_symmetric(A, free, n, wide);

    for (int i = 0; i < c; i++) {
        const int at = 3 * i + 2;
        const number gap = y[f->at_gaps + i] - offsets[i];
        bias[at] = gap / h;
        bounds[at] = friction[i];
        if (restitution[i] > 0) {
            const number before = rate_of(f, entries, va, at), ahead = rate_of(f, entries, free, at);
            if (before < 0 && gap + h * (before < ahead ? before : ahead) <= 0)
                bias[at] = restitution[i] * before;
        }
    }
    for (int i = 0; i < f->ropes; i++)
        bias[3 * c + i] = (y[f->at_gaps + c + i] - offsets[c + i]) / h;
    for (int i = 0; i < f->stops; i++)
        bias[first_stop + i] = f->impulse_sign[first_stop + i]
            * (q[f->stop_position[i]] - limits[i]) / h;
    for (int i = 0; i < f->dry; i++) {
        const int at = first_stop + f->stops + i;
        bounds[at] = h * coulomb[i];
        acting[at] = bounds[at] > 0 ? 1 : -1;
    }

    /* contacts, ropes and stops that the loops hold never act */
    for (int i = 0; i < c; i++)
        if (!can_move(f, entries, 3 * i + 2, i))
            acting[3 * i] = acting[3 * i + 1] = acting[3 * i + 2] = -1;
    for (int i = 0; i < f->ropes; i++)
        if (!can_move(f, entries, 3 * c + i, c + i))
            acting[3 * c + i] = -1;
    for (int i = 0; i < f->stops; i++)
        if (!can_move(f, entries, first_stop + i, gaps + i))
            acting[first_stop + i] = -1;

    /* rows that act, until the others are not violated */
    const number *rates = free;
    number worst = 0;
    for (;;) {
        int more = 0, count = 0;
        for (int i = 0; i < first_stop + f->stops; i++) {
            const int contact = i < 3 * c;
            const int at = contact ? i + 2 : i;
            if (acting[at] == 0 && rate_of(f, entries, rates, at) + bias[at] < 0) {
                more = acting[at] = 1;
                if (contact)
                    acting[i] = acting[i + 1] = 1;
            }
            i = at;
        }
        for (int i = 0; i < m; i++)
            if (acting[i] == 1)
                index[count++] = i;
        if (rates == free && count)
            more = 1;
        if (!more)
            break;
        const int filled = FILLED(count);
        memset(Z, 0, n * filled * sizeof(number));
        for (int a = 0; a < count; a++) {
            const int row = f->impulse_row[index[a]], sign = f->impulse_sign[index[a]];
            for (int b = f->row_start[row]; b < f->row_start[row + 1]; b++)
                Z[f->row_column[b] * filled + a] = sign * entries[b];
        }
        solve_many(A, Z, n, wide, filled);
        number *unit = vectors, *u = unit + most_rows, *most = u + most_rows;
        number *now = most + most_rows;
        for (int a = 0; a < count; a++)
            unit[a] = compliance[index[a]];
        for (int b = 0; b < n; b++)
            for (int a = 0; a < count; a++)
                unit[a] += Z[b * filled + a] * Z[b * filled + a];
        int kept = 0;
        for (int a = 0; a < count; a++) {
            const int at = index[a];
            kinds[a] = at >= first_stop + f->stops ? DRY : at >= 3 * c ? STOP : SIDE;
            if (at < 3 * c && at % 3 == 2) {
                kinds[a] = NORMAL;
                if (!(unit[a] > 0)) /* it cannot be changed */
                    acting[at] = acting[at - 1] = acting[at - 2] = -1;
                const number larger = unit[a - 1] > unit[a - 2] ? unit[a - 1] : unit[a - 2];
                unit[a] = unit[a] > larger ? unit[a] : larger;
                unit[a - 1] = unit[a - 2] = unit[a];
            } else if (kinds[a] != SIDE && !(unit[a] > 0))
                acting[at] = -1;
        }
        for (int a = 0; a < count; a++)
            kept += acting[index[a]] == 1;
        if (kept < count) {
            rates = free;
            continue;
        }
        for (int a = 0; a < count; a++) {
            const int at = index[a];
            unit[a] = ROOT(unit[a]);
            u[a] = (rate_of(f, entries, free, at) + bias[at]) / unit[a];
            most[a] = kinds[a] == DRY ? bounds[at] * unit[a] : bounds[at];
            now[a] = x[at] * unit[a];
        }
        for (int a = 0; a < count; a++) {
            const number inverse = 1 / unit[a];
            for (int b = 0; b < n; b++)
                Z[b * filled + a] *= inverse;
        }
        memset(G, 0, count * filled * sizeof(number));
        for (int b = 0; b < n; b++)
            for (int a = 0; a < count; a++)
                if (Z[b * filled + a] != 0)
                    add_row(G + a * filled, Z[b * filled + a], Z + b * filled, 0, filled);
        for (int a = 0; a < count; a++)
            G[a * filled + a] += compliance[index[a]] / (unit[a] * unit[a]);
        number *room[9];
        for (int a = 0; a < 9; a++)
            room[a] = now + (a + 1) * most_rows;
        problem p = {count, filled, G, u, kinds, most, room[0], room[1], room[2], inside, room[3], D,
            room[4], room[5], factorized, 0};
        worst = solve_rows(&p, now, series, room[6], room[7], room[8]);
        for (int b = 0; b < n; b++) {
            change[b] = 0;
            for (int a = 0; a < count; a++)
                change[b] += Z[b * filled + a] * now[a];
            change[b] *= ROOT(A[b * wide + b]); /* Z = D^(-1/2) U^(-T) times the rows */
        }
        solve_upper(A, change, n, wide);
        for (int b = 0; b < n; b++)
            change[b] += free[b];
        memset(x, 0, m * sizeof(number));
        for (int a = 0; a < count; a++)
            x[index[a]] = now[a] / unit[a];
        rates = change;
    }
    if (rates == free)
        memset(x, 0, m * sizeof(number));
    number sum = 0;
    for (int i = 0; i < n; i++)
        sum += va[i] = rates[i];
    for (int i = 0; i < k; i++)
        if (acting[first_cable + i] == -1)
            x[first_cable + i] = bounds[first_cable + i];
    *residual = worst;
    return IS_FINITE(sum);
}

/* Whether contacts, ropes and stops are violated at most by the bounds for a start, `times` so much. */
FAST int starts_free(const rows_of_robot *f, const number *y, const number *q,
    const number *numbers, number times)
{
    const int gaps = f->contacts + f->ropes, first_stop = 3 * f->contacts + f->ropes + f->cables;
    const number *offsets = numbers + 2 * f->contacts;
    const number *limits = offsets + gaps + (4 + f->motors) * f->cables;
    const number *least = limits + f->stops + f->dry + 2 * f->implicit;
    for (int i = 0; i < gaps; i++)
        if (!(y[f->at_gaps + i] - offsets[i] >= times * least[i]))
            return 0;
    for (int i = 0; i < f->stops; i++) {
        const number gap = q[f->stop_position[i]] - limits[i];
        if (!(f->impulse_sign[first_stop + i] * gap >= times * least[gaps + i]))
            return 0;
    }
    return 1;
}
