// What is always in view, the pages below it, and STOP.

import { connect, listen, page, post, stop } from "./wire.js";
import { alertWith, fixed } from "./parts.js";
import { redrawAll } from "./plots.js";
import { session } from "./views/session.js";
import { calibration } from "./views/calibration.js";
import { taps } from "./views/taps.js";
import { loads } from "./views/loads.js";
import { sessions } from "./views/sessions.js";
import { settings } from "./views/settings.js";
import { scope } from "./views/scope.js";

const views = { session, calibration, taps, loads, sessions, settings, scope };
const offered = Array.from(document.querySelectorAll("nav a"), (link) => link.hash.slice(1)); // a console for setting up has fewer
const byId = (id) => document.getElementById(id);
let view = null;

function route() {
  const asked = location.hash.slice(1).split("/")[0];
  const name = offered.includes(asked) ? asked : offered[0];
  const next = views[name];
  if (view && view.end) view.end();
  view = next;
  const root = byId("view");
  root.replaceChildren();
  view.show(root);
  for (const link of document.querySelectorAll("nav a")) {
    if (link.getAttribute("href") === `#${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${name} – mesotap console`;
}

// --- always in view ---------------------------------------------------------

function showLoad() {
  const { load, state } = page.parts;
  if (!load || !state) return;
  const limit = state.limit_mn;
  const target = state.plan_mn[state.load_set];
  byId("load").textContent = load.mn === null ? "–" : fixed(load.mn);
  byId("target").textContent = target === undefined ? "–" : fixed(target);
  byId("limit").textContent = fixed(limit);
  const full = limit ? limit * 1.1 : 1;
  const at = (value) => Math.max(0, Math.min(1000, (1000 * value) / full));
  byId("bar-load").setAttribute("width", load.mn === null ? 0 : at(load.mn));
  byId("bar-target").setAttribute("x", target === undefined ? -20 : at(target) - 4);
  byId("bar-limit").setAttribute("x", limit ? at(limit) - 4 : -20);
  const age = load.at === null ? null : Date.now() / 1000 - load.at;
  byId("load-age").textContent = age === null ? "no reading yet" : age < 1 ? "read just now" : `read ${age < 120 ? `${Math.round(age)} s` : `${Math.round(age / 60)} min`} ago`;
  document.querySelector(".figure").classList.toggle("stale", age === null || age > 1);
}

function setText(id, text) {
  const element = byId(id);
  if (element.textContent !== text) element.textContent = text; // what has not changed is not read out again
}

function paused(state) {
  return `Paused, ${state.watched ? "the load is watched" : "the surfaces are apart"}. Continue, or STOP.`;
}

function showState() {
  const state = page.parts.state;
  if (!state) return;
  document.body.classList.toggle("unconnected", !page.connected);
  if (!page.connected) {
    setText("words", "no connection");
    setText("detail", "what is shown is old");
    setText("next", BY_HAND);
  } else {
    setText("words", state.stopping ? "stopping" : state.paused ? "paused" : state.words);
    setText("detail", state.text);
    setText("next", state.stopping ? stopping(state) : state.ask ? state.ask.text : state.paused ? paused(state) : state.next);
  }
  if (state.stopping || !state.running) unconfirmed = false;
  const ended = state.ended;
  alertWith(unconfirmed ? UNCONFIRMED : !page.connected ? unconnected() : state.alarm ? sentence(state.alarm) : ended && ended.how !== "filed" ? sentence(ended.text) : drifted());
}

const BY_HAND = "If there is a load: back the micrometer off by hand, or reach STOP from another page.";
const UNCONFIRMED = "STOP is not confirmed: the console does not answer. Back the micrometer off by hand.";
const CONFIRMED_MS = 1000; // STOP is on the wire within 0.1 s of the press
let unconfirmed = false;

function stopping(state) {
  if (state.state === "FILE") return "STOP was received: the surfaces are apart, the session file is written to its end.";
  if (state.words === "starting") return "STOP was received: nothing moves towards contact; the session ends as soon as it has started.";
  return "STOP was received: the surfaces are being taken apart.";
}

// As the first of a sentence, and with the page's button for the command.
function sentence(text) {
  return (text.charAt(0).toUpperCase() + text.slice(1)).replace("; 'mesotap resume' goes on", "").replace("the surfaces are taken apart; the surfaces are apart", "the surfaces are apart");
}

function drifted() {
  const { compared } = page.parts.calibration || {};
  return compared && compared.drifted ? "The strain gauge drifted between its calibrations: the loads of this session are in doubt. Calibration says by how much." : "";
}

function unconnected() {
  if (page.full) return "Too many pages of this console are open: close one of them.";
  const kept = drove && Date.now() - lostAt < KEPT_MS ? "; control is kept for this page for ten seconds" : "";
  return `The connection to the console is lost and is tried again. A console that has gone or hangs ends its session with the surfaces apart; otherwise it goes on${kept}.`;
}

const KEPT_MS = 10000;
let lostAt = 0;
let drove = false; // when it was last connected
let back = ""; // what became of control while the connection was lost

export function driving() {
  const audience = page.parts.audience;
  return Boolean(page.connected && audience && audience.holder === page.number);
}

// Whether control was kept or lost while the connection was.
function noteControl() {
  if (!page.connected) back = drove ? "lost" : "";
  else if (page.parts.audience) {
    drove = driving();
    if (back === "lost") back = drove ? "kept" : "gone";
    else if (drove !== (back === "kept")) back = "";
  }
}

function showControl() {
  const audience = page.parts.audience;
  const button = byId("control");
  if (!audience) {
    if (!page.connected) setText("who", page.number === null ? "" : `Page ${page.number} has no connection.`);
    button.disabled = true;
    return;
  }
  const watchers = audience.pages.length - (audience.holder_open ? 1 : 0);
  const others = `${watchers} watching`;
  button.hidden = false;
  if (driving()) {
    const asking = audience.asking[0];
    setText("who", `This page (${page.number}) holds control${back === "kept" ? ", kept for it while its connection was lost" : ""}; ${others}.`);
    button.textContent = asking ? `Hand control to page ${asking}` : "You hold control";
    button.disabled = !asking;
    button.onclick = () => post("control", { do: "give", to: asking });
  } else if (audience.holder === null) {
    setText("who", back === "gone" ? "Nobody holds control: this page lost its connection for more than ten seconds." : "Nobody holds control.");
    button.textContent = "Take control";
    button.disabled = false;
    button.onclick = () => post("control", { do: "take" });
  } else {
    const asked = audience.asking.includes(page.number);
    const watching = back === "gone" ? `lost its connection for more than ten seconds, and watches` : "watches";
    const away = audience.holder_open ? "" : "; its connection is lost: if it is not back in ten seconds, anybody may take control";
    setText("who", `This page (${page.number}) ${watching}; page ${audience.holder} holds control${away}.`);
    button.textContent = asked ? "Control asked for" : "Ask for control";
    button.disabled = asked;
    button.onclick = () => post("control", { do: "ask" });
  }
}

// --- STOP -------------------------------------------------------------------

function pressStop() {
  const state = page.parts.state;
  const runs = state && state.running;
  const doubted = () => {
    const now = page.parts.state;
    unconfirmed = Boolean(!page.connected || (now && now.running && !now.stopping && !now.ended));
    showState();
  };
  if (runs || !page.connected) setTimeout(doubted, CONFIRMED_MS);
  stop().catch(doubted);
}

byId("stop").addEventListener("pointerdown", (event) => {
  if (event.button === 0) pressStop(); // when it goes down, not when it comes up
});
byId("stop").addEventListener("click", (event) => {
  if (event.detail === 0) pressStop(); // by keyboard or by a program that helps
});
addEventListener("keydown", (event) => {
  if (event.key !== " " || event.repeat) return;
  const field = event.target.closest?.("input, textarea, select, [contenteditable]");
  if (field && field.type !== "checkbox") return; // somebody writes
  event.preventDefault();
  pressStop();
}, { capture: true });
addEventListener("keyup", (event) => { // a button or a checkbox acts when the key comes up
  if (event.key === " " && event.target.closest?.("button, a, input[type=checkbox]")) event.preventDefault();
}, { capture: true });

// A link is good once, for whoever opens it: only the page that drives gives one.
byId("another").addEventListener("click", async () => {
  const answer = await post("link", {});
  byId("link").textContent = answer.ok ? `${location.origin}${answer.path} (opens once)` : answer.error;
});

// --- dark and light ---------------------------------------------------------

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  localStorage.setItem("mesotap-theme", name);
  redrawAll();
}

byId("theme").addEventListener("click", () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
setTheme(localStorage.getItem("mesotap-theme") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));

listen((part) => {
  if (part === "connection" && !page.connected && document.body.classList.contains("unconnected") === false) lostAt = Date.now();
  if (part === "audience" || part === "connection") noteControl();
  if (part === "load" || part === "state") showLoad();
  if (["state", "calibration", "connection", "you"].includes(part)) showState();
  if (["audience", "you", "connection"].includes(part)) showControl();
  setText("connection", page.connected ? `connected as page ${page.number}` : "not connected: trying again");
  if (view && view.update) view.update(part);
});
setInterval(() => {
  showLoad();
  if (!page.connected) showState(); // what is said of control changes with time
}, 500);
addEventListener("hashchange", route);
route();
connect();
