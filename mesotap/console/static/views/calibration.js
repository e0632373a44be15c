// The line of the strain gauge growing point by point, before against after, and what is left over.

import { page } from "../wire.js";
import { fixed, make, number, sheet } from "../parts.js";
import { beyond, colour, plot, points } from "../plots.js";

let line, rest, words, verdict;

// Straight line by least squares through [load, voltage] pairs.
function fitted(pairs) {
  const n = pairs.length;
  if (n < 2) return null;
  const mx = pairs.reduce((s, p) => s + p[0], 0) / n;
  const my = pairs.reduce((s, p) => s + p[1], 0) / n;
  const sxx = pairs.reduce((s, p) => s + (p[0] - mx) ** 2, 0);
  if (!sxx) return null;
  const slope = pairs.reduce((s, p) => s + (p[0] - mx) * (p[1] - my), 0) / sxx;
  return { slope, offset: my - slope * mx };
}

function show() {
  const shown = page.parts.calibration;
  if (!shown || !line) return;
  const { before, after } = shown;
  const all = [...before.map((p) => [p[0], p[1], null]), ...after.map((p) => [p[0], null, p[1]])].sort((p, q) => p[0] - q[0]);
  const fit = fitted(before) || fitted(after);
  const later = fitted(after);
  const x = all.map((p) => p[0]);
  line.set([x, all.map((p) => p[1]), all.map((p) => p[2]), x.map((v) => (fit ? fit.offset + fit.slope * v : null))]);
  const over = (v, load) => (v === null || !fit ? null : (v - fit.offset - fit.slope * load) * 1e3);
  rest.set([x, all.map((p) => over(p[1], p[0])), all.map((p) => over(p[2], p[0])), x.map(() => (fit ? 0 : null))]);
  const told = [];
  if (fit) told.push(`Before: ${number(fit.slope, 5)} mV/mN, ${fixed(fit.offset, 3)} mV without a weight, ${before.length} readings.`);
  if (later) told.push(`After: ${number(later.slope, 5)} mV/mN (${fixed(100 * (later.slope / fit.slope - 1), 2)} %), ${fixed(later.offset, 3)} mV, ${after.length} readings.`);
  words.textContent = told.join(" ") || "No reading yet.";
  showVerdict(shown.compared);
}

function showVerdict(compared) {
  verdict.hidden = !compared;
  words.hidden = Boolean(compared);
  if (!compared || verdict.dataset.said === compared.statement) return;
  verdict.dataset.said = compared.statement;
  verdict.className = compared.drifted ? "warning" : "";
  verdict.replaceChildren(
    make("p", { class: `verdict ${compared.drifted ? "bad" : "good"}` }, compared.drifted ? "✗ The strain gauge drifted" : "✓ Before and after agree"),
    make("p", {}, compared.statement),
    make("p", {}, compared.drifted
      ? "What it means: every load of this session is in doubt by about that shift, and with it what depends on the load. Look at the gauge's cables, glue and temperature, let it warm up, and repeat the session; zero_every_loads in the settings finds drift from load to load."
      : "What it means: nothing speaks against the loads of this session."));
}

export const calibration = {
  show(root) {
    const series = [points("a", { points: { show: true, size: 10, fill: () => colour("a") } }), points("b", { points: { show: true, size: 17, width: 2.5, fill: "transparent" } }), { colour: "third", width: 1.5 }];
    line = plot({ title: "Bridge voltage against weight", x: "weight, mN", y: "bridge voltage, mV", series, height: 300, rangeX: beyond });
    rest = plot({ title: "Residuals", x: "weight, mN", y: "residual, µV", series, height: 300, rangeX: beyond });
    words = make("p", { role: "status", id: "calibration-words" });
    verdict = make("div", { role: "alert", id: "drift", hidden: true });
    const key = make("p", { class: "key" }, make("i", { class: "dot a" }), "before", make("i", { class: "ring b" }), "after", make("i", { class: "c" }), "line through those before");
    root.append(sheet("Calibration of the strain gauge", verdict, words),
      make("div", { class: "two" }, sheet("Bridge voltage against weight", key, line.box), sheet("What is left over: each reading less the line", key.cloneNode(true), rest.box)));
    show();
  },
  update(part) {
    if (part === "calibration") show();
  },
  end() {
    line.end();
    rest.end();
    line = rest = null;
  },
};
