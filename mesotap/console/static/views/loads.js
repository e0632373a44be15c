// What each load came to, against theory; the diagnosis so far; at the end the report and the diagnosis.

import { page, post } from "../wire.js";
import { alertWith, make, put, sheet, within } from "../parts.js";
import { boxes, plot } from "../plots.js";
import { driving } from "../main.js";

const DASHES = [[], [10, 5], [3, 4], [14, 4, 3, 4], [6, 3, 2, 3, 2, 3]];
const SIGNS = ["──", "─ ─", "· · ·", "─ ·", "─ · ·"];
let stiffness, damping, table, key, told, documents, soFar, opened, curves;

function build(theory) {
  if (stiffness) stiffness.end();
  curves = theory.length;
  const lines = theory.map((curve, i) => ({ colour: "third", dash: DASHES[i % DASHES.length], width: 2 }));
  stiffness = plot({
    title: "Contact stiffness against load", x: "load, mN", y: "k_c, MN/m", height: 320,
    series: lines.length ? lines : [{ colour: "third" }],
    hooks: { draw: [(u) => boxes(u, found().map((l) => ({ x: l.load_mn, box: l.stiffness_box, scale: 1e-6 })), "a")] },
    range: () => span(found().flatMap((l) => ends(l.stiffness_box, 1e-6)), theory.flatMap((c) => c.k_c.map((v) => v * 1e-6))),
  });
  key.replaceChildren(make("span", { class: "item" }, make("i", { class: "a" }), "measured: quartiles, median, whiskers"),
    ...theory.map((curve, i) => make("span", { class: "item" }, make("b", { class: "dash" }, SIGNS[i % SIGNS.length]), ` ${curve.name}`)));
  return stiffness.box;
}

const found = () => ((page.parts.loads || {}).loads || []).filter((load) => load.stiffness_box);
const ends = (box, scale) => (box ? [box.lower_whisker * scale, box.upper_whisker * scale, ...box.outliers.map((v) => v * scale)] : []);

// What was measured is always in view; a theory far above it may leave at the top.
function span(measured, beside = []) {
  const highest = Math.max(0, ...measured.filter(Number.isFinite));
  if (highest > 0) return [0, highest * (beside.length ? 2 : 1.1)];
  return [0, Math.max(1e-9, ...beside.filter(Number.isFinite)) * 1.05 || 1];
}

function show() {
  const { loads, state } = page.parts;
  if (!loads || !stiffness) return;
  const theory = loads.theory || [];
  if (theory.length !== curves) stiffness.box.replaceWith(build(theory));
  const x = theory.length ? theory[0].load_mn : [0, (state.limit_mn || 1000)];
  stiffness.set([x, ...(theory.length ? theory.map((c) => c.k_c.map((v) => v * 1e-6)) : [x.map(() => null)])]);
  damping.set([x, x.map(() => null)]);
  told.textContent = loads.why ? `Not analysed: ${loads.why}` : "";
  put(table, loads.loads, () => loads.loads.map((load) => make("tr", {}, make("td", {}, String(load.load_set + 1)), make("td", {}, load.load_mn.toFixed(1)), make("td", {}, String(load.used)),
    make("td", {}, within(load.f2_hz, 1)), make("td", {}, within(load.zeta2, 100)), make("td", {}, within(load.k_c, 1e-6)), make("td", {}, within(load.c_c, 1)))));
  const diagnosis = state.so_far || {};
  const mayNot = !driving() || diagnosis.running || !loads.loads.length;
  put(soFar, [mayNot, diagnosis], () => [
    make("button", { type: "button", id: "diagnose", "data-key": "diagnose", disabled: mayNot,
      onclick: async () => { const answer = await post("diagnose", {}); if (!answer.ok) alertWith(answer.error); } },
    diagnosis.running ? `Diagnosing ${diagnosis.taps || ""} taps …` : "Diagnose what there is so far"),
    make("span", { role: "status", class: "small" }, diagnosis.why ? ` ${diagnosis.why}` : diagnosis.running ? " It takes some minutes, and gives way to the session." : diagnosis.ready ? ` Of ${diagnosis.taps} taps, below.` : "")]);
  const done = (state.reported || state.diagnosed) && state.session;
  const wanted = `${done ? `${state.session} ${state.reported} ${state.diagnosed}` : ""} ${diagnosis.ready ? diagnosis.taps : ""}`;
  if (wanted === opened) return;
  opened = wanted;
  documents.replaceChildren();
  const frame = (title, src) => documents.append(sheet(title, make("iframe", { class: "report", src, sandbox: "", title })));
  if (diagnosis.ready) frame(`Diagnosis of the first ${diagnosis.taps} taps`, "/sessions/so-far/diagnosis");
  if (done) {
    if (state.reported) frame("Report of this session", `/sessions/${state.session}/report`);
    if (state.diagnosed) frame("Diagnosis of this session", `/sessions/${state.session}/diagnosis`);
  }
}

export const loads = {
  show(root) {
    key = make("p", { class: "key" });
    const theory = (page.parts.loads || {}).theory || [];
    build(theory);
    damping = plot({
      title: "Damping of the contact mode against load", x: "load, mN", y: "ζ2, %", series: [{ colour: "b" }], height: 320,
      hooks: { draw: [(u) => boxes(u, found().map((l) => ({ x: l.load_mn, box: l.damping_box, scale: 100 })), "b")] },
      range: () => span(found().flatMap((l) => ends(l.damping_box, 100))),
    });
    table = make("tbody");
    told = make("p", { role: "status" });
    soFar = make("p");
    documents = make("div", { class: "documents" });
    opened = "";
    const headings = ["step", "load, mN", "taps", "f2, Hz", "ζ2, %", "k_c, MN/m", "c_c, N s/m"];
    root.append(
      make("div", { class: "two" }, sheet("Contact stiffness against theory", stiffness.box, key), sheet("Damping of the contact mode", damping.box)),
      sheet("Loads: combined taps with 95 % intervals", make("p", { class: "small" }, "Loads are those of the calibration before the test; the report follows the gauge to each tap."), told, make("div", { class: "scroll" }, make("table", { id: "loads" }, make("thead", {}, make("tr", {}, ...headings.map((h) => make("th", { scope: "col" }, h)))), table)), soFar),
      documents);
    show();
  },
  update(part) {
    if (["loads", "state", "audience"].includes(part)) show();
  },
  end() {
    stiffness.end();
    damping.end();
    stiffness = damping = null;
    curves = -1;
  },
};
