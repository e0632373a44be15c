// Each tap: its record and spectrum, the verdict with its reason, what it came to, and the row of this load.

import { page, post, recordIn, get } from "../wire.js";
import { alertWith, figure, fixed, make, put, sheet, within } from "../parts.js";
import { plot } from "../plots.js";
import { responses } from "../response.js";
import { driving } from "../main.js";

let record, spectrum, answered, answer, pushes, pushed, push, row, choice, verdict, numbers, hand, noted, where, chosen = null, shown = null, judging = false;

function tapOf(n) {
  return (page.parts.taps || { taps: [] }).taps.find((tap) => tap.number === n) || null;
}

function draw() {
  const r = shown;
  if (!r || !record) return;
  const t = new Float64Array(r.samples);
  for (let i = 0; i < r.samples; i++) t[i] = (1e3 * (i - r.pretrigger)) / r.rate_hz;
  record.set([t, r.a, r.b]);
  const last = Math.min(r.bins, Math.ceil(Math.min(5000, r.rate_hz / 2) / r.bin_hz));
  const f = new Float64Array(Math.max(0, last - 1));
  for (let i = 1; i < last; i++) f[i - 1] = i * r.bin_hz;
  spectrum.set([f, r.spectrum.subarray(1, last)]);
  pushes.hidden = !r.force;
  if (r.force) {
    const first = Math.max(0, r.pretrigger - Math.round(2e-3 * r.rate_hz)), end = Math.min(r.samples, r.pretrigger + Math.round(6e-3 * r.rate_hz));
    push.set([t.subarray(first, end), r.force.subarray(first, end)]);
    pushed.set([f, r.force_spectrum.subarray(1, last)]);
  }
  if (r.came && !r.drawn) {
    r.drawn = true;
    requestAnimationFrame(() => {
      page.latency.push({ tap: r.number, drawn_s: Date.now() / 1000 - r.told_at });
      if (page.latency.length > 5000) page.latency.shift();
    });
  }
}

function showVerdict() {
  const tap = shown && (tapOf(shown.number) || shown);
  if (!verdict) return;
  if (!tap) {
    put(verdict, "none", () => [make("p", {}, "No tap yet.")]);
    numbers.replaceChildren();
    hand.hidden = true;
    return;
  }
  const left = tap.accepted && tap.left_out;
  const sign = left ? "– good, and left out by the choice so far" : tap.accepted ? "✓ accepted" : "✗ not used";
  put(verdict, [tap.number, tap.accepted, tap.reason, tap.by_hand, tap.overruled, tap.left_out, tap.hammer], () => [
    make("p", { class: `verdict ${left ? "left" : tap.accepted ? "good" : "bad"}` }, `Tap ${tap.number}: ${sign}${tap.by_hand ? " by hand" : ""}`),
    left ? make("p", { class: "small", id: "left-out" }, tap.left_out.replace(/^left out: /, "")) : "",
    tap.hammer ? make("p", { class: "small", id: "hammer" }, tap.hammer) : "",
    make("p", {}, tap.accepted ? (tap.by_hand ? `reason: ${tap.by_hand}${tap.overruled ? `; against it spoke: ${tap.overruled}` : ""}` : "") : tap.reason)]);
  const j = tap.judged;
  const share = j.force_ratio;
  const limit = page.parts.state.force_limit || 1;
  const lost = share / limit;
  const drift = page.parts.state.locked_mn === null || tap.load_set !== page.parts.state.load_set ? tap.after_mn - tap.before_mn : tap.after_mn - page.parts.state.locked_mn;
  const m = tap.modes || {};
  numbers.replaceChildren(
    figure("f2", within(m.f2_hz, 1), "Hz", "tap-f2"),
    figure("ζ2", within(m.zeta2, 100), "%", "tap-zeta2"),
    figure("k_c", within(m.k_c, 1e-6), "MN/m", "tap-kc"),
    figure("peak", fixed(j.peak_acceleration_m_s2, 2), "m/s²"),
    tap.peak_force_n === null || tap.peak_force_n === undefined ? "" : figure("hammer's peak", fixed(tap.peak_force_n, 2), "N", "tap-force"),
    figure("load drift since lock", Number.isFinite(drift) ? `${drift >= 0 ? "+" : ""}${drift.toFixed(1)}` : "–", "mN"),
    figure("relieves the contact by", share === null || share === undefined ? "–" : fixed(100 * share), "% of the load"),
    make("div", {}, make("span", { class: "small" }, `limit ${fixed(100 * limit)} %; at 100 % the surfaces part`), make("meter", { min: 0, max: 1.5, low: 0.8, high: 1, optimum: 0, value: Math.min(1.5, lost || 0), "aria-label": "force against the loss-of-contact limit" })));
  if (tap.modes && tap.modes.notes && tap.modes.notes.length) numbers.append(make("p", { class: "small" }, tap.modes.notes.join("; ")));
  hand.hidden = !page.parts.state.running || page.parts.state.state === "FILE";
  hand.querySelector("button").textContent = tap.accepted ? "Reject this tap" : "Accept this tap";
  hand.querySelector("button").disabled = !driving();
}

function showRow() {
  const state = page.parts.state;
  if (!state || !row) return;
  const set = shown ? shown.load_set : state.load_set;
  const here = (page.parts.taps || { taps: [] }).taps.filter((tap) => tap.load_set === set);
  const missing = Math.max(0, state.wanted - here.filter((tap) => tap.accepted).length);
  const now = shown ? shown.number : null;
  const target = state.plan_mn[set];
  where.textContent = target === undefined ? "" : `At ${fixed(target)} mN`;
  const good = here.filter((tap) => tap.accepted), leftOut = good.filter((tap) => tap.left_out);
  choice.hidden = !(state.used < state.wanted);
  choice.textContent = `${good.length} of ${state.wanted} good taps made, ${state.used} will be used: ${good.length - leftOut.length} kept and ${leftOut.length} left out so far.`;
  put(row, [now, missing, here.map((tap) => [tap.number, tap.accepted, tap.left_out, tap.peak_force_n])], () => [
    ...here.map((tap) => make("li", {}, make("button", {
      type: "button", "data-key": tap.number, class: tap.accepted ? (tap.left_out ? "left" : "good") : "bad", "aria-pressed": now === tap.number ? "true" : "false",
      "aria-label": `tap ${tap.number}, ${tap.accepted ? (tap.left_out ? "good, left out by choice" : "accepted") : "not used"}`, onclick: () => choose(tap.number),
    }, `${tap.accepted ? (tap.left_out ? "–" : "✓") : "✗"} ${tap.number}`, tap.peak_force_n === null || tap.peak_force_n === undefined ? null : make("span", { class: "small" }, ` ${fixed(tap.peak_force_n, 1)} N`)))),
    ...Array.from({ length: missing }, () => make("li", { class: "empty", "aria-hidden": "true" }))]);
}

function showResponse() {
  const told = page.parts.response || {};
  answered.hidden = !told.taps;
  if (answered.hidden) return;
  const target = page.parts.state && page.parts.state.plan_mn[told.load_set];
  answered.querySelector("#response-of").textContent = `Hammer, taps so far${target === undefined ? "" : ` at ${fixed(target)} mN`}`;
  answer.update("");
}

async function choose(n) {
  noted.textContent = "";
  chosen = n;
  try {
    shown = recordIn(await (await get(`/api/taps/${n}`)).arrayBuffer());
  } catch {
    const tap = tapOf(n);
    if (tap) shown = { ...tap, samples: 0, bins: 0, a: [], b: [], spectrum: new Float32Array(0), force: null };
  }
  draw();
  showRow();
  showVerdict();
}

async function judge(event) {
  event.preventDefault();
  if (judging) return; // pressed twice: the first is under way
  const tap = tapOf(shown.number);
  const field = hand.querySelector("input");
  const reason = field.value.trim();
  if (!reason) {
    noted.textContent = "Give a reason first: it is kept with the tap.";
    field.focus();
    return;
  }
  judging = true;
  noted.textContent = "";
  const answer = await post("judge", { number: tap.number, accepted: !tap.accepted, reason }).finally(() => { judging = false; });
  if (!hand) return; // another page was opened meanwhile
  if (!answer.ok) alertWith(answer.error);
  else {
    field.value = "";
    noted.textContent = page.parts.state.paused ? "Noted; it counts when the session goes on." : "Noted.";
  }
}

export const taps = {
  show(root) {
    record = plot({ title: "Record of A and B", x: "time after the trigger, ms", y: "acceleration, m/s²", series: [{ colour: "a" }, { colour: "b", dash: [6, 3] }], height: 190 });
    spectrum = plot({ title: "Spectrum of the mean of A and B", x: "frequency, Hz", y: "m/s² per Hz", series: [{ colour: "third" }], log: true, height: 170 });
    push = plot({ title: "Force of the hammer", x: "time after the trigger, ms", y: "force, N", series: [{ colour: "a" }], height: 150 });
    pushed = plot({ title: "Spectrum of the force", x: "frequency, Hz", y: "N per Hz", series: [{ colour: "third" }], log: true, height: 150 });
    pushes = make("div", { id: "force", hidden: true }, make("h2", {}, "Force of the hammer"), push.box, make("h2", {}, "Spectrum of the force"), pushed.box);
    choice = make("p", { class: "small", id: "choice", role: "status", hidden: true });
    row = make("ul", { class: "row-of-taps", id: "row" });
    verdict = make("div", { role: "status", id: "verdict" });
    numbers = make("div", { class: "numbers" });
    hand = make("form", { class: "line", hidden: true, novalidate: true, onsubmit: judge },
      make("label", {}, "reason, kept with the tap", make("input", { name: "reason", class: "wide", required: true, maxlength: 200, autocomplete: "off" })),
      make("button", { type: "submit", id: "judge" }, "Reject this tap"),
      noted = make("span", { role: "status", class: "small", id: "noted" }));
    answer = responses();
    answered = make("section", { class: "sheet", id: "response", "aria-label": "Hammer", hidden: true }, make("h2", { id: "response-of" }), answer.box);
    const newest = make("button", { type: "button", onclick: () => { chosen = null; shown = page.record; this.update("record"); } }, "Follow the newest");
    where = make("h2");
    const key = make("span", { class: "key" }, make("i", { class: "a" }), "A", make("i", { class: "b dashed" }), "B");
    root.append(
      make("section", { class: "sheet line", "aria-label": "Taps at this load" }, where, row, newest, choice),
      make("div", { class: "two" },
        make("section", { class: "sheet", "aria-label": "Verdict" }, verdict, numbers, hand),
        make("section", { class: "sheet", "aria-label": "Record and spectrum" },
          make("h2", {}, "Record", key), record.box, make("h2", {}, "Spectrum of the mean of A and B"), spectrum.box, pushes)),
      answered);
    shown = chosen === null ? page.record : shown;
    draw();
    showRow();
    showVerdict();
    showResponse();
  },
  update(part) {
    if (part === "response") showResponse();
    if (part === "record" && chosen === null) {
      shown = page.record;
      draw();
    }
    if (["record", "taps", "state", "audience"].includes(part)) {
      showRow();
      showVerdict();
    }
  },
  end() {
    record.end();
    spectrum.end();
    push.end();
    pushed.end();
    answer.end();
    record = answered = answer = spectrum = push = pushed = pushes = choice = row = verdict = numbers = hand = null;
  },
};
