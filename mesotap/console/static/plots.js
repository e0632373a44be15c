// Plots in the colours of the page, with units on their axes.

import { make } from "./parts.js";

const live = new Set();

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function axis(label) {
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize);
  return {
    label,
    labelSize: size * 1.4,
    labelFont: `${Math.round(size * 0.85)}px system-ui, sans-serif`,
    font: `${Math.round(size * 0.75)}px system-ui, sans-serif`,
    size: (u, values) => size * Math.max(2.6, 0.9 + 0.45 * Math.max(0, ...(values || []).map((v) => String(v).length))), // room for the longest
    stroke: () => colour("ink"),
    grid: { stroke: () => colour("line"), width: 1 },
    ticks: { stroke: () => colour("line"), width: 1 },
  };
}

// A little more than the points need: those at the very edge are drawn too.
export const beyond = (u, low, high) => (low === null ? [0, 1] : [low - 0.03 * (high - low || 1), high + 0.03 * (high - low || 1)]);
const decade = (v) => v !== null && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-9;
const powerOfTen = (v) => `10${String(Math.round(Math.log10(v))).replace(/./g, (c) => ({ "-": "⁻" })[c] || "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])}`;

// An element with a plot; set(data) draws it anew. Described for those who do not see it.
export function plot({ title, x, y, series, height = 260, log = false, description, hooks = {}, range = null, logX = false, rangeX = null }) {
  const box = make("div", { class: "plot", role: "img", "aria-label": description || title });
  let chart = null;
  let last = null;
  const build = () => {
    if (chart) chart.destroy();
    const xAxis = axis(x);
    xAxis.size = parseFloat(getComputedStyle(document.documentElement).fontSize) * 1.7;
    const yAxis = axis(y);
    for (const [one, isLog] of [[xAxis, logX], [yAxis, log]]) {
      one.values = isLog ? (u, ticks) => ticks.map((v) => (decade(v) ? powerOfTen(v) : "")) : (u, ticks) => ticks.map((v) => (v === null ? "" : String(+v.toPrecision(9))));
      if (isLog) one.grid.filter = one.ticks.filter = (u, ticks) => ticks.map((v) => (decade(v) ? v : null));
    }
    chart = new uPlot(
      {
        width: Math.max(200, box.clientWidth),
        height,
        legend: { show: false },
        cursor: { points: { show: false } },
        scales: { x: { time: false, ...(logX ? { distr: 3 } : {}), ...(rangeX ? { range: rangeX } : {}) }, y: { ...(log ? { distr: 3 } : {}), ...(range ? { range } : {}) } },
        axes: [xAxis, yAxis],
        hooks,
        series: [{}, ...series.map((s) => ({ points: { show: false }, ...s, stroke: s.colour ? () => colour(s.colour) : s.stroke, width: s.width ?? 1.5 }))],
      },
      last || [[], ...series.map(() => [])],
      box,
    );
  };
  const fit = new ResizeObserver(() => {
    if (chart && box.clientWidth) chart.setSize({ width: box.clientWidth, height });
    else if (box.clientWidth) build();
  });
  fit.observe(box);
  const handle = {
    box,
    set(data) {
      last = data;
      if (chart) chart.setData(data);
    },
    redraw: () => box.clientWidth && build(),
    end() {
      fit.disconnect();
      if (chart) chart.destroy();
      live.delete(handle);
    },
  };
  live.add(handle);
  return handle;
}

export function redrawAll() {
  for (const handle of live) handle.redraw();
}

export function points(colourName, options = {}) {
  return { colour: colourName, width: 0, paths: () => null, points: { show: true, size: 9, fill: () => colour(colourName), stroke: () => colour(colourName) }, ...options };
}

// Boxes of quartiles with median and whiskers, drawn over a plot (Fig. 7, 8).
export function boxes(u, found, colourName) {
  const context = u.ctx;
  const half = 7 * devicePixelRatio;
  context.save();
  context.strokeStyle = context.fillStyle = colour(colourName);
  context.lineWidth = 2 * devicePixelRatio;
  for (const { x, box, scale } of found) {
    if (!box) continue;
    const at = u.valToPos(x, "x", true);
    const y = (value) => u.valToPos(value * scale, "y", true);
    context.beginPath();
    context.moveTo(at, y(box.lower_whisker));
    context.lineTo(at, y(box.lower_quartile));
    context.moveTo(at, y(box.upper_quartile));
    context.lineTo(at, y(box.upper_whisker));
    context.moveTo(at - half, y(box.median));
    context.lineTo(at + half, y(box.median));
    context.stroke();
    const top = y(box.upper_quartile);
    context.strokeRect(at - half, top, 2 * half, Math.max(2, y(box.lower_quartile) - top));
    for (const outlier of box.outliers) {
      context.beginPath();
      context.arc(at, y(outlier), 3 * devicePixelRatio, 0, 2 * Math.PI);
      context.stroke();
    }
  }
  context.restore();
}
