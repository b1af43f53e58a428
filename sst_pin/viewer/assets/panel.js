"use strict";
// The panel beside the picture. One clock, `time`, drives Meshcat's animation, the curves and their
// cursor. A page has two modes: it plays a motion, or its robot answers (`live`). In this order:
// data and modes, curves, the clock, what the reader does, the start of the page.
const panel = (() => {
  const SPEEDS = [2, 1, 0.5, 0.2, 0.1, 0.05, 0.02];
  let data = null; // of the motion, from the package
  let curves = null; // the set of curves that is shown
  let chosen = null; // its name, if the reader has chosen it
  let time = 0; // of the motion, [s]
  let playing = false;
  let lastFrame = null; // time of the last frame, [ms]; null if it does not play
  let answering = false; // whether the robot answers

  // Whether there is a motion, not a single configuration.
  const moves = () => data !== null && data.t.length > 1;
  const firstTime = () => data.t[0], lastTime = () => data.t[data.t.length - 1];

  // --- data and modes ----------------------------------------------------------------------

  function load(next) {
    const layers = shownLayers();
    data = next;
    data.layers = { ...data.layers, floor: true, ...layers };
    document.body.classList.toggle("still", !moves());
    document.title = data.title;
    at("title").textContent = data.title;
    at("robot").textContent = data.robot;
    at("credit").textContent = data.credit;
    loadControls();
    describeArrows();
    stage.load(data);
    document.body.classList.toggle("answers", Boolean(data.live));
    live?.load(data.live);
    const names = data.curves.map((set) => set.called);
    choose(names.includes(chosen) ? chosen : names[0]);
    seek(firstTime());
    if (data.live && !moves()) answer(true);
    else play(moves() && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  function loadControls() {
    at("warnings").replaceChildren(...data.warnings.map((textContent) =>
      Object.assign(document.createElement("li"), { textContent })));
    at("curves").innerHTML = data.curves.map((set) => `<option>${set.called}</option>`).join("");
    const speeds = [...new Set([...SPEEDS, data.speed])].sort((a, b) => b - a);
    at("speed").innerHTML = speeds.map((s) => `<option value="${s}">${s}\u00d7</option>`).join("");
    at("speed").value = String(data.speed);
    at("time").min = firstTime();
    at("time").max = lastTime();
    at("layers").innerHTML = Object.entries(data.layers).map(([name, isShown]) => {
      const box = `<input type="checkbox" data-layer="${name}"${isShown ? " checked" : ""}>`;
      return `<label>${box}${name}</label>`;
    }).join("");
  }

  // Layers that are shown, as the reader has set them.
  function shownLayers() {
    const boxes = [...at("layers").querySelectorAll("input")];
    return Object.fromEntries(boxes.map((box) => [box.dataset.layer, box.checked]));
  }

  // Let the robot answer, or play the motion.
  function answer(on) {
    answering = on;
    play(false);
    document.body.classList.toggle("live", on);
    for (const button of at("modes").children) {
      const isOn = (button.dataset.mode === "live") === on;
      button.setAttribute("aria-pressed", String(isOn));
    }
    if (!on) live.run(false);
    if (moves()) stage.seek(0, 0); // `live` places the bodies, or `choose` seeks the time
    if (on) {
      showLegend(live.motors);
      stage.resize();
      live.reset();
    } else {
      choose(at("curves").value);
    }
  }

  // A text about the arrows of the motors, then the note of the data.
  function describeArrows() {
    const torques = data.curves.find((set) => set.called === "torques");
    const largest = {}; // by unit
    for (const row of torques?.values ?? []) {
      row.forEach((value, k) => {
        const unit = torques.units[k];
        largest[unit] = Math.max(largest[unit] || 0, Math.abs(value));
      });
    }
    const SPACE = "\u00a0"; // a line does not break there
    const sizes = Object.entries(largest).filter(([, value]) => value > 0)
      .map(([unit, value]) => `${Number(value.toPrecision(3))} ${unit}`.replaceAll(" ", SPACE));
    const texts = [data.note];
    if (sizes.length) {
      const arrows = "Arrows at the joints: motor torques and forces, in the colours of the curves";
      const growth = /square root/.test(data.note) ? "" : "Lengths grow with the square root.";
      texts.unshift(`${arrows}; the largest is ${sizes.join(", ")}. ${growth}`);
    }
    at("arrows").textContent = texts.join(" ");
    at("arrows").hidden = !at("arrows").textContent.trim();
  }

  // --- curves ------------------------------------------------------------------------------

  function choose(called) {
    curves = data.curves.find((set) => set.called === called);
    at("curves").value = called;
    showLegend(curves);
    fit();
  }

  // Names, units and room for the values of curves, or of motors.
  function showLegend({ names, owners, units }) {
    at("legend").innerHTML = names.map((name, k) => {
      const owner = escaped(owners[k]), text = breakable(subscript(escaped(name)));
      const ends = `x1="0" x2="34" y1="4" y2="4"`;
      const stroke = chart.stroke(k, data.colours);
      const line = `<svg width="34" height="8"><line ${ends} ${stroke}/></svg>`;
      const shownOwner = owners[k] === name ? "" : `<i>${breakable(owner)}</i>`;
      const value = `<span><span class="value"></span> <small>${units[k]}</small></span>`;
      return `<div title="${owner}"><b>${line}${text}</b>${shownOwner}${value}</div>`;
    }).join("");
  }

  function showValues(now) {
    at("legend").querySelectorAll(".value").forEach((span, k) => {
      span.textContent = chart.readable(now[k], Math.abs(now[k]) < 1e4 ? 2 : 0);
    });
    stage.placeLabels();
  }

  function fit() {
    stage.resize();
    if (!data || answering) return;
    chart.draw(data.t, curves, data.colours);
    show();
  }

  // --- the clock ---------------------------------------------------------------------------

  // Index of the last sample that is not after t, by bisection.
  function index(t) {
    let low = 0, high = data.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (data.t[middle] <= t) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  // Values of the curves at time t, interpolated between two samples.
  function values(t) {
    const i = Math.min(index(t), Math.max(data.t.length - 2, 0));
    const j = Math.min(i + 1, data.t.length - 1);
    const share = j > i ? (t - data.t[i]) / (data.t[j] - data.t[i]) : 0;
    return curves.values[i].map((value, k) => value + share * (curves.values[j][k] - value));
  }

  // Show the robot, the curves and the values at `time`.
  function show() {
    const now = values(time);
    at("clock").textContent = "";
    if (moves()) {
      stage.seek(time - firstTime(), index(time) * data.trail);
      at("time").value = time;
      chart.cursor(time, now);
      const digits = Math.max(0, 2 - Math.floor(Math.log10(lastTime() - firstTime())));
      at("clock").textContent = `t = ${time.toFixed(digits)} s`;
    }
    showValues(now);
  }

  function seek(t) {
    time = Math.min(Math.max(t, firstTime()), lastTime());
    show();
  }

  function play(on) {
    playing = on && moves();
    lastFrame = null;
    at("play").textContent = playing ? "Pause" : "Play";
  }

  // `now` is the time of the frame, [ms].
  function frame(now) {
    requestAnimationFrame(frame);
    if (answering) {
      live.frame(now);
      showValues(live.tau);
    } else if (playing) {
      if (lastFrame !== null) {
        const length = lastTime() - firstTime();
        const passed = (now - lastFrame) / 1000 * Number(at("speed").value);
        seek(firstTime() + (time - firstTime() + passed) % length); // again from the start
      }
      lastFrame = now;
    } else if (data) {
      stage.placeLabels(); // the camera may turn
    }
  }

  // --- what the reader does ----------------------------------------------------------------

  at("play").onclick = () => play(!playing);
  at("time").oninput = () => {
    play(false);
    seek(Number(at("time").value));
  };
  at("curves").onchange = () => {
    chosen = at("curves").value;
    choose(chosen);
  };
  at("layers").onchange = ({ target }) => stage.showLayer(target.dataset.layer, target.checked);
  at("modes").onclick = ({ target: { dataset } }) => {
    if (dataset.mode) answer(dataset.mode === "live");
  };
  at("views").onclick = ({ target: { dataset } }) => {
    if (dataset.view) stage.look(dataset.view);
  };
  at("pane").addEventListener("dblclick", () => stage.look("usual"));

  // Seek the time under a pressed pointer on the curves.
  function seekPointer(event) {
    const t = event.buttons ? chart.timeAt(event.clientX) : null;
    if (t === null) return;
    play(false);
    seek(t);
  }
  at("chart").onpointerdown = (event) => {
    at("chart").setPointerCapture(event.pointerId);
    seekPointer(event);
  };
  at("chart").onpointermove = seekPointer;

  // A control that was clicked gives the keyboard back to the page; one that was reached by the tab
  // key keeps it. A list keeps it until its value changes.
  function releaseKeys() {
    window.focus();
    document.activeElement.blur();
  }
  window.addEventListener("click", (event) => {
    const byPointer = event.detail > 0;
    if (byPointer && event.target.tagName !== "SELECT") releaseKeys();
  });
  window.addEventListener("change", ({ target }) => {
    if (target.tagName === "SELECT") releaseKeys();
  });
  at("view").addEventListener("pointerdown", releaseKeys);

  // R resets the view. The space bar plays or simulates, arrows step through the motion.
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const focus = event.target.tagName, isInList = focus === "SELECT";
    const isSpace = event.key === " " && !isInList && !["BUTTON", "INPUT"].includes(focus);
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "r") stage.look("usual");
    if (answering && isSpace) {
      event.preventDefault();
      at("go").click();
    }
    if (!moves() || answering || isInList) return;
    if (isSpace) {
      event.preventDefault();
      play(!playing);
    }
    if (step) {
      event.preventDefault();
      play(false);
      seek(time + step * (lastTime() - firstTime()) / 100);
    }
  });

  // --- the start of the page ---------------------------------------------------------------

  window.addEventListener("resize", fit);
  window.addEventListener("load", fit);

  const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const scene = JSON.parse(at("scene").textContent);
  scene.commands.map(bytesOf).forEach(stage.command);
  load(scene.panel);
  if (scene.served) { // new data of the panel are text, commands of Meshcat are bytes
    const address = `${location.protocol.replace("http", "ws")}//${location.host}/socket`;
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data: message }) => {
      if (typeof message === "string") {
        load(JSON.parse(message));
        return;
      }
      stage.command(new Uint8Array(message));
      stage.placeLabels();
    };
  }
  requestAnimationFrame(frame);

  // Resolved when the next frame has been drawn.
  const drawn = () => new Promise((done) =>
    requestAnimationFrame(() => requestAnimationFrame(done)));
  return {
    seek, play, load, choose, answer,
    // The page as a picture for documents, without controls.
    picture() {
      document.body.classList.add("picture");
      fit();
    },
    // Show the motion at a part of its duration.
    still(share) {
      play(false);
      seek(firstTime() + share * (lastTime() - firstTime()));
      return drawn();
    },
    get time() { return time; },
    get playing() { return playing; },
    values: () => values(time),
  };
})();
