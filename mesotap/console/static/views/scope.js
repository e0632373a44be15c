// Both accelerometers, the hammer and the load live, for setting up, and the check of the wiring by one tap.

import { page, post } from "../wire.js";
import { alertWith, figure, fixed, make, number, sheet } from "../parts.js";
import { plot } from "../plots.js";
import { responses } from "../response.js";
import { driving } from "../main.js";

const SPANS_MS = [10, 20, 50, 100, 200, 500, 1000, 2000];
let root, trace, push, pushes, hammer, hammered, pushed, spectrum, begin, ask, form, averaged, levels, gates, said, verdicts, relation, holding, drawn, held;

async function act(what, content = {}) {
  const answer = await post(what, content);
  if (!answer.ok) alertWith(answer.error);
  return answer;
}

function settings() {
  const fields = new FormData(form);
  return { averages: Number(fields.get("averages")), span_ms: Number(fields.get("span")), triggered: fields.get("mode") === "tap", level: Number(fields.get("level")) };
}

function drawTrace(p) {
  const t = new Float64Array(p.points);
  for (let i = 0; i < p.points; i++) t[i] = p.first_ms + i * p.step_ms;
  trace.set([t, p.numbers.subarray(0, p.points), p.numbers.subarray(p.points, 2 * p.points)]);
  if (p.forces) push.set([t, p.numbers.subarray(2 * p.points, 3 * p.points)]);
}

function drawSpectrum(p) {
  const from = (2 + p.forces) * p.points;
  const f = new Float64Array(p.bins - 1);
  for (let i = 1; i < p.bins; i++) f[i - 1] = i * p.bin_hz;
  spectrum.set([f, p.numbers.subarray(from + 1, from + p.bins), p.numbers.subarray(from + p.bins + 1, from + 2 * p.bins)]);
}

function draw() {
  drawn = 0;
  const p = page.parts.picture;
  if (!root || !p || !p.numbers || held) return;
  if (p.points) drawTrace(p);
  if (p.count) drawSpectrum(p);
  averaged.textContent = `${p.count} of ${p.averages} averaged`;
  page.pictures = (page.pictures || 0) + 1;
}

// What is shown of each channel, a row each: name, and of a level its text and whether it is as it should be.
const ROWS = [
  ["rms, m/s²", (level) => [number(level.rms)]],
  ["peak, m/s²", (level) => [number(level.peak)]],
  ["of full scale", (level) => [`${number(100 * level.share, 2)} %`]],
  ["range", (level) => (level.overloaded ? ["✗ overloaded", false] : level.peak === 0 ? ["✗ nothing", false] : ["✓ in range", true])],
  ["noise, m/s² rms", (level, p) => (level.noise === null ? ["–"] : level.noise > p.largest_noise ? [`✗ ${number(level.noise)}`, false] : [`✓ ${number(level.noise)}`, true])],
];

function levelRow(name, of, p) {
  return make("tr", {}, make("th", { scope: "row" }, name), ...p.levels.map((level) => {
    const [text, good] = of(level, p);
    return make("td", { class: good === true ? "good" : good === false ? "bad" : "" }, text);
  }));
}

function showLevels() {
  const p = page.parts.picture;
  if (!p || !levels) return;
  levels.replaceChildren(...ROWS.map(([name, of]) => levelRow(name, of, p)));
  const text = `Full scale ${number(p.full_scale)} m/s². A session takes a tap with at most ${number(p.largest_noise, 2)} m/s² rms of noise; with the noise of now a tap has to reach ${number(p.least_tap, 2)} m/s², and is felt from ${number(p.threshold, 2)} m/s² on.${p.lost ? ` The recorder lost ${p.lost} samples.` : ""}`;
  if (gates.textContent !== text) gates.textContent = text;
  const told = p.levels.flatMap((level, i) => (level.overloaded ? [`${"AB"[i]} is overloaded.`] : [])).join(" ");
  if (said.textContent !== told) said.textContent = told;
}

// The hammer, where there is one: its trace under that of A and B, its level, and what its taps so far came to.
function showHammer() {
  const p = page.parts.picture;
  if (!root) return;
  const has = Boolean(p && p.hammer);
  pushes.hidden = hammered.hidden = !has;
  if (!has) return;
  const { peak, reach, dead } = p.hammer;
  const level = dead ? "✗ its channel never changes" : `peak of the last half second ${number(peak)} N; the channel holds ${number(reach)} N`;
  if (pushed.textContent !== level) pushed.textContent = level;
  pushed.classList.toggle("bad", dead);
}

function showResponse() {
  if (root) hammer.update("No tap in the force channel yet: tap with the hammer.");
}

const STATES = { none: "Not checked yet.", quiet: "Keep off the rig: the noise is measured.", waiting: "Waiting for the tap.", done: "" };

function showCheck() {
  const p = page.parts.picture;
  if (!p || !verdicts) return;
  const { state, verdicts: found, numbers } = p.check;
  const key = JSON.stringify(p.check);
  if (verdicts.dataset.key === key) return; // what has not changed is not read out again
  verdicts.dataset.key = key;
  const bad = found.filter((v) => v.passed === false);
  verdicts.replaceChildren(
    make("p", { class: `verdict ${state !== "done" ? "" : bad.length ? "bad" : "good"}` }, STATES[state] || (bad.length ? `✗ ${bad.length} of ${found.length} to mend` : "✓ wiring and polarity are right")),
    make("ul", { class: "verdicts" }, ...[...bad, ...found.filter((v) => v.passed !== false)].map((v) =>
      make("li", { class: v.passed === false ? "bad" : "" }, make("b", {}, `${v.passed === false ? "✗" : v.passed ? "✓" : "–"} ${v.name}: `), v.says))));
  relation.replaceChildren(...("gain" in numbers ? [
    figure("polarity of B against A", numbers.gain < 0 ? "opposite" : "equal", ""),
    figure("correlation", fixed(numbers.correlation, 4), `${fixed(numbers.correlation_low, 4)} to ${fixed(numbers.correlation_high, 4)}`),
    figure("gain of B over A", `${fixed(Math.abs(numbers.gain), 4)} ± ${number(numbers.gain_half, 1)}`, ""),
    figure("delay of B", `${fixed(numbers.delay_samples, 3)} ± ${number(numbers.delay_half, 1)}`, "samples"),
  ] : []));
}

function showAsk() {
  const question = page.parts.state && page.parts.state.ask;
  ask.hidden = !question;
  if (!question) return;
  ask.replaceChildren(
    make("p", { class: "big" }, question.text),
    make("button", { type: "button", class: "main", id: "done", disabled: !driving(), onclick: () => act("answer", { id: question.id }) }, "Done"));
}

function showControls() {
  const state = page.parts.state;
  if (!state || !root) return;
  const may = driving();
  const runs = state.viewing;
  begin.hidden = runs;
  begin.querySelector("button").disabled = !may || state.running;
  begin.querySelector("p").textContent = state.running ? "A session runs: the view can begin when it has ended." : "What the gauge reads as the view begins counts as no load. Nothing moves; over the load limit the surfaces are taken apart.";
  for (const button of root.querySelectorAll("[data-runs]")) button.disabled = !may || !runs;
  for (const field of form.querySelectorAll("input, select")) field.disabled = !may || !runs;
  const simulated = page.parts.picture && page.parts.picture.simulated;
  for (const button of root.querySelectorAll("[data-simulated]")) button.hidden = !simulated;
  showAsk();
}

function follow() { // what another page has set, unless somebody writes here
  const p = page.parts.picture;
  if (!p || form.contains(document.activeElement)) return;
  const set = (name, value) => { const field = form.elements[name]; if (field.value !== String(value)) field.value = value; };
  set("averages", p.averages);
  set("span", p.span_ms);
  set("mode", p.triggered ? "tap" : "free");
  set("level", p.level);
}

function fields() {
  const change = () => { if (form.reportValidity()) act("view/show", settings()); };
  return make("form", { class: "line", id: "view-settings", onsubmit: (event) => event.preventDefault(), onchange: change },
    make("label", {}, "time shown, ms", make("select", { name: "span" }, ...SPANS_MS.map((ms) => make("option", { value: ms, selected: ms === 50 }, ms)))),
    make("label", {}, "trace", make("select", { name: "mode" }, make("option", { value: "free" }, "runs freely"), make("option", { value: "tap" }, "begins at a tap"))),
    make("label", {}, "level of the trigger, m/s²", make("input", { name: "level", type: "number", min: 0.001, max: 1000, step: "any", value: 0.05, required: true })),
    make("label", {}, "spectra averaged", make("input", { name: "averages", type: "number", min: 1, max: 200, step: 1, value: 16, required: true })),
    make("button", { type: "button", id: "reset", "data-runs": true, onclick: () => act("view/reset") }, "Average anew"));
}

function hold() {
  held = !held;
  holding.setAttribute("aria-pressed", String(held));
  holding.textContent = held ? "Go on" : "Hold";
}

export const scope = {
  show(into) {
    root = into;
    held = false;
    drawn = 0;
    const key = () => make("p", { class: "key" }, make("i", { class: "a" }), "A", make("i", { class: "b" }), "B (dashed)");
    const series = [{ colour: "a" }, { colour: "b", dash: [6, 3] }];
    trace = plot({ title: "A and B against time", x: "time, ms", y: "acceleration, m/s²", series, height: 280 });
    spectrum = plot({ title: "Averaged amplitude spectral density of A and B", x: "frequency, Hz", y: "m/s² per √Hz", series, log: true, logX: true, height: 280, rangeX: (u, least, most) => (most > least && least > 0 ? [least, most] : [10, 10000]) });
    push = plot({ title: "Force of the hammer against time", x: "time, ms", y: "force, N", series: [{ colour: "third" }], height: 150 });
    pushes = make("div", { id: "force", hidden: true }, make("h2", {}, "Force of the hammer"), push.box);
    hammer = responses();
    pushed = make("p", { class: "small", id: "hammer-level" });
    hammered = make("section", { class: "sheet", id: "hammer", "aria-label": "Hammer", hidden: true }, make("h2", {}, "Hammer"), pushed, hammer.box,
      make("p", {}, make("button", { type: "button", id: "drop", "data-runs": true, onclick: () => act("view/drop") }, "Leave out the last tap"), " ", make("button", { type: "button", id: "taps-anew", "data-runs": true, onclick: () => act("view/reset") }, "Average anew")));
    ask = make("section", { class: "sheet ask", hidden: true, "aria-label": "What is asked of you" });
    begin = make("section", { class: "sheet", "aria-label": "Begin" }, make("p", {}), make("button", { type: "button", class: "main", id: "begin", onclick: () => act("view/begin") }, "The surfaces are apart: begin the live view"));
    form = fields();
    averaged = make("span", { class: "small", id: "averaged" });
    levels = make("tbody");
    gates = make("p", { class: "small", id: "gates" });
    said = make("p", { class: "bad", role: "alert", id: "overload" });
    verdicts = make("div", { role: "status", id: "check" });
    relation = make("div", { class: "numbers", id: "relation" });
    holding = make("button", { type: "button", id: "hold", "aria-pressed": "false", onclick: hold }, "Hold");
    const headings = ["level", "A", "B"];
    const side = make("select", { id: "side", "aria-label": "where the lower mass is tapped" }, make("option", { value: "middle" }, "between the accelerometers"), make("option", { value: "a" }, "beside A"), make("option", { value: "b" }, "beside B"));
    root.append(ask, begin,
      make("div", { class: "two" },
        sheet("Trace", key(), trace.box, pushes),
        sheet("Spectrum", make("p", { class: "key" }, make("i", { class: "a" }), "A", make("i", { class: "b" }), "B (dashed) · ", averaged), spectrum.box)),
      hammered,
      make("div", { class: "two" }, make("div", { class: "stack" },
        sheet("Levels", make("div", { class: "scroll" }, make("table", { id: "levels" }, make("thead", {}, make("tr", {}, ...headings.map((h) => make("th", { scope: "col" }, h)))), levels)), said, gates),
        sheet("What is shown", form, make("p", {}, holding, " ", make("button", { type: "button", id: "tap", "data-runs": true, "data-simulated": true, onclick: () => act("view/tap") }, "Tap the simulated rig"), " ", make("button", { type: "button", id: "end", "data-runs": true, onclick: () => act("view/end") }, "End the view")))),
        sheet("Wiring and polarity", make("p", {}, make("label", {}, "tap the lower mass, from above", side)),
          make("p", {}, make("button", { type: "button", class: "main", id: "check-by-tap", "data-runs": true, onclick: () => act("view/check", { side: side.value }) }, "Check by one tap")), verdicts, relation)));
    this.update("state");
    this.update("picture");
    this.update("response");
  },
  update(part) {
    if (!root) return;
    if (["state", "audience", "you", "connection"].includes(part)) showControls();
    if (part === "picture") {
      if (page.parts.picture && root.querySelector("[data-simulated]").hidden === Boolean(page.parts.picture.simulated)) showControls();
      showLevels();
      showHammer();
      showCheck();
      follow();
      if (!drawn) drawn = requestAnimationFrame(draw);
    }
    if (part === "response") showResponse();
  },
  end() {
    trace.end();
    spectrum.end();
    push.end();
    hammer.end();
    root = push = pushes = hammer = hammered = pushed = trace = spectrum = begin = ask = form = averaged = levels = gates = said = verdicts = relation = holding = null;
  },
};
