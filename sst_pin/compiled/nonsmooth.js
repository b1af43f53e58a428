// SPDX-License-Identifier: BSD-2-Clause
// Steps of a page with contacts, ropes, cables, stops and dry friction, as `dynamics/nonsmooth_step.py`
// and `dynamics/impulses.py` make them; those files say why.
// `elements` are the numbers of the rows, in the order contacts (three rows each), ropes, cables,
// stops, dry joints; `rise` is the largest speed that lifts what starts below its ground, [m/s].
function nonsmooth(elements, rise) {
  "use strict";
  const STOP = 0, DRY = 1, SIDE = 2, NORMAL = 3;
  const SOLVED = 1e-9, ROUNDING = 1e-11, LARGEST = 1e3; // of the error of x = P(x - w)
  const SWEEPS = 10, STEPS = 20, WARM_STEPS = 6, SERIES = 12, REFINED = 3;
  const PROXIMAL = [1e-6, 1e-8, 1e-3, 1e-7, 1e-5, 1e-2];
  const LEAST_PIVOT = 1e-12;
  const HELD_BY_LOOPS = 1e-10; // as in thresholds.py
  const { contacts, ropes, cables, stops, dry, damping, stiffness, gap_scale } = elements;
  const firstRope = 3 * contacts.length, firstCable = firstRope + ropes.length;
  const firstStop = firstCable + cables.length, firstDry = firstStop + stops.length, m = firstDry + dry.length;
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
  // A problem has A, u, the kinds of its rows and their bounds.

  function projected({ kind, bounds }, y) {
    const x = y.map((each, i) => kind[i] === DRY ? clipped(each, bounds[i]) : Math.max(each, 0));
    kind.forEach((each, i) => {
      if (each !== NORMAL) return;
      const most = bounds[i] * x[i], side = Math.hypot(y[i - 2], y[i - 1]), factor = side > most ? most / side : 1;
      x[i - 2] = factor * y[i - 2];
      x[i - 1] = factor * y[i - 1];
    });
    return x;
  }

  // Rows of dF, F = x - P(x - w), from dF = 1 - S + S A + proximal S with the derivative S of P.
  function slopes({ A, kind, bounds }, y, proximal) {
    const D = y.map((_, i) => { const row = new Float64Array(y.length); row[i] = 1; return row; });
    const add = (i, j, slope) => { // S[i][j]
      const row = D[i], from = A[j];
      for (let k = 0; k < row.length; k++) row[k] += slope * from[k];
      row[j] += slope * (proximal - 1);
    };
    kind.forEach((each, i) => {
      if (each === STOP && y[i] > 0) add(i, i, 1);
      if (each === DRY && Math.abs(y[i]) <= bounds[i]) add(i, i, 1);
      if (each !== NORMAL || !(y[i] > 0)) return;
      add(i, i, 1);
      const side = Math.hypot(y[i - 2], y[i - 1]), most = bounds[i] * y[i], slips = side > most;
      for (const a of [i - 2, i - 1]) {
        if (!slips) { add(a, a, 1); continue; }
        for (const b of [i - 2, i - 1]) add(a, b, most / side * (Number(a === b) - y[a] * y[b] / side ** 2));
        add(a, i, bounds[i] * y[a] / side);
      }
    });
    return D;
  }

  // The best of some steps of Newton's method from x, and its residual.
  function newton(problem, x, proximal, steps) {
    const { A, u } = problem, rates = LARGEST * largestOf(u);
    let best = x, least = Infinity;
    for (let step = 0; step < steps; step++) {
      const y = x.map((each, i) => each - dot(A[i], x) - u[i]), P = projected(problem, y), F = x.map((each, i) => each - P[i]);
      const error = F.some(Number.isNaN) ? Infinity : largestOf(F) && largestOf(F) / Math.min(largestOf(x), rates);
      if (!(error < least) && least < SOLVED) break;
      if (error < least) [best, least] = [x, error];
      if (least < ROUNDING) break;
      const change = solved(slopes(problem, y, proximal), F);
      if (!change?.every(Number.isFinite)) break;
      x = x.map((each, i) => each - change[i]);
    }
    return [best, least];
  }

  // One sweep of projected Gauss-Seidel; the sides of a contact follow its normal row.
  function swept({ A, u, kind, bounds }, start) {
    const x = start.slice(), rate = (i) => dot(A[i], x) + u[i];
    kind.forEach((each, i) => {
      if (each === SIDE) return;
      x[i] -= rate(i) / A[i][i];
      x[i] = each === DRY ? clipped(x[i], bounds[i]) : Math.max(x[i], 0);
      if (each !== NORMAL) return;
      const trace = A[i - 2][i - 2] + A[i - 1][i - 1], sides = trace > 0 ? [i - 2, i - 1].map((a) => x[a] - rate(a) / trace) : [0, 0];
      const side = Math.hypot(...sides), most = bounds[i] * x[i], factor = side > most ? most / side : 1;
      [x[i - 2], x[i - 1]] = [factor * sides[0], factor * sides[1]];
    });
    return x;
  }

  function solution(problem, start) {
    let [best, least] = newton(problem, start, PROXIMAL[0], WARM_STEPS), alone = start;
    for (let series = 0; series < SERIES && !(least < ROUNDING || (least < SOLVED && series >= REFINED)); series++) {
      const fromSweeps = series % 3 === 0; // every third series starts from the sweeps alone, which go on
      let x = fromSweeps ? alone : best;
      for (let k = 0; k < (fromSweeps ? SWEEPS * (1 + series) : SWEEPS); k++) x = swept(problem, x);
      if (fromSweeps) alone = x;
      const [near, error] = newton(problem, x, PROXIMAL[series % PROXIMAL.length], STEPS);
      if (error < least) [best, least] = [near, error];
    }
    return [best, least];
  }

  // --- a step --------------------------------------------------------------------------------

  // Matrices of the terms y at a configuration; `layout` says where they are.
  function read(layout, y) {
    const { n, places, row_start, row_column } = layout, M = Array.from({ length: n }, () => new Float64Array(n));
    for (let i = 0, at = places.inertia; i < n; i++) for (let j = i; j < n; j++) M[i][j] = M[j][i] = y[at++];
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

  // Rates of the coordinates after a step of length h, impulses x and their residual; null if the
  // inertia is not positive definite. `efforts` are those of the motors at the start of the step,
  // `gains` their stiffness and damping, `limits` those of the stops, `start` impulses near x.
  function step({ M, forces, gaps, lengths, J, implicit, scale }, { q, va, efforts, gains, limits, h, start }) {
    // Inertia and momentum, with damping and stiffness at the end of the step.
    const motors = efforts.length, first = implicit.length - motors;
    const soft = [...damping, ...gains.damping], hard = [...stiffness, ...gains.stiffness];
    const A = M.map((row) => Float64Array.from(row)), momentum = M.map((row, i) => dot(row, va) + h * forces[i]);
    implicit.forEach((row, k) => {
      if (k >= first) row.forEach((x, i) => { momentum[i] += h * efforts[k - first] * x; });
      const factor = h * soft[k] + h * h * hard[k];
      if (factor) row.forEach((x, i) => { if (x) row.forEach((z, j) => { A[i][j] += factor * x * z; }); });
    });

    // Cables: w = J va + bias + compliance x; one of constant tension is a force.
    const acting = new Array(m).fill(0), bias = new Float64Array(m), compliance = new Float64Array(m), bounds = new Float64Array(m);
    cables.forEach((cable, k) => {
      const i = firstCable + k, tension = cable.preload + cable.stiffness * (lengths[k] - cable.rest) - dot(cable.shares, efforts);
      const yielding = cable.damping + h * cable.stiffness;
      if (yielding > 0) {
        bias[i] = -tension / yielding;
        compliance[i] = 1 / (h * yielding);
        return;
      }
      acting[i] = -1; // never a row
      bounds[i] = h * Math.max(tension, 0);
      J[i].forEach((x, a) => { momentum[a] += bounds[i] * x; });
    });
    const G = cholesky(A);
    if (!G) return null;
    const free = backward(G, forward(G, momentum)), Z = J.map((row) => forward(G, row));

    contacts.forEach(({ friction, restitution, radius }, k) => {
      const i = 3 * k + 2, gap = gaps[k] - radius, before = dot(J[i], va), ahead = Math.min(before, dot(J[i], free));
      const hits = restitution > 0 && before < 0 && gap + h * ahead <= 0;
      bias[i] = hits ? restitution * before : Math.max(gap / h, -rise);
      bounds[i] = friction;
    });
    ropes.forEach((length, k) => { bias[firstRope + k] = Math.max((gaps[contacts.length + k] + length) / h, -rise); });
    stops.forEach(({ position, side }, k) => { bias[firstStop + k] = side * (q[position] - limits[k]) / h; });
    dry.forEach((force, k) => {
      bounds[firstDry + k] = h * force;
      acting[firstDry + k] = force > 0 ? 1 : -1;
    });

    // Contacts, ropes and stops that the loops hold never act: what they have on the coordinates is rounding.
    const gapRows = [...contacts.map((_, k) => 3 * k + 2), ...ropes.map((_, k) => firstRope + k), ...stops.map((_, k) => firstStop + k)];
    gapRows.forEach((i, k) => {
      if (J[i].some((x, a) => Math.abs(x) * scale[a] > HELD_BY_LOOPS * gap_scale[k])) return;
      acting[i] = -1;
    });

    // Rows that act, until the others are not violated.
    let rates = free, x = new Float64Array(m), residual = 0, solvedOnce = false;
    for (;;) {
      let more = false;
      for (let i = 0; i < firstDry; i++) {
        if (kinds[i] === SIDE || acting[i] !== 0 || !(dot(J[i], rates) + bias[i] < 0)) continue;
        if (!(dot(Z[i], Z[i]) + compliance[i] > 0)) continue; // it cannot be changed
        more = true;
        acting[i] = 1;
        if (kinds[i] === NORMAL) acting[i - 1] = acting[i - 2] = 1;
      }
      const index = kinds.map((_, i) => i).filter((i) => acting[i] === 1 && (kinds[i] !== DRY || dot(Z[i], Z[i]) > 0));
      if (!more && (solvedOnce || !index.length)) break;
      solvedOnce = true;
      // Rows are divided by the square roots of their diagonal entries; a contact has one unit.
      const size = index.map((i) => dot(Z[i], Z[i]) + compliance[i]);
      index.forEach((i, a) => { if (kinds[i] === NORMAL) size[a] = size[a - 1] = size[a - 2] = Math.max(size[a], size[a - 1], size[a - 2]); });
      const units = size.map(Math.sqrt), kind = index.map((i) => kinds[i]);
      const problem = {
        A: index.map((i, a) => Float64Array.from(index, (j, b) => (dot(Z[i], Z[j]) + (a === b ? compliance[i] : 0)) / (units[a] * units[b]))),
        u: index.map((i, a) => (dot(J[i], free) + bias[i]) / units[a]),
        kind,
        bounds: index.map((i, a) => kind[a] === DRY ? bounds[i] * units[a] : bounds[i]),
      };
      const [found, error] = solution(problem, index.map((i, a) => start[i] * units[a])), change = new Float64Array(free.length);
      residual = error;
      x = new Float64Array(m);
      index.forEach((i, a) => {
        x[i] = found[a] / units[a];
        Z[i].forEach((z, k) => { change[k] += x[i] * z; });
      });
      rates = backward(G, change).map((each, k) => each + free[k]);
    }
    cables.forEach((_, k) => { if (acting[firstCable + k] < 0) x[firstCable + k] = bounds[firstCable + k]; });
    return { rates, x, residual };
  }

  return { read, step, SOLVED, none: () => new Float64Array(m) };
}
