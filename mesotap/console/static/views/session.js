// Begin, go on, pause; what is asked of the person at the bench.

import { page, post, get } from "../wire.js";
import { alertWith, fixed, make, put, sheet } from "../parts.js";
import { driving } from "../main.js";

let root, ask, plan, said, actions, unfinished;

async function act(what, content = {}) {
  const answer = await post(what, content);
  if (!answer.ok) alertWith(answer.error);
  return answer;
}

async function lookForUnfinished() {
  const found = await (await get("/api/sessions")).json().catch(() => ({ sessions: [] }));
  unfinished = found.sessions.filter((s) => !s.done || !s.report);
  showActions();
}

function showActions() {
  const state = page.parts.state;
  if (!state || !actions) return;
  const may = driving();
  if (state.viewing) {
    put(actions, "viewing", () => [make("p", {}, "The live view runs (Scope): end it there before a session begins.")]);
    return;
  }
  if (state.running && state.state === "FILE") {
    const doing = `${state.words}${state.text ? `: ${state.text}` : ""} …`;
    put(actions, doing, () => [make("p", { role: "status", id: "filing" }, doing)]);
    return;
  }
  if (state.running) {
    const good = (page.parts.taps || { taps: [] }).taps.filter((tap) => tap.accepted).length;
    const wanted = state.wanted * state.plan_mn.length;
    const step = `step ${Math.min(state.load_set + 1, state.plan_mn.length)} of ${state.plan_mn.length}`;
    put(actions, ["pause", may, state.paused, state.name, good, wanted, step], () => [
      make("p", {}, state.name ? `${state.name}: ${step}, ${good} of ${wanted} good taps` : "starting …"),
      make("p", {}, make("progress", { max: wanted || 1, value: good, "aria-label": "good taps of the whole plan" })),
      make("button", { type: "button", id: "pause", "data-key": "pause", disabled: !may, onclick: () => act("pause") }, state.paused ? "Continue" : "Pause")]);
    return;
  }
  if (actions.querySelector("form")) {
    for (const button of actions.querySelectorAll("button")) button.disabled = !may;
  } else {
    const form = make("form", { class: "line" },
      make("label", {}, "operator", make("input", { name: "operator", autocomplete: "off", maxlength: 100 })),
      make("label", {}, "specimen", make("input", { name: "specimen", class: "wide", autocomplete: "off", maxlength: 200 })),
      make("label", {}, "title", make("input", { name: "title", class: "wide", autocomplete: "off", maxlength: 200 })),
      make("button", { type: "submit", class: "main", id: "run", disabled: !may }, "Start a new session"));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      act("run", Object.fromEntries(new FormData(form)));
    });
    put(actions, "begin", () => [form, make("p", { class: "small" }, "Fields that are left empty are as in the configuration."), make("div", { id: "unfinished" })]);
    lookForUnfinished();
  }
  const list = actions.querySelector("#unfinished");
  if (list && unfinished) {
    put(list, [may, unfinished], () => unfinished.slice(0, 5).map((s) => make("p", {},
      make("button", { type: "button", class: "resume", "data-key": s.id, disabled: !may, onclick: () => act("resume", { id: s.id }) }, `Resume ${s.name}`),
      ` ${s.done ? "its report was not finished" : s.goes_on}, ${s.accepted} good taps${s.specimen ? ` · ${s.specimen}` : ""}`)));
  }
}

function showAsk() {
  const question = page.parts.state && page.parts.state.ask;
  if (!ask) return;
  ask.hidden = !question;
  if (!question) {
    ask.dataset.id = "";
    return;
  }
  if (ask.dataset.id !== String(question.id)) {
    ask.dataset.id = question.id;
    ask.replaceChildren(
      make("p", { class: "big" }, question.text),
      make("p", { class: "big", id: "live" }),
      make("button", { type: "button", class: "main", id: "done", onclick: () => act("answer", { id: question.id }) }, "Done (Enter)"));
  }
  ask.querySelector("#done").disabled = !driving();
  ask.querySelector("#live").textContent = question.stop ? `${question.live}: stop turning` : question.live;
  ask.classList.toggle("now", question.stop);
}

function showPlan() {
  const state = page.parts.state;
  if (!state || !plan) return;
  const taken = (page.parts.taps || { taps: [] }).taps;
  const rows = state.plan_mn.map((target, i) => {
    const good = taken.filter((tap) => tap.load_set === i && tap.accepted).length;
    return [i === state.load_set && state.running && state.state !== "FILE", i + 1, fixed(target, 1), `${good} of ${state.wanted}`];
  });
  put(plan, rows, () => rows.map(([now, step, target, good]) => make("tr", now ? { "aria-current": "step" } : {},
    make("td", {}, `${now ? "▶ " : ""}${step}`), make("td", {}, target), make("td", {}, good))));
}

function showSaid() {
  const state = page.parts.state;
  if (state && said) put(said, state.said, () => state.said.slice().reverse().map((text) => make("li", {}, text)));
}

addEventListener("keydown", (event) => {
  if (event.key !== "Enter" || !root || !root.isConnected) return;
  if (event.target.closest && event.target.closest("input, textarea, select, button, a")) return;
  const done = document.getElementById("done");
  if (done && !ask.hidden && !done.disabled) done.click();
});

export const session = {
  show(into) {
    root = into;
    ask = make("section", { class: "sheet ask", hidden: true, "aria-label": "What is asked of you" });
    actions = make("div");
    plan = make("tbody");
    said = make("ul", { class: "said", "aria-live": "polite" });
    root.append(ask, sheet("Session", actions),
      make("div", { class: "two" },
        sheet("Load plan", make("div", { class: "scroll" }, make("table", { id: "plan" },
          make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "step"), make("th", { scope: "col" }, "load, mN"), make("th", { scope: "col" }, "good taps"))), plan))),
        sheet("What was said, the newest first", said)));
    this.update("state");
  },
  update(part) {
    if (["state", "audience", "you", "connection"].includes(part)) {
      showActions();
      showAsk();
      showSaid();
    }
    if (part === "taps") showActions();
    if (part === "state" || part === "taps") showPlan();
  },
  end() {
    root = ask = actions = plan = said = null;
  },
};
