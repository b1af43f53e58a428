"use strict";
// One clock drives Meshcat's animation, the curves and their cursor.
const panel = (() => {
  const SPEEDS = [2, 1, 0.5, 0.2, 0.1, 0.05, 0.02];
  let data = null, curves = null, picked = null, time = 0, playing = false, before = null, answering = false;

  const moves = () => data !== null && data.t.length > 1;

  function load(next) {
    const layers = shownLayers();
    data = next;
    data.layers = { ...data.layers, floor: true, ...layers };
    document.body.classList.toggle("still", !moves());
    document.title = data.title;
    at("title").textContent = data.title;
    at("robot").textContent = data.robot;
    at("credit").textContent = data.credit;
    at("warnings").replaceChildren(...data.warnings.map((text) => {
      const line = document.createElement("li");
      line.textContent = text;
      return line;
    }));
    at("curves").innerHTML = data.curves.map((set) => `<option>${set.called}</option>`).join("");
    const speeds = [...new Set([...SPEEDS, data.speed])].sort((a, b) => b - a);
    at("speed").innerHTML = speeds.map((s) => `<option value="${s}">${s}\u00d7</option>`).join("");
    at("speed").value = String(data.speed);
    at("time").min = data.t[0];
    at("time").max = data.t[data.t.length - 1];
    at("layers").innerHTML = Object.keys(data.layers).map((name) =>
      `<label><input type="checkbox" data-layer="${name}"${data.layers[name] ? " checked" : ""}>${name}</label>`).join("");
    describeArrows();
    stage.load(data);
    document.body.classList.toggle("answers", Boolean(data.live));
    live?.load(data.live);
    choose(data.curves.some((set) => set.called === picked) ? picked : data.curves[0].called);
    seek(data.t[0]);
    if (data.live && !moves()) answer(true);
    else play(moves() && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  function answer(on) { // or play the motion
    answering = on;
    play(false);
    document.body.classList.toggle("live", on);
    for (const button of at("modes").children) button.setAttribute("aria-pressed", String((button.dataset.mode === "live") === on));
    if (!on) live.run(false);
    if (moves()) stage.seek(0, 0);
    if (on) { legend(live.motors); stage.resize(); live.reset(); } else choose(at("curves").value);
  }

  function shownLayers() { // as the reader has set them
    return Object.fromEntries([...at("layers").querySelectorAll("input")].map((box) => [box.dataset.layer, box.checked]));
  }

  function describeArrows() { // of the motors, beside the robot
    const { units, values } = data.curves.find((set) => set.called === "torques") || { values: [] }, largest = {};
    for (const row of values) row.forEach((v, k) => { largest[units[k]] = Math.max(largest[units[k]] || 0, Math.abs(v)); });
    const sizes = Object.entries(largest).filter(([, value]) => value > 0)
      .map(([unit, value]) => `${Number(value.toPrecision(3))}\u00a0${unit.replace(" ", "\u00a0")}`);
    const ofMotors = `Arrows at the joints: motor torques and forces, in the colours of the curves; the largest is ${sizes.join(", ")}. ${/square root/.test(data.note) ? "" : "Lengths grow with the square root."}`;
    at("arrows").textContent = [...(sizes.length ? [ofMotors] : []), data.note].join(" ");
    at("arrows").hidden = !at("arrows").textContent.trim();
  }

  function choose(called) {
    curves = data.curves.find((set) => set.called === called);
    at("curves").value = called;
    legend(curves);
    fit();
  }

  function legend(curves) {
    at("legend").innerHTML = curves.names.map((name, k) => {
      const owner = curves.owners[k] === name ? "" : `<i>${breakable(escaped(curves.owners[k]))}</i>`;
      return `<div title="${escaped(curves.owners[k])}"><b><svg width="34" height="8"><line x1="0" x2="34" y1="4" y2="4" ` +
        `${chart.stroke(k, data.colours)}/></svg>${breakable(subscript(escaped(name)))}</b>${owner}` +
        `<span><span class="value"></span> <small>${curves.units[k]}</small></span></div>`;
    }).join("");
  }

  function fit() {
    stage.resize();
    if (!data || answering) return;
    chart.draw(data.t, curves, data.colours);
    show();
  }

  function index(t) { // of the last sample not after t
    let low = 0, high = data.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (data.t[middle] <= t) low = middle; else high = middle - 1;
    }
    return low;
  }

  function values(t) {
    const i = Math.min(index(t), Math.max(data.t.length - 2, 0)), j = Math.min(i + 1, data.t.length - 1);
    const share = j > i ? (t - data.t[i]) / (data.t[j] - data.t[i]) : 0;
    return curves.values[i].map((value, k) => value + share * (curves.values[j][k] - value));
  }

  function show() {
    const now = values(time);
    if (moves()) {
      stage.seek(time - data.t[0], index(time) * data.trail);
      at("time").value = time;
      chart.cursor(time, now);
      const digits = Math.max(0, 2 - Math.floor(Math.log10(data.t[data.t.length - 1] - data.t[0])));
      at("clock").textContent = `t = ${time.toFixed(digits)} s`;
    } else {
      at("clock").textContent = "";
    }
    write(now);
  }

  function write(now) {
    at("legend").querySelectorAll(".value").forEach((span, k) => {
      span.textContent = chart.readable(now[k], Math.abs(now[k]) < 1e4 ? 2 : 0);
    });
    stage.placeLabels();
  }

  function seek(t) {
    time = Math.min(Math.max(t, data.t[0]), data.t[data.t.length - 1]);
    show();
  }

  function play(on) {
    playing = on && moves();
    before = null;
    at("play").textContent = playing ? "Pause" : "Play";
  }

  function frame(now) {
    requestAnimationFrame(frame);
    if (answering) {
      live.frame(now);
      write(live.tau);
    } else if (playing) {
      if (before !== null) {
        const start = data.t[0], length = data.t[data.t.length - 1] - start;
        const ahead = time - start + (now - before) / 1000 * Number(at("speed").value);
        seek(start + ahead % length); // round and round
      }
      before = now;
    } else if (data) {
      stage.placeLabels(); // the camera may turn
    }
  }

  // --- hands on ----------------------------------------------------------------------------

  at("play").onclick = () => play(!playing);
  at("time").oninput = () => { play(false); seek(Number(at("time").value)); };
  at("curves").onchange = () => choose(picked = at("curves").value);
  at("layers").onchange = ({ target }) => stage.showLayer(target.dataset.layer, target.checked);
  at("modes").onclick = ({ target }) => { if (target.dataset.mode) answer(target.dataset.mode === "live"); };
  at("views").onclick = ({ target }) => { if (target.dataset.view) stage.look(target.dataset.view); };
  const drag = (event) => {
    const t = event.buttons ? chart.timeAt(event.clientX) : null;
    if (t === null) return;
    play(false);
    seek(t);
  };
  at("chart").onpointerdown = (event) => { at("chart").setPointerCapture(event.pointerId); drag(event); };
  at("chart").onpointermove = drag;

  // After a click the keys are the page's again; whoever comes by the tab key keeps them.
  const release = () => { window.focus(); document.activeElement.blur(); };
  window.addEventListener("click", (event) => { if (event.detail && event.target.tagName !== "SELECT") release(); });
  window.addEventListener("change", ({ target }) => { if (target.tagName === "SELECT") release(); });
  at("view").addEventListener("pointerdown", release);
  at("pane").addEventListener("dblclick", () => stage.look("usual"));
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const focus = event.target.tagName;
    if (event.key === "r") stage.look("usual");
    if (answering && event.key === " " && !["BUTTON", "INPUT", "SELECT"].includes(focus)) { event.preventDefault(); at("go").click(); }
    if (!moves() || answering || focus === "SELECT") return;
    if (event.key === " " && !["BUTTON", "INPUT"].includes(focus)) { event.preventDefault(); play(!playing); }
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) {
      event.preventDefault();
      play(false);
      seek(time + step * (data.t[data.t.length - 1] - data.t[0]) / 100);
    }
  });
  window.addEventListener("resize", fit);
  window.addEventListener("load", fit);

  const decode = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const scene = JSON.parse(at("scene").textContent);
  scene.commands.map(decode).forEach(stage.command);
  load(scene.panel);
  if (scene.served) {
    const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data: message }) => {
      if (typeof message === "string") load(JSON.parse(message));
      else { stage.command(new Uint8Array(message)); stage.placeLabels(); }
    };
  }
  requestAnimationFrame(frame);
  const drawn = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  return {
    seek, play, load, choose, answer,
    picture() { document.body.classList.add("picture"); fit(); },
    still(share) { // some part of the motion, once it has been drawn
      play(false);
      seek(data.t[0] + share * (data.t[data.t.length - 1] - data.t[0]));
      return drawn();
    },
    get time() { return time; },
    get playing() { return playing; },
    values: () => values(time),
  };
})();
