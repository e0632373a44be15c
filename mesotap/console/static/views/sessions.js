// Sessions in the console's folder: list, search, open, compare.

import { get, page } from "../wire.js";
import { alertWith, make, sheet, within } from "../parts.js";
import { plot, points } from "../plots.js";

const MOST = 4;
const COLOURS = ["a", "b", "third", "ink"];
let found = [];
let chosen, charts;

function endCharts() {
  for (const chart of charts || []) chart.end();
  charts = [];
}

const marked = (s) => (s.drifted ? `${s.name} ⚠ gauge drifted` : s.name);

function differences(found) {
  const shown = (d) => (d.of === "ratio" ? [d.value, d.low, d.high].map((v) => v.toFixed(4)) : [d.value, d.low, d.high].map((v) => (100 * v).toPrecision(3)));
  const row = (d) => { const [value, low, high] = shown(d); return make("tr", {}, make("td", { class: "text" }, `${d.b} against ${d.a}`), make("td", { class: "text" }, d.of === "ratio" ? "k_c, ratio" : "ζ2, difference in %"), make("td", {}, value), make("td", {}, `${low} to ${high}`), make("td", {}, d.p_value.toPrecision(2))); };
  return sheet("Differences over all loads", make("div", { class: "scroll" }, make("table", { id: "differences" }, make("thead", {}, make("tr", {}, ...["sessions", "of", "value", "95 % interval", "p"].map((h) => make("th", { scope: "col", class: "text" }, h)))), make("tbody", {}, ...found.filter((d) => d.load_mn === null).map(row)))), make("p", {}, "Masses, springs, weights and clock that the sessions have in common are counted once. How much specimens scatter is not in these intervals: 'mesotap compare --by title' tells."));
}

async function compare(into) {
  endCharts();
  const taken = [];
  for (const id of chosen) {
    const answer = await get(`/api/sessions/${id}`).then((r) => r.json()).catch((error) => ({ error: String(error.message) }));
    if (answer.error) alertWith(answer.error);
    else taken.push(answer);
  }
  const x = [...new Set(taken.flatMap((s) => s.loads.map((l) => l.load_mn)))].sort((p, q) => p - q);
  const column = (session, of) => x.map((load) => { const l = session.loads.find((entry) => entry.load_mn === load); return l ? of(l) : null; });
  const series = taken.map((_, i) => points(COLOURS[i], { points: { show: true, size: 8 + 3 * i, width: 2, fill: "transparent" } }));
  const stiffness = plot({ title: "Contact stiffness of the sessions", x: "load, mN", y: "k_c, MN/m", series, height: 320 });
  const damping = plot({ title: "Damping of the sessions", x: "load, mN", y: "ζ2, %", series, height: 320 });
  charts = [stiffness, damping];
  const key = make("p", { class: "key" }, ...taken.map((s, i) => make("span", {}, make("i", { class: ["a", "b", "c", "d"][i] }), marked(s))));
  const doubtful = taken.filter((s) => s.drifted);
  const doubt = doubtful.length ? make("p", { class: "warning", role: "alert" }, `⚠ The strain gauge drifted in ${doubtful.map((s) => s.name).join(", ")}: every load there is in doubt, and with it where its points stand. Its report says by how much.`) : null;
  const targets = [...new Set(taken.flatMap((s) => s.loads.map((l) => l.target_mn)))].sort((p, q) => p - q);
  const row = (target) => make("tr", {}, make("td", {}, target.toFixed(1)), ...taken.map((s) => { const l = s.loads.find((entry) => entry.target_mn === target); return make("td", {}, l ? `${within({ value: l.k_c.value, half: (l.k_c.high - l.k_c.low) / 2 }, 1e-6)} at ${within({ value: l.load_mn, half: l.load_half_mn })} mN` : "–"); }));
  into.replaceChildren(sheet("Compared", key, ...(doubt ? [doubt] : []), make("div", { class: "two" }, stiffness.box, damping.box),
    make("div", { class: "scroll" }, make("table", { id: "compared" }, make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "planned load, mN"), ...taken.map((s) => make("th", { scope: "col" }, `k_c, MN/m, at the measured load: ${marked(s)}`)))), make("tbody", {}, ...targets.map(row))))));
  const told = await get(`/api/compare?ids=${[...chosen].join(",")}`).then((r) => r.json()).catch((error) => ({ error: String(error.message) }));
  into.append(told.error ? make("p", { class: "warning" }, `Differences cannot be tested: ${told.error}`) : differences(told.differences));
  stiffness.set([x, ...taken.map((s) => column(s, (l) => l.k_c.value * 1e-6))]);
  damping.set([x, ...taken.map((s) => column(s, (l) => l.zeta2.value * 100))]);
  into.scrollIntoView();
}

export const sessions = {
  async show(root) {
    chosen = new Set();
    charts = [];
    const rows = make("tbody");
    const opened = make("div");
    const search = make("input", { type: "search", class: "wide", id: "search", autocomplete: "off" });
    const button = make("button", { type: "button", id: "compare", disabled: true, onclick: () => compare(opened) }, `Compare those marked (at most ${MOST})`);
    const mark = (s) => make("input", { type: "checkbox", "aria-label": `compare ${s.name}`, disabled: !s.report, title: s.report ? "" : "it has no report yet, so that there is nothing to compare", onkeydown: (event) => { if (event.key === "Enter") event.target.click(); }, onchange: (event) => {
      if (event.target.checked && chosen.size < MOST) chosen.add(s.id);
      else chosen.delete(s.id);
      event.target.checked = chosen.has(s.id);
      button.disabled = chosen.size < 2;
    } });
    const open = (s, what) => {
      endCharts();
      opened.replaceChildren(sheet(`${what} of ${s.name}`, make("iframe", { class: "report", src: `/sessions/${s.id}/${what}`, sandbox: "", title: `${what} of ${s.name}` })));
      opened.scrollIntoView();
    };
    const runs = (s) => page.parts.state && page.parts.state.running && page.parts.state.session === s.id;
    const stateOf = (s) => `${runs(s) ? `runs: ${page.parts.state.words}` : s.goes_on || s.state}${s.drifted ? " ⚠ gauge drifted" : ""}`;
    const cut = (text) => make("td", { class: "text" }, make("span", { class: "cut", title: text }, text));
    const list = () => {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const hits = found.filter((s) => words.every((w) => `${s.name} ${s.specimen} ${s.title} ${s.operator} ${stateOf(s)} ${s.verdict || ""} ${(s.mechanisms || []).join(" ")}`.toLowerCase().includes(w)));
      chosen.clear();
      button.disabled = true;
      rows.replaceChildren(...hits.map((s) => make("tr", {},
        make("td", { class: "text" }, mark(s)), make("td", { class: "text name" }, s.name), cut(s.specimen), cut(s.title), make("td", { class: `text state${s.drifted ? " bad" : ""}` }, stateOf(s)), make("td", {}, `${s.accepted} of ${s.taps}`),
        make("td", { class: "text buttons" }, ...["report", "diagnosis"].filter((what) => s[what]).map((what) => make("button", { type: "button", onclick: () => open(s, what) }, what))))));
    };
    search.addEventListener("input", list);
    const headings = ["compare", "name", "specimen", "title", "state", "good taps", "open"];
    root.append(sheet("Sessions in this folder", make("label", {}, "search", search),
      make("div", { class: "scroll" }, make("table", { id: "past" }, make("thead", {}, make("tr", {}, ...headings.map((h) => make("th", { scope: "col", class: "text" }, h)))), rows)), make("p", {}, button)), opened);
    found = (await (await get("/api/sessions")).json()).sessions;
    list();
  },
  end() {
    endCharts();
  },
};
