/* SPDX-License-Identifier: BSD-2-Clause */
/* One nonsmooth step of one robot, as dynamics/nonsmooth_step.py makes it; that file gives the reasons.
 * It needs dense_solvers.h and impulses.h.
 *
 * A step of length h leads from the rates va_0 of the coordinates to va (Moreau and Jean):
 *
 *     A free = M va_0 + h f,  A = M + h D + h^2 K      rates without the impulses
 *     va = free + A^-1 J^T x                           with the impulses x of the rows J
 *     w = J va + bias + compliance x                   rates of the rows
 *
 * where x and w solve the problem of impulses.h. M is the inertia matrix, f are the forces at q, and D
 * and K are the damping and the stiffness of joints, of lines that also push, and of motors: these are
 * implicit, which means that they act with the rates va. With the bias gap / h, the gap after the step
 * is h w, which is not negative. */

/* A row of a gap that is not larger than this, without units, is rounding: as in thresholds.py. */
#ifdef SINGLE
#define HELD_BY_LOOPS 1e-5f
#else
#define HELD_BY_LOOPS 1e-10
#endif

/* Sizes and tables of a robot, from nonsmooth_kernel.Layout. */
typedef struct {
    int n;      /* coordinates */
    int q;      /* entries of a configuration */
    int load;   /* entries of the external wrenches */
    int motors;
    int m;      /* impulses, in this order: three of each contact, ropes, cables, stops, dry friction */
    int contacts, ropes, cables, stops, dry;
    int implicit; /* implicit forces, in this order: joints, lines that also push, motors */
    /* Where parts of the terms begin. The terms are the results of the kernel at q: the upper triangle
     * of M, f, gaps of contacts and ropes, lengths of cables, positions of motors, entries of rows. */
    int at_inertia, at_forces, at_gaps, at_lengths, at_positions, at_entries;
    int outputs, checks; /* number of terms, and of the checks behind them */
    /* A sparse matrix: row r has the entries row_start[r] to row_start[r + 1] - 1, in these columns,
     * which ascend. */
    const int *row_start, *row_column;
    const int *impulse_row, *impulse_sign; /* a row of J is this row of the matrix, times 1 or -1 */
    const int *implicit_row;               /* row of the matrix of each implicit force */
    const int *stop_position;              /* index in q of each stop */
    const number *coordinate_scale, *gap_scale; /* the units of coordinates and of gaps */
} rows_of_robot;

/* Other numbers of a robot, in the order of `parameter_values` in nonsmooth_motions.py. */
typedef struct {
    const number *friction, *restitution; /* of contacts */
    const number *offsets; /* of contacts and ropes: the gaps are the terms less these */
    /* of cables; on_cables, shape (cables, motors), is the push of each motor per effort */
    const number *line_stiffness, *rest_lengths, *line_damping, *preload, *on_cables;
    const number *limits;              /* of stops */
    const number *coulomb;             /* of dry friction */
    const number *damping, *stiffness; /* of implicit forces */
    const number *least_gaps; /* with which a motion may start: of contacts, ropes and stops */
} numbers_of_robot;

/* The beginning of a step. */
typedef struct {
    const rows_of_robot *robot;
    numbers_of_robot numbers;
    const number *terms, *entries; /* at q; entries are the last part of the terms */
    const number *q, *va;
    const number *tau;  /* torques of the motors */
    const number *held; /* positions that the stiffness of the motors holds */
    number h;
} beginning;

/* Whether a row is solved for. */
enum { NEVER_ACTS = -1, MAY_ACT, ACTS };

/* All rows of a step; numbers that are not set are zero. */
typedef struct {
    int *state;
    number *bias, *compliance;
    number *bounds; /* as in impulses.h */
} rows_of_step;

/* The rows that act, as a problem without units. */
typedef struct {
    int count, wide;
    int *index; /* their numbers among all rows */
    int *kinds;
    /* With A = U^T D U, Z = D^(-1/2) U^(-T) J^T, shape (n, wide), so that J A^-1 J^T = Z^T Z. */
    number *Z;
    number *G;    /* J A^-1 J^T + compliance, shape (count, wide) */
    number *unit; /* the root of its diagonal entry; rates are divided by it, impulses multiplied */
    number *u, *bounds, *x;
} acting_rows;

/* Lengths of the workspaces `work` and `flags` of `nonsmooth_step`. */
#define WORKSPACE(n, m, motors) ((n) * FILLED(n) + 2 * FILLED(n) + (n) * FILLED(m) \
    + 2 * (m) * FILLED(m) + 16 * FILLED(m) + (motors))
#define FLAGS(m) (5 * (m) + 1)

/* --- the numbers of a step ---------------------------------------------------------------------- */

INLINED int first_rope(const rows_of_robot *robot)
{
    return 3 * robot->contacts;
}

INLINED int first_cable(const rows_of_robot *robot)
{
    return first_rope(robot) + robot->ropes;
}

INLINED int first_stop(const rows_of_robot *robot)
{
    return first_cable(robot) + robot->cables;
}

INLINED int first_dry(const rows_of_robot *robot)
{
    return first_stop(robot) + robot->stops;
}

/* The first motor among the implicit forces. */
INLINED int first_motor(const rows_of_robot *robot)
{
    return robot->implicit - robot->motors;
}

INLINED int kind_of(const rows_of_robot *robot, int i)
{
    if (i >= first_dry(robot))
        return DRY;
    if (i >= first_rope(robot))
        return STOP; /* ropes, cables and stops */
    return i % 3 == 2 ? NORMAL : SIDE;
}

INLINED numbers_of_robot named_numbers(const rows_of_robot *robot, const number *numbers)
{
    numbers_of_robot r;
    r.friction = numbers;
    r.restitution = r.friction + robot->contacts;
    r.offsets = r.restitution + robot->contacts;
    r.line_stiffness = r.offsets + robot->contacts + robot->ropes;
    r.rest_lengths = r.line_stiffness + robot->cables;
    r.line_damping = r.rest_lengths + robot->cables;
    r.preload = r.line_damping + robot->cables;
    r.on_cables = r.preload + robot->cables;
    r.limits = r.on_cables + robot->cables * robot->motors;
    r.coulomb = r.limits + robot->stops;
    r.damping = r.coulomb + robot->dry;
    r.stiffness = r.damping + robot->implicit;
    r.least_gaps = r.stiffness + robot->implicit;
    return r;
}

/* The next numbers of a workspace. */
INLINED number *next_numbers(number **work, int count)
{
    number *first = *work;
    *work += count;
    return first;
}

/* Rate of row i, J_i v. */
INLINED number rate_of(const beginning *b, const number *v, int i)
{
    const rows_of_robot *robot = b->robot;
    const int row = robot->impulse_row[i];
    number sum = 0;
    for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
        sum += b->entries[a] * v[robot->row_column[a]];
    return robot->impulse_sign[i] * sum;
}

/* --- rates without the impulses ----------------------------------------------------------------- */

/* A = M, its upper triangle, and momentum = M va_0 + h f. */
INLINED void set_inertia(const beginning *b, number *A, int wide, number *momentum)
{
    const int n = b->robot->n;
    const number *va = b->va;
    memset(A, 0, n * wide * sizeof(number));
    for (int i = 0, at = b->robot->at_inertia; i < n; i++)
        for (int j = i; j < n; j++)
            A[i * wide + j] = b->terms[at++];
    for (int i = 0; i < n; i++)
        momentum[i] = b->h * b->terms[b->robot->at_forces + i];
    for (int i = 0; i < n; i++) {
        momentum[i] += A[i * wide + i] * va[i];
        for (int j = i + 1; j < n; j++) {
            momentum[i] += A[i * wide + j] * va[j];
            momentum[j] += A[i * wide + j] * va[i];
        }
    }
}

/* Efforts of the motors at q, with those of their stiffness. */
INLINED void set_efforts(const beginning *b, number *effort)
{
    const number *stiffness = b->numbers.stiffness + first_motor(b->robot);
    const number *position = b->terms + b->robot->at_positions;
    for (int i = 0; i < b->robot->motors; i++)
        effort[i] = b->tau[i] - stiffness[i] * (position[i] - b->held[i]);
}

/* Add h D + h^2 K to A, and the impulses of the motors to the momentum. */
INLINED void add_implicit_forces(
    const beginning *b, const number *effort, number *A, int wide, number *momentum)
{
    const rows_of_robot *robot = b->robot;
    const number h = b->h;
    for (int i = 0; i < robot->implicit; i++) {
        const int row = robot->implicit_row[i], motor = i - first_motor(robot);
        const int *column = robot->row_column;
        const number factor = h * b->numbers.damping[i] + h * h * b->numbers.stiffness[i];
        for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++) {
            if (motor >= 0)
                momentum[column[a]] += h * effort[motor] * b->entries[a];
            if (factor != 0)
                for (int c = a; c < robot->row_start[row + 1]; c++)
                    A[column[a] * wide + column[c]] += factor * b->entries[a] * b->entries[c];
        }
    }
}

/* --- rows --------------------------------------------------------------------------------------- */

/* Cables. With the rate l_dot of its length and soft = damping + h stiffness, a cable has the tension
 *
 *     x / h = tension + soft l_dot,
 *
 * or none where this is negative. So its row has the rate w = -l_dot - tension / soft + x / (h soft).
 * Gains of a motor on a cable add to its stiffness and damping. A cable without both has no row: its
 * tension is constant, its impulse is put in its bound and added to the momentum. */
INLINED void set_cables(
    const beginning *b, const number *effort, const rows_of_step *rows, number *momentum)
{
    const rows_of_robot *robot = b->robot;
    const numbers_of_robot *numbers = &b->numbers;
    for (int k = 0; k < robot->cables; k++) {
        const number stretch = b->terms[robot->at_lengths + k] - numbers->rest_lengths[k];
        const number *push = numbers->on_cables + k * robot->motors;
        number tension = numbers->preload[k] + numbers->line_stiffness[k] * stretch;
        number stiffness = numbers->line_stiffness[k], damping = numbers->line_damping[k];
        for (int j = 0; j < robot->motors; j++) {
            const int motor = first_motor(robot) + j;
            tension -= push[j] * effort[j];
            stiffness += push[j] * push[j] * numbers->stiffness[motor];
            damping += push[j] * push[j] * numbers->damping[motor];
        }
        const int i = first_cable(robot) + k, row = robot->impulse_row[i];
        if (stiffness + damping > 0) {
            const number soft = damping + b->h * stiffness;
            rows->bias[i] = -tension / soft;
            rows->compliance[i] = 1 / (b->h * soft);
            continue;
        }
        rows->state[i] = NEVER_ACTS;
        rows->bounds[i] = tension > 0 ? b->h * tension : 0;
        for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
            momentum[robot->row_column[a]] += rows->bounds[i] * b->entries[a];
    }
}

/* Contacts. One that hits its ground with restitution e leaves it with e times its rate before. */
INLINED void set_contacts(const beginning *b, const number *free_rates, const rows_of_step *rows)
{
    for (int k = 0; k < b->robot->contacts; k++) {
        const int normal = 3 * k + 2;
        const number gap = b->terms[b->robot->at_gaps + k] - b->numbers.offsets[k];
        rows->bias[normal] = gap / b->h;
        rows->bounds[normal] = b->numbers.friction[k];
        const number restitution = b->numbers.restitution[k];
        if (restitution > 0) {
            const number before = rate_of(b, b->va, normal), ahead = rate_of(b, free_rates, normal);
            if (before < 0 && gap + b->h * (before < ahead ? before : ahead) <= 0)
                rows->bias[normal] = restitution * before;
        }
    }
}

INLINED void set_ropes_and_stops(const beginning *b, const rows_of_step *rows)
{
    const rows_of_robot *robot = b->robot;
    for (int k = 0; k < robot->ropes; k++) {
        const int gap = robot->contacts + k;
        rows->bias[first_rope(robot) + k] =
            (b->terms[robot->at_gaps + gap] - b->numbers.offsets[gap]) / b->h;
    }
    for (int k = 0; k < robot->stops; k++) {
        const int i = first_stop(robot) + k;
        const number beyond = b->q[robot->stop_position[k]] - b->numbers.limits[k];
        rows->bias[i] = robot->impulse_sign[i] * beyond / b->h;
    }
}

/* Dry friction always acts, if there is any. */
INLINED void set_dry_friction(const beginning *b, const rows_of_step *rows)
{
    for (int k = 0; k < b->robot->dry; k++) {
        const int i = first_dry(b->robot) + k;
        rows->bounds[i] = b->h * b->numbers.coulomb[k];
        rows->state[i] = rows->bounds[i] > 0 ? ACTS : NEVER_ACTS;
    }
}

/* Whether row i, that of a gap, is more than rounding. */
INLINED int can_move(const beginning *b, int i, int gap)
{
    const rows_of_robot *robot = b->robot;
    const int row = robot->impulse_row[i];
    const number least = HELD_BY_LOOPS * robot->gap_scale[gap];
    for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
        if (MAGNITUDE(b->entries[a]) * robot->coordinate_scale[robot->row_column[a]] > least)
            return 1;
    return 0;
}

/* Let contacts, ropes and stops never act whose gaps the loops hold. */
INLINED void drop_held_by_loops(const beginning *b, const rows_of_step *rows)
{
    const rows_of_robot *robot = b->robot;
    int gap = 0;
    for (int k = 0; k < robot->contacts; k++, gap++)
        if (!can_move(b, 3 * k + 2, gap))
            rows->state[3 * k] = rows->state[3 * k + 1] = rows->state[3 * k + 2] = NEVER_ACTS;
    for (int k = 0; k < robot->ropes; k++, gap++)
        if (!can_move(b, first_rope(robot) + k, gap))
            rows->state[first_rope(robot) + k] = NEVER_ACTS;
    for (int k = 0; k < robot->stops; k++, gap++)
        if (!can_move(b, first_stop(robot) + k, gap))
            rows->state[first_stop(robot) + k] = NEVER_ACTS;
}

/* --- rows that act ------------------------------------------------------------------------------ */

/* Let the rows act that these rates violate. Returns whether there are any. */
INLINED int add_violated(const beginning *b, const rows_of_step *rows, const number *rates)
{
    int any = 0;
    for (int i = 0; i < first_dry(b->robot); i++) {
        const int kind = kind_of(b->robot, i);
        if (kind == SIDE || rows->state[i] != MAY_ACT || !(rate_of(b, rates, i) + rows->bias[i] < 0))
            continue;
        any = 1;
        rows->state[i] = ACTS;
        if (kind == NORMAL)
            rows->state[i - 1] = rows->state[i - 2] = ACTS;
    }
    return any;
}

/* List the rows that act; returns their number. */
INLINED int list_acting(const rows_of_robot *robot, const rows_of_step *rows, acting_rows *acting)
{
    int count = 0;
    for (int i = 0; i < robot->m; i++)
        if (rows->state[i] == ACTS) {
            acting->kinds[count] = kind_of(robot, i);
            acting->index[count++] = i;
        }
    acting->count = count;
    acting->wide = FILLED(count);
    return count;
}

/* Z, from the factors of A. */
INLINED void set_Z(const beginning *b, const number *A, int wide, const acting_rows *acting)
{
    const rows_of_robot *robot = b->robot;
    memset(acting->Z, 0, robot->n * acting->wide * sizeof(number));
    for (int k = 0; k < acting->count; k++) {
        const int i = acting->index[k], row = robot->impulse_row[i];
        for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
            acting->Z[robot->row_column[a] * acting->wide + k] = robot->impulse_sign[i] * b->entries[a];
    }
    solve_many(A, acting->Z, robot->n, wide, acting->wide);
}

/* Units from the diagonal of J A^-1 J^T + compliance; the three rows of a contact have one unit, so
 * that the cone of friction stays round. No impulse can change a row with a diagonal entry of zero: it
 * never acts from now on. Returns whether there is such a row. */
INLINED int set_units(const beginning *b, const rows_of_step *rows, const acting_rows *acting)
{
    const int count = acting->count;
    number *size = acting->unit;
    int any = 0;
    for (int k = 0; k < count; k++)
        size[k] = rows->compliance[acting->index[k]];
    for (int j = 0; j < b->robot->n; j++) {
        const number *z = acting->Z + j * acting->wide;
        for (int k = 0; k < count; k++)
            size[k] += z[k] * z[k];
    }
    for (int k = 0; k < count; k++) {
        const int is_normal = acting->kinds[k] == NORMAL, i = acting->index[k];
        if (acting->kinds[k] != SIDE && !(size[k] > 0)) {
            any = 1;
            rows->state[i] = NEVER_ACTS;
            if (is_normal)
                rows->state[i - 1] = rows->state[i - 2] = NEVER_ACTS;
        }
        if (is_normal) {
            const number larger = size[k - 1] > size[k - 2] ? size[k - 1] : size[k - 2];
            size[k] = size[k] > larger ? size[k] : larger;
            size[k - 1] = size[k - 2] = size[k];
        }
    }
    for (int k = 0; k < count; k++)
        acting->unit[k] = ROOT(size[k]);
    return any;
}

/* The problem w = G x + u of the rows, in their units; the solver starts from the impulses `start`. */
INLINED void set_problem(const beginning *b, const rows_of_step *rows, const number *free_rates,
    const number *start, const acting_rows *acting)
{
    const int count = acting->count, wide = acting->wide;
    number *G = acting->G;
    for (int k = 0; k < count; k++) {
        const int i = acting->index[k];
        const number unit = acting->unit[k], inverse = 1 / unit;
        acting->u[k] = (rate_of(b, free_rates, i) + rows->bias[i]) / unit;
        acting->bounds[k] = acting->kinds[k] == DRY ? rows->bounds[i] * unit : rows->bounds[i];
        acting->x[k] = start[i] * unit;
        for (int j = 0; j < b->robot->n; j++)
            acting->Z[j * wide + k] *= inverse;
    }
    memset(G, 0, count * wide * sizeof(number));
    for (int j = 0; j < b->robot->n; j++) {
        const number *z = acting->Z + j * wide;
        for (int k = 0; k < count; k++)
            if (z[k] != 0)
                add_row(G + k * wide, z[k], z, 0, wide);
    }
    for (int k = 0; k < count; k++) {
        const number unit = acting->unit[k];
        G[k * wide + k] += rows->compliance[acting->index[k]] / (unit * unit);
    }
}

/* rates = free + A^-1 J^T x = free + U^-1 D^(-1/2) Z x. */
INLINED void set_rates(const beginning *b, const number *A, int wide, const number *free_rates,
    const acting_rows *acting, number *rates)
{
    const int n = b->robot->n;
    for (int j = 0; j < n; j++) {
        const number *z = acting->Z + j * acting->wide;
        rates[j] = 0;
        for (int k = 0; k < acting->count; k++)
            rates[j] += z[k] * acting->x[k];
        rates[j] *= ROOT(A[j * wide + j]); /* 1 / D stands there */
    }
    solve_upper(A, rates, n, wide);
    for (int j = 0; j < n; j++)
        rates[j] += free_rates[j];
}

/* --- the step ----------------------------------------------------------------------------------- */

/* One step of length h from q, at which the kernel has these terms. The rates va become those at the
 * end of the step. The impulses x of the step before, where the solver starts, become those of this
 * step. `residual` gets the error of x, see impulses.h; `series` is the most series of the solver.
 * False if A is not positive definite or a rate is not finite. `work` and `flags` are workspace. */
FAST int nonsmooth_step(const rows_of_robot *robot, const number *terms, const number *q, number *va,
    const number *tau, const number *held, number h, const number *numbers, int series, number *x,
    number *residual, number *work, int *flags)
{
    const int n = robot->n, m = robot->m, wide = FILLED(n), most = FILLED(m);
    beginning b;
    b.robot = robot;
    b.numbers = named_numbers(robot, numbers);
    b.terms = terms;
    b.entries = terms + robot->at_entries;
    b.q = q;
    b.va = va;
    b.tau = tau;
    b.held = held;
    b.h = h;
    number *A = next_numbers(&work, n * wide);
    number *free_rates = next_numbers(&work, wide), *changed_rates = next_numbers(&work, wide);
    rows_of_step rows;
    rows.bias = next_numbers(&work, most);
    rows.compliance = next_numbers(&work, most);
    rows.bounds = next_numbers(&work, most);
    rows.state = flags;
    acting_rows acting;
    acting.Z = next_numbers(&work, n * most);
    acting.G = next_numbers(&work, m * most);
    acting.unit = next_numbers(&work, most);
    acting.u = next_numbers(&work, most);
    acting.bounds = next_numbers(&work, most);
    acting.x = next_numbers(&work, most);
    acting.index = flags + m;
    acting.kinds = flags + 2 * m;
    problem p;
    p.A = acting.G;
    p.u = acting.u;
    p.kinds = acting.kinds;
    p.bounds = acting.bounds;
    p.w = next_numbers(&work, most);
    p.y = next_numbers(&work, most);
    p.F = next_numbers(&work, most);
    p.dx = next_numbers(&work, most);
    p.D = next_numbers(&work, m * most);
    p.right = next_numbers(&work, most);
    p.row = next_numbers(&work, most);
    p.formula = flags + 3 * m;
    p.formula_of_factors = flags + 4 * m;
    number *after_sweeps = next_numbers(&work, most), *near = next_numbers(&work, most);
    number *best = next_numbers(&work, most), *effort = next_numbers(&work, robot->motors);

    for (int i = 0; i < m; i++) {
        rows.state[i] = MAY_ACT;
        rows.bias[i] = rows.compliance[i] = rows.bounds[i] = 0;
    }
    number *momentum = free_rates; /* becomes the free rates */
    set_inertia(&b, A, wide, momentum);
    set_efforts(&b, effort);
    add_implicit_forces(&b, effort, A, wide, momentum);
    set_cables(&b, effort, &rows, momentum);
    if (!factorize(A, n, wide, changed_rates))
        return 0;
    solve_symmetric(A, free_rates, n, wide);

    set_contacts(&b, free_rates, &rows);
    set_ropes_and_stops(&b, &rows);
    set_dry_friction(&b, &rows);
    drop_held_by_loops(&b, &rows);

    /* Solve for the rows that act, and let those act too that the result violates, until there are no
     * more. A row that acts goes on to act, so this ends. */
    const number *rates = free_rates;
    int solved = 0; /* whether `rates` are those after impulses */
    *residual = 0;
    for (;;) {
        const int added = add_violated(&b, &rows, rates);
        const int count = list_acting(robot, &rows, &acting);
        if (!count || (solved && !added))
            break;
        set_Z(&b, A, wide, &acting);
        if (set_units(&b, &rows, &acting)) { /* some cannot be changed: start again without them */
            rates = free_rates;
            solved = 0;
            continue;
        }
        set_problem(&b, &rows, free_rates, x, &acting);
        p.m = count;
        p.wide = acting.wide;
        p.proximal_of_factors = 0;
        *residual = solve_rows(&p, acting.x, series, after_sweeps, near, best);
        set_rates(&b, A, wide, free_rates, &acting, changed_rates);
        rates = changed_rates;
        solved = 1;
        memset(x, 0, m * sizeof(number));
        for (int k = 0; k < count; k++)
            x[acting.index[k]] = acting.x[k] / acting.unit[k];
    }

    if (!solved)
        memset(x, 0, m * sizeof(number));
    for (int i = first_cable(robot); i < first_stop(robot); i++)
        if (rows.state[i] == NEVER_ACTS)
            x[i] = rows.bounds[i]; /* of constant tension */
    number sum = 0;
    for (int i = 0; i < n; i++)
        sum += va[i] = rates[i];
    return IS_FINITE(sum);
}

/* Whether no contact, rope or stop is violated more than a motion may start with, `times` as much. */
FAST int starts_free(const rows_of_robot *robot, const number *terms, const number *q,
    const number *numbers, number times)
{
    const numbers_of_robot r = named_numbers(robot, numbers);
    const number *least = r.least_gaps;
    for (int k = 0; k < robot->contacts + robot->ropes; k++)
        if (!(terms[robot->at_gaps + k] - r.offsets[k] >= times * *least++))
            return 0;
    for (int k = 0; k < robot->stops; k++) {
        const number beyond = q[robot->stop_position[k]] - r.limits[k];
        if (!(robot->impulse_sign[first_stop(robot) + k] * beyond >= times * *least++))
            return 0;
    }
    return 1;
}
