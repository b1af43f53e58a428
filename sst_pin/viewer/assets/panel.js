"use strict";
// One clock drives Meshcat's animation, the torque curves and their cursor.
const panel = (() => {
  const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
  const DASHES = ["", "9 3", "2.5 2.5", "9 3 2.5 3", "5 2", "1 3"];
  const SPEEDS = [2, 1, 0.5, 0.2, 0.1, 0.05, 0.02];
  const at = (id) => document.getElementById(id);
  const viewer = new MeshCat.Viewer(at("pane"));
  window.viewer = viewer;
  viewer.gui.domElement.style.display = "none"; // the panel's controls stand for it

  let data = null, time = 0, playing = false, before = null, chart = null, looked = false;

  function fit() {
    viewer.set_3d_pane_size(at("pane").clientWidth, at("pane").clientHeight);
    if (data) { chart = drawChart(); show(); }
  }

  // --- scene -------------------------------------------------------------------------------

  function command(bytes) {
    viewer.handle_command_bytearray(bytes);
    if (viewer.animator.playing) viewer.animator.pause();
  }

  function decode(text) {
    return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  }

  function node(path) {
    return viewer.scene_tree.find(["meshcat", "sst", ...path.split("/")]).object;
  }

  function look(camera) { // positions in metres, z up; three.js has y up
    const up = ([x, y, z]) => [x, z, -y];
    viewer.camera.fov = camera.fov;
    viewer.camera.position.set(...up(camera.position));
    viewer.controls.target.set(...up(camera.target));
    viewer.set_dirty();
  }

  function placeLabels() {
    const pane = at("pane");
    for (const label of at("labels").children) {
      const object = node(label.dataset.node);
      object.updateWorldMatrix(true, false);
      let shown = true;
      for (let o = object; o; o = o.parent) shown = shown && o.visible;
      // The label of an axis stands beyond its tip.
      const p = viewer.camera.position.clone().set(0, 0, Number(label.dataset.along));
      p.applyMatrix4(object.matrixWorld).project(viewer.camera);
      label.hidden = !shown || p.z > 1;
      const x = (p.x + 1) / 2 * pane.clientWidth, y = (1 - p.y) / 2 * pane.clientHeight;
      label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
    }
  }

  // --- panel -------------------------------------------------------------------------------

  const stroke = (k) => `stroke="${COLOURS[k % 6]}" stroke-dasharray="${DASHES[k % 6]}"`;
  const subscript = (name) => name.replace(/^tau/, "\u03c4").replace(/_(\w+)$/, "<sub>$1</sub>");

  function load(next) {
    data = next;
    const still = data.t.length < 2;
    document.body.classList.toggle("still", still);
    document.title = data.title;
    at("title").textContent = data.title;
    at("warnings").replaceChildren(...data.warnings.map((text) => {
      const line = document.createElement("li");
      line.textContent = text;
      return line;
    }));
    at("torques").innerHTML = data.names.map((name, k) =>
      `<div><b><svg width="34" height="8"><line x1="0" x2="34" y1="4" y2="4" ${stroke(k)}/></svg>` +
      `${subscript(name)}</b>` +
      `<span><span class="value"></span> <small>${data.units[k]}</small></span></div>`).join("");
    const speeds = [...new Set([...SPEEDS, data.speed])].sort((a, b) => b - a);
    at("speed").innerHTML = speeds.map((s) => `<option value="${s}">${s}\u00d7</option>`).join("");
    at("speed").value = String(data.speed);
    at("time").min = data.t[0];
    at("time").max = data.t[data.t.length - 1];
    at("layers").innerHTML = Object.keys(data.layers).map((name) =>
      `<label><input type="checkbox" data-layer="${name}">${name}</label>`).join("");
    for (const box of at("layers").querySelectorAll("input")) {
      box.checked = data.layers[box.dataset.layer];
      box.onchange = () => { node(box.dataset.layer).visible = box.checked; show(); };
      node(box.dataset.layer).visible = box.checked;
    }
    at("labels").innerHTML = data.labels.map((l) =>
      `<span data-node="${l.node}" data-along="${l.along}" style="color:${l.colour}">${subscript(l.text)}</span>`).join("");
    if (!looked) look(data.camera); // afterwards the view is the reader's
    looked = true;
    fit();
    seek(data.t[0]);
    play(!still);
  }

  function index(t) { // of the last sample not after t
    let low = 0, high = data.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (data.t[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  // With a minus sign that is one, and none before a zero.
  function readable(value, digits) {
    const text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
  }

  function torques(t) {
    const i = Math.min(index(t), Math.max(data.t.length - 2, 0)), j = Math.min(i + 1, data.t.length - 1);
    const share = j > i ? (t - data.t[i]) / (data.t[j] - data.t[i]) : 0;
    return data.tau[i].map((value, k) => value + share * (data.tau[j][k] - value));
  }

  function show() {
    const tau = torques(time);
    if (data.t.length > 1) {
      viewer.animator.seek(time - data.t[0]);
      at("time").value = time;
      node("trail").traverse((object) => {
        if (object.isMesh) object.geometry.setDrawRange(0, index(time) * data.trail);
      });
      chart.cursor(time, tau);
      const digits = Math.max(0, 2 - Math.floor(Math.log10(data.t[data.t.length - 1] - data.t[0])));
      at("clock").textContent = `t = ${time.toFixed(digits)} s`;
    } else {
      at("clock").textContent = "";
    }
    at("torques").querySelectorAll(".value").forEach((span, k) => {
      span.textContent = readable(tau[k], 2);
    });
    viewer.set_dirty();
    placeLabels();
  }

  function seek(t) {
    time = Math.min(Math.max(t, data.t[0]), data.t[data.t.length - 1]);
    show();
  }

  function play(on) {
    playing = on && data.t.length > 1;
    before = null;
    at("play").textContent = playing ? "Pause" : "Play";
  }

  function frame(now) {
    requestAnimationFrame(frame);
    if (playing) {
      if (before !== null) {
        const start = data.t[0], length = data.t[data.t.length - 1] - start;
        const ahead = time - start + (now - before) / 1000 * Number(at("speed").value);
        seek(start + ahead % length); // round and round
      }
      before = now;
    } else if (data) {
      placeLabels(); // the camera may turn
    }
  }

  // --- curves ------------------------------------------------------------------------------

  function ticks(low, high, count) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999);
    const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return Array.from({ length: last - first + 1 }, (_, i) => {
      const value = (first + i) * step;
      return { value, text: readable(value, digits) };
    });
  }

  function drawChart() {
    const svg = at("chart"), width = svg.clientWidth, height = svg.clientHeight;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const left = 46, right = width - 10, top = 26, bottom = height - 40;
    const all = data.tau.flat(), spread = Math.max(...all) - Math.min(...all) || 1;
    const low = Math.min(0, ...all) - 0.05 * spread, high = Math.max(0, ...all) + 0.05 * spread;
    const start = data.t[0], end = data.t[data.t.length - 1];
    const x = (t) => left + (t - start) / ((end - start) || 1) * (right - left);
    const y = (v) => bottom - (v - low) / (high - low) * (bottom - top);
    let inside = "";
    for (const { value, text } of ticks(low, high, Math.max(2, (bottom - top) / 60))) {
      inside += `<line class="${value === 0 ? "zero" : "grid"}" x1="${left}" x2="${right}" y1="${y(value)}" y2="${y(value)}"/>`;
      inside += `<text x="${left - 7}" y="${y(value) + 4}" text-anchor="end">${text}</text>`;
    }
    for (const { value, text } of ticks(start, end, Math.max(2, (right - left) / 85))) {
      inside += `<line class="frame" x1="${x(value)}" x2="${x(value)}" y1="${bottom}" y2="${bottom + 4}"/>`;
      inside += `<text x="${x(value)}" y="${bottom + 18}" text-anchor="middle">${text}</text>`;
    }
    inside += `<path class="frame" d="M${left},${top}V${bottom}H${right}"/>`;
    inside += `<text x="${(left + right) / 2}" y="${height - 5}" text-anchor="middle">time (s)</text>`;
    inside += `<text x="4" y="14">${data.what}</text>`;
    data.names.forEach((_, k) => {
      const points = data.t.map((t, i) => `${x(t).toFixed(1)},${y(data.tau[i][k]).toFixed(1)}`);
      inside += `<polyline class="curve" ${stroke(k)} points="${points.join(" ")}"/>`;
    });
    inside += `<line class="cursor" y1="${top}" y2="${bottom}"/>`;
    inside += data.names.map((_, k) => `<circle r="4.5" fill="${COLOURS[k % 6]}" stroke="#fff" stroke-width="1.5"/>`).join("");
    svg.innerHTML = inside;
    const line = svg.querySelector(".cursor"), dots = svg.querySelectorAll("circle");
    return {
      cursor(t, tau) {
        line.setAttribute("x1", x(t));
        line.setAttribute("x2", x(t));
        dots.forEach((dot, k) => { dot.setAttribute("cx", x(t)); dot.setAttribute("cy", y(tau[k])); });
      },
      timeAt: (px) => start + (px - left) / (right - left) * (end - start),
    };
  }

  // --- hands on ----------------------------------------------------------------------------

  at("play").onclick = () => play(!playing);
  at("time").oninput = () => { play(false); seek(Number(at("time").value)); };
  const drag = (event) => {
    if (!event.buttons) return;
    play(false);
    seek(chart.timeAt(event.clientX - at("chart").getBoundingClientRect().left));
  };
  at("chart").onpointerdown = (event) => { at("chart").setPointerCapture(event.pointerId); drag(event); };
  at("chart").onpointermove = drag;
  window.addEventListener("keydown", (event) => {
    if (!data || data.t.length < 2 || ["SELECT", "BUTTON"].includes(event.target.tagName)) return;
    if (event.key === " ") { event.preventDefault(); play(!playing); }
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) {
      event.preventDefault();
      play(false);
      seek(time + step * (data.t[data.t.length - 1] - data.t[0]) / 100);
    }
  });
  window.addEventListener("resize", fit);
  window.addEventListener("load", fit);

  const scene = JSON.parse(at("scene").textContent);
  scene.commands.map(decode).forEach(command);
  load(scene.panel);
  if (scene.live) {
    const socket = new WebSocket(`ws://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data: message }) => {
      if (typeof message === "string") load(JSON.parse(message));
      else { command(new Uint8Array(message)); placeLabels(); }
    };
  }
  requestAnimationFrame(frame);
  const drawn = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  return {
    seek, play, load,
    picture() { document.body.classList.add("picture"); fit(); },
    still(share) { // some part of the motion, once it has been drawn
      play(false);
      seek(data.t[0] + share * (data.t[data.t.length - 1] - data.t[0]));
      return drawn();
    },
    get time() { return time; },
    get playing() { return playing; },
    torques: () => torques(time),
  };
})();
