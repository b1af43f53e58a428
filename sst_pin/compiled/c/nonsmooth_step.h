/* SPDX-License-Identifier: BSD-2-Clause */
/* One nonsmooth step of one robot, as dynamics/nonsmooth_step.py makes it. It needs impulses.h and
 * dense_solvers.h.
 *
 * A step of length h leads from the rates va_0 of the coordinates to va (Moreau and Jean):
 *
 *     A free = M va_0 + h f,  A = M + h D + h^2 K      free rates: those without the impulses
 *     va = free + A^-1 J^T x                           with the impulses x of the rows J
 *     w = J va + bias + compliance x                   rates of the rows
 *
 * where x and w solve the problem of impulses.h. M is the inertia matrix, f are the forces at q. D
 * and K are the damping and the stiffness of joints, of lines that also push, and of motors: these
 * forces are implicit, which means that they act with the rates va. With the bias gap / h, the gap
 * after the step is h w, which is not negative.
 *
 * The main function, `nonsmooth_step`, is near the end. It computes the free rates, sets the rows
 * of contacts, ropes, cables, stops and dry friction, and solves for the rows that act. */

/* The loops hold a gap if it does not change with the coordinates: if its rate, for a unit rate of
 * each coordinate, is at most this. Rates are free of units, and such a rate is rounding.
 * thresholds.py has the same number. */
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
    int m; /* impulses, in this order: three of each contact, ropes, cables, stops, dry friction */
    int contacts, ropes, cables, stops, dry;
    int implicit; /* implicit forces, in this order: joints, lines that also push, motors */
    /* The terms are the results of a generated kernel at q. Here its parts begin: the upper
     * triangle of M, f, gaps of contacts and ropes, lengths of cables, positions of motors, entries
     * of the sparse matrix below. */
    int at_inertia, at_forces, at_gaps, at_lengths, at_positions, at_entries;
    int outputs, checks; /* number of terms, and of the checks behind them */
    /* A sparse matrix, whose rows are those of J and of implicit forces. Row r has the entries
     * row_start[r] to row_start[r + 1] - 1, in these columns, which ascend. */
    const int *row_start, *row_column;
    const int *impulse_row, *impulse_sign; /* row i of J is this row of the matrix, times 1 or -1 */
    const int *implicit_row;               /* row of the matrix of each implicit force */
    const int *stop_position;              /* index in q of each stop */
    const number *coordinate_scale, *gap_scale; /* the units of coordinates and of gaps */
} robot_tables;

/* Physical parameters of a robot, in the order of `parameter_values` in nonsmooth_motions.py. */
typedef struct {
    const number *friction, *restitution; /* of contacts */
    const number *offsets; /* of contacts and ropes: the gaps are the terms minus these */
    const number *line_stiffness, *rest_lengths, *line_damping, *preload; /* of cables */
    /* shape (cables, motors): the force by which a motor pushes the ends of a cable apart, for a
     * unit of its effort */
    const number *on_cables;
    const number *limits;              /* of stops */
    const number *coulomb;             /* of dry friction */
    const number *damping, *stiffness; /* of implicit forces */
    const number *least_gaps;          /* of contacts, ropes and stops at the start of a motion */
} robot_numbers;

/* The robot at the start of a step. */
typedef struct {
    const robot_tables *robot;
    robot_numbers numbers;
    const number *terms, *entries; /* at q; the entries are the last part of the terms */
    const number *q, *va;
    const number *tau;  /* torques of the motors */
    const number *held; /* positions that the stiffness of the motors holds */
    number h;
} step_start;

/* Whether a row is solved for. */
enum { NEVER_ACTS = -1, MAY_ACT, ACTS };

/* All m rows of a step; numbers that are not set are zero. */
typedef struct {
    int *state;
    number *bias, *compliance;
    number *bounds; /* see impulses.h; of a cable without a row its constant impulse */
} step_rows;

/* The rows that act, as a problem of impulses.h. Rates are divided by the unit of their row and
 * impulses are multiplied by it (`set_units`). Both are then square roots of energies. */
typedef struct {
    int count, wide; /* number of rows; length of the rows of Z and G */
    int *index;      /* of each row among all rows */
    int *kinds;
    /* Z = D^(-1/2) U^(-T) J^T, shape (n, wide), with A = U^T D U: so J A^-1 J^T = Z^T Z. */
    number *Z;
    number *G; /* J A^-1 J^T + compliance, shape (count, wide) */
    number *unit;
    number *u, *bounds, *x;
} acting_rows;

/* The numbers of a step, in memory of the caller. */
typedef struct {
    int wide;  /* length of the rows of A */
    number *A; /* later its factors */
    number *effort, *free_rates, *changed_rates;
    step_rows rows;
    acting_rows acting;
    problem p;
    number *after_sweeps, *near, *best; /* workspace of `solve_rows` */
} step_workspace;

/* --- rows and gaps ---------------------------------------------------------------------------- */

INLINED int first_rope(const robot_tables *robot)
{
    return 3 * robot->contacts;
}

INLINED int first_cable(const robot_tables *robot)
{
    return first_rope(robot) + robot->ropes;
}

INLINED int first_stop(const robot_tables *robot)
{
    return first_cable(robot) + robot->cables;
}

INLINED int first_dry(const robot_tables *robot)
{
    return first_stop(robot) + robot->stops;
}

/* The first motor among the implicit forces. */
INLINED int first_motor(const robot_tables *robot)
{
    return robot->implicit - robot->motors;
}

/* The kind of row i, see impulses.h. */
INLINED int kind_of(const robot_tables *robot, int i)
{
    if (i >= first_dry(robot))
        return DRY;
    if (i >= first_rope(robot))
        return STOP; /* ropes, cables and stops */
    return i % 3 == 2 ? NORMAL : SIDE;
}

/* Gaps are those of contacts, then ropes, then stops. */
INLINED int gap_count(const robot_tables *robot)
{
    return robot->contacts + robot->ropes + robot->stops;
}

/* The row of gap k; of a contact the normal row. */
INLINED int row_of_gap(const robot_tables *robot, int k)
{
    const int contacts = robot->contacts, ropes = robot->ropes;
    if (k < contacts)
        return 3 * k + 2;
    if (k < contacts + ropes)
        return first_rope(robot) + k - contacts;
    return first_stop(robot) + k - contacts - ropes;
}

/* Gap k; it is negative if the contact, rope or stop is violated. */
INLINED number gap_of(const robot_tables *robot, const robot_numbers *numbers, const number *terms,
    const number *q, int k)
{
    const int stop = k - robot->contacts - robot->ropes;
    if (stop < 0)
        return terms[robot->at_gaps + k] - numbers->offsets[k];
    const number beyond = q[robot->stop_position[stop]] - numbers->limits[stop];
    return robot->impulse_sign[first_stop(robot) + stop] * beyond;
}

/* Rate of row i, J_i v. */
INLINED number rate_of(const step_start *b, const number *v, int i)
{
    const robot_tables *robot = b->robot;
    const int row = robot->impulse_row[i];
    number sum = 0;
    for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
        sum += b->entries[a] * v[robot->row_column[a]];
    return robot->impulse_sign[i] * sum;
}

/* Set the state of row i; with a normal row, also those of the sides of its contact. */
INLINED void set_state(const robot_tables *robot, const step_rows *rows, int i, int state)
{
    rows->state[i] = state;
    if (kind_of(robot, i) == NORMAL)
        rows->state[i - 1] = rows->state[i - 2] = state;
}

INLINED robot_numbers named_numbers(const robot_tables *robot, const number *numbers)
{
    robot_numbers r;
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

/* --- workspace -------------------------------------------------------------------------------- */

/* Lengths of the arrays `work` and `flags` of `nonsmooth_step`; `laid_out` divides them. */
#define WORKSPACE(n, m, motors) ((n) * FILLED(n) + 2 * FILLED(n) + (n) * FILLED(m) \
    + 2 * (m) * FILLED(m) + 16 * FILLED(m) + (motors))
#define FLAGS(m) (5 * (m) + 1) /* 1, as an array must not be empty */

/* The next numbers of an array. */
INLINED number *next_numbers(number **work, int count)
{
    number *first = *work;
    *work += count;
    return first;
}

INLINED step_workspace laid_out(const robot_tables *robot, number *work, int *flags)
{
    const int n = robot->n, m = robot->m, most = FILLED(m);
    step_workspace s;
    s.wide = FILLED(n);
    s.A = next_numbers(&work, n * s.wide);
    s.free_rates = next_numbers(&work, s.wide);
    s.changed_rates = next_numbers(&work, s.wide);

    s.rows.bias = next_numbers(&work, most);
    s.rows.compliance = next_numbers(&work, most);
    s.rows.bounds = next_numbers(&work, most);
    s.rows.state = flags;

    s.acting.Z = next_numbers(&work, n * most);
    s.acting.G = next_numbers(&work, m * most);
    s.acting.unit = next_numbers(&work, most);
    s.acting.u = next_numbers(&work, most);
    s.acting.bounds = next_numbers(&work, most);
    s.acting.x = next_numbers(&work, most);
    s.acting.index = flags + m;
    s.acting.kinds = flags + 2 * m;

    s.p.A = s.acting.G;
    s.p.u = s.acting.u;
    s.p.kinds = s.acting.kinds;
    s.p.bounds = s.acting.bounds;
    s.p.w = next_numbers(&work, most);
    s.p.y = next_numbers(&work, most);
    s.p.F = next_numbers(&work, most);
    s.p.dx = next_numbers(&work, most);
    s.p.D = next_numbers(&work, m * most);
    s.p.right = next_numbers(&work, most);
    s.p.row = next_numbers(&work, most);
    s.p.formula = flags + 3 * m;
    s.p.formula_of_factors = flags + 4 * m;

    s.after_sweeps = next_numbers(&work, most);
    s.near = next_numbers(&work, most);
    s.best = next_numbers(&work, most);
    s.effort = next_numbers(&work, robot->motors);
    return s;
}

/* --- rates without the impulses --------------------------------------------------------------- */

/* A = M, its upper triangle, and momentum = M va_0 + h f. */
INLINED void set_inertia(const step_start *b, number *A, int wide, number *momentum)
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

/* Efforts of the motors at q: their torques, and those of their stiffness. */
INLINED void set_efforts(const step_start *b, number *effort)
{
    const number *stiffness = b->numbers.stiffness + first_motor(b->robot);
    const number *position = b->terms + b->robot->at_positions;
    for (int i = 0; i < b->robot->motors; i++)
        effort[i] = b->tau[i] - stiffness[i] * (position[i] - b->held[i]);
}

/* Add h D + h^2 K to A, and the impulses of the motors to the momentum. Cables have no part in the
 * rows of motors, which are empty if a motor drives cables alone: `set_cables` adds these efforts
 * and gains. */
INLINED void add_implicit_forces(
    const step_start *b, const number *effort, number *A, int wide, number *momentum)
{
    const robot_tables *robot = b->robot;
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

/* Set the rows of cables. J va is the rate at which a cable shortens, -l_dot of its length. With
 * its tension at the start of the step and soft = damping + h stiffness, the tension at the end is
 *
 *     x / h = tension + soft l_dot,
 *
 * or zero where this is negative. The row is therefore w = J va - tension / soft + x / (h soft): it
 * is zero in a taut cable, and positive in a slack one, whose x is zero. Gains of a motor on a
 * cable add to its stiffness and damping. A cable with neither has a constant tension and no row:
 * its impulse is added to the momentum, and kept in its bound. */
INLINED void set_cables(
    const step_start *b, const number *effort, const step_rows *rows, number *momentum)
{
    const robot_tables *robot = b->robot;
    const robot_numbers *numbers = &b->numbers;
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
        } else {
            rows->state[i] = NEVER_ACTS;
            rows->bounds[i] = tension > 0 ? b->h * tension : 0;
            for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
                momentum[robot->row_column[a]] += rows->bounds[i] * b->entries[a];
        }
    }
}

/* --- rows of gaps and dry friction ------------------------------------------------------------ */

/* Set the rows of contacts. A contact that hits its ground with restitution e leaves it with e
 * times the rate before. It hits the ground if it approaches it, and if its rate before the step or
 * its free rate leads to the ground in this step. */
INLINED void set_contacts(const step_start *b, const number *free_rates, const step_rows *rows)
{
    for (int k = 0; k < b->robot->contacts; k++) {
        const int normal = row_of_gap(b->robot, k);
        const number gap = gap_of(b->robot, &b->numbers, b->terms, b->q, k);
        rows->bias[normal] = gap / b->h;
        rows->bounds[normal] = b->numbers.friction[k];
        const number restitution = b->numbers.restitution[k];
        if (restitution > 0) {
            const number before = rate_of(b, b->va, normal), ahead = rate_of(b, free_rates, normal);
            const number lower = before < ahead ? before : ahead;
            if (before < 0 && gap + b->h * lower <= 0)
                rows->bias[normal] = restitution * before;
        }
    }
}

INLINED void set_ropes_and_stops(const step_start *b, const step_rows *rows)
{
    for (int k = b->robot->contacts; k < gap_count(b->robot); k++)
        rows->bias[row_of_gap(b->robot, k)] =
            gap_of(b->robot, &b->numbers, b->terms, b->q, k) / b->h;
}

/* Dry friction always acts, if there is any. */
INLINED void set_dry_friction(const step_start *b, const step_rows *rows)
{
    for (int k = 0; k < b->robot->dry; k++) {
        const int i = first_dry(b->robot) + k;
        rows->bounds[i] = b->h * b->numbers.coulomb[k];
        rows->state[i] = rows->bounds[i] > 0 ? ACTS : NEVER_ACTS;
    }
}

/* Whether gap k can change: its row is larger than rounding. */
INLINED int can_change(const step_start *b, int k)
{
    const robot_tables *robot = b->robot;
    const int row = robot->impulse_row[row_of_gap(robot, k)];
    const number least = HELD_BY_LOOPS * robot->gap_scale[k];
    for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++)
        if (MAGNITUDE(b->entries[a]) * robot->coordinate_scale[robot->row_column[a]] > least)
            return 1;
    return 0;
}

/* Contacts, ropes and stops whose gaps the loops hold never act. */
INLINED void drop_held_by_loops(const step_start *b, const step_rows *rows)
{
    for (int k = 0; k < gap_count(b->robot); k++)
        if (!can_change(b, k))
            set_state(b->robot, rows, row_of_gap(b->robot, k), NEVER_ACTS);
}

/* --- rows that act ---------------------------------------------------------------------------- */

/* Let the rows act that these rates violate. Returns whether there are new ones. */
INLINED int add_violated(const step_start *b, const step_rows *rows, const number *rates)
{
    int any = 0;
    for (int i = 0; i < first_dry(b->robot); i++) {
        /* the sides of a contact follow its normal row */
        if (kind_of(b->robot, i) == SIDE || rows->state[i] != MAY_ACT)
            continue;
        if (rate_of(b, rates, i) + rows->bias[i] < 0) {
            any = 1;
            set_state(b->robot, rows, i, ACTS);
        }
    }
    return any;
}

/* List the rows that act; returns their number. */
INLINED int list_acting(const robot_tables *robot, const step_rows *rows, acting_rows *acting)
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

/* Set Z, from the factors of A. */
INLINED void set_Z(const step_start *b, const number *A, int wide, const acting_rows *acting)
{
    const robot_tables *robot = b->robot;
    memset(acting->Z, 0, robot->n * acting->wide * sizeof(number));
    for (int k = 0; k < acting->count; k++) { /* Z = J^T */
        const int i = acting->index[k], row = robot->impulse_row[i];
        for (int a = robot->row_start[row]; a < robot->row_start[row + 1]; a++) {
            number *z = acting->Z + robot->row_column[a] * acting->wide;
            z[k] = robot->impulse_sign[i] * b->entries[a];
        }
    }
    solve_many(A, acting->Z, robot->n, wide, acting->wide);
}

/* Set the unit of each row: the square root of its entry on the diagonal of J A^-1 J^T
 * + compliance. Divided by the units, the diagonal is at most 1. The three rows of a contact have
 * one unit, the largest of the three, so that the cone of friction stays round.
 *
 * If the entry is zero, no impulse can change the rate of the row. Such a row never acts from now
 * on. Returns whether there is one. */
INLINED int set_units(const step_start *b, const step_rows *rows, const acting_rows *acting)
{
    const int count = acting->count;
    number *size = acting->unit; /* the diagonal: squares of the units, until the last loop */
    int any = 0;
    /* row k has the diagonal entry compliance + |column k of Z|^2, because J A^-1 J^T = Z^T Z */
    for (int k = 0; k < count; k++)
        size[k] = rows->compliance[acting->index[k]];
    for (int j = 0; j < b->robot->n; j++) {
        const number *z = acting->Z + j * acting->wide;
        for (int k = 0; k < count; k++)
            size[k] += z[k] * z[k];
    }
    for (int k = 0; k < count; k++) {
        if (acting->kinds[k] != SIDE && !(size[k] > 0)) {
            any = 1;
            set_state(b->robot, rows, acting->index[k], NEVER_ACTS);
        }
        if (acting->kinds[k] == NORMAL) { /* its two sides stand before it */
            const number larger = size[k - 1] > size[k - 2] ? size[k - 1] : size[k - 2];
            size[k] = size[k] > larger ? size[k] : larger;
            size[k - 1] = size[k - 2] = size[k];
        }
    }
    for (int k = 0; k < count; k++)
        acting->unit[k] = ROOT(size[k]);
    return any;
}

/* Set the problem w = G x + u of the rows, in their units. The solver starts from the impulses
 * `start`. A bound of dry friction is an impulse; a bound of a contact, mu, has no unit. */
INLINED void set_problem(const step_start *b, const step_rows *rows, const number *free_rates,
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
    for (int j = 0; j < b->robot->n; j++) { /* G = Z^T Z */
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

/* rates = free + A^-1 J^T x = free + U^-1 D^(-1/2) Z x. Here x and the columns of Z are those of
 * the scaled problem (`acting->unit`): the units cancel in Z x. */
INLINED void set_rates(const step_start *b, const number *A, int wide, const number *free_rates,
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

/* --- the step --------------------------------------------------------------------------------- */

/* Set the factors of A, the free rates and the rows of cables. False if A is not positive
 * definite. */
INLINED int set_free_rates(const step_start *b, const step_workspace *s)
{
    number *momentum = s->free_rates; /* becomes the free rates */
    set_inertia(b, s->A, s->wide, momentum);
    set_efforts(b, s->effort);
    add_implicit_forces(b, s->effort, s->A, s->wide, momentum);
    set_cables(b, s->effort, &s->rows, momentum);
    /* `changed_rates` is workspace here */
    if (!factorize(s->A, b->robot->n, s->wide, s->changed_rates))
        return 0;
    solve_symmetric(s->A, momentum, b->robot->n, s->wide);
    return 1;
}

/* One step of length h from q. `terms` are the results of the kernel at q. va are the rates at the
 * start, and become the rates at the end of the step. x are the impulses of the step before, from
 * which the solver starts, and become the impulses of this step. `residual` gets the error of x.
 * `series` is the largest number of series of the solver; see impulses.h. `work` and `flags` are
 * workspace. False if A is not positive definite or a rate is not finite. */
FAST int nonsmooth_step(const robot_tables *robot, const number *terms, const number *q, number *va,
    const number *tau, const number *held, number h, const number *numbers, int series, number *x,
    number *residual, number *work, int *flags)
{
    const int n = robot->n, m = robot->m;
    step_start b;
    b.robot = robot;
    b.numbers = named_numbers(robot, numbers);
    b.terms = terms;
    b.entries = terms + robot->at_entries;
    b.q = q;
    b.va = va;
    b.tau = tau;
    b.held = held;
    b.h = h;

    step_workspace s = laid_out(robot, work, flags);
    for (int i = 0; i < m; i++) {
        s.rows.state[i] = MAY_ACT;
        s.rows.bias[i] = s.rows.compliance[i] = s.rows.bounds[i] = 0;
    }
    if (!set_free_rates(&b, &s))
        return 0;
    set_contacts(&b, s.free_rates, &s.rows);
    set_ropes_and_stops(&b, &s.rows);
    set_dry_friction(&b, &s.rows);
    drop_held_by_loops(&b, &s.rows);

    /* Solve for the rows that act. Rows that the result violates act from then on. Solve again,
     * until there are no more such rows. A row that acts continues to act, so this ends. */
    const number *rates = s.free_rates;
    int solved = 0; /* whether `rates` are those after impulses */
    *residual = 0;
    for (;;) {
        const int any_new = add_violated(&b, &s.rows, rates);
        const int count = list_acting(robot, &s.rows, &s.acting);
        if (!count || (solved && !any_new))
            break;
        set_Z(&b, s.A, s.wide, &s.acting);
        if (set_units(&b, &s.rows, &s.acting)) {
            /* impulses cannot change some of the rows: start again without these */
            rates = s.free_rates;
            solved = 0;
            continue;
        }
        set_problem(&b, &s.rows, s.free_rates, x, &s.acting);
        s.p.m = count;
        s.p.wide = s.acting.wide;
        s.p.proximal_of_factors = 0;
        *residual = solve_rows(&s.p, s.acting.x, series, s.after_sweeps, s.near, s.best);
        set_rates(&b, s.A, s.wide, s.free_rates, &s.acting, s.changed_rates);
        rates = s.changed_rates;
        solved = 1;
        memset(x, 0, m * sizeof(number));
        for (int k = 0; k < count; k++)
            x[s.acting.index[k]] = s.acting.x[k] / s.acting.unit[k];
    }

    if (!solved)
        memset(x, 0, m * sizeof(number));
    for (int i = first_cable(robot); i < first_stop(robot); i++)
        if (s.rows.state[i] == NEVER_ACTS) /* a cable of constant tension */
            x[i] = s.rows.bounds[i];
    number sum = 0; /* not finite if a rate is not */
    for (int i = 0; i < n; i++) {
        va[i] = rates[i];
        sum += rates[i];
    }
    return IS_FINITE(sum);
}

/* Whether a motion may start at q: each gap is at least `factor` times its least gap. Least gaps
 * are negative, so that a small violation is allowed. */
FAST int may_start(const robot_tables *robot, const number *terms, const number *q,
    const number *numbers, number factor)
{
    const robot_numbers named = named_numbers(robot, numbers);
    for (int k = 0; k < gap_count(robot); k++)
        if (!(gap_of(robot, &named, terms, q, k) >= factor * named.least_gaps[k])) /* NaN too */
            return 0;
    return 1;
}
