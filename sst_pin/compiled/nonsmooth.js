// SPDX-License-Identifier: BSD-2-Clause
// Steps of a page with contacts, ropes, cables, stops and dry friction, as c/nonsmooth_step.h and
// c/impulses.h make them, which state the equations:
//
//     A free = M va_0 + h f,  A = M + h D + h^2 K      rates without the impulses
//     va = free + A^-1 J^T x                           with the impulses x of the rows J
//     w = J va + bias + compliance x                   rates of the rows
//     x = P(x - w)                                     complementarity and Coulomb's friction
//
// Three things differ from the C: a contact or rope that starts violated is lifted slowly (`rise`)
// instead of refused; cables get no gains of motors; and Newton's matrix is always solved with pivots.
//
// `elements` are the numbers of the rows, in the order contacts (three rows each), ropes, cables, stops,
// dry joints and lines; `rise` is the largest speed that lifts what starts below its ground, [m/s].
function nonsmooth(elements, rise) {
  "use strict";
  const STOP = 0, DRY = 1, SIDE = 2, NORMAL = 3; // kinds of rows
  const SOLVED = 1e-9; // largest error of x = P(x - w) in a solution, relative to the impulses
  const ROUNDING = 1e-11; // Newton's method goes on to this error
  const LARGEST = 1e3; // larger impulses count as this multiple of the rates in the error
  const SERIES = 12; // the most series, as in Warp: sweeps, then steps of Newton's method
  const SWEEPS = 10, STEPS = 20; // in a series
  const WARM_STEPS = 6; // Newton's steps from the impulses of the step before, without sweeps
  const REFINED = 3; // series that improve a solution which is not exact to rounding
  const PROXIMAL = [1e-6, 1e-8, 1e-3, 1e-7, 1e-5, 1e-2]; // terms of the series in turn
  const LEAST_PIVOT = 1e-12; // smaller pivots of the inertia are rounding, relative to its diagonal
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
  const dot = (a, b) => { let sum = 0; for (let i = 0; i < a.length; i++) sum += a[i] * b[i]; return sum; };
  const clipped = (x, most) => Math.min(Math.max(x, -most), most);
  const largestOf = (x) => x.reduce((most, each) => Math.max(most, Math.abs(each)), 0);

  // --- linear algebra ------------------------------------------------------------------------

  // A = G G^T, lower triangle; null if a pivot is rounding.
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

  function forward(G, b) { // G z = b
    const z = Float64Array.from(b);
    for (let i = 0; i < z.length; i++) {
      for (let k = 0; k < i; k++) z[i] -= G[i][k] * z[k];
      z[i] /= G[i][i];
    }
    return z;
  }

  function backward(G, b) { // G^T x = b
    const x = Float64Array.from(b);
    for (let i = x.length - 1; i >= 0; i--) {
      x[i] /= G[i][i];
      for (let k = 0; k < i; k++) x[k] -= G[i][k] * x[i];
    }
    return x;
  }

  // D x = b by elimination with pivots, in place; null if D is singular.
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
  // A problem has A, u, the kinds of its rows and their bounds: the largest impulse of a DRY row, the
  // coefficient of friction at a NORMAL row. The rows of a contact are SIDE, SIDE, NORMAL.

  // P(y) puts y into the bounds, and the sides of a contact into the circle of its friction.
  function projected({ kind, bounds }, y) {
    const x = y.map((each, i) => kind[i] === DRY ? clipped(each, bounds[i]) : Math.max(each, 0));
    kind.forEach((each, i) => {
      if (each !== NORMAL) return;
      const most = bounds[i] * x[i], side = Math.hypot(y[i - 2], y[i - 1]);
      const factor = side > most ? most / side : 1;
      x[i - 2] = factor * y[i - 2];
      x[i - 1] = factor * y[i - 1];
    });
    return x;
  }

  // Newton's matrix of F = x - P(y) at y = x - w: with S = dP / dy and dy = dx - A dx it is
  // 1 - S + S A + proximal S. Entries of S that are not zero are added one by one.
  function newtonMatrix({ A, kind, bounds }, y, proximal) {
    const D = y.map((_, i) => { const row = new Float64Array(y.length); row[i] = 1; return row; });
    const addSlope = (i, j, slope) => { // S[i][j]
      const row = D[i], from = A[j];
      for (let k = 0; k < row.length; k++) row[k] += slope * from[k];
      row[j] += slope * (proximal - 1);
    };
    kind.forEach((each, i) => {
      const isInside = each === DRY ? Math.abs(y[i]) <= bounds[i] : y[i] > 0;
      if (each === SIDE || !isInside) return;
      addSlope(i, i, 1);
      if (each !== NORMAL) return;
      const sides = [i - 2, i - 1], side = Math.hypot(y[i - 2], y[i - 1]), most = bounds[i] * y[i];
      for (const a of sides) {
        if (!(side > most)) {
          addSlope(a, a, 1);
          continue;
        }
        // It slides: P is `most` along the direction of the sides.
        for (const b of sides) addSlope(a, b, most / side * (Number(a === b) - y[a] * y[b] / side ** 2));
        addSlope(a, i, bounds[i] * y[a] / side);
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

  // The best of some steps of Newton's method from x, and its residual.
  function newton(problem, x, proximal, steps) {
    const { A, u } = problem;
    let best = x, least = Infinity;
    for (let step = 0; step < steps; step++) {
      const y = x.map((each, i) => each - dot(A[i], x) - u[i]); // x - w
      const P = projected(problem, y), F = x.map((each, i) => each - P[i]);
      const error = errorOf(F, x, u);
      if (!(error < least) && least < SOLVED) break;
      if (error < least) [best, least] = [x, error];
      if (least < ROUNDING) break;
      const change = solved(newtonMatrix(problem, y, proximal), F);
      if (!change?.every(Number.isFinite)) break;
      x = x.map((each, i) => each - change[i]);
    }
    return [best, least];
  }

  // One sweep of projected Gauss-Seidel: each row in turn is solved alone. The sides of a contact follow
  // its normal row; their divisor, the trace, is not less than the eigenvalues of their block of A.
  function swept({ A, u, kind, bounds }, start) {
    const x = start.slice(), rate = (i) => dot(A[i], x) + u[i];
    kind.forEach((each, i) => {
      if (each === SIDE) return;
      x[i] -= rate(i) / A[i][i];
      x[i] = each === DRY ? clipped(x[i], bounds[i]) : Math.max(x[i], 0);
      if (each !== NORMAL) return;
      const trace = A[i - 2][i - 2] + A[i - 1][i - 1];
      const sides = trace > 0 ? [i - 2, i - 1].map((a) => x[a] - rate(a) / trace) : [0, 0];
      const side = Math.hypot(...sides), most = bounds[i] * x[i];
      const factor = side > most ? most / side : 1;
      [x[i - 2], x[i - 1]] = [factor * sides[0], factor * sides[1]];
    });
    return x;
  }

  // The solution near a start, and its residual. Every third series of Newton's steps starts from the
  // sweeps alone, which go on; the others start from the best impulses.
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

  // Matrices of the terms y at a configuration; `layout` says where they are.
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
      M,
      forces: y.slice(places.forces, places.forces + n),
      gaps: y.slice(places.gaps, places.gaps + contacts.length + ropes.length),
      lengths: y.slice(places.lengths, places.lengths + cables.length),
      J: layout.impulse_row.map((row, i) => rows[row].map((x) => layout.impulse_sign[i] * x)),
      implicit: layout.implicit_row.map((row) => rows[row]),
      scale: layout.coordinate_scale,
    };
  }

  // A = M + h D + h^2 K, which is the inertia, and the momentum M va_0 + h f, with the efforts of the motors
  // in f. `implicit` are the rows of dampers and springs: joints, lines that also push, motors.
  function withImplicitForces({ M, forces, implicit }, { va, efforts, gains, h }) {
    const firstMotor = implicit.length - efforts.length;
    const allDamping = [...damping, ...gains.damping], allStiffness = [...stiffness, ...gains.stiffness];
    const inertia = M.map((row) => Float64Array.from(row));
    const momentum = M.map((row, i) => dot(row, va) + h * forces[i]);
    implicit.forEach((row, k) => {
      if (k >= firstMotor) row.forEach((x, i) => { momentum[i] += h * efforts[k - firstMotor] * x; });
      const factor = h * allDamping[k] + h * h * allStiffness[k];
      if (!factor) return;
      row.forEach((x, i) => {
        if (x) row.forEach((z, j) => { inertia[i][j] += factor * x * z; });
      });
    });
    return { inertia, momentum };
  }

  // All rows with w = J va + bias + compliance x. `acting` is 1 for a row that acts, 0 for one that may,
  // -1 for one that never does.
  function newRows() {
    return {
      acting: new Array(m).fill(0),
      bias: new Float64Array(m),
      compliance: new Float64Array(m),
      bounds: new Float64Array(m),
    };
  }

  // Set the rows of cables. With the rate l_dot of its length, a cable has the tension x / h = tension +
  // yielding l_dot, or none. One of constant tension is no row but a force: its impulse is its bound, and
  // the momentum changes by it.
  function setCables(rows, momentum, { lengths, J }, { efforts, h }) {
    cables.forEach((cable, k) => {
      const i = firstCable + k;
      const tension = cable.preload + cable.stiffness * (lengths[k] - cable.rest) - dot(cable.shares, efforts);
      const yielding = cable.damping + h * cable.stiffness;
      if (yielding > 0) {
        rows.bias[i] = -tension / yielding;
        rows.compliance[i] = 1 / (h * yielding);
        return;
      }
      rows.acting[i] = -1;
      rows.bounds[i] = h * Math.max(tension, 0);
      J[i].forEach((x, a) => { momentum[a] += rows.bounds[i] * x; });
    });
  }

  // Set the rows of contacts, ropes, stops and dry friction, for the rates of the free motion.
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
      rows.acting[firstDry + k] = force > 0 ? 1 : -1;
    });
  }

  // The problem of the rows `index`. Rows are divided by the square roots of their diagonal entries, the
  // `units`; a contact has one unit.
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

  // Contacts, ropes and stops that the loops hold never act: what they have on the coordinates is rounding.
  function dropHeldByLoops(acting, { J, scale }) {
    const gapRows = [
      ...contacts.map((_, k) => 3 * k + 2),
      ...ropes.map((_, k) => firstRope + k),
      ...stops.map((_, k) => firstStop + k),
    ];
    gapRows.forEach((i, k) => {
      if (J[i].some((x, a) => Math.abs(x) * scale[a] > HELD_BY_LOOPS * gap_scale[k])) return;
      acting[i] = -1;
    });
  }

  // Rates of the coordinates after a step, impulses x and their residual; null if the inertia is not
  // positive definite. `terms` are from `read`; of the state, `h` is the length of the step, `efforts` are
  // those of the motors at its start, `gains` their stiffness and damping, `limits` those of the stops,
  // `start` impulses near x.
  function step(terms, state) {
    const { J } = terms, { start } = state;
    const { inertia, momentum } = withImplicitForces(terms, state);
    const rows = newRows();
    setCables(rows, momentum, terms, state);
    const G = cholesky(inertia);
    if (!G) return null;
    const free = backward(G, forward(G, momentum));
    const Z = J.map((row) => forward(G, row)); // J inertia^-1 J^T = Z Z^T
    setOtherRows(rows, free, terms, state);
    dropHeldByLoops(rows.acting, terms);

    // Solve for the rows that act, and let those act too that the result violates, until there are none.
    const { acting, bias, compliance } = rows;
    const canChange = (i) => dot(Z[i], Z[i]) + compliance[i] > 0; // by its impulse
    const isViolated = (i, rates) => dot(J[i], rates) + bias[i] < 0;
    kinds.forEach((kind, i) => { if (kind === DRY && !canChange(i)) acting[i] = -1; });
    let rates = free, x = new Float64Array(m), residual = 0, isSolved = false;
    for (;;) {
      let isNew = false;
      for (let i = 0; i < firstDry; i++) {
        if (kinds[i] === SIDE || acting[i] !== 0 || !isViolated(i, rates) || !canChange(i)) continue;
        isNew = true;
        acting[i] = 1;
        if (kinds[i] === NORMAL) acting[i - 1] = acting[i - 2] = 1;
      }
      const index = kinds.map((_, i) => i).filter((i) => acting[i] === 1);
      if (!index.length || (isSolved && !isNew)) break;
      isSolved = true;
      const { problem, units } = problemOf(index, rows, free, J, Z);
      const [impulses, error] = solution(problem, index.map((i, a) => start[i] * units[a]));
      residual = error;
      x = new Float64Array(m);
      const change = new Float64Array(free.length);
      index.forEach((i, a) => {
        x[i] = impulses[a] / units[a];
        Z[i].forEach((z, k) => { change[k] += x[i] * z; });
      });
      rates = backward(G, change).map((each, k) => each + free[k]);
    }
    cables.forEach((_, k) => {
      if (acting[firstCable + k] < 0) x[firstCable + k] = rows.bounds[firstCable + k];
    });
    return { rates, x, residual };
  }

  return { read, step, SOLVED, none: () => new Float64Array(m) };
}
