"use strict";
// Curves against time in an SVG.
const chart = (() => {
  const DASHES = ["", "9 3", "2.5 2.5", "9 3 2.5 3", "5 2", "1 3"];
  const svg = at("chart");
  let scale = null;

  // With a minus sign that is one, and none before a zero.
  function readable(value, digits) {
    const text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
  }

  function ticks(low, high, count) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const ends = (s) => [Math.ceil(low / s - 1e-9), Math.floor(high / s + 1e-9)];
    const steps = [0.2, 0.5, 1, 2, 5, 10].map((m) => m * power);
    const few = steps.findIndex((s) => s >= rough * 0.999), enough = (s) => ends(s)[1] > ends(s)[0];
    const step = steps.slice(0, few + 1).findLast(enough); // with two numbers at least
    const [first, last] = ends(step);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return Array.from({ length: last - first + 1 }, (_, i) => {
      const value = (first + i) * step;
      return { value, text: readable(value, digits) };
    });
  }

  // Colours come round with other dashes.
  const stroke = (k, colours) =>
    `stroke="${colours[k % colours.length]}" stroke-dasharray="${DASHES[(k + Math.floor(k / colours.length)) % DASHES.length]}"`;

  function draw(t, curves, colours) {
    const width = svg.clientWidth, height = svg.clientHeight;
    if (!width || t.length < 2) { scale = null; return; }
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const left = 52, right = width - 20, top = 26, bottom = height - 40;
    let least = 0, most = 0;
    for (const row of curves.values) for (const v of row) { least = Math.min(least, v); most = Math.max(most, v); }
    const spread = most - least || 1, low = least - 0.05 * spread, high = most + 0.05 * spread;
    const start = t[0], end = t[t.length - 1];
    const x = (time) => left + (time - start) / (end - start) * (right - left);
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
    inside += `<text x="4" y="14">${curves.what}</text>`;
    curves.names.forEach((_, k) => {
      const points = t.map((time, i) => `${x(time).toFixed(1)},${y(curves.values[i][k]).toFixed(1)}`);
      inside += `<polyline class="curve" ${stroke(k, colours)} points="${points.join(" ")}"/>`;
    });
    inside += `<line class="cursor" y1="${top}" y2="${bottom}"/>`;
    inside += curves.names.map((_, k) => `<circle r="4.5" fill="${colours[k % colours.length]}"/>`).join("");
    svg.innerHTML = inside;
    scale = { x, y, line: svg.querySelector(".cursor"), dots: svg.querySelectorAll("circle"),
      time: (px) => start + (px - left) / (right - left) * (end - start) };
  }

  function cursor(t, values) {
    if (!scale) return;
    for (const end of ["x1", "x2"]) scale.line.setAttribute(end, scale.x(t));
    scale.dots.forEach((dot, k) => { dot.setAttribute("cx", scale.x(t)); dot.setAttribute("cy", scale.y(values[k])); });
  }

  const timeAt = (clientX) => scale && scale.time(clientX - svg.getBoundingClientRect().left);
  return { draw, cursor, timeAt, readable, stroke };
})();
