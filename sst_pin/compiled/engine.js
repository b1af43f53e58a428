// SPDX-License-Identifier: BSD-2-Clause
// A robot that moves by its own functions. `move` and `follow` move it by hand: the coordinates in small
// steps, and after each one Newton's method closes the loops. `advance` moves it in time: it integrates
// the direct dynamics by the method of Dormand and Prince, or, for a robot with contacts or ropes, makes
// the steps of `nonsmooth`.
// `functions` are those of `page_code`, `data` is from `live_data`. The result is the state of the robot
// with the functions that change it. Lengths are free of units where they are divided by the robot's.
function engine(functions, data) {
  "use strict";

  // --- constants -----------------------------------------------------------------------------
  // A fall is one from rest by the robot's length, under its gravity.

  const MOVE_STEP = 0.02; // longest step of a coordinate by hand, [rad] or robot lengths
  const JUMP = 0.1; // a correction of q by more, [rad] or robot lengths, changes the assembly mode
  const DET_CHANGE = 3; // largest factor of det Phi_u in a step: its sign changes at a singularity
  const GOOD_PIVOTS = 1e-3; // the robot's own coordinates suit a pose with this check of small pivots
  const BETTER_PIVOTS = 16; // others are chosen where their check is smaller by this factor
  const TOLERANCE = 1e-7; // relative error of a step in time
  const FIRST_STEP = 1e-3, SHORTEST_STEP = 1e-7, END = 1e-12; // [s]; a rest shorter than END is rounding
  const HOLD_FREQUENCY = 12; // of the coordinates with "hold", critically damped, [rad/s]
  const PUSH_TIME = 0.1; // [s]
  const STOP_FREQUENCY = 20; // of the spring of a stop, relative to 1 / time of a fall
  const STOP_BUFFER = 0.005; // distance from a limit at which its spring begins, [rad] or robot lengths
  const SMOOTH = 0.01; // width of Coulomb friction without one, [rad/s]: a jump stops an integrator
  const SIGN_WIDTH = 3; // index of this width in the symbolic parameters
  // Steps with impulses.
  const LONGEST_STEP = 5e-3; // in times of a fall
  const BEND = 0.25; // largest correction of q that closes the loops, relative to the step
  const RISE = 0.1; // speed that lifts what starts below its ground, in speeds of a fall
  const HOLD_STIFFNESS = 20; // of motors with "hold", in robot weights at the robot's length per rad
  const HOLD_DAMPING = 0.3; // damping over stiffness, in times of a fall

  const SINGULAR = "the simulation stopped close to a singularity";
  const TOO_SHORT = `${SINGULAR}, where its steps became too short`;

  const nq = data.q.length, n = data.coordinates.length, motors = data.motors.names.length;
  const fall = Math.sqrt(data.size / data.fall); // time of a fall, [s]
  const scale = data.coordinates.map((each) => each.scale); // units of the coordinates
  const zeros = (size) => new Array(size).fill(0);
  const unitVector = (size, k) => Array.from({ length: size }, (_, j) => Number(j === k));
  const turned = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI)); // to [-pi, pi]
  const largest = (change) => Math.max(0, ...change.map((x, k) => Math.abs(x) / scale[k]));
  const noTorques = zeros(motors), noRates = zeros(n);
  const noWrenches = zeros(6 * (data.bodies.length - 1)); // [force; moment] of each body

  // --- kernels -------------------------------------------------------------------------------

  // A kernel as a function of its input arrays. It returns its outputs, and behind them its checks, in an
  // array that the next call overwrites.
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
  // The dynamics in several choices of coordinates and pivots; the first has the robot's own coordinates.
  // `rates(q, va)` of a set are those of q, then those of all joints.
  const sets = functions.sets.map(({ coordinates, parts, layout, kernels }) => ({
    coordinates,
    parts,
    layout,
    ...bindAll(kernels),
    closingOutputs: kernels.closing.output,
    termsOutputs: kernels.terms?.output,
  }));
  const own = sets[0];
  const impulsive = functions.nonsmooth && nonsmooth(functions.nonsmooth, RISE * data.size / fall);

  // One step of Newton's method onto the closures, with the coordinates of a set held: q after it; of q
  // before it det Phi_u (Phi_u are the columns of Phi for the dependent rates), and two checks, which are
  // at most 1 where the loops are closed and where pivots are not small.
  function newtonStep(set, q) {
    const y = set.closing(q), checks = set.closingOutputs;
    return { next: y.subarray(0, nq), det: y[nq], gap: y[checks], smallPivots: y[checks + 1] };
  }

  // Whether det Phi_u changes little enough to stay in the assembly mode.
  const keepsMode = (before, after) => after / before > 1 / DET_CHANGE && after / before < DET_CHANGE;

  // Whether the checks behind the outputs of a kernel pass. The first check is that the loops are
  // closed, which they are not within a step of an integrator: it does not count.
  const checksPass = (y, outputs) => y.subarray(outputs + 1).every((check) => check <= 1);

  // Some outputs of a kernel; NaN if a check fails.
  function valid(y, outputs, first = 0) {
    const isGood = checksPass(y, outputs);
    return Array.from(y.subarray(first, outputs), (x) => isGood ? x : NaN);
  }

  const torques = (q, va, aa) => valid(common.torques(q, va, aa, noWrenches), motors);
  const holdingTorques = () => torques(robot.q, noRates, noRates);
  const finite = (x) => Number.isFinite(x) ? x : 0;

  // --- the state -----------------------------------------------------------------------------

  // `way` is how the motors are driven: "none", "hold", or "sliders" with these efforts. A grip is a hand
  // at a point of a body; it has a target, which it pulls the point to, or a force until some time.
  const robot = {
    q: data.q.slice(),
    va: data.va.slice(),
    time: 0,
    way: "none",
    efforts: zeros(motors),
    grip: null,
    contactForces: [],
  };

  // Back to the first state; `start` has to follow.
  function reset() {
    robot.q = data.q.slice();
    robot.va = data.va.slice();
    robot.time = 0;
    robot.grip = null;
    robot.efforts = zeros(motors);
  }

  // Position of a coordinate.
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

  // Condition number of Phi_u: the worst of its parts, which share no rate.
  function condition(q = robot.q) {
    const Phi = common.loops(q);
    return Math.max(1, ...own.parts.map((part) => conditionOf(Phi, part.rates, part.size)));
  }

  // Condition number of some columns of Phi; the largest singular value counts as at least `size`.
  function conditionOf(Phi, columns, size) {
    const product = (i, j) => {
      let sum = 0;
      for (let k = 0; k < Phi.length; k += data.nv) sum += Phi[k + i] * Phi[k + j];
      return sum;
    };
    const squares = eigenvalues(columns.map((i) => columns.map((j) => product(i, j))));
    return Math.sqrt(Math.max(...squares, size * size) / Math.max(Math.min(...squares), 0));
  }

  // Eigenvalues of a symmetric matrix by Jacobi's rotations, in place.
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

  const nearSingularity = (x) => `close to a singularity, condition number ${Number(x.toPrecision(3))}`;

  // --- by hand -------------------------------------------------------------------------------

  // The name of a joint that is further beyond its limits at `after` than at `before`.
  function reachedLimit(before, after) {
    const beyond = (q, { i, low, high }) => Math.max(low - q[i], q[i] - high, 0);
    const isFurther = (bound) => beyond(after, bound) > beyond(before, bound) + 1e-12;
    return data.bounds.find((bound) => bound.what === "limits" && isFurther(bound))?.name;
  }

  // Move the coordinates as far as they lead within one assembly mode and the limits. Returns what ends
  // the move, or no text.
  function move(change) {
    const count = Math.max(1, Math.ceil(largest(change) / MOVE_STEP));
    const part = change.map((x) => x / count);
    let before = condition(), det = newtonStep(own, robot.q).det;
    for (let k = 0; k < count; k++) {
      const rates = own.rates(robot.q, part);
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
      if (!(detAfter / det > 1 / DET_CHANGE) || !isRegular) return nearSingularity(Math.max(before, after));
      robot.q = next;
      before = after;
      det = detAfter;
    }
    return "";
  }

  // `places` of the kernel has 12 numbers for each body: its axes, one after the other, and its origin.
  function pointOf(places, { body, at }) {
    const R = 12 * body, p = R + 9;
    const coordinate = (i) =>
      places[p + i] + places[R + i] * at[0] + places[R + 3 + i] * at[1] + places[R + 6 + i] * at[2];
    return [0, 1, 2].map(coordinate);
  }

  // `flow` is the rate of `places`.
  const velocityOf = (grip, q, q_dot) => pointOf(common.flow(q, q_dot), grip);

  // The velocities of a point for unit rates of the coordinates: the columns of its Jacobian.
  function jacobianColumns(grip) {
    const ratesFor = (k) => own.rates(robot.q, unitVector(n, k)).slice(0, nq);
    return robot.va.map((_, k) => velocityOf(grip, robot.q, ratesFor(k)));
  }

  // A x = b with three rows and a symmetric A, by Cramer's rule: its rows are also its columns.
  function solvedByCramer(A, b) {
    const dot = (x, y) => x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    const cross = (x, y) =>
      [0, 1, 2].map((i) => x[(i + 1) % 3] * y[(i + 2) % 3] - x[(i + 2) % 3] * y[(i + 1) % 3]);
    const det = (x, y, z) => dot(x, cross(y, z));
    const whole = det(A[0], A[1], A[2]);
    return [det(b, A[1], A[2]), det(A[0], b, A[2]), det(A[0], A[1], b)].map((x) => x / whole);
  }

  // Move a gripped point towards its target by damped least squares: with the squared units S of the
  // coordinates and the distance b, they change by S J^T (J S J^T + damping 1)^-1 b.
  function follow() {
    const damping = (0.05 * data.size) ** 2;
    const at = pointOf(common.places(robot.q), robot.grip), J = jacobianColumns(robot.grip);
    const entry = (i, j) => J.reduce((sum, c, k) => sum + c[i] * scale[k] ** 2 * c[j], i === j ? damping : 0);
    const A = [0, 1, 2].map((i) => [0, 1, 2].map((j) => entry(i, j))); // symmetric
    const force = solvedByCramer(A, robot.grip.target.map((x, i) => x - at[i]));
    const along = (c) => c[0] * force[0] + c[1] * force[1] + c[2] * force[2];
    const change = J.map((c, k) => scale[k] ** 2 * along(c));
    const share = Math.min(1, 0.1 / (largest(change) || 1)); // in one frame 0.1 rad or robot lengths
    return move(change.map((x, k) => onSlider(k, share * x)));
  }

  // A change of a coordinate as far as its slider goes; one that is beyond its end may come back.
  function onSlider(k, change) {
    const { kind, low, high } = data.coordinates[k];
    if (kind !== "position") return change;
    const x = value(k);
    return Math.min(Math.max(x + change, Math.min(low, x)), Math.max(high, x)) - x;
  }

  // --- what the pose is like -----------------------------------------------------------------

  // In words, what a pose is that the machine cannot take, and which motors are beyond their largest
  // efforts; `shown` writes a number with its unit.
  function wrong(shown, tau) {
    const words = [...leftRanges(shown), ...largeEfforts(tau)];
    const number = condition();
    if (!(number <= data.condition)) words.push(nearSingularity(number));
    if (robot.unsolved) words.push("forces of contacts are not solved to 1e-9");
    if (robot.holds && !holdingTorques().every(Number.isFinite)) words.push("the motors do not hold this pose");
    if (!(newtonStep(own, robot.q).gap <= 1)) words.unshift("the loops are open");
    return words;
  }

  function leftRanges(shown) {
    const words = [];
    for (const { name, unit, i, what, low, high } of data.bounds) {
      const middle = (low + high) / 2;
      // On an arc, whole turns do not count.
      const x = what === "arc" ? middle + turned(robot.q[i] - middle) : robot.q[i];
      if (!(x < low || x > high)) continue;
      words.push(
        `${name} leaves its ${what} of ${shown(low, unit)} to ${shown(high, unit)}: ${shown(robot.q[i], unit)}`,
      );
    }
    return words;
  }

  function largeEfforts(tau) {
    const { owners, units, limits } = data.motors, words = [];
    tau.forEach((x, k) => {
      if (limits[k] === null || !(Math.abs(x) > limits[k])) return;
      words.push(`${owners[k]} is beyond its effort limit of ${Number(limits[k].toPrecision(3))} ${units[k]}`);
    });
    return words;
  }

  // Efforts of the motors: those that act, or those that hold the pose.
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
    const rounding = 1e-9 * data.fall / data.size;
    return robot.way !== "hold" && aa.every((x, k) => Math.abs(x) < rounding * scale[k]);
  }

  // --- wrenches ------------------------------------------------------------------------------

  // Wrenches on the bodies besides those of the motors, [force; moment] about their mass centres: of the
  // hand and, without impulses, of the stops.
  function wrenches(q, q_dot) {
    const W = noWrenches.slice();
    addHand(W, q, q_dot);
    for (const stop of impulsive ? [] : data.stops) {
      const force = stopForce(stop, q, q_dot);
      if (force) addAlongJoint(W, common.places(q).slice(), stop, force);
    }
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

  // Add a force along the axis of a joint, or a moment about it: on its body, the opposite on the parent.
  function addAlongJoint(W, places, { body, parent, turns, axis }, size) {
    const origin = pointOf(places, { body, at: [0, 0, 0] });
    const along = pointOf(places, { body, at: axis }).map((x, i) => size * (x - origin[i]));
    for (const [link, sign] of [[body, 1], [parent, -1]]) {
      if (!link) continue; // the ground
      if (turns) along.forEach((x, i) => { W[6 * link - 3 + i] += sign * x; });
      else addForce(W, places, link, origin, along.map((x) => sign * x));
    }
  }

  // Add the force of the hand: a spring to the target with a damping of 0.7 times the critical one, or a
  // push.
  function addHand(W, q, q_dot) {
    const { grip } = robot;
    if (!grip || !(grip.target || robot.time < grip.until)) return;
    const places = common.places(q).slice(), p = pointOf(places, grip);
    let { force } = grip;
    if (grip.target) {
      const { target, mass, pull } = grip, speed = velocityOf(grip, q, q_dot);
      force = p.map((x, i) => mass * (pull ** 2 * (target[i] - x) - 1.4 * pull * speed[i]));
    }
    addForce(W, places, grip.body, p, force);
  }

  // A stop is a spring with critical damping. Its stiffness per inertia:
  const stopStiffness = (STOP_FREQUENCY ** 2 * data.fall) / data.size;
  let stopInertias = new Map(); // of the stops that act, from one frame to the next

  // Force of a stop on its joint. It begins a little before the limit, and only pushes.
  function stopForce(stop, q, q_dot) {
    const { i, low, high } = stop;
    const buffer = Math.min(STOP_BUFFER * data.scales[i], (high - low) / 8);
    const below = low + buffer - q[i], above = q[i] - high + buffer;
    if (below <= 0 && above <= 0) return 0;
    const depth = below > 0 ? below : above, sense = below > 0 ? 1 : -1;
    if (!stopInertias.has(stop)) stopInertias.set(stop, inertiaAlong(stop, q));
    const push = stopStiffness * depth - 2 * Math.sqrt(stopStiffness) * sense * q_dot[i];
    return sense * stopInertias.get(stop) * Math.max(0, push);
  }

  // Inertia that a force along a joint feels: that of the whole robot, at rest.
  function inertiaAlong(stop, q) {
    const W = noWrenches.slice();
    addAlongJoint(W, common.places(q).slice(), stop, 1);
    const accelerations = (loads) =>
      Array.from(current.state_rate(q, noRates, noTorques, loads).subarray(nq, nq + n));
    const free = accelerations(noWrenches), pressed = accelerations(W);
    const aa = free.map((x, k) => pressed[k] - x);
    return 1 / Math.max(current.rates(q, aa)[stop.i], 1e-12);
  }

  // A body is gripped at a point: the mass that the hand feels there, and the frequency of its spring.
  function gripped(grip) {
    const J = jacobianColumns(grip), places = common.places(robot.q).slice(), p = pointOf(places, grip);
    const accelerations = (W) => own.state_rate(robot.q, robot.va, noTorques, W).slice(nq, nq + n);
    const free = accelerations(noWrenches);
    // The acceleration along each axis by a unit force along it is the reciprocal of a mass.
    const responses = [0, 1, 2].map((i) => {
      const W = noWrenches.slice();
      addForce(W, places, grip.body, p, unitVector(3, i));
      const pushed = accelerations(W);
      return J.reduce((sum, c, k) => sum + c[i] * (pushed[k] - free[k]), 0);
    });
    const mass = 1 / Math.max(...responses, 1e-9);
    robot.grip = { ...grip, mass, pull: Math.sqrt(Math.max(150, 10 * data.fall / data.size)) }; // [rad/s]
  }

  // Push along a ray, as hard as gives the gripped mass the speed of a fall.
  function push(ray) {
    const size = robot.grip.mass * Math.sqrt(data.fall * data.size) / PUSH_TIME;
    const force = ray.map((x) => size * x);
    robot.grip = { ...robot.grip, target: null, force, until: robot.time + PUSH_TIME };
  }

  // --- in time -------------------------------------------------------------------------------

  // A simulation goes on in the `current` set of coordinates, with these rates, and a `step` in [s]. `moved`
  // is how far the robot's own coordinates have come, and `goal` how far they shall, with "hold".
  let current, currentRates, step, moved, goal;

  function start() {
    current = own;
    currentRates = robot.va.slice();
    moved = zeros(n);
    goal = zeros(n);
    step = impulsive ? LONGEST_STEP * fall : FIRST_STEP;
    robot.contactForces = [];
    robot.unsolved = false;
    if (impulsive) startImpulses();
  }

  // Go on by dt, or as far as the clock allows, `until`. Returns the time that is left, or words if the
  // motion ends.
  function advance(dt, until = Infinity) {
    return impulsive ? advanceByImpulses(dt, until) : advanceSmoothly(dt, until);
  }

  // For "hold": let coordinate k go ahead, or all stay.
  function goTo(k, ahead) {
    if (impulsive) moveMotorGoals(k, ahead);
    else if (k === undefined) goal = moved?.slice();
    else goal[k] = moved[k] + ahead;
  }

  // Choose coordinates and pivots for the pose: the robot's own, or others if their pivots are much larger.
  function chooseSet() {
    const checks = sets.map((set) => {
      const { smallPivots } = newtonStep(set, robot.q);
      return Number.isFinite(smallPivots) ? smallPivots : Infinity;
    });
    const least = Math.min(...checks);
    let wanted = current;
    if (checks[0] < GOOD_PIVOTS) wanted = own;
    else if (BETTER_PIVOTS * least < checks[sets.indexOf(current)]) wanted = sets[checks.indexOf(least)];
    if (wanted === current) return;
    const v = Array.from(current.rates(robot.q, currentRates)).slice(nq);
    current = wanted;
    currentRates = wanted.coordinates.map((j) => v[j]);
  }

  // The robot is at q after a step of length h, with rates of the current coordinates.
  function accept(q, rates, h) {
    const v = current.rates(q, rates).subarray(nq);
    robot.q = q;
    currentRates = rates;
    robot.va = own.coordinates.map((j) => v[j]);
    robot.time += h;
  }

  // --- smooth steps --------------------------------------------------------------------------

  // Efforts of the motors; with "hold" those of a critically damped spring between coordinates and goals.
  function drivenEfforts(q, va, displacement) {
    if (robot.way !== "hold") return sliderEfforts();
    const aa = goal.map((to, k) => HOLD_FREQUENCY ** 2 * (to - displacement[k]) - 2 * HOLD_FREQUENCY * va[k]);
    return torques(q, noRates, aa);
  }

  // The rate of a state: of q, of the rates of the current coordinates, and of `moved`.
  function derivative(state) {
    const q = state.slice(0, nq), rates = state.slice(nq, nq + n), displacement = state.slice(nq + n);
    const allRates = Array.from(current.rates(q, rates)), q_dot = allRates.slice(0, nq);
    const va = own.coordinates.map((j) => allRates[nq + j]);
    const W = wrenches(q, q_dot), tau = drivenEfforts(q, va, displacement);
    return [...current.state_rate(q, rates, tau, W).subarray(0, nq + n), ...va];
  }

  // Dormand and Prince's method of order 5: coefficients of the stages, the last of which is the end of the
  // step, and of the estimate of the error.
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

  // The state after a step of length h, and its error: at most 1 if it is good enough.
  function tried(h) {
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
      if (sets.length > 1) chooseSet();
      const h = Math.min(step, left);
      const { det } = newtonStep(current, robot.q);
      const { end, error } = tried(h);
      const factor = Math.max(0.2, 0.9 * error ** -0.2); // of the next step, by the order of the error
      const next = error <= 1 ? closed(end.slice(0, nq), current) : null;
      const after = next && newtonStep(current, next);
      if (next && keepsMode(det, after.det)) {
        if (!(after.smallPivots <= 1)) return SINGULAR;
        accept(next, end.slice(nq, nq + n), h);
        moved = end.slice(nq + n);
        left -= h;
        if (h === step) step = h * Math.min(4, factor);
      } else {
        step = h * (error > 1 ? factor : 0.3);
      }
      if (!(step > SHORTEST_STEP)) return TOO_SHORT;
    }
    return left;
  }

  // --- steps with impulses -------------------------------------------------------------------
  // A robot with contacts or ropes makes the steps of `nonsmooth`: they have its stops, cables and dry
  // friction too.

  let impulses, actingEfforts; // of the last step
  let limits; // of the stops
  let motorsMoved, motorGoals; // how far the motors have come, and how far they shall with "hold"
  let goals; // where the coordinates then are

  // "hold" keeps motors in place by stiffness and damping; winches of cables have none.
  const stiffness = zeros(motors).map((_, k) => {
    if (functions.nonsmooth?.cables.some(({ shares }) => shares[k])) return 0;
    const perUnit = data.motors.units[k] === "N m" ? data.size : 1 / data.size;
    return HOLD_STIFFNESS * data.weight * perUnit;
  });

  function startImpulses() {
    impulses = impulsive.none();
    // A start beyond a limit moves the limit there.
    limits = functions.nonsmooth.stops.map(({ position, side, limit }) => {
      const furthest = side > 0 ? Math.min : Math.max;
      return furthest(limit, robot.q[position]);
    });
    actingEfforts = zeros(motors);
    motorsMoved = zeros(motors);
    moveMotorGoals();
  }

  // The terms of a step, or null if one of their checks fails.
  function termsOf(set, rates, W) {
    const y = set.terms(robot.q, rates, W);
    return checksPass(y, set.termsOutputs) ? impulsive.read(set.layout, y) : null;
  }

  // Rates of the motors by those of the coordinates: the last rows of implicit forces.
  const motorRows = ({ implicit }) => implicit.slice(implicit.length - motors);

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

  // Gains of the motors, and their efforts at the beginning of a step without damping.
  function motorControl() {
    const isHeld = robot.way === "hold";
    const gains = { stiffness: isHeld ? stiffness : zeros(motors) };
    gains.damping = gains.stiffness.map((x) => HOLD_DAMPING * fall * x);
    let efforts = sliderEfforts();
    if (isHeld && robot.holds) efforts = holdingTorques().map(finite); // which know of no contacts
    efforts = efforts.map((x, k) => x + gains.stiffness[k] * (motorGoals[k] - motorsMoved[k]));
    return { gains, efforts };
  }

  // The end of a step of length h: rates of the current coordinates, impulses and their residual, rates
  // and efforts of the motors; null where there is no solution.
  function impulsiveStep(terms, h) {
    const { gains, efforts } = motorControl();
    const state = { q: robot.q, va: currentRates, efforts, gains, limits, h, start: impulses };
    const end = impulsive.step(terms, state);
    if (!end) return null;
    const motorRates = motorRows(terms).map((row) => row.reduce((sum, x, i) => sum + x * end.rates[i], 0));
    const damped = efforts.map((x, k) => x - (gains.damping[k] + h * gains.stiffness[k]) * motorRates[k]);
    return { ...end, motorRates, efforts: damped };
  }

  // As `advanceSmoothly`, by steps of one length, which are shorter near singularities.
  function advanceByImpulses(dt, until) {
    const distance = (a, b) => Math.max(...a.map((x, i) => Math.abs(x - b[i]) / data.scales[i]));
    let left = dt;
    while (left > END && performance.now() < until) {
      if (sets.length > 1) chooseSet();
      const h = left / Math.ceil(left / step);
      const { det } = newtonStep(current, robot.q);
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
        step = Math.min(2 * step, LONGEST_STEP * fall);
      } else {
        step = 0.3 * h;
      }
      if (!(step > SHORTEST_STEP)) return TOO_SHORT;
    }
    return left;
  }

  start();
  return Object.assign(robot, {
    reset, move, value, condition, measure, follow, start, advance, goTo, gripped, push, rests, wrong,
    holds: Boolean(common.torques),
    keepsMotors: Boolean(common.torques || (impulsive && motors)),
    torques,
    accelerations: (q, va, tau) => valid(own.state_rate(q, va, tau, noWrenches), nq + n, nq),
    energies: () => Array.from(common.energies(robot.q, own.rates(robot.q, robot.va).subarray(nq))),
    places: () => common.places(robot.q),
    point: (grip) => pointOf(common.places(robot.q), grip),
  });
}
