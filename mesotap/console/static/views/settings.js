// config.yaml as a form: the sentences of `config check`, the difference, and only then saved.

import { get, post } from "../wire.js";
import { alertWith, make, sheet } from "../parts.js";
import { driving } from "../main.js";

let form, state, outcome, save, changed;

function changes() {
  return Object.fromEntries([...changed].map(([key, input]) => [key, input.value]));
}

async function check() {
  save.disabled = true;
  const answer = await post("settings/check", { changes: changes(), state });
  if (!answer.ok) {
    outcome.replaceChildren(make("p", { class: "bad", role: "alert" }, answer.error));
    return;
  }
  show(answer);
  save.disabled = !changed.size || answer.faults.length > 0 || !driving();
}

// Beside each value what is wrong with it: the list of all faults may be far up the page.
function mark(faults) {
  for (const input of form.querySelectorAll("[name]")) {
    const of = new RegExp(`(^|[^\\w.])${input.name.replaceAll(".", "\\.")}([^\\w.]|$)`);
    const fault = faults.find((line) => of.test(line));
    const said = input.parentNode.querySelector(".fault");
    if (said) said.remove();
    input.toggleAttribute("aria-invalid", false);
    if (!fault) continue;
    input.setAttribute("aria-invalid", "true");
    input.after(make("span", { class: "fault", role: "alert" }, `✗ ${fault}`));
  }
}

function show(answer) {
  mark(answer.faults);
  outcome.replaceChildren(
    ...answer.faults.map((fault) => make("p", { class: "bad", role: "alert" }, `✗ ${fault}`)),
    ...answer.said.map((line) => make("p", { class: "small" }, line)),
    make("pre", { class: "difference", tabindex: 0, "aria-label": "difference" }, ...answer.difference.slice(2).map((line) => make("span", { class: line[0] === "+" ? "good" : line[0] === "-" ? "bad" : "" }, `${line}\n`))));
}

async function keep(event) {
  event.preventDefault();
  const answer = await post("settings", { changes: changes(), state });
  if (!answer.ok) {
    alertWith(answer.error);
    return;
  }
  show(answer);
  if (answer.saved) {
    await load();
    outcome.prepend(make("p", { class: "good", role: "status" }, "✓ saved; the next session begins with it"));
  }
}

async function load() {
  const shown = await (await get("/api/settings")).json();
  state = shown.state;
  changed = new Map();
  save.disabled = true;
  if (shown.error) {
    outcome.replaceChildren(make("p", { class: "bad", role: "alert" }, shown.error));
    return;
  }
  const sections = new Map();
  for (const field of shown.fields) {
    const parts = field.key.split(".");
    const section = parts.slice(0, -1).join(".") || "the file";
    if (!sections.has(section)) sections.set(section, make("fieldset", {}, make("legend", {}, section)));
    const input = field.choices.length
      ? make("select", { name: field.key }, ...field.choices.map((choice) => make("option", choice === field.value ? { selected: true } : {}, choice)))
      : make("input", { name: field.key, value: field.value, autocomplete: "off", class: field.value.length > 20 ? "wide" : "" });
    input.addEventListener("change", () => {
      if (input.value === field.value) changed.delete(field.key);
      else changed.set(field.key, input);
      check();
    });
    sections.get(section).append(make("label", {}, parts[parts.length - 1], input, field.comment ? make("span", { class: "small" }, field.comment) : null));
  }
  form.replaceChildren(...sections.values());
}

export const settings = {
  async show(root) {
    outcome = make("div", { id: "outcome" });
    form = make("div", { class: "fields" });
    save = make("button", { type: "submit", class: "main", id: "save", disabled: true }, "Save");
    const filter = make("input", { type: "search", class: "wide", id: "filter" });
    filter.addEventListener("input", () => {
      for (const label of form.querySelectorAll("label")) label.hidden = !label.textContent.toLowerCase().includes(filter.value.toLowerCase());
      for (const set of form.querySelectorAll("fieldset")) set.hidden = !set.querySelector("label:not([hidden])");
    });
    root.append(make("form", { onsubmit: keep }, sheet("Settings", make("p", { class: "small" }, "Comments of the file are kept. What stands on several lines, and parts of the rig, are changed in the file."),
      make("label", {}, "show those that contain", filter), outcome, save), sheet("All of them", form)));
    await load();
  },
};
