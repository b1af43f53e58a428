"use strict";
// A robot that answers: it is posed by hand, or simulated after "Let go", by an `engine`
// (engine.js) with the robot's own functions, `sst_functions` (page_code.py). In this order:
// simulation and controls, drawing, words, frames, the hand. `load` starts with the data of
// live_data.py; `frame` is called for each frame of the page. The scene (`stage`), its `viewer` and
// helpers for the page (`at`, the element with an id; `escaped`, `breakable`) are in stage.js, and
// `chart` in chart.js.
const live = (() => {
  const THREE = MeshCat.THREE;
  const SHOWN = { rad: [180 / Math.PI, "deg"], m: [1000, "mm"] }; // factor and unit that are shown
  const FRAME_TIME = 12; // time of a frame for the simulation, [ms]
  const LONGEST_FRAME = 0.05; // a longer time between two frames is not simulated, [s]
  const FRAMES_PER_TEXT = 6; // words are written in each sixth frame
  const SHORTEST = 1e-3; // scale of arrows without a force: a scale of 0 has no inverse
  const Z = new THREE.Vector3(0, 0, 1);

  let data, robot; // the robot's data and engine
  let tau; // efforts of the motors that are shown
  let largest; // the largest effort so far by unit, which has the longest arrow
  let running = false; // whether it is simulated
  let resting = false; // whether no force moved it when the simulation began
  let pace = 1; // simulated time relative to real time
  let note = ""; // why the simulation ended
  let reason = ""; // why the last move by hand ended early
  let lastFrame = null, frames = 0; // time of the last frame, [ms], and their number
  let pressed = null; // the press of a pointer that grips a part

  // --- simulation and controls ---------------------------------------------------------------

  function run(on) {
    running = on;
    note = "";
    reason = "";
    lastFrame = null;
    pace = 1;
    resting = on && robot.rests();
    if (!on) robot.va = robot.va.map(() => 0);
    robot.start();
    at("go").textContent = on ? "Stop" : "Let go";
    inputsOf("sliders").forEach((input, k) => { input.disabled = on && isRate(k); });
    refresh();
  }

  function reset() {
    run(false);
    robot.reset();
    inputsOf("efforts").forEach((input) => { input.value = 0; });
    robot.start();
    refresh();
  }

  function load(next) {
    data = next;
    robot = engine(sst_functions, data);
    largest = {};
    const ways = { none: "off" };
    if (robot.keepsMotors) ways.hold = "hold";
    if (robot.efforts.length) ways.sliders = "by sliders";
    const option = ([way, text]) => `<option value="${way}">${text}</option>`;
    at("control").innerHTML = Object.entries(ways).map(option).join("");
    at("sliders").replaceChildren(...data.coordinates.map(({ name, low, high }, k) =>
      slider(name, low, high, (wanted) => setCoordinate(k, wanted))));
    inputsOf("sliders").forEach((input, k) => {
      if (!isRate(k)) return; // such a slider springs back when it is let go
      input.onpointerup = input.onpointercancel = input.onblur = () => { input.value = 0; };
    });
    at("efforts").replaceChildren(...data.motors.owners.map((name, k) => {
      const setEffort = (wanted) => { robot.efforts[k] = wanted; };
      return slider(`\u03c4 ${name}`, -data.largest[k], data.largest[k], setEffort);
    }));
    setControl();
    reset();
  }

  // A row with a name, a slider and room for its value.
  function slider(name, low, high, oninput) {
    const row = document.createElement("label"), label = document.createElement("span");
    const input = document.createElement("input");
    row.className = "slider";
    label.innerHTML = breakable(escaped(name));
    const options = { type: "range", min: low, max: high, step: "any", value: 0, ariaLabel: name };
    Object.assign(input, options);
    input.oninput = () => oninput(Number(input.value));
    row.append(label, input, document.createElement("output"));
    return row;
  }

  const inputsOf = (id) => [...at(id).children].map((row) => row.children[1]);

  // Whether coordinate k is one of several rates of a joint: it has no position, its slider is a
  // speed.
  const isRate = (k) => data.coordinates[k].kind === "rate";

  function setControl() {
    robot.way = at("control").value;
    at("efforts").hidden = robot.way !== "sliders";
    robot.goTo();
  }

  // The slider of coordinate k was moved: move the robot by hand, or in a simulation the goal of
  // "hold".
  function setCoordinate(k, wanted) {
    if (isRate(k)) return; // it moves in each frame, by `moveBySpeeds`
    const turn = 2 * Math.PI;
    let ahead = wanted - robot.value(k);
    const isAngle = data.coordinates[k].kind === "angle";
    if (isAngle) ahead -= turn * Math.round(ahead / turn); // the shorter way round
    if (running && robot.way === "hold") {
      robot.goTo(k, ahead);
      return;
    }
    run(false);
    reason = robot.move(robot.va.map((_, j) => j === k ? ahead : 0));
    refresh();
  }

  function refresh() {
    draw();
    tell();
  }

  // --- drawing -------------------------------------------------------------------------------

  function draw() {
    const places = robot.places();
    // The matrix that places body j; three.js wants it row by row. `stage.place` takes the path of
    // a node in the scene, a list of names.
    const M = (j) => {
      const row = (i) => [0, 3, 6, 9].map((column) => places[12 * j + column + i]);
      return new THREE.Matrix4().set(...row(0), ...row(1), ...row(2), 0, 0, 0, 1);
    };
    tau = robot.measure(running);
    for (let j = 1; j < data.bodies.length; j++) stage.place([String(j)], M(j));
    drawStruts(M);
    drawTorques();
    drawContacts(M);
    drawHand();
  }

  // Struts lie between two points of bodies; their shapes are 1 m long, along z.
  function drawStruts(M) {
    for (const { node, joints, points } of data.struts) {
      const [a, b] = joints.map((j, k) => new THREE.Vector3(...points[k]).applyMatrix4(M(j)));
      const along = b.clone().sub(a);
      const turn = new THREE.Quaternion().setFromUnitVectors(Z, along.clone().normalize());
      const scale = new THREE.Vector3(1, 1, along.length());
      stage.place([node], new THREE.Matrix4().compose(a, turn, scale));
    }
  }

  // Arrows of the motors. Their lengths grow with the square root of the effort. `node` is a path.
  // `share` is the part of the motor's effort that acts on the joint of the arrow, relative to its
  // largest part; it may be negative. An arrow of a negative effort is scaled by `mirror`, which
  // reverses it.
  function drawTorques() {
    const { units } = data.motors;
    units.forEach((unit, k) => {
      largest[unit] = Math.max(largest[unit] || 1e-9, Math.abs(tau[k]));
    });
    for (const { node, at: base, motor, share, mirror } of data.arrows) {
      const size = share * tau[motor] / largest[units[motor]];
      const length = Math.max(Math.sqrt(Math.abs(size)), SHORTEST);
      const scale = new THREE.Vector3(...(size < 0 ? mirror : [1, 1, 1])).multiplyScalar(length);
      stage.place(node, new THREE.Matrix4().fromArray(base).scale(scale));
    }
  }

  // Points that touch a ground, and arrows of the forces on them; the longest arrow is the robot's
  // weight. An arrow begins at the point if `start` is 0, and ends there if `start` is its length.
  // Where `start` is null, a mark of the point stands for the arrow.
  function drawContacts(M) {
    for (const { node, body, at: centre, ground, axes, radius } of data.touches) {
      const place = M(ground).multiply(new THREE.Matrix4().fromArray(axes));
      const normal = new THREE.Vector3().setFromMatrixColumn(place, 2);
      const point = new THREE.Vector3(...centre).applyMatrix4(M(body));
      stage.place([node], place.setPosition(point.addScaledVector(normal, -radius)));
    }
    for (const { node, at: base, touch, start } of data.forces) {
      const force = new THREE.Vector3(...(robot.contactForces[touch] || [0, 0, 0]));
      const share = Math.min(1, force.length() / data.weight), hasForce = share > 1e-6;
      const turn = new THREE.Quaternion().setFromUnitVectors(Z, hasForce ? force.normalize() : Z);
      const away = new THREE.Vector3();
      let length = hasForce ? Math.max(Math.sqrt(share), SHORTEST) : SHORTEST;
      if (start === null) length = hasForce ? 1 : SHORTEST; // the mark of a point, of one size
      else away.set(0, 0, -start * length).applyQuaternion(turn);
      const scale = new THREE.Vector3(length, length, length);
      const placed = new THREE.Matrix4().compose(away, turn, scale);
      stage.place(node, new THREE.Matrix4().fromArray(base).multiply(placed));
    }
  }

  // A line from the gripped point to the hand, or against the direction of a push.
  function drawHand() {
    const { grip } = robot;
    handLine.visible = Boolean(grip);
    if (!grip) return;
    const p = robot.point(grip);
    let end = grip.target;
    if (!end) {
      const length = 0.4 * data.size / Math.hypot(...grip.force);
      end = p.map((x, i) => x - length * grip.force[i]);
    }
    const ends = new THREE.Float32BufferAttribute([...p, ...end], 3);
    handLine.geometry.setAttribute("position", ends);
  }

  // --- words ---------------------------------------------------------------------------------

  function shown(x, unit) {
    const [factor, text] = SHOWN[unit];
    return `${chart.readable(factor * x, 1)} ${text}`;
  }

  function tell() {
    const [ofRates, potential] = robot.energies();
    const kinetic = running ? ofRates : 0; // a pose is held at rest
    const problems = problemsNow();
    const lines = [
      ...listItems(problems, ""),
      ...listItems(factsNow(problems, kinetic), "well"),
    ];
    at("told").replaceChildren(...lines);
    tellEnergy(kinetic, potential);
    tellSliders();
  }

  function problemsNow() {
    const isSingular = (text) => text.startsWith("close to a singularity");
    const problems = robot.wrong(shown, tau);
    const isKnown = isSingular(reason) && problems.some(isSingular); // the pose says the same
    if (reason && !isKnown) problems.unshift(`stopped: ${reason}`);
    if (note) problems.unshift(note);
    return problems;
  }

  function factsNow(problems, kinetic) {
    const facts = [];
    if (running) {
      const slow = pace < 0.9 ? `, at ${pace.toFixed(2)} of real time` : "";
      facts.push(`t = ${robot.time.toFixed(1)} s${slow}`);
    } else if (!robot.holds) {
      const counts = `${tau.length} motors do not hold ${robot.va.length} coordinates`;
      facts.push(`${counts}: no torques at rest`);
    } else if (!problems.length) {
      facts.push("loops closed, not singular; the torques below hold this pose");
    }
    if (resting && !kinetic) {
      facts.push("no force moves this robot at rest: drag a part, or drive its motors");
    }
    return facts;
  }

  const listItems = (texts, className) => texts.map((textContent) =>
    Object.assign(document.createElement("li"), { textContent, className }));

  function tellEnergy(kinetic, potential) {
    const size = Math.abs(kinetic) + Math.abs(potential) + 1e-3;
    const digits = Math.min(3, Math.max(0, 3 - Math.floor(Math.log10(size)))); // four in all
    const written = (x) => chart.readable(x, digits);
    const sum = `kinetic ${written(kinetic)} + potential ${written(potential)}`;
    at("energy").textContent = `energy: ${sum} = ${written(kinetic + potential)} J`;
  }

  function tellSliders() {
    [...at("sliders").children].forEach(({ children: [, input, output] }, k) => {
      if (isRate(k)) return;
      if (document.activeElement !== input) input.value = robot.value(k);
      output.textContent = shown(robot.value(k), data.coordinates[k].unit);
    });
    [...at("efforts").children].forEach(({ children: [, , output] }, k) => {
      output.textContent = `${chart.readable(robot.efforts[k], 2)} ${data.motors.units[k]}`;
    });
  }

  // --- frames --------------------------------------------------------------------------------

  // `now` is the time of the frame, [ms].
  function frame(now) {
    const passed = lastFrame === null ? 0 : (now - lastFrame) / 1000;
    const dt = Math.min(passed, LONGEST_FRAME), before = robot.q;
    lastFrame = now;
    if (running) {
      if (dt > 0) simulate(dt);
    } else {
      if (robot.grip?.target) reason = robot.follow();
      moveBySpeeds(dt);
    }
    if (!running && !robot.grip && robot.q === before) return;
    draw();
    frames += 1;
    if (frames % FRAMES_PER_TEXT === 0 || !running) tell();
  }

  function simulate(dt) {
    const left = robot.advance(dt, performance.now() + FRAME_TIME);
    if (typeof left === "string") { // it ended
      run(false);
      note = left;
      tell();
    } else {
      pace += 0.1 * ((dt - left) / dt - pace);
    }
    const { grip } = robot, pushEnds = grip && !grip.target && robot.time >= grip.until;
    if (pushEnds) robot.grip = null;
  }

  // Sliders of rates move the robot by hand while they are held. They have the range of a position,
  // a turn or some lengths of the robot, and half of their value is the speed, per second.
  function moveBySpeeds(dt) {
    const change = inputsOf("sliders").map((input, k) =>
      isRate(k) ? dt * Number(input.value) / 2 : 0);
    if (change.some(Boolean)) reason = robot.move(change);
  }

  // --- the hand ------------------------------------------------------------------------------

  const CLICK = { distance: 6, time: 400 }; // a shorter press is a push, [px] and [ms]
  const AROUND = [[0, 0], [9, 0], [-9, 0], [0, 9], [0, -9]]; // places around a pointer, [px]
  const pane = at("pane");
  const handLine = new THREE.Line(
    new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xb00020, depthTest: false }),
  );
  handLine.frustumCulled = handLine.visible = false;
  viewer.scene.add(handLine);

  // The point of a body under a pointer or close to it: { body, at, from, ray }. `at` is in the
  // axes of the body, `from` in base axes, `ray` the direction of the view. It is null if there is
  // none.
  function gripAt({ clientX, clientY }) {
    for (const [x, y] of AROUND) {
      const hit = stage.hit(clientX + x, clientY + y);
      const strut = hit && data.struts.find(({ node }) => node === hit.mover);
      const body = strut ? Math.max(...strut.joints) : Number(hit?.mover);
      if (!(body > 0)) continue;
      const M = robot.places().slice(12 * body); // axes, then the origin
      const away = hit.point.map((p, i) => p - M[9 + i]);
      const inBody = [0, 3, 6].map((axis) =>
        M[axis] * away[0] + M[axis + 1] * away[1] + M[axis + 2] * away[2]);
      return { body, at: inBody, from: hit.point, ray: hit.ray };
    }
    return null;
  }

  // The listeners come before Meshcat's, which turn the view.
  pane.addEventListener("pointerdown", (event) => {
    const isLive = document.body.classList.contains("live");
    const grip = isLive && !pressed && !event.button && gripAt(event);
    if (!grip) return;
    event.stopPropagation(); // the view stays
    pane.setPointerCapture(event.pointerId);
    pressed = {
      id: event.pointerId, x: event.clientX, y: event.clientY, when: event.timeStamp,
      from: grip.from, ray: grip.ray,
    };
    robot.gripped(grip);
    robot.grip.target = grip.from;
  }, true);

  pane.addEventListener("pointermove", (event) => {
    if (pressed?.id !== event.pointerId || !robot.grip) return;
    robot.grip.target = stage.inPlane(event.clientX, event.clientY, pressed.from);
  }, true);

  function release(event) {
    if (pressed?.id !== event.pointerId) return;
    const distance = Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y);
    const isClick = distance < CLICK.distance && event.timeStamp - pressed.when < CLICK.time;
    if (robot.grip && running && isClick && event.type === "pointerup") robot.push(pressed.ray);
    else robot.grip = null;
    pressed = null;
    refresh();
  }
  pane.addEventListener("pointerup", release, true);
  pane.addEventListener("pointercancel", release, true);

  at("go").onclick = () => run(!running);
  at("again").onclick = reset;
  at("control").onchange = setControl;
  return {
    load, frame, run, reset, refresh,
    get robot() { return robot; },
    get running() { return running; },
    get motors() { return data.motors; },
    get tau() { return tau; },
  };
})();
