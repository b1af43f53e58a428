"use strict";
// Curves against time in an SVG.
const chart = (() => {
  const DASHES = ["", "9 3", "2.5 2.5", "9 3 2.5 3", "5 2", "1 3"];
  const svg = at("chart");
  // Of the drawn axes: functions from values to pixels and back, and the elements that the cursor
  // moves.
  let scale = null;

  // A number with some digits: its minus sign is a true one, and a zero has none.
  function readable(value, digits) {
    const text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
  }

  // Round numbers from low to high, about `count` of them and at least two, with their texts.
  function ticks(low, high, count) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const steps = [0.2, 0.5, 1, 2, 5, 10].map((m) => m * power);
    const ends = (s) => [Math.ceil(low / s - 1e-9), Math.floor(high / s + 1e-9)]; // in steps
    const isEnough = (s) => ends(s)[1] > ends(s)[0];
    const widest = steps.findIndex((s) => s >= rough * 0.999);
    const step = steps.slice(0, widest + 1).findLast(isEnough);
    const [first, last] = ends(step);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return Array.from({ length: last - first + 1 }, (_, i) => {
      const value = (first + i) * step;
      return { value, text: readable(value, digits) };
    });
  }

  // Colour and dashes of curve k. When the colours begin again, each has other dashes.
  function stroke(k, colours) {
    const round = Math.floor(k / colours.length), dashes = DASHES[(k + round) % DASHES.length];
    return `stroke="${colours[k % colours.length]}" stroke-dasharray="${dashes}"`;
  }

  const segment = (kind, x1, y1, x2, y2) =>
    `<line class="${kind}" x1="${x1}" x2="${x2}" y1="${y1}" y2="${y2}"/>`;
  const word = (x, y, text, anchor = "start") =>
    `<text x="${x}" y="${y}" text-anchor="${anchor}">${text}</text>`;

  // Draw the curves, samples by curves, at the times t.
  function draw(t, curves, colours) {
    const width = svg.clientWidth, height = svg.clientHeight;
    if (!width || t.length < 2) { scale = null; return; }
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const left = 52, right = width - 20, top = 26, bottom = height - 40;
    let least = 0, most = 0;
    for (const value of curves.values.flat()) {
      least = Math.min(least, value);
      most = Math.max(most, value);
    }
    const spread = most - least || 1, low = least - 0.05 * spread, high = most + 0.05 * spread;
    const start = t[0], end = t[t.length - 1];
    const x = (time) => left + (time - start) / (end - start) * (right - left);
    const y = (v) => bottom - (v - low) / (high - low) * (bottom - top);
    let inside = "";
    for (const { value, text } of ticks(low, high, Math.max(2, (bottom - top) / 60))) {
      inside += segment(value === 0 ? "zero" : "grid", left, y(value), right, y(value));
      inside += word(left - 7, y(value) + 4, text, "end");
    }
    for (const { value, text } of ticks(start, end, Math.max(2, (right - left) / 85))) {
      inside += segment("frame", x(value), bottom, x(value), bottom + 4);
      inside += word(x(value), bottom + 18, text, "middle");
    }
    inside += `<path class="frame" d="M${left},${top}V${bottom}H${right}"/>`;
    inside += word((left + right) / 2, height - 5, "time (s)", "middle");
    inside += word(4, 14, curves.what);
    curves.names.forEach((_, k) => {
      const point = (time, i) => `${x(time).toFixed(1)},${y(curves.values[i][k]).toFixed(1)}`;
      const points = t.map(point);
      inside += `<polyline class="curve" ${stroke(k, colours)} points="${points.join(" ")}"/>`;
    });
    inside += `<line class="cursor" y1="${top}" y2="${bottom}"/>`;
    const dot = (_, k) => `<circle r="4.5" fill="${colours[k % colours.length]}"/>`;
    inside += curves.names.map(dot).join("");
    svg.innerHTML = inside;
    const time = (px) => start + (px - left) / (right - left) * (end - start);
    const line = svg.querySelector(".cursor"), dots = svg.querySelectorAll("circle");
    scale = { x, y, time, line, dots };
  }

  // Move the cursor to time t, and its dots to the values of the curves.
  function cursor(t, values) {
    if (!scale) return;
    for (const end of ["x1", "x2"]) scale.line.setAttribute(end, scale.x(t));
    scale.dots.forEach((dot, k) => {
      dot.setAttribute("cx", scale.x(t));
      dot.setAttribute("cy", scale.y(values[k]));
    });
  }

  // The time at a place of the window; null if nothing is drawn.
  const timeAt = (clientX) => scale && scale.time(clientX - svg.getBoundingClientRect().left);
  return { draw, cursor, timeAt, readable, stroke };
})();
