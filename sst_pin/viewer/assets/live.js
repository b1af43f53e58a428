"use strict";
// The robot that answers: posed by hand or simulated by an `engine` with its own functions.
const live = (() => {
  const THREE = MeshCat.THREE, SHOWN = { rad: [180 / Math.PI, "deg"], m: [1000, "mm"] };
  const BUDGET = 12; // ms of a frame
  let d, r, tau, most, running = false, resting = false, pace = 1, reason = "", note = "", last = null, seen = 0, pressed = null;
  const numbers = (id) => [...at(id).children].map((row) => row.children[1]);
  const listed = (words, kind) => words.map((textContent) => Object.assign(document.createElement("li"), { textContent, className: kind }));

  function run(on) {
    [running, note, reason, last, pace, resting] = [on, "", "", null, 1, on && r.rests()];
    if (!on) r.va = r.va.map(() => 0);
    r.start();
    at("go").textContent = on ? "Stop" : "Let go";
    numbers("sliders").forEach((input, k) => { input.disabled = on && d.coordinates[k].kind === "rate"; });
    refresh();
  }

  function reset() {
    run(false);
    r.reset();
    numbers("efforts").forEach((input) => { input.value = 0; });
    r.start();
    refresh();
  }

  function slider(name, low, high, oninput) {
    const row = Object.assign(document.createElement("label"), { className: "slider" });
    row.append(Object.assign(document.createElement("span"), { innerHTML: breakable(escaped(name)) }),
      Object.assign(document.createElement("input"), { type: "range", min: low, max: high, step: "any", value: 0, ariaLabel: name }), document.createElement("output"));
    row.children[1].oninput = ({ target }) => oninput(Number(target.value));
    return row;
  }

  function load(data) {
    [d, r, most] = [data, engine(sst_functions, data), {}];
    const ways = { none: "off", ...(r.keepsMotors && { hold: "hold" }), ...(r.efforts.length && { sliders: "by sliders" }) };
    at("control").innerHTML = Object.entries(ways).map(([way, text]) => `<option value="${way}">${text}</option>`).join("");
    at("sliders").replaceChildren(...d.coordinates.map(({ name, low, high }, k) => slider(name, low, high, (wanted) => set(k, wanted))));
    numbers("sliders").forEach((input, k) => {
      if (d.coordinates[k].kind === "rate") input.onpointerup = input.onpointercancel = input.onblur = () => { input.value = 0; };
    });
    at("efforts").replaceChildren(...d.motors.owners.map((name, k) => slider(`\u03c4 ${name}`, -d.largest[k], d.largest[k], (wanted) => { r.efforts[k] = wanted; })));
    control();
    reset();
  }

  function control() {
    r.way = at("control").value;
    at("efforts").hidden = r.way !== "sliders";
    r.goTo();
  }

  // What a slider of a coordinate does: in a simulation it is the goal of "hold".
  function set(k, wanted) {
    const { kind } = d.coordinates[k];
    let ahead = wanted - r.value(k);
    if (kind === "rate") return;
    if (kind === "angle") ahead -= 2 * Math.PI * Math.round(ahead / (2 * Math.PI));
    if (running && r.way === "hold") { r.goTo(k, ahead); return; }
    run(false);
    reason = r.move(r.va.map((_, j) => j === k ? ahead : 0));
    refresh();
  }

  function refresh() {
    draw();
    tell();
  }

  function draw() {
    const places = Array.from(r.places()), M = (j) => new THREE.Matrix4().set(...[0, 1, 2].flatMap((i) => [0, 3, 6, 9].map((c) => places[12 * j + c + i])), 0, 0, 0, 1);
    tau = r.measure(running);
    for (let j = 1; j < d.bodies.length; j++) stage.place([String(j)], M(j));
    for (const { node, joints, points } of d.struts) {
      const [a, b] = joints.map((j, k) => new THREE.Vector3(...points[k]).applyMatrix4(M(j))), along = b.clone().sub(a);
      const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.clone().normalize());
      stage.place([node], new THREE.Matrix4().compose(a, turn, new THREE.Vector3(1, 1, along.length())));
    }
    d.motors.units.forEach((unit, k) => { most[unit] = Math.max(most[unit] || 1e-9, Math.abs(tau[k])); });
    for (const { node, at: base, motor, share, mirror } of d.arrows) {
      const size = share * tau[motor] / most[d.motors.units[motor]], sense = new THREE.Vector3(...(size < 0 ? mirror : [1, 1, 1]));
      stage.place(node, new THREE.Matrix4().fromArray(base).scale(sense.multiplyScalar(Math.max(Math.sqrt(Math.abs(size)), 1e-3))));
    }
    drawContacts(M);
    line.visible = Boolean(r.grip);
    if (!r.grip) return;
    const p = r.point(r.grip), end = r.grip.target || p.map((x, i) => x - 0.4 * d.size * r.grip.force[i] / Math.hypot(...r.grip.force));
    line.geometry.setAttribute("position", new THREE.Float32BufferAttribute([...p, ...end], 3));
  }

  // Points that touch a ground, and the forces on them; the longest arrow is the robot's weight. M(j) places a body.
  function drawContacts(M) {
    d.touches.forEach(({ node, body, at: centre, ground, axes, radius }) => {
      const place = M(ground).multiply(new THREE.Matrix4().fromArray(axes)), normal = new THREE.Vector3().setFromMatrixColumn(place, 2);
      stage.place([node], place.setPosition(new THREE.Vector3(...centre).applyMatrix4(M(body)).addScaledVector(normal, -radius)));
    });
    for (const { node, at: base, touch, start } of d.forces) {
      const force = new THREE.Vector3(...(r.contactForces[touch] || [0, 0, 0])), share = Math.min(1, force.length() / d.weight), away = new THREE.Vector3();
      let length = share > 1e-6 ? Math.max(Math.sqrt(share), 1e-3) : 1e-3;
      const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), share > 1e-6 ? force.normalize() : new THREE.Vector3(0, 0, 1));
      if (start === null) length = share > 1e-6 ? 1 : 1e-3; // the mark of a point
      else away.set(0, 0, -start * length).applyQuaternion(turn);
      stage.place(node, new THREE.Matrix4().fromArray(base).multiply(new THREE.Matrix4().compose(away, turn, new THREE.Vector3(length, length, length))));
    }
  }

  function shown(x, unit) { const [factor, text] = SHOWN[unit]; return `${chart.readable(factor * x, 1)} ${text}`; }

  function tell() {
    const singular = (text) => text.startsWith("close to a singularity"), words = r.wrong(shown, tau), well = [];
    if (reason && !(singular(reason) && words.some(singular))) words.unshift(`stopped: ${reason}`);
    if (note) words.unshift(note);
    if (running) well.push(`t = ${r.time.toFixed(1)} s${pace < 0.9 ? `, at ${pace.toFixed(2)} of real time` : ""}`);
    else if (!r.holds) well.push(`${tau.length} motors do not hold ${r.va.length} coordinates: no torques at rest`);
    else if (!words.length) well.push("loops closed, not singular; the torques below hold this pose");
    const [ofRates, potential] = r.energies(), kinetic = running ? ofRates : 0; // a pose is held at rest
    if (resting && !kinetic) well.push("no force moves this robot at rest: drag a part, or drive its motors");
    at("told").replaceChildren(...listed(words, ""), ...listed(well, "well"));
    const digits = Math.min(3, Math.max(0, 3 - Math.floor(Math.log10(Math.abs(kinetic) + Math.abs(potential) + 1e-3))));
    const [K, U, both] = [kinetic, potential, kinetic + potential].map((x) => chart.readable(x, digits));
    at("energy").textContent = `energy: kinetic ${K} + potential ${U} = ${both} J`;
    [...at("sliders").children].forEach(({ children: [, input, output] }, k) => {
      const { unit, kind } = d.coordinates[k];
      if (kind === "rate") return;
      if (document.activeElement !== input) input.value = r.value(k);
      output.textContent = shown(r.value(k), unit);
    });
    [...at("efforts").children].forEach((row, k) => { row.children[2].textContent = `${chart.readable(r.efforts[k], 2)} ${d.motors.units[k]}`; });
  }

  function frame(now) {
    const dt = last === null ? 0 : Math.min((now - last) / 1000, 0.05), before = r.q;
    last = now;
    if (running && dt > 0) {
      const left = r.advance(dt, performance.now() + BUDGET);
      if (typeof left === "string") { run(false); note = left; tell(); } else pace += 0.1 * ((dt - left) / dt - pace);
      if (r.grip && !r.grip.target && r.time >= r.grip.until) r.grip = null;
    } else if (r.grip?.target) reason = r.follow();
    const held = numbers("sliders").map((input, k) => d.coordinates[k].kind === "rate" && !running ? dt * Number(input.value) / 2 : 0);
    if (held.some(Boolean)) reason = r.move(held);
    if (!running && !r.grip && r.q === before) return;
    draw();
    if (++seen % 6 === 0 || !running) tell();
  }

  // --- the hand ------------------------------------------------------------------------------

  const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xb00020, depthTest: false })), pane = at("pane");
  line.frustumCulled = line.visible = false;
  viewer.scene.add(line);

  // The body under a pointer or close to it, and where it is met.
  function met({ clientX, clientY }) {
    for (const [x, y] of [[0, 0], [9, 0], [-9, 0], [0, 9], [0, -9]]) {
      const hit = stage.hit(clientX + x, clientY + y), strut = hit && d.struts.find(({ node }) => node === hit.mover);
      const body = strut ? Math.max(...strut.joints) : Number(hit?.mover);
      if (!(body > 0)) continue;
      const M = r.places().slice(12 * body), away = hit.point.map((p, i) => p - M[9 + i]);
      return { body, at: [0, 3, 6].map((c) => M[c] * away[0] + M[c + 1] * away[1] + M[c + 2] * away[2]), from: hit.point, ray: hit.ray };
    }
    return null;
  }

  pane.addEventListener("pointerdown", (event) => {
    const grip = document.body.classList.contains("live") && !pressed && !event.button && met(event);
    if (!grip) return;
    event.stopPropagation(); // the view stays
    pane.setPointerCapture(event.pointerId);
    pressed = { id: event.pointerId, x: event.clientX, y: event.clientY, when: event.timeStamp, from: grip.from, ray: grip.ray };
    r.gripped(grip);
    r.grip.target = grip.from;
  }, true);
  pane.addEventListener("pointermove", (event) => {
    if (pressed?.id === event.pointerId && r.grip) r.grip.target = stage.inPlane(event.clientX, event.clientY, pressed.from);
  }, true);
  for (const kind of ["pointerup", "pointercancel"]) pane.addEventListener(kind, (event) => {
    if (pressed?.id !== event.pointerId) return;
    const still = Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < 6 && event.timeStamp - pressed.when < 400;
    if (r.grip && running && still && kind === "pointerup") r.push(pressed.ray);
    else r.grip = null;
    pressed = null;
    refresh();
  }, true);

  at("go").onclick = () => run(!running);
  at("again").onclick = reset;
  at("control").onchange = control;
  return { load, frame, run, reset, refresh, get robot() { return r; }, get running() { return running; }, get motors() { return d.motors; }, get tau() { return tau; } };
})();
