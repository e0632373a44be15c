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
    size: size * 2.6,
    stroke: () => colour("ink"),
    grid: { stroke: () => colour("line"), width: 1 },
    ticks: { stroke: () => colour("line"), width: 1 },
  };
}

// An element with a plot; set(data) draws it anew. Described for those who do not see it.
export function plot({ title, x, y, series, height = 260, log = false, description, hooks = {}, scales = {} }) {
  const box = make("div", { class: "plot", role: "img", "aria-label": description || title });
  let chart = null;
  let last = null;
  const build = () => {
    if (chart) chart.destroy();
    const xAxis = axis(x);
    xAxis.size = parseFloat(getComputedStyle(document.documentElement).fontSize) * 1.7;
    const yAxis = axis(y);
    if (log) yAxis.values = (u, ticks) => ticks.map((v) => (v === null ? "" : Math.log10(v) % 1 ? "" : v >= 0.01 && v < 1e4 ? String(+v.toPrecision(1)) : v.toExponential(0)));
    chart = new uPlot(
      {
        width: Math.max(200, box.clientWidth),
        height,
        legend: { show: false },
        cursor: { points: { show: false } },
        scales: { x: { time: false }, y: log ? { distr: 3 } : {}, ...scales },
        axes: [xAxis, yAxis],
        hooks,
        series: [{}, ...series.map((s) => ({ ...s, stroke: s.colour ? () => colour(s.colour) : s.stroke, width: s.width ?? 1.5 }))],
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
