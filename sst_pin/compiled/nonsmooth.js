// SPDX-License-Identifier: BSD-2-Clause
// Steps of a page with contacts, ropes, cables, stops and dry friction. c/nonsmooth_step.h and
// c/impulses.h make the same steps and explain them:
//
//     A free = M va_0 + h f,  A = M + h D + h^2 K      rates without the impulses
//     va = free + A^-1 J^T x                           with the impulses x of the rows J
//     w = J va + bias + compliance x                   rates of the rows
//     x = P(x - w)                                     complementarity and Coulomb's friction
//
// Three things differ from the C: a contact or rope that starts violated is lifted slowly (`rise`)
// instead of refused; cables get no gains of motors; and Newton's matrix is always solved with
// pivots.
//
// `elements` are the parameters of the rows, in the order contacts (three rows each), ropes,
// cables, stops, dry joints and lines. `rise` is the largest speed that lifts what starts below its
// ground, [m/s]. The result has `read`, which makes matrices of a kernel's results, and `step`, the
// main function.
function nonsmooth(elements, rise) {
  "use strict";
  const STOP = 0, DRY = 1, SIDE = 2, NORMAL = 3; // kinds of rows
  const NEVER_ACTS = -1, MAY_ACT = 0, ACTS = 1; // whether a row is solved for
  const SOLVED = 1e-9; // largest error of x = P(x - w) in a solution, relative to the impulses
  const ROUNDING = 1e-11; // with a smaller error a solution cannot become better
  const LARGEST = 1e3; // the error is relative to at most this multiple of the rates
  const SERIES = 12; // the most series, as in Warp: sweeps, then steps of Newton's method
  const SWEEPS = 10, STEPS = 20; // in a series
  const WARM_STEPS = 6; // Newton's steps from the impulses of the step before, without sweeps
  const REFINED = 3; // series that improve a solution which is not exact to rounding
  const PROXIMAL = [1e-6, 1e-8, 1e-3, 1e-7, 1e-5, 1e-2]; // terms of the series in turn
  const LEAST_PIVOT = 1e-12; // pivots of the inertia below this part of its diagonal are rounding
  const HELD_BY_LOOPS = 1e-10; // as in thresholds.py
  const { contacts, ropes, cables, stops, dry, damping, stiffness, gap_scale } = elements;
  const firstRope = 3 * contacts.length, firstCable = firstRope + ropes.length;
  const firstStop = firstCable + cables.length, firstDry = firstStop + stops.length;
  const m = firstDry + dry.length;
  const kinds = Array.from({ length: m }, (_, i) => {
    if (i >= firstDry) return DRY;
    if (i >= firstRope) return STOP;
    return i % 3 === 2 ? NORMAL : SIDE;
  });
  const dot = (a, b) => {
    let sum = 0;
    for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
    return sum;
  };
  const clipped = (x, most) => Math.min(Math.max(x, -most), most);
  const largestOf = (x) => x.reduce((most, each) => Math.max(most, Math.abs(each)), 0);

  // --- linear algebra ------------------------------------------------------------------------

  // The lower triangle G with A = G G^T; null if a pivot is rounding.
  function cholesky(A) {
    const n = A.length, G = A.map((row) => Float64Array.from(row));
    for (let i = 0; i < n; i++) {
      for (let j = 0; j <= i; j++) {
        let sum = A[i][j];
        for (let k = 0; k < j; k++) sum -= G[i][k] * G[j][k];
        if (i !== j) G[i][j] = sum / G[j][j];
        else if (sum > LEAST_PIVOT * A[i][i]) G[i][i] = Math.sqrt(sum);
        else return null;
      }
    }
    return G;
  }

  // Solve G z = b.
  function forward(G, b) {
    const z = Float64Array.from(b);
    for (let i = 0; i < z.length; i++) {
      for (let k = 0; k < i; k++) z[i] -= G[i][k] * z[k];
      z[i] /= G[i][i];
    }
    return z;
  }

  // Solve G^T x = b.
  function backward(G, b) {
    const x = Float64Array.from(b);
    for (let i = x.length - 1; i >= 0; i--) {
      x[i] /= G[i][i];
      for (let k = 0; k < i; k++) x[k] -= G[i][k] * x[i];
    }
    return x;
  }

  // Solve D x = b by elimination with pivots, in place; null if D is singular.
  function solved(D, b) {
    const n = b.length;
    for (let k = 0; k < n; k++) {
      let pivot = k;
      for (let i = k + 1; i < n; i++) if (Math.abs(D[i][k]) > Math.abs(D[pivot][k])) pivot = i;
      if (!(Math.abs(D[pivot][k]) > 0)) return null;
      [D[k], D[pivot]] = [D[pivot], D[k]];
      [b[k], b[pivot]] = [b[pivot], b[k]];
      for (let i = k + 1; i < n; i++) {
        const factor = D[i][k] / D[k][k];
        if (factor === 0) continue;
        for (let j = k; j < n; j++) D[i][j] -= factor * D[k][j];
        b[i] -= factor * b[k];
      }
    }
    for (let i = n - 1; i >= 0; i--) {
      for (let j = i + 1; j < n; j++) b[i] -= D[i][j] * b[j];
      b[i] /= D[i][i];
    }
    return b;
  }

  // --- x = P(x - w), w = A x + u -------------------------------------------------------------
  // A problem has A, u, the `kind` of each row, and its `bounds`: the largest impulse of a DRY row,
  // the coefficient of friction at a NORMAL row. The rows of a contact are SIDE, SIDE, NORMAL.

  // P(y): y cut off at the bounds, and the sides of a contact at the circle of its friction.
  function projected({ kind, bounds }, y) {
    const x = y.map((each, i) => kind[i] === DRY ? clipped(each, bounds[i]) : Math.max(each, 0));
    kind.forEach((each, i) => {
      if (each !== NORMAL) return; // sides are set with their normal row
      const radius = bounds[i] * x[i], length = Math.hypot(y[i - 2], y[i - 1]);
      const factor = length > radius ? radius / length : 1;
      x[i - 2] = factor * y[i - 2];
      x[i - 1] = factor * y[i - 1];
    });
    return x;
  }

  // Newton's matrix of F = x - P(y), y = x - A x - u. With S = dP / dy and dy = dx - A dx it is
  // 1 - S + S A, to which proximal S is added. Most entries of S are zero: the others are added one
  // by one.
  function newtonMatrix({ A, kind, bounds }, y, proximal) {
    const D = y.map((_, i) => { const row = new Float64Array(y.length); row[i] = 1; return row; });
    // Add the part of S_ij to row i: S_ij times row j of A + (proximal - 1) 1.
    const addSlope = (i, j, slope) => {
      const row = D[i], from = A[j];
      for (let k = 0; k < row.length; k++) row[k] += slope * from[k];
      row[j] += slope * (proximal - 1);
    };
    kind.forEach((each, i) => {
      const isInside = each === DRY ? Math.abs(y[i]) <= bounds[i] : y[i] > 0;
      if (each === SIDE || !isInside) return;
      addSlope(i, i, 1);
      if (each !== NORMAL) return;
      const sides = [i - 2, i - 1], radius = bounds[i] * y[i];
      const length = Math.hypot(y[i - 2], y[i - 1]);
      for (const a of sides) {
        if (!(length > radius)) {
          addSlope(a, a, 1);
          continue;
        }
        // It slides: P_a = radius y_a / length.
        for (const b of sides) {
          const delta = Number(a === b);
          addSlope(a, b, radius / length * (delta - y[a] * y[b] / length ** 2));
        }
        addSlope(a, i, bounds[i] * y[a] / length);
      }
    });
    return D;
  }

  // The largest entry of F = x - P(x - w), relative to the impulses; 0 where all are 0.
  function errorOf(F, x, u) {
    if (F.some(Number.isNaN)) return Infinity;
    const largest = largestOf(F);
    if (largest === 0) return 0;
    return largest / Math.min(largestOf(x), LARGEST * largestOf(u));
  }

  // The best x of some steps of Newton's method, and its residual.
  function newton(problem, x, proximal, steps) {
    const { A, u } = problem;
    let best = x, least = Infinity;
    for (let step = 0; step < steps; step++) {
      const y = x.map((each, i) => each - dot(A[i], x) - u[i]); // x - w
      const P = projected(problem, y), F = x.map((each, i) => each - P[i]);
      const error = errorOf(F, x, u);
      if (!(error < least) && least < SOLVED) break; // a solution that does not become better
      if (error < least) [best, least] = [x, error];
      if (least < ROUNDING) break;
      const change = solved(newtonMatrix(problem, y, proximal), F);
      if (!change?.every(Number.isFinite)) break;
      x = x.map((each, i) => each - change[i]);
    }
    return [best, least];
  }

  // One sweep of projected Gauss-Seidel: each row in turn is solved alone, the sides of a contact
  // after its normal row. Both sides have one divisor, the trace of their block of A: it is not
  // less than the eigenvalues of the block.
  function swept({ A, u, kind, bounds }, start) {
    const x = start.slice(), rate = (i) => dot(A[i], x) + u[i];
    kind.forEach((each, i) => {
      if (each === SIDE) return;
      x[i] -= rate(i) / A[i][i];
      x[i] = each === DRY ? clipped(x[i], bounds[i]) : Math.max(x[i], 0);
      if (each !== NORMAL) return;
      const trace = A[i - 2][i - 2] + A[i - 1][i - 1];
      const sides = trace > 0 ? [i - 2, i - 1].map((a) => x[a] - rate(a) / trace) : [0, 0];
      const length = Math.hypot(...sides), radius = bounds[i] * x[i];
      const factor = length > radius ? radius / length : 1;
      [x[i - 2], x[i - 1]] = [factor * sides[0], factor * sides[1]];
    });
    return x;
  }

  // The solution near a start, and its residual. Every third series continues the sweeps of the
  // third series before, as if there had been no Newton's steps in between; the other series start
  // from the best impulses.
  function solution(problem, start) {
    let [best, least] = newton(problem, start, PROXIMAL[0], WARM_STEPS);
    let afterSweeps = start;
    for (let series = 0; series < SERIES; series++) {
      if (least < ROUNDING || (least < SOLVED && series >= REFINED)) break;
      const fromSweeps = series % 3 === 0;
      const sweeps = fromSweeps ? SWEEPS * (1 + series) : SWEEPS;
      let x = fromSweeps ? afterSweeps : best;
      for (let k = 0; k < sweeps; k++) x = swept(problem, x);
      if (fromSweeps) afterSweeps = x;
      const [near, error] = newton(problem, x, PROXIMAL[series % PROXIMAL.length], STEPS);
      if (error < least) [best, least] = [near, error];
    }
    return [best, least];
  }

  // --- a step --------------------------------------------------------------------------------

  // The terms of a step, from the results y of a kernel; `layout` says where they are in y.
  function read(layout, y) {
    const { n, places, row_start, row_column } = layout;
    const M = Array.from({ length: n }, () => new Float64Array(n));
    let at = places.inertia; // the upper triangle, row by row
    for (let i = 0; i < n; i++) for (let j = i; j < n; j++) M[i][j] = M[j][i] = y[at++];
    const rows = row_start.slice(1).map((end, k) => {
      const row = new Float64Array(n);
      for (let i = row_start[k]; i < end; i++) row[row_column[i]] = y[places.entries + i];
      return row;
    });
    return {
      M, // inertia
      forces: y.slice(places.forces, places.forces + n),
      gaps: y.slice(places.gaps, places.gaps + contacts.length + ropes.length),
      lengths: y.slice(places.lengths, places.lengths + cables.length),
      J: layout.impulse_row.map((row, i) => rows[row].map((x) => layout.impulse_sign[i] * x)),
      implicit: layout.implicit_row.map((row) => rows[row]), // joints, lines that also push, motors
      scale: layout.coordinate_scale,
    };
  }

  // The inertia A = M + h D + h^2 K, and the momentum M va_0 + h f with the efforts of the motors
  // in f. The rows `implicit` are those of dampers and springs; motors are the last ones.
  function withImplicitForces({ M, forces, implicit }, { va, efforts, gains, h }) {
    const firstMotor = implicit.length - efforts.length;
    const allDamping = [...damping, ...gains.damping];
    const allStiffness = [...stiffness, ...gains.stiffness];
    const inertia = M.map((row) => Float64Array.from(row));
    const momentum = M.map((row, i) => dot(row, va) + h * forces[i]);
    implicit.forEach((row, k) => {
      if (k >= firstMotor) {
        row.forEach((x, i) => { momentum[i] += h * efforts[k - firstMotor] * x; });
      }
      const factor = h * allDamping[k] + h * h * allStiffness[k];
      if (!factor) return;
      row.forEach((x, i) => {
        if (x) row.forEach((z, j) => { inertia[i][j] += factor * x * z; });
      });
    });
    return { inertia, momentum };
  }

  // All rows of a step, w = J va + bias + compliance x. Numbers that are not set are zero.
  function newRows() {
    return {
      state: new Array(m).fill(MAY_ACT),
      bias: new Float64Array(m),
      compliance: new Float64Array(m),
      bounds: new Float64Array(m),
    };
  }

  // Set the rows of cables. With the rate l_dot of its length, a cable has the tension
  //
  //     x / h = tension + soft l_dot,  soft = damping + h stiffness,
  //
  // or none if this is negative. A cable of constant tension has no row: its impulse is added to
  // the momentum, and kept in its bound.
  function setCables(rows, momentum, { lengths, J }, { efforts, h }) {
    cables.forEach((cable, k) => {
      const i = firstCable + k;
      const spring = cable.preload + cable.stiffness * (lengths[k] - cable.rest);
      const tension = spring - dot(cable.shares, efforts);
      const soft = cable.damping + h * cable.stiffness;
      if (soft > 0) {
        rows.bias[i] = -tension / soft;
        rows.compliance[i] = 1 / (h * soft);
        return;
      }
      rows.state[i] = NEVER_ACTS;
      rows.bounds[i] = h * Math.max(tension, 0);
      J[i].forEach((x, a) => { momentum[a] += rows.bounds[i] * x; });
    });
  }

  // Set the rows of contacts, ropes, stops and dry friction. `free` are the rates without impulses.
  // A contact that hits its ground leaves it with the restitution times the rate before.
  function setOtherRows(rows, free, { gaps, J }, { q, va, limits, h }) {
    contacts.forEach(({ friction, restitution, radius }, k) => {
      const i = 3 * k + 2, gap = gaps[k] - radius;
      const before = dot(J[i], va), ahead = Math.min(before, dot(J[i], free));
      const hits = restitution > 0 && before < 0 && gap + h * ahead <= 0;
      rows.bias[i] = hits ? restitution * before : Math.max(gap / h, -rise);
      rows.bounds[i] = friction;
    });
    ropes.forEach((length, k) => {
      rows.bias[firstRope + k] = Math.max((gaps[contacts.length + k] + length) / h, -rise);
    });
    stops.forEach(({ position, side }, k) => {
      rows.bias[firstStop + k] = side * (q[position] - limits[k]) / h;
    });
    dry.forEach((force, k) => {
      rows.bounds[firstDry + k] = h * force;
      rows.state[firstDry + k] = force > 0 ? ACTS : NEVER_ACTS;
    });
  }

  // The problem of the rows `index`. Row a of the problem is row i = index[a] of all. Rows are
  // divided by the square roots of their diagonal entries, the `units`; the three rows of a contact
  // have one unit, so that the cone of friction stays round.
  function problemOf(index, rows, free, J, Z) {
    const size = index.map((i) => dot(Z[i], Z[i]) + rows.compliance[i]);
    index.forEach((i, a) => {
      if (kinds[i] !== NORMAL) return;
      size[a] = size[a - 1] = size[a - 2] = Math.max(size[a], size[a - 1], size[a - 2]);
    });
    const units = size.map(Math.sqrt), kind = index.map((i) => kinds[i]);
    const entry = (i, a, j, b) => {
      const compliance = a === b ? rows.compliance[i] : 0;
      return (dot(Z[i], Z[j]) + compliance) / (units[a] * units[b]);
    };
    const problem = {
      A: index.map((i, a) => Float64Array.from(index, (j, b) => entry(i, a, j, b))),
      u: index.map((i, a) => (dot(J[i], free) + rows.bias[i]) / units[a]),
      kind,
      bounds: index.map((i, a) => kind[a] === DRY ? rows.bounds[i] * units[a] : rows.bounds[i]),
    };
    return { problem, units };
  }

  // Contacts, ropes and stops whose gaps the loops hold never act: their rows are rounding.
  function dropHeldByLoops(state, { J, scale }) {
    const gapRows = [
      ...contacts.map((_, k) => 3 * k + 2),
      ...ropes.map((_, k) => firstRope + k),
      ...stops.map((_, k) => firstStop + k),
    ];
    gapRows.forEach((i, k) => {
      const least = HELD_BY_LOOPS * gap_scale[k];
      if (!J[i].some((x, a) => Math.abs(x) * scale[a] > least)) state[i] = NEVER_ACTS;
    });
  }

  // One step: rates of the coordinates after it, impulses x, and their residual; null if the
  // inertia is not positive definite. `terms` are from `read`. `start` is the state { q, va,
  // efforts, gains, limits, h, impulses } at the start: `efforts` of the motors, `gains` their
  // stiffness and damping, `limits` of the stops, `h` the length of the step, `impulses` near x.
  function step(terms, start) {
    const { J } = terms;
    const { inertia, momentum } = withImplicitForces(terms, start);
    const rows = newRows();
    setCables(rows, momentum, terms, start);
    const G = cholesky(inertia);
    if (!G) return null;
    const free = backward(G, forward(G, momentum));
    const Z = J.map((row) => forward(G, row)); // J inertia^-1 J^T = Z Z^T
    setOtherRows(rows, free, terms, start);
    dropHeldByLoops(rows.state, terms);

    // Solve for the rows that act. Then let those act too that the result violates, and solve
    // again, until there are no more.
    const { state, bias, compliance } = rows;
    const canChange = (i) => dot(Z[i], Z[i]) + compliance[i] > 0; // by its impulse
    const isViolated = (i, rates) => dot(J[i], rates) + bias[i] < 0;
    kinds.forEach((kind, i) => { if (kind === DRY && !canChange(i)) state[i] = NEVER_ACTS; });
    let rates = free, x = new Float64Array(m), residual = 0, isSolved = false;
    for (;;) {
      let anyNew = false;
      for (let i = 0; i < firstDry; i++) {
        if (kinds[i] === SIDE || state[i] !== MAY_ACT) continue; // sides follow their normal row
        if (!isViolated(i, rates) || !canChange(i)) continue;
        anyNew = true;
        state[i] = ACTS;
        if (kinds[i] === NORMAL) state[i - 1] = state[i - 2] = ACTS;
      }
      const index = kinds.map((_, i) => i).filter((i) => state[i] === ACTS);
      if (!index.length || (isSolved && !anyNew)) break;
      isSolved = true;
      const { problem, units } = problemOf(index, rows, free, J, Z);
      const near = index.map((i, a) => start.impulses[i] * units[a]);
      const [impulses, error] = solution(problem, near);
      residual = error;
      x = new Float64Array(m);
      const change = new Float64Array(free.length); // Z^T x
      index.forEach((i, a) => {
        x[i] = impulses[a] / units[a];
        Z[i].forEach((z, k) => { change[k] += x[i] * z; });
      });
      rates = backward(G, change).map((each, k) => each + free[k]);
    }
    cables.forEach((_, k) => { // those of constant tension
      const i = firstCable + k;
      if (state[i] === NEVER_ACTS) x[i] = rows.bounds[i];
    });
    return { rates, x, residual };
  }

  return { read, step, SOLVED, none: () => new Float64Array(m) };
}
