// Sessions in the console's folder: list, search, open.

import { get } from "../wire.js";
import { make, sheet } from "../parts.js";

let found = [];

export const sessions = {
  async show(root) {
    const rows = make("tbody");
    const opened = make("div");
    const search = make("input", { type: "search", class: "wide", id: "search", autocomplete: "off" });
    const list = () => {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const hits = found.filter((s) => words.every((w) => `${s.name} ${s.specimen} ${s.title} ${s.operator} ${s.state}`.toLowerCase().includes(w)));
      rows.replaceChildren(...hits.map((s) => make("tr", {},
        make("td", { class: "text" }, s.name), make("td", { class: "text" }, s.specimen), make("td", { class: "text" }, s.title), make("td", { class: "text" }, s.state), make("td", {}, `${s.accepted} of ${s.taps}`),
        make("td", { class: "text" }, ...["report", "diagnosis"].filter((what) => s[what]).map((what) => make("button", { type: "button", onclick: () => open(s, what) }, what))))));
    };
    const open = (s, what) => {
      opened.replaceChildren(sheet(`${what} of ${s.name}`, make("iframe", { class: "report", src: `/sessions/${s.id}/${what}`, sandbox: "", title: `${what} of ${s.name}` })));
      opened.scrollIntoView();
    };
    search.addEventListener("input", list);
    root.append(sheet("Sessions in this folder", make("label", {}, "search", search),
      make("div", { class: "scroll" }, make("table", { id: "past" }, make("thead", {}, make("tr", {}, ...["name", "specimen", "title", "state", "good taps", "open"].map((h) => make("th", { scope: "col", class: "text" }, h)))), rows))), opened);
    found = (await (await get("/api/sessions")).json()).sessions;
    list();
  },
};
