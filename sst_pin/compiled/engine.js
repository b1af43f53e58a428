// SPDX-License-Identifier: BSD-2-Clause
// The engine of a page that computes: the state of a robot, and the functions that change it.
//
// - By hand: `move` changes the coordinates in small steps, and after each step Newton's method
//   closes the loops. `follow` moves a gripped point to its target in this way.
// - In time: `advance` integrates the direct dynamics by the method of Dormand and Prince. A robot
//   with contacts or ropes makes the steps with impulses of nonsmooth.js instead.
//
// `functions` are the kernels of page_code.py, `data` is from live_data.py. Positions without units
// are angles in radians, and lengths relative to the length of the robot. Some times are relative
// to `fallTime` = sqrt(length of the robot / gravity), and some speeds to length / fallTime. A fall
// from rest by this length takes sqrt(2) fallTime.
function engine(functions, data) {
  "use strict";

  // --- constants -----------------------------------------------------------------------------

  // By hand.
  const MOVE_STEP = 0.02; // longest step of a coordinate, without units
  const JUMP = 0.1; // a correction of q by more, without units, changes the assembly mode
  const DET_CHANGE = 3; // largest factor of det Phi_u in a step; its sign changes at a singularity
  const FOLLOW_STEP = 0.1; // longest change of a coordinate in one frame, without units
  const FOLLOW_DAMPING = 0.05; // of the least squares, in robot lengths
  // Sets of coordinates and pivots. The check `smallPivots` is large if a pivot is small.
  const GOOD_PIVOTS = 1e-3; // the robot's own coordinates are taken up to this check
  const BETTER_PIVOTS = 16; // another set is chosen if its check is smaller by this factor
  // Steps in time.
  const TOLERANCE = 1e-7; // relative error of a step
  const FIRST_STEP = 1e-3; // [s]
  const SHORTEST_STEP = 1e-7; // [s]
  const END = 1e-12; // a rest of time up to this is rounding, [s]
  const HOLD_FREQUENCY = 12; // of the coordinates with "hold", critically damped, [rad/s]
  const STOP_FREQUENCY = 20; // of the spring of a stop, relative to 1 / fallTime
  const STOP_BUFFER = 0.005; // distance from a limit at which its spring begins, without units
  // Width of Coulomb friction that has none, [rad/s]: an integrator cannot pass its jump.
  const SMOOTH = 0.01;
  const SIGN_WIDTH = 3; // index of this width in the symbolic parameters
  // Steps with impulses.
  const LONGEST_STEP = 5e-3; // relative to fallTime
  const BEND = 0.25; // largest correction of q that closes the loops, relative to the step
  // Speed that lifts a point which starts below its ground, relative to length / fallTime.
  const RISE = 0.1;
  // Of motors with "hold", in robot weights at the robot's length per rad.
  const HOLD_STIFFNESS = 20;
  const HOLD_DAMPING = 0.3; // damping over stiffness, relative to fallTime
  // The hand.
  const PUSH_TIME = 0.1; // [s]
  const HAND_DAMPING = 0.7; // relative to the critical damping
  // Stiffness of the hand's spring per mass: relative to gravity / length, and at least, [1/s^2]. A
  // mass that hangs on it at rest is then 1/10 of the robot's length below the hand, or less.
  const HAND_STIFFNESS = 10;
  const LEAST_HAND_STIFFNESS = 150;

  const SINGULAR = "the simulation stopped close to a singularity";
  const TOO_SHORT = `${SINGULAR}, where its steps became too short`;

  const nq = data.q.length, n = data.coordinates.length, motors = data.motors.names.length;
  const gravity = data.fall; // [m/s^2]
  const fallTime = Math.sqrt(data.size / gravity); // [s]
  const scale = data.coordinates.map((each) => each.scale); // units of the coordinates
  const zeros = (size) => new Array(size).fill(0);
  const unitVector = (size, k) => Array.from({ length: size }, (_, j) => Number(j === k));
  const turned = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI)); // to [-pi, pi]
  // The largest change of a coordinate, without units.
  const largest = (change) => Math.max(0, ...change.map((x, k) => Math.abs(x) / scale[k]));
  const noTorques = zeros(motors), noRates = zeros(n);
  const noWrenches = zeros(6 * (data.bodies.length - 1)); // [force; moment] of each body

  // --- kernels -------------------------------------------------------------------------------

  // A kernel as a function of its input arrays. It returns an array of its outputs, then its
  // checks; the next call overwrites this array. `signWidth` is the width of Coulomb friction that
  // has none. A kernel consists of functions: `constants(p)` computes what depends on the robot's
  // numbers alone, and the `parts`, one after the other, compute the rest. `size` is the length of
  // p, which holds the numbers and these constants, and `room` that of the workspace w.
  function bind({ inputs, output, checks, size, room, constants, parts }, signWidth) {
    const x = new Float64Array(inputs.reduce((sum, count) => sum + count, 0));
    const p = new Float64Array(size);
    const y = new Float64Array(output + checks);
    const w = new Float64Array(room);
    p.set(functions.numbers);
    if (signWidth && !(p[SIGN_WIDTH] > 0)) p[SIGN_WIDTH] = signWidth;
    constants(p);
    return (...arrays) => {
      let start = 0;
      for (const array of arrays) {
        x.set(array, start);
        start += array.length;
      }
      for (const part of parts) part(x, p, y, w);
      return y;
    };
  }

  function bindAll(kernels) {
    const bound = ([name, kernel]) => [name, bind(kernel, name === "state_rate" ? SMOOTH : 0)];
    return Object.fromEntries(Object.entries(kernels).map(bound));
  }

  const common = bindAll(functions.common);
  // Sets of coordinates and pivots, each with its kernels of the dynamics; the first set has the
  // robot's own coordinates. `rates(q, va)` of a set are the rates of q, then those of all joints;
  // va are the rates of its coordinates.
  const sets = functions.sets.map(({ coordinates, parts, layout, kernels }) => ({
    coordinates,
    parts,
    layout,
    ...bindAll(kernels),
    closingOutputs: kernels.closing.output,
    termsOutputs: kernels.terms?.output,
  }));
  const own = sets[0];
  // The steps with impulses, for a robot with contacts or ropes.
  const rise = RISE * data.size / fallTime; // [m/s]
  const impulsive = functions.nonsmooth && nonsmooth(functions.nonsmooth, rise);

  // One step of Newton's method onto the closures, with the coordinates of a set held: `next` is q
  // after it. The others are of q before it: det Phi_u (Phi_u are the columns of Phi for the
  // dependent rates), and two checks. `gap` is at most 1 if the loops are closed, `smallPivots` if
  // the pivots are not small.
  function newtonStep(set, q) {
    const y = set.closing(q), checks = set.closingOutputs;
    return { next: y.subarray(0, nq), det: y[nq], gap: y[checks], smallPivots: y[checks + 1] };
  }

  // Whether det Phi_u changes little enough to stay in the assembly mode.
  const keepsMode = (before, after) =>
    after / before > 1 / DET_CHANGE && after / before < DET_CHANGE;

  // Whether the checks of a kernel pass. The first check, that the loops are closed, does not
  // count: within a step of an integrator they are not.
  const checksPass = (y, outputs) => y.subarray(outputs + 1).every((check) => check <= 1);

  // The outputs of a kernel from `first` on; NaN if a check fails.
  function valid(y, outputs, first = 0) {
    const isGood = checksPass(y, outputs);
    return Array.from(y.subarray(first, outputs), (x) => isGood ? x : NaN);
  }

  // Bodies at q: for each one 12 numbers, its axes one after the other and its origin.
  const placesOf = (q) => common.places(q).slice();

  const torques = (q, va, aa) => valid(common.torques(q, va, aa, noWrenches), motors);
  const holdingTorques = () => torques(robot.q, noRates, noRates);
  const finite = (x) => Number.isFinite(x) ? x : 0;

  // --- the state -----------------------------------------------------------------------------

  // `way` says how the motors are driven: "none"; "hold", which holds the coordinates; or
  // "sliders", which set `efforts`. A grip is a hand at the point `at` of a body, in the axes of
  // the body. If it has a `target`, a spring pulls the point there; else it pushes with a `force`,
  // `until` some time. `gripped` says what its `mass` and `pull` are. `unsolved` says whether the
  // last step with impulses was not solved. Constants at the end of this file: `holds` says whether
  // the motors can hold a pose, `keepsMotors` whether they can be driven by "hold".
  const robot = {
    q: data.q.slice(),
    va: data.va.slice(),
    time: 0,
    way: "none",
    efforts: zeros(motors),
    grip: null,
    contactForces: [],
    unsolved: false,
  };

  // Go back to the first state; `start` has to be called next.
  function reset() {
    robot.q = data.q.slice();
    robot.va = data.va.slice();
    robot.time = 0;
    robot.grip = null;
    robot.efforts = zeros(motors);
  }

  // Position of coordinate k; 0 for one of several rates of a joint, which has none.
  function value(k) {
    const { kind, i } = data.coordinates[k];
    if (kind === "position") return robot.q[i];
    return kind === "angle" ? Math.atan2(robot.q[i + 1], robot.q[i]) : 0;
  }

  // --- loops ---------------------------------------------------------------------------------

  // The closed configuration near q with the coordinates held; null if there is none.
  function closed(q, set = own) {
    for (let k = 0; k < 12; k++) {
      const { next, gap } = newtonStep(set, q);
      q = Array.from(next);
      if (!q.every(Number.isFinite)) return null;
      if (gap <= 1) return q; // closed before this step
    }
    return null;
  }

  // Condition number of Phi_u. It consists of parts, for instance loops, that share no rate and no
  // row; the largest condition number of a part counts.
  function condition(q = robot.q) {
    const Phi = common.loops(q);
    return Math.max(1, ...own.parts.map((part) => conditionOf(Phi, part.rates, part.size)));
  }

  // Condition number of some columns of Phi, which is stored row by row, from the eigenvalues of
  // their Gram matrix. No checks follow Phi in its array. `size` is the usual largest singular
  // value: a part with a single column is compared with it.
  function conditionOf(Phi, columns, size) {
    const product = (i, j) => { // of columns i and j
      let sum = 0;
      for (let k = 0; k < Phi.length; k += data.nv) sum += Phi[k + i] * Phi[k + j];
      return sum;
    };
    const squares = eigenvalues(columns.map((i) => columns.map((j) => product(i, j))));
    return Math.sqrt(Math.max(...squares, size * size) / Math.max(Math.min(...squares), 0));
  }

  // Eigenvalues of a symmetric matrix by Jacobi's rotations; A changes.
  function eigenvalues(A) {
    const m = A.length;
    for (let sweep = 0, rotations = 1; sweep < 12 && rotations; sweep++) {
      rotations = 0;
      for (let i = 0; i < m; i++) {
        for (let j = i + 1; j < m; j++) {
          if (Math.abs(A[i][j]) <= 1e-15 * Math.sqrt(Math.abs(A[i][i] * A[j][j]))) continue;
          rotations += 1;
          rotate(A, i, j);
        }
      }
    }
    return A.map((row, i) => row[i]);
  }

  // A := R^T A R with the rotation of axes i and j that makes A_ij zero.
  function rotate(A, i, j) {
    const angle = Math.atan2(2 * A[i][j], A[j][j] - A[i][i]) / 2;
    const c = Math.cos(angle), s = Math.sin(angle);
    for (const row of A) [row[i], row[j]] = [c * row[i] - s * row[j], s * row[i] + c * row[j]];
    for (let k = 0; k < A.length; k++) {
      [A[i][k], A[j][k]] = [c * A[i][k] - s * A[j][k], s * A[i][k] + c * A[j][k]];
    }
  }

  const nearSingularity = (x) =>
    `close to a singularity, condition number ${Number(x.toPrecision(3))}`;

  // --- by hand -------------------------------------------------------------------------------

  // The name of a joint that is further beyond its limits at the configuration `after` than at
  // `before`.
  function reachedLimit(before, after) {
    const beyond = (q, { i, low, high }) => Math.max(low - q[i], q[i] - high, 0);
    const isFurther = (bound) => beyond(after, bound) > beyond(before, bound) + 1e-12;
    return data.bounds.find((bound) => bound.what === "limits" && isFurther(bound))?.name;
  }

  // Change the coordinates, within one assembly mode and the limits. Returns why the move ended
  // early, or no text.
  function move(change) {
    const count = Math.max(1, Math.ceil(largest(change) / MOVE_STEP));
    const step = change.map((x) => x / count);
    let before = condition(), det = newtonStep(own, robot.q).det;
    for (let k = 0; k < count; k++) {
      const rates = own.rates(robot.q, step);
      const ahead = robot.q.map((x, i) => x + rates[i]);
      const next = closed(ahead);
      if (!next) return "the loops cannot be closed beyond this pose";
      if (next.some((x, i) => Math.abs(x - ahead[i]) > JUMP * data.scales[i])) {
        return "the assembly mode ends here";
      }
      const joint = reachedLimit(robot.q, next);
      if (joint) return `${joint} is at its limit`;
      const after = condition(next), detAfter = newtonStep(own, next).det;
      const isRegular = after <= data.condition || after < before;
      const isContinuous = detAfter / det > 1 / DET_CHANGE; // it may grow, away from a singularity
      if (!isContinuous || !isRegular) return nearSingularity(Math.max(before, after));
      robot.q = next;
      before = after;
      det = detAfter;
    }
    return "";
  }

  // A point { body, at } in base axes; `at` is in the body's axes.
  function pointOf(places, { body, at }) {
    const R = 12 * body, p = R + 9; // where its axes begin, and its origin
    const coordinate = (i) =>
      places[p + i] + places[R + i] * at[0] + places[R + 3 + i] * at[1] + places[R + 6 + i] * at[2];
    return [0, 1, 2].map(coordinate);
  }

  // Velocity of a point: `flow` is the rate of `places`, and a point is linear in them.
  const velocityOf = (point, q, q_dot) => pointOf(common.flow(q, q_dot), point);

  // The velocities of a point for unit rates of the coordinates: the columns of its Jacobian.
  function jacobianColumns(grip) {
    const ratesFor = (k) => own.rates(robot.q, unitVector(n, k)).slice(0, nq);
    return robot.va.map((_, k) => velocityOf(grip, robot.q, ratesFor(k)));
  }

  // Solve A x = b with three rows by Cramer's rule. A is symmetric: the determinants are written
  // with its rows, which are its columns.
  function solvedByCramer(A, b) {
    const dot = (x, y) => x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    const cross = (x, y) =>
      [0, 1, 2].map((i) => x[(i + 1) % 3] * y[(i + 2) % 3] - x[(i + 2) % 3] * y[(i + 1) % 3]);
    const det = (x, y, z) => dot(x, cross(y, z));
    const whole = det(A[0], A[1], A[2]);
    return [det(b, A[1], A[2]), det(A[0], b, A[2]), det(A[0], A[1], b)].map((x) => x / whole);
  }

  // Move the gripped point towards its target by damped least squares. With the Jacobian J of the
  // point, a diagonal matrix S of the squared units of the coordinates, and b from the point to the
  // target, the coordinates change by S J^T (J S J^T + damping 1)^-1 b. Returns what `move`
  // returns.
  function follow() {
    const damping = (FOLLOW_DAMPING * data.size) ** 2;
    const p = pointOf(placesOf(robot.q), robot.grip), J = jacobianColumns(robot.grip);
    const entry = (i, j) =>
      J.reduce((sum, c, k) => sum + c[i] * scale[k] ** 2 * c[j], i === j ? damping : 0);
    const A = [0, 1, 2].map((i) => [0, 1, 2].map((j) => entry(i, j)));
    const force = solvedByCramer(A, robot.grip.target.map((x, i) => x - p[i]));
    const along = (c) => c[0] * force[0] + c[1] * force[1] + c[2] * force[2];
    const change = J.map((c, k) => scale[k] ** 2 * along(c));
    const share = Math.min(1, FOLLOW_STEP / (largest(change) || 1));
    return move(change.map((x, k) => onSlider(k, share * x)));
  }

  // A change of coordinate k, cut off at the ends of its slider. A position beyond an end may come
  // back, but not go further.
  function onSlider(k, change) {
    const { kind, low, high } = data.coordinates[k];
    if (kind !== "position") return change;
    const x = value(k), least = Math.min(low, x), most = Math.max(high, x);
    return Math.min(Math.max(x + change, least), most) - x;
  }

  // --- what the pose is like -----------------------------------------------------------------

  // Warnings, in words: why the machine cannot take this pose, and which motors are beyond their
  // largest efforts `tau`. `shown` writes a number with its unit.
  function wrong(shown, tau) {
    const words = [...leftRanges(shown), ...largeEfforts(tau)];
    const number = condition();
    if (!(number <= data.condition)) words.push(nearSingularity(number));
    if (robot.unsolved) words.push("forces of contacts are not solved to 1e-9");
    if (robot.holds && !holdingTorques().every(Number.isFinite)) {
      words.push("the motors do not hold this pose");
    }
    if (!(newtonStep(own, robot.q).gap <= 1)) words.unshift("the loops are open");
    return words;
  }

  function leftRanges(shown) {
    const words = [];
    for (const { name, unit, i, what, low, high } of data.bounds) {
      const middle = (low + high) / 2;
      // On an arc, whole turns do not count: x is the angle closest to the middle.
      const x = what === "arc" ? middle + turned(robot.q[i] - middle) : robot.q[i];
      if (!(x < low || x > high)) continue;
      const range = `${shown(low, unit)} to ${shown(high, unit)}`;
      words.push(`${name} leaves its ${what} of ${range}: ${shown(robot.q[i], unit)}`);
    }
    return words;
  }

  function largeEfforts(tau) {
    const { owners, units, limits } = data.motors, words = [];
    tau.forEach((x, k) => {
      if (limits[k] === null || !(Math.abs(x) > limits[k])) return;
      const limit = `${Number(limits[k].toPrecision(3))} ${units[k]}`;
      words.push(`${owners[k]} is beyond its effort limit of ${limit}`);
    });
    return words;
  }

  // Efforts of the motors: in a simulation those that act, else those that hold the pose.
  function measure(isRunning) {
    let efforts = zeros(motors);
    if (isRunning) efforts = impulsive ? actingEfforts : drivenEfforts(robot.q, robot.va, moved);
    else if (common.torques) efforts = holdingTorques();
    return efforts.map(finite);
  }

  // Efforts that the sliders set; zero if they set none.
  const sliderEfforts = () => robot.way === "sliders" ? robot.efforts : noTorques;

  // Whether the robot stays at rest without a hand: no acceleration is larger than rounding.
  function rests() {
    const aa = own.state_rate(robot.q, noRates, sliderEfforts(), noWrenches).slice(nq, nq + n);
    const rounding = 1e-9 * gravity / data.size;
    return robot.way !== "hold" && aa.every((x, k) => Math.abs(x) < rounding * scale[k]);
  }

  // --- wrenches ------------------------------------------------------------------------------

  // Wrenches on the bodies besides those of the motors, [force; moment] about their mass centres:
  // those of the hand and of the stops. Steps with impulses have stops of their own.
  function wrenches(q, q_dot) {
    const W = noWrenches.slice(), stops = impulsive ? [] : data.stops;
    const forces = stops
      .map((stop) => ({ stop, force: stopForce(stop, q, q_dot) }))
      .filter(({ force }) => force);
    const { grip } = robot, handActs = grip && (grip.target || robot.time < grip.until);
    if (!handActs && !forces.length) return W;
    const places = placesOf(q);
    if (handActs) addHand(W, places, q, q_dot);
    for (const { stop, force } of forces) addAlongJoint(W, places, stop, force);
    return W;
  }

  // Add a force at a point p of a body to W.
  function addForce(W, places, body, p, force) {
    const centre = pointOf(places, { body, at: data.centres[body] });
    [0, 1, 2].forEach((i) => {
      const j = (i + 1) % 3, k = (i + 2) % 3;
      W[6 * body - 6 + i] += force[i];
      W[6 * body - 3 + i] += (p[j] - centre[j]) * force[k] - (p[k] - centre[k]) * force[j];
    });
  }

  // Add a force along the axis of a joint or, if it turns, a moment about the axis: on the body of
  // the joint, and the opposite on the parent.
  function addAlongJoint(W, places, { body, parent, turns, axis }, size) {
    const origin = pointOf(places, { body, at: [0, 0, 0] });
    const along = pointOf(places, { body, at: axis }).map((x, i) => size * (x - origin[i]));
    for (const [link, sign] of [[body, 1], [parent, -1]]) {
      if (!link) continue; // the ground
      if (turns) along.forEach((x, i) => { W[6 * link - 3 + i] += sign * x; });
      else addForce(W, places, link, origin, along.map((x) => sign * x));
    }
  }

  // Add the force of the hand: a damped spring to the target, or the force of a push.
  function addHand(W, places, q, q_dot) {
    const { grip } = robot, p = pointOf(places, grip);
    let { force } = grip;
    if (grip.target) {
      const { target, mass, pull } = grip, speed = velocityOf(grip, q, q_dot);
      const damping = 2 * HAND_DAMPING * pull;
      force = p.map((x, i) => mass * (pull ** 2 * (target[i] - x) - damping * speed[i]));
    }
    addForce(W, places, grip.body, p, force);
  }

  // A stop is a spring with critical damping. Its stiffness per inertia:
  const stopStiffness = (STOP_FREQUENCY ** 2 * gravity) / data.size;
  let stopInertias = new Map(); // inertias of the stops that act, computed once in a frame

  // Force of a stop on its joint, 0 if it does not act. It begins a little before the limit, and
  // only pushes.
  function stopForce(stop, q, q_dot) {
    const { i, low, high } = stop;
    const buffer = Math.min(STOP_BUFFER * data.scales[i], (high - low) / 8);
    const below = low + buffer - q[i], above = q[i] - high + buffer;
    if (below <= 0 && above <= 0) return 0;
    const depth = below > 0 ? below : above, sense = below > 0 ? 1 : -1; // of the force
    if (!stopInertias.has(stop)) stopInertias.set(stop, inertiaAlong(stop, q));
    const push = stopStiffness * depth - 2 * Math.sqrt(stopStiffness) * sense * q_dot[i];
    return sense * stopInertias.get(stop) * Math.max(0, push);
  }

  // Inertia of the whole robot against a force along a joint, at rest: 1 / acceleration by a unit
  // force.
  function inertiaAlong(stop, q) {
    const W = noWrenches.slice();
    addAlongJoint(W, placesOf(q), stop, 1);
    const accelerations = (loads) =>
      Array.from(current.state_rate(q, noRates, noTorques, loads).subarray(nq, nq + n));
    const free = accelerations(noWrenches), pressed = accelerations(W);
    const aa = free.map((x, k) => pressed[k] - x);
    return 1 / Math.max(current.rates(q, aa)[stop.i], 1e-12);
  }

  // Grip a body at a point { body, at }. The grip gets the mass that the hand feels there, and the
  // frequency `pull` of its spring, [rad/s].
  function gripped(grip) {
    const J = jacobianColumns(grip), places = placesOf(robot.q), p = pointOf(places, grip);
    const accelerations = (W) => own.state_rate(robot.q, robot.va, noTorques, W).slice(nq, nq + n);
    const free = accelerations(noWrenches);
    // The acceleration along an axis, by a unit force along this axis, is the reciprocal of a mass.
    // The smallest of the three masses counts, so that the spring is never too stiff.
    const responses = [0, 1, 2].map((i) => {
      const W = noWrenches.slice();
      addForce(W, places, grip.body, p, unitVector(3, i));
      const pushed = accelerations(W);
      return J.reduce((sum, c, k) => sum + c[i] * (pushed[k] - free[k]), 0);
    });
    const mass = 1 / Math.max(...responses, 1e-9);
    const relative = HAND_STIFFNESS * gravity / data.size;
    const stiffness = Math.max(LEAST_HAND_STIFFNESS, relative); // per mass
    robot.grip = { ...grip, mass, pull: Math.sqrt(stiffness) };
  }

  // Push along a ray, a unit vector. The push gives the gripped mass the speed length / fallTime,
  // which is sqrt(gravity * length).
  function push(ray) {
    const size = robot.grip.mass * Math.sqrt(gravity * data.size) / PUSH_TIME;
    const force = ray.map((x) => size * x);
    robot.grip = { ...robot.grip, target: null, force, until: robot.time + PUSH_TIME };
  }

  // --- in time -------------------------------------------------------------------------------

  let current; // the set of coordinates in which the simulation goes on
  let currentRates; // rates of its coordinates
  let step; // length of the next step, [s]
  let moved; // how far the robot's own coordinates have moved since the start
  let goal; // how far they are to move, with "hold"

  // Start a simulation at the state of the robot.
  function start() {
    current = own;
    currentRates = robot.va.slice();
    moved = zeros(n);
    goal = zeros(n);
    step = impulsive ? LONGEST_STEP * fallTime : FIRST_STEP;
    robot.contactForces = [];
    robot.unsolved = false;
    if (impulsive) startImpulses();
  }

  // Go on by dt, [s], or until performance.now() reaches `until`, [ms]. Returns the time that is
  // left; or words, if the motion ends.
  function advance(dt, until = Infinity) {
    return impulsive ? advanceByImpulses(dt, until) : advanceSmoothly(dt, until);
  }

  // Set the goal of "hold": coordinate k goes ahead by an amount; without arguments all stay in
  // place.
  function goTo(k, ahead) {
    if (impulsive) moveMotorGoals(k, ahead);
    else if (k === undefined) goal = moved.slice();
    else goal[k] = moved[k] + ahead;
  }

  // Choose the set for the pose: the robot's own coordinates if they are good enough, or another
  // set if its pivots are much larger. Returns det Phi_u of the chosen set.
  function chooseSet() {
    const steps = sets.map((set) => newtonStep(set, robot.q));
    const checks = steps.map(({ smallPivots: x }) => Number.isFinite(x) ? x : Infinity);
    const least = Math.min(...checks), checkOfCurrent = checks[sets.indexOf(current)];
    let wanted = current;
    if (checks[0] < GOOD_PIVOTS) wanted = own;
    else if (BETTER_PIVOTS * least < checkOfCurrent) wanted = sets[checks.indexOf(least)];
    if (wanted !== current) {
      const v = Array.from(current.rates(robot.q, currentRates)).slice(nq);
      current = wanted;
      currentRates = wanted.coordinates.map((j) => v[j]);
    }
    return steps[sets.indexOf(current)].det;
  }

  // Accept a step of length h: the robot is at q, with these rates of the current coordinates.
  function accept(q, rates, h) {
    const v = current.rates(q, rates).subarray(nq);
    robot.q = q;
    currentRates = rates;
    robot.va = own.coordinates.map((j) => v[j]);
    robot.time += h;
  }

  // --- smooth steps --------------------------------------------------------------------------

  // Efforts of the motors. With "hold" each coordinate has a critically damped spring to its goal;
  // `displacement` is how far the coordinates have moved.
  function drivenEfforts(q, va, displacement) {
    if (robot.way !== "hold") return sliderEfforts();
    const stiffness = HOLD_FREQUENCY ** 2, damping = 2 * HOLD_FREQUENCY; // per inertia
    const aa = goal.map((to, k) => stiffness * (to - displacement[k]) - damping * va[k]);
    return torques(q, noRates, aa);
  }

  // The rate of a state, which has q, the rates of the current coordinates, and `moved`.
  function derivative(state) {
    const q = state.slice(0, nq), rates = state.slice(nq, nq + n);
    const displacement = state.slice(nq + n);
    const allRates = Array.from(current.rates(q, rates)), q_dot = allRates.slice(0, nq);
    const va = own.coordinates.map((j) => allRates[nq + j]);
    const W = wrenches(q, q_dot), tau = drivenEfforts(q, va, displacement);
    return [...current.state_rate(q, rates, tau, W).subarray(0, nq + n), ...va];
  }

  // Dormand and Prince's method of order 5: coefficients of the stages, and of the estimated error.
  // The last stage is the end of the step.
  const STAGES = [
    [],
    [1 / 5],
    [3 / 40, 9 / 40],
    [44 / 45, -56 / 15, 32 / 9],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
  ];
  const ERROR = [71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40];

  // Try a step of length h: the state at its end, and the error of it, which is at most 1 in a good
  // step.
  function tryStep(h) {
    const before = [...robot.q, ...currentRates, ...moved];
    const rateUnits = current.coordinates.map((j) => data.rate_scales[j]);
    const units = [...data.scales, ...rateUnits, ...scale];
    const slopes = [];
    let end = before;
    for (const coefficients of STAGES) {
      end = before.map((x, i) => coefficients.reduce((sum, a, k) => sum + h * a * slopes[k][i], x));
      slopes.push(derivative(end));
    }
    const errors = before.map((x, i) => {
      const error = h * ERROR.reduce((sum, a, k) => sum + a * slopes[k][i], 0);
      return Math.abs(error) / (units[i] + Math.abs(x));
    });
    return { end, error: Math.max(...errors) / TOLERANCE };
  }

  function advanceSmoothly(dt, until) {
    let left = dt;
    stopInertias = new Map();
    while (left > END && performance.now() < until) {
      const det = chooseSet();
      const h = Math.min(step, left);
      const { end, error } = tryStep(h);
      const factor = Math.max(0.2, 0.9 * error ** -0.2); // of the next step: the error grows as h^5
      const next = error <= 1 ? closed(end.slice(0, nq), current) : null;
      const after = next && newtonStep(current, next);
      if (next && keepsMode(det, after.det)) {
        if (!(after.smallPivots <= 1)) return SINGULAR;
        accept(next, end.slice(nq, nq + n), h);
        moved = end.slice(nq + n);
        left -= h;
        if (h === step) step = h * Math.min(4, factor); // not after a shorter last step
      } else {
        step = h * (error > 1 ? factor : 0.3);
      }
      if (!(step > SHORTEST_STEP)) return TOO_SHORT;
    }
    return left;
  }

  // --- steps with impulses -------------------------------------------------------------------
  // A robot with contacts or ropes makes the steps of nonsmooth.js, which include its stops, cables
  // and dry friction. "hold" works on the motors here, not on the coordinates.

  let impulses, actingEfforts; // of the last step
  let limits; // positions of the stops
  let motorsMoved; // how far the motors have moved since the start
  let motorGoals; // how far they are to move, with "hold"
  let goals; // positions of the coordinates when the motors are there

  // Stiffness of each motor with "hold". Motors that drive cables have none.
  const holdStiffness = zeros(motors).map((_, k) => {
    if (functions.nonsmooth?.cables.some(({ shares }) => shares[k])) return 0;
    const perUnit = data.motors.units[k] === "N m" ? data.size : 1 / data.size;
    return HOLD_STIFFNESS * data.weight * perUnit;
  });

  function startImpulses() {
    impulses = impulsive.none();
    // A start beyond a limit moves the limit there; side 1 is a lower limit, -1 an upper one.
    limits = functions.nonsmooth.stops.map(({ position, side, limit }) => {
      const furthest = side > 0 ? Math.min : Math.max;
      return furthest(limit, robot.q[position]);
    });
    actingEfforts = zeros(motors);
    motorsMoved = zeros(motors);
    moveMotorGoals();
  }

  // The terms of a step from robot.q with these rates of the set's coordinates and wrenches W; null
  // if one of their checks fails.
  function termsOf(set, rates, W) {
    const y = set.terms(robot.q, rates, W);
    return checksPass(y, set.termsOutputs) ? impulsive.read(set.layout, y) : null;
  }

  // The matrix from rates of the coordinates to rates of the motors: the last rows of implicit
  // forces.
  const motorRows = ({ implicit }) => implicit.slice(implicit.length - motors);

  // `goTo` for steps with impulses.
  function moveMotorGoals(k, ahead) {
    const values = data.coordinates.map((_, j) => value(j));
    if (k === undefined) {
      motorGoals = motorsMoved.slice();
      goals = values;
      return;
    }
    const wanted = values[k] + ahead;
    const difference = wanted - goals[k];
    const change = data.coordinates[k].kind === "angle" ? turned(difference) : difference;
    const terms = termsOf(own, robot.va, noWrenches);
    if (!terms) return;
    motorRows(terms).forEach((row, i) => { motorGoals[i] += row[k] * change; });
    goals[k] = wanted;
  }

  // Gains of the motors, and their efforts at the start of a step, without the damping of the
  // gains.
  function motorControl() {
    const isHeld = robot.way === "hold";
    const gains = { stiffness: isHeld ? holdStiffness : zeros(motors) };
    gains.damping = gains.stiffness.map((x) => HOLD_DAMPING * fallTime * x);
    let efforts = sliderEfforts();
    // The torques that hold the pose as if there were no contacts.
    if (isHeld && robot.holds) efforts = holdingTorques().map(finite);
    efforts = efforts.map((x, k) => x + gains.stiffness[k] * (motorGoals[k] - motorsMoved[k]));
    return { gains, efforts };
  }

  // The end of a step of length h: `rates` of the current coordinates, impulses `x`, their
  // `residual`, and rates and efforts of the motors. It is null if there is no solution.
  function impulsiveStep(terms, h) {
    const { gains, efforts } = motorControl();
    const end = impulsive.step(
      terms, { q: robot.q, va: currentRates, efforts, gains, limits, h, impulses },
    );
    if (!end) return null;
    const motorRates = motorRows(terms).map(
      (row) => row.reduce((sum, x, i) => sum + x * end.rates[i], 0),
    );
    const damping = gains.damping.map((x, k) => x + h * gains.stiffness[k]);
    const damped = efforts.map((x, k) => x - damping[k] * motorRates[k]);
    return { ...end, motorRates, efforts: damped };
  }

  // `advanceSmoothly` for steps with impulses. Their length is constant, and shorter near
  // singularities.
  function advanceByImpulses(dt, until) {
    const distance = (a, b) => Math.max(...a.map((x, i) => Math.abs(x - b[i]) / data.scales[i]));
    let left = dt;
    while (left > END && performance.now() < until) {
      const det = chooseSet();
      const h = left / Math.ceil(left / step); // equal steps, the last of which ends at dt
      const q_dot = current.rates(robot.q, currentRates).slice(0, nq);
      const terms = termsOf(current, currentRates, wrenches(robot.q, q_dot));
      const end = terms && impulsiveStep(terms, h);
      let ahead = null; // q before the loops are closed
      if (end) {
        const rates = current.rates(robot.q, end.rates);
        ahead = robot.q.map((x, i) => x + h * rates[i]);
      }
      const next = ahead?.every(Number.isFinite) ? closed(ahead, current) : null;
      const after = next && newtonStep(current, next);
      const isSound = next && keepsMode(det, after.det)
        && distance(next, ahead) <= BEND * distance(next, robot.q) + 1e-9;
      if (isSound) {
        if (!(after.smallPivots <= 1)) return SINGULAR;
        accept(next, Array.from(end.rates), h);
        impulses = end.x;
        actingEfforts = end.efforts;
        motorsMoved = motorsMoved.map((x, k) => x + h * end.motorRates[k]);
        const contactForce = (_, k) => Array.from(end.x.slice(3 * k, 3 * k + 3), (x) => x / h);
        robot.contactForces = functions.nonsmooth.contacts.map(contactForce);
        robot.unsolved = !(end.residual <= impulsive.SOLVED);
        left -= h;
        step = Math.min(2 * step, LONGEST_STEP * fallTime);
      } else {
        step = 0.3 * h;
      }
      if (!(step > SHORTEST_STEP)) return TOO_SHORT;
    }
    return left;
  }

  start();
  return Object.assign(robot, {
    reset, start, move, follow, advance, goTo, gripped, push,
    value, condition, measure, rests, wrong,
    holds: Boolean(common.torques),
    keepsMotors: Boolean(common.torques || (impulsive && motors)),
    torques,
    accelerations: (q, va, tau) => valid(own.state_rate(q, va, tau, noWrenches), nq + n, nq),
    energies: () => Array.from(common.energies(robot.q, own.rates(robot.q, robot.va).subarray(nq))),
    places: () => placesOf(robot.q),
    point: (grip) => pointOf(placesOf(robot.q), grip),
  });
}
