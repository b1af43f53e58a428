// SPDX-License-Identifier: BSD-2-Clause
// A robot that moves by its own functions: by hand along its closures, or in time.
// `functions` are those of `page_code`, `d` the numbers of `page_data`.
function engine(functions, d) {
  "use strict";
  const STEP = 0.02, JUMP = 0.1; // of a move; a correction of q that changes the assembly mode
  const CHANGE = 3; // of det Phi_u in a step, which changes its sign at a singularity
  const TOLERANCE = 1e-7, SHORTEST = 1e-7; // of a step, relative; [s]
  const STIFF = 12, PUSH = 0.1; // of "hold" [1/s]; how long a push lasts [s]
  const SPRING = 20, BUFFER = 0.005; // of a stop: its frequency in those of a fall; where it begins before the limit, in parts of the range's unit
  const LONGEST = 5e-3, BEND = 0.25; // of a step with impulses: in times of a fall; its correction that closes the loops, relative
  const RISE = 0.1; // speed that lifts what starts below its ground, in those of a fall
  const WEIGHTS = 20, SETTLING = 0.3; // of "hold" with impulses: stiffness of motors, in weights at the robot's length per rad; damping, in times of a fall
  const SMOOTH = 0.01; // [rad/s] of Coulomb friction without a width, whose jumps stop an integrator
  const zeros = (n) => new Array(n).fill(0), turned = (x) => x - 2 * Math.PI * Math.round(x / (2 * Math.PI));
  const nq = d.q.length, n = d.coordinates.length, motors = d.motors.names.length, rest = zeros(6 * d.bodies.length - 6);

  function bind({ inputs, output, checks, size, room, constants, parts }, width) {
    const x = new Float64Array(inputs.reduce((a, b) => a + b, 0)), p = new Float64Array(size);
    const y = new Float64Array(output + checks), w = new Float64Array(room);
    p.set(functions.numbers);
    if (width && !(p[3] > 0)) p[3] = width;
    constants(p);
    return (...given) => {
      let i = 0;
      for (const array of given) { x.set(array, i); i += array.length; }
      for (const part of parts) part(x, p, y, w);
      return y;
    };
  }
  const all = (kernels) => Object.fromEntries(Object.entries(kernels).map(([name, kernel]) => [name, bind(kernel, name === "state_rate" && SMOOTH)]));
  const F = all(functions.common), sets = functions.sets.map(({ coordinates, parts, layout, kernels }) => (
    { coordinates, parts, layout, ...all(kernels), checked: kernels.closing.output, size: kernels.terms?.output }));
  const own = sets[0];
  const fall = Math.sqrt(d.size / d.fall); // time of a fall by the robot's length [s]
  const impulsive = functions.nonsmooth && nonsmooth(functions.nonsmooth, RISE * d.size / fall);

  // The state, and what acts: how the motors are driven, their efforts, a hand.
  const r = { q: d.q.slice(), va: d.va.slice(), time: 0, way: "none", efforts: zeros(motors), grip: null, contactForces: [] };
  let now, rate_, moved, goal, step; // of a simulation: its set of coordinates, their rates, what the own ones have moved
  const scale = d.coordinates.map((each) => each.scale), largest = (change) => Math.max(0, ...change.map((x, k) => Math.abs(x) / scale[k]));
  const rates = (set, q, va) => set.rates(q, va); // of q, then of all joints

  function reset() {
    Object.assign(r, { q: d.q.slice(), va: d.va.slice(), time: 0, grip: null, efforts: zeros(motors) });
  }

  // --- kinematics ----------------------------------------------------------------------------

  // Newton's method with the coordinates held; null where it finds nothing.
  function closed(x, set = own) {
    for (let k = 0; k < 12; k++) {
      const y = set.closing(x), gap = y[set.checked];
      x = Array.from(y.subarray(0, nq));
      if (!x.every(Number.isFinite)) return null;
      if (gap <= 1) return x; // it was closed before this step
    }
    return null;
  }

  // Condition number of the columns of Phi for the dependent rates: that of the worst of the parts that share no rate.
  function condition(q = r.q, set = own) {
    const Phi = F.loops(q);
    return Math.max(1, ...set.parts.map((part) => conditionOf(Phi, part.rates, part.size)));
  }

  // Condition number of some columns of Phi, by Jacobi's rotations of Phi^T Phi; their norm counts as at least a size.
  function conditionOf(Phi, columns, size = 0) {
    const nv = d.nv, m = columns.length;
    const A = columns.map((i) => columns.map((j) => { let sum = 0; for (let k = 0; k < Phi.length; k += nv) sum += Phi[k + i] * Phi[k + j]; return sum; }));
    for (let sweep = 0, left = 1; sweep < 12 && left; sweep++) {
      left = 0;
      for (let i = 0; i < m; i++) for (let j = i + 1; j < m; j++) {
        if (Math.abs(A[i][j]) <= 1e-15 * Math.sqrt(Math.abs(A[i][i] * A[j][j]))) continue;
        left += 1;
        const t = Math.atan2(2 * A[i][j], A[j][j] - A[i][i]) / 2, c = Math.cos(t), s = Math.sin(t);
        for (const row of A) [row[i], row[j]] = [c * row[i] - s * row[j], s * row[i] + c * row[j]];
        for (let k = 0; k < m; k++) [A[i][k], A[j][k]] = [c * A[i][k] - s * A[j][k], s * A[i][k] + c * A[j][k]];
      }
    }
    const squares = A.map((row, i) => row[i]);
    return Math.sqrt(Math.max(...squares, size * size) / Math.max(Math.min(...squares), 0));
  }
  const near = (x) => `close to a singularity, condition number ${Number(x.toPrecision(3))}`;

  // The name of a joint that a step takes beyond its limits, further than it was.
  function limited(before, after) {
    const beyond = (q, { i, low, high }) => Math.max(low - q[i], q[i] - high, 0);
    return d.bounds.find((bound) => bound.what === "limits" && beyond(after, bound) > beyond(before, bound) + 1e-12)?.name;
  }

  // Move the coordinates in small steps, as far as they lead within one assembly mode and the limits; says what ended it.
  function move(change) {
    const steps = Math.max(1, Math.ceil(largest(change) / STEP)), part = change.map((x) => x / steps);
    for (let k = 0, before = condition(), det = own.closing(r.q)[nq]; k < steps; k++) {
      const ahead = rates(own, r.q, part), guess = r.q.map((x, i) => x + ahead[i]), next = closed(guess);
      if (!next) return "the loops cannot be closed beyond this pose";
      if (next.some((x, i) => Math.abs(x - guess[i]) > JUMP * d.scales[i])) return "the assembly mode ends here";
      const end = limited(r.q, next);
      if (end) return `${end} is at its limit`;
      const after = condition(next), size = own.closing(next)[nq];
      if (!(size / det > 1 / CHANGE) || !(after <= d.condition || after < before)) return near(Math.max(before, after));
      [r.q, before, det] = [next, after, size];
    }
    return "";
  }

  function value(k) { // of a coordinate
    const { kind, i } = d.coordinates[k];
    return kind === "position" ? r.q[i] : kind === "angle" ? Math.atan2(r.q[i + 1], r.q[i]) : 0;
  }

  // A point of a body from `places`, or its velocity from their rates.
  const on = (M, { body, at }) => [0, 1, 2].map((i) => [0, 3, 6].reduce((sum, c, k) => sum + M[12 * body + c + i] * at[k], M[12 * body + 9 + i]));
  const velocity = (grip, q, q_dot) => on(F.flow(q, q_dot), grip);
  const columns = (grip) => r.va.map((_, k) => velocity(grip, r.q, rates(own, r.q, r.va.map((_, j) => Number(j === k))).slice(0, nq)));

  // The smallest change of the coordinates, damped, that brings a point nearer to its target.
  function follow() {
    const at = r.point(r.grip), J = columns(r.grip), damped = (0.05 * d.size) ** 2;
    const A = [0, 1, 2].map((i) => [0, 1, 2].map((j) => J.reduce((sum, c, k) => sum + c[i] * scale[k] ** 2 * c[j], i === j ? damped : 0)));
    const cross = (a, b) => [0, 1, 2].map((i) => a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], b = r.grip.target.map((x, i) => x - at[i]);
    const det = dot(A[0], cross(A[1], A[2])), force = [dot(b, cross(A[1], A[2])), dot(A[0], cross(b, A[2])), dot(A[0], cross(A[1], b))].map((x) => x / det);
    const change = J.map((c, k) => scale[k] ** 2 * dot(c, force)), share = Math.min(1, 0.1 / (largest(change) || 1));
    return move(change.map((x, k) => {
      const { kind, low, high } = d.coordinates[k], is = value(k);
      return kind === "position" ? Math.min(Math.max(is + share * x, Math.min(low, is)), Math.max(high, is)) - is : share * x;
    }));
  }

  // What a pose is that the machine cannot take, and which motors are beyond their largest efforts.
  function wrong(shown, tau) {
    const words = d.bounds.filter(({ i, low, high, what }) => {
      const x = what === "arc" ? (low + high) / 2 + turned(r.q[i] - (low + high) / 2) : r.q[i];
      return x < low || x > high;
    }).map(({ name, unit, i, what, low, high }) => `${name} leaves its ${what} of ${shown(low, unit)} to ${shown(high, unit)}: ${shown(r.q[i], unit)}`);
    const { owners, units, limits } = d.motors, is = condition();
    tau.forEach((x, k) => {
      if (limits[k] !== null && Math.abs(x) > limits[k]) words.push(`${owners[k]} is beyond its effort limit of ${Number(limits[k].toPrecision(3))} ${units[k]}`);
    });
    if (!(is <= d.condition)) words.push(near(is));
    if (r.unsolved) words.push("forces of contacts are not solved to 1e-9");
    if (r.holds && !r.torques(r.q, zeros(n), zeros(n)).every(Number.isFinite)) words.push("the motors do not hold this pose");
    if (!(own.closing(r.q)[own.checked] <= 1)) words.unshift("the loops are open");
    return words;
  }

  // --- dynamics ------------------------------------------------------------------------------

  // Results where the checks behind them hold, else NaN; the first one is that loops are closed, which they are not within a step.
  const judged = (y, size, first = 0) => Array.from(y.subarray(first, size), (x) => y.subarray(size + 1).every((check) => check <= 1) ? x : NaN);
  const torques = (q, va, aa) => judged(F.torques(q, va, aa, rest), motors);

  // What the motors give: nothing, what is given to them, or what holds the coordinates at a goal.
  function efforts(q, va, s) {
    if (r.way === "hold") return r.torques(q, zeros(n), goal.map((g, k) => STIFF ** 2 * (g - s[k]) - 2 * STIFF * va[k]));
    return r.way === "sliders" ? r.efforts : zeros(motors);
  }

  // What acts on the bodies besides the motors, as [force; moment] about their mass centres: a hand, and the stops.
  function loads(q, q_dot) {
    const W = rest.slice();
    byHand(W, q, q_dot);
    for (const stop of impulsive ? [] : d.stops) {
      const size = pushOf(stop, q, q_dot);
      if (size) press(W, F.places(q).slice(), stop, size);
    }
    return W;
  }

  // Add a force at the point p of a body to W.
  function addForce(W, M, body, p, force) {
    const c = on(M, { body, at: d.centres[body] });
    [0, 1, 2].forEach((i) => {
      const [j, k] = [(i + 1) % 3, (i + 2) % 3];
      W[6 * body - 6 + i] += force[i];
      W[6 * body - 3 + i] += (p[j] - c[j]) * force[k] - (p[k] - c[k]) * force[j];
    });
  }

  function byHand(W, q, q_dot) { // a spring, or a push
    const { grip } = r;
    if (!grip || !(grip.target || r.time < grip.until)) return;
    const M = F.places(q).slice(), p = on(M, grip), speed = grip.target && velocity(grip, q, q_dot);
    const force = grip.target ? p.map((x, i) => grip.mass * (grip.pull ** 2 * (grip.target[i] - x) - 1.4 * grip.pull * speed[i])) : grip.force;
    addForce(W, M, grip.body, p, force);
  }

  // Add a force along the axis of a joint, or a moment about it, to W: on its body, and the opposite on the parent.
  function press(W, M, { body, parent, turns, axis }, size) {
    const origin = on(M, { body, at: [0, 0, 0] }), tip = on(M, { body, at: axis }), along = tip.map((x, i) => size * (x - origin[i]));
    for (const [owner, sign] of [[body, 1], [parent, -1]]) {
      if (!owner) continue;
      if (turns) along.forEach((x, i) => { W[6 * owner - 3 + i] += sign * x; });
      else addForce(W, M, owner, origin, along.map((x) => sign * x));
    }
  }

  // --- stops -----------------------------------------------------------------------------------

  const stopStiffness = (SPRING ** 2 * d.fall) / d.size; // per inertia
  let felt = new Map(); // inertia that a force along a joint feels, of the stops that act

  // Force of a stop on its joint: a spring with critical damping that begins a little before the limit, and only pushes.
  function pushOf(stop, q, q_dot) {
    const { i, low, high } = stop, buffer = Math.min(BUFFER * d.scales[i], (high - low) / 8);
    const below = low + buffer - q[i], above = q[i] - high + buffer;
    if (below <= 0 && above <= 0) return 0;
    const [depth, sense] = below > 0 ? [below, 1] : [above, -1];
    if (!felt.has(stop)) felt.set(stop, inertiaAlong(stop, q));
    return sense * felt.get(stop) * Math.max(0, stopStiffness * depth - 2 * Math.sqrt(stopStiffness) * sense * q_dot[i]);
  }

  function inertiaAlong(stop, q) { // of the whole robot, at rest
    const W = rest.slice(), still = zeros(n), none = zeros(motors);
    press(W, F.places(q).slice(), stop, 1);
    const free = Array.from(now.state_rate(q, still, none, rest).subarray(nq, nq + n)), pressed = now.state_rate(q, still, none, W).subarray(nq, nq + n);
    const aa = free.map((x, k) => pressed[k] - x);
    return 1 / Math.max(rates(now, q, aa)[stop.i], 1e-12);
  }

  function derivative(x, set) { // of q, the rates of the set, and what the own coordinates have moved
    const q = x.slice(0, nq), u = x.slice(nq, nq + n), y = Array.from(rates(set, q, u)), va = own.coordinates.map((j) => y[nq + j]);
    return [...set.state_rate(q, u, efforts(q, va, x.slice(nq + n)), loads(q, y.slice(0, nq))).subarray(0, nq + n), ...va];
  }

  // Dormand and Prince's method of order 5, whose error estimate chooses the steps.
  const NODES = [[], [1 / 5], [3 / 40, 9 / 40], [44 / 45, -56 / 15, 32 / 9], [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656], [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]];
  const ERROR = [71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40];
  function tried(h) {
    const x = [...r.q, ...rate_, ...moved], units = [...d.scales, ...now.coordinates.map((j) => d.rate_scales[j]), ...scale], K = [];
    let end = x;
    for (const row of NODES) {
      end = x.map((value, i) => row.reduce((sum, a, k) => sum + h * a * K[k][i], value));
      K.push(derivative(end, now));
    }
    const error = x.map((value, i) => Math.abs(h * ERROR.reduce((sum, a, k) => sum + a * K[k][i], 0)) / (units[i] + Math.abs(value)));
    return [end, Math.max(...error) / TOLERANCE];
  }

  function start() {
    [now, rate_, moved, goal, step] = [own, r.va.slice(), zeros(n), zeros(n), impulsive ? LONGEST * fall : 1e-3];
    r.contactForces = [];
    r.unsolved = false;
    if (impulsive) startImpulses();
  }

  // Coordinates and pivots that suit the pose: the own ones, or others whose pivots are much larger.
  function settle() {
    const small = sets.map((set) => set.closing(r.q)[set.checked + 1]).map((x) => Number.isFinite(x) ? x : Infinity);
    const best = sets[small.indexOf(Math.min(...small))], wanted = small[0] < 1e-3 ? own : Math.min(...small) * 16 < small[sets.indexOf(now)] ? best : now;
    if (wanted === now) return;
    const v = Array.from(rates(now, r.q, rate_)).slice(nq);
    [now, rate_] = [wanted, wanted.coordinates.map((j) => v[j])];
  }

  // Go on by dt, or as far as `until` allows; what is left, or words where the motion ends.
  function advance(dt, until = Infinity) {
    if (impulsive) return advanceByImpulses(dt, until);
    let left = dt;
    felt = new Map();
    while (left > 1e-12 && performance.now() < until) {
      if (sets.length > 1) settle();
      const h = Math.min(step, left), det = now.closing(r.q)[nq], [end, error] = tried(h);
      const next = error <= 1 ? closed(end.slice(0, nq), now) : null, y = next && now.closing(next), ratio = y ? y[nq] / det : 1;
      if (next && ratio > 1 / CHANGE && ratio < CHANGE) {
        if (!(y[now.checked + 1] <= 1)) return "the simulation stopped close to a singularity";
        [r.q, rate_, moved] = [next, end.slice(nq, nq + n), end.slice(nq + n)];
        const v = rates(now, next, rate_).subarray(nq);
        [r.va, r.time, left] = [own.coordinates.map((j) => v[j]), r.time + h, left - h];
        if (h === step) step = h * Math.min(4, Math.max(0.2, 0.9 * error ** -0.2));
      } else step = h * (error > 1 ? Math.max(0.2, 0.9 * error ** -0.2) : 0.3);
      if (!(step > SHORTEST)) return "the simulation stopped close to a singularity, where its steps became too short";
    }
    return left;
  }

  // For "hold": where a coordinate is to go, or all stay.
  function goTo(k, ahead) {
    if (impulsive) { moveGoals(k, ahead); return; }
    if (k === undefined) goal = moved?.slice();
    else goal[k] = moved[k] + ahead;
  }

  function measure(running) { // torques that act, or hold the pose
    const found = running ? (impulsive ? acting : efforts(r.q, r.va, moved)) : F.torques ? r.torques(r.q, zeros(n), zeros(n)) : zeros(motors);
    return found.map((x) => Number.isFinite(x) ? x : 0);
  }

  // Whether no acceleration is larger than rounding at rest, without a hand on the robot.
  function rests() {
    const aa = own.state_rate(r.q, zeros(n), r.way === "sliders" ? r.efforts : zeros(motors), rest).slice(nq, nq + n);
    return r.way !== "hold" && aa.every((x, k) => Math.abs(x) < 1e-9 * d.fall / d.size * scale[k]);
  }

  // --- contacts and ropes --------------------------------------------------------------------
  // A robot with them makes the steps of `nonsmooth`, which also contain stops, cables and dry friction.

  // Of the last step: impulses, and what the motors gave. Limits of the stops. What the motors have moved, and shall have; goals of the coordinates.
  let impulses, acting, limits, motorsMoved, motorGoals, goals;

  // "hold" keeps motors in place by stiffness and damping; winches of cables have none.
  const stiffness = zeros(motors).map((_, k) => {
    if (functions.nonsmooth?.cables.some(({ shares }) => shares[k])) return 0;
    return WEIGHTS * d.weight * (d.motors.units[k] === "N m" ? d.size : 1 / d.size);
  });

  function startImpulses() { // a start beyond a limit moves the limit there
    const { stops } = functions.nonsmooth;
    impulses = impulsive.none();
    limits = stops.map(({ position, side, limit }) => side > 0 ? Math.min(limit, r.q[position]) : Math.max(limit, r.q[position]));
    [acting, motorsMoved] = [zeros(motors), zeros(motors)];
    moveGoals();
  }

  // Matrices of a step, or null where a check fails; the first check is that loops are closed, as above.
  function termsOf(set, rates, W) {
    const y = set.terms(r.q, rates, W);
    return y.subarray(set.size + 1).every((check) => check <= 1) ? impulsive.read(set.layout, y) : null;
  }

  const motorRows = ({ implicit }) => implicit.slice(implicit.length - motors); // their rates for those of the coordinates

  // Where a coordinate is to go, or all motors stay.
  function moveGoals(k, ahead) {
    const values = d.coordinates.map((_, j) => value(j));
    if (k === undefined) {
      [motorGoals, goals] = [motorsMoved.slice(), values];
      return;
    }
    const wanted = values[k] + ahead, change = d.coordinates[k].kind === "angle" ? turned(wanted - goals[k]) : wanted - goals[k];
    const terms = termsOf(own, r.va, rest);
    if (!terms) return;
    motorRows(terms).forEach((row, i) => { motorGoals[i] += row[k] * change; });
    goals[k] = wanted;
  }

  // Rates after a step of length h, impulses and their residual; null where there is no solution.
  function stepped(terms, h) {
    if (!terms) return null;
    const hold = r.way === "hold", gains = { stiffness: hold ? stiffness : zeros(motors) };
    gains.damping = gains.stiffness.map((x) => SETTLING * fall * x);
    let given = r.way === "sliders" ? r.efforts : zeros(motors);
    if (hold && r.holds) given = torques(r.q, zeros(n), zeros(n)).map((x) => Number.isFinite(x) ? x : 0); // at rest, without contacts
    given = given.map((x, k) => x + gains.stiffness[k] * (motorGoals[k] - motorsMoved[k]));
    const end = impulsive.step(terms, { q: r.q, va: rate_, efforts: given, gains, limits, h, start: impulses });
    if (!end) return null;
    const motorRates = motorRows(terms).map((row) => row.reduce((sum, x, i) => sum + x * end.rates[i], 0));
    const gives = given.map((x, k) => x - (gains.damping[k] + h * gains.stiffness[k]) * motorRates[k]);
    return { ...end, motorRates, gives };
  }

  // As `advance`, by steps of one length, which are shorter near singularities.
  function advanceByImpulses(dt, until) {
    let left = dt;
    while (left > 1e-12 && performance.now() < until) {
      if (sets.length > 1) settle();
      const h = left / Math.ceil(left / step), det = now.closing(r.q)[nq], q_dot = rates(now, r.q, rate_).slice(0, nq);
      const terms = termsOf(now, rate_, loads(r.q, q_dot));
      const end = stepped(terms, h), ahead = end && Array.from(rates(now, r.q, end.rates).subarray(0, nq), (x, i) => r.q[i] + h * x);
      const next = ahead?.every(Number.isFinite) ? closed(ahead, now) : null;
      const way = (a, b) => Math.max(...a.map((x, i) => Math.abs(x - b[i]) / d.scales[i]));
      const y = next && now.closing(next), ratio = y ? y[nq] / det : 0;
      if (ratio > 1 / CHANGE && ratio < CHANGE && way(next, ahead) <= BEND * way(next, r.q) + 1e-9) {
        if (!(y[now.checked + 1] <= 1)) return "the simulation stopped close to a singularity";
        [r.q, rate_, impulses, acting] = [next, Array.from(end.rates), end.x, end.gives];
        motorsMoved = motorsMoved.map((x, k) => x + h * end.motorRates[k]);
        r.contactForces = functions.nonsmooth.contacts.map((_, k) => Array.from(end.x.slice(3 * k, 3 * k + 3), (x) => x / h));
        r.unsolved = !(end.residual <= impulsive.SOLVED);
        const v = rates(now, next, rate_).subarray(nq);
        [r.va, r.time, left] = [own.coordinates.map((j) => v[j]), r.time + h, left - h];
        step = Math.min(2 * step, LONGEST * fall);
      } else step = 0.3 * h;
      if (!(step > SHORTEST)) return "the simulation stopped close to a singularity, where its steps became too short";
    }
    return left;
  }

  // --- the hand ------------------------------------------------------------------------------

  // A point of a body in a hand: what mass it feels, and a spring that pulls it.
  function gripped(grip) {
    const J = columns(grip), none = own.state_rate(r.q, r.va, zeros(motors), rest).slice(nq);
    const response = [0, 1, 2].map((i) => {
      r.grip = { ...grip, force: [0, 1, 2].map((j) => Number(i === j)), until: Infinity };
      const W = rest.slice();
      byHand(W, r.q);
      const more = own.state_rate(r.q, r.va, zeros(motors), W).slice(nq);
      return J.reduce((sum, c, k) => sum + c[i] * (more[k] - none[k]), 0);
    });
    r.grip = { ...grip, mass: 1 / Math.max(...response, 1e-9), pull: Math.sqrt(Math.max(150, 10 * d.fall / d.size)) };
  }

  function push(ray) { // along a ray, as hard as makes the speed of a fall by the robot's length
    const size = r.grip.mass * Math.sqrt(d.fall * d.size) / PUSH;
    r.grip = { ...r.grip, target: null, force: ray.map((x) => size * x), until: r.time + PUSH };
  }

  start();
  return Object.assign(r, {
    reset, move, value, condition, measure, follow, start, advance, goTo, gripped, push, rests, wrong,
    holds: Boolean(F.torques),
    keepsMotors: Boolean(F.torques || (impulsive && motors)),
    torques,
    accelerations: (q, va, tau) => judged(own.state_rate(q, va, tau, rest), nq + n, nq),
    energies: () => Array.from(F.energies(r.q, rates(own, r.q, r.va).subarray(nq))),
    places: () => F.places(r.q),
    point: (grip) => on(F.places(r.q), grip),
  });
}
