// What each load came to, against theory; and the report and the diagnosis.

import { page } from "../wire.js";
import { make, sheet, within } from "../parts.js";
import { plot, points } from "../plots.js";

let stiffness, damping, table, document_;

function show() {
  const { loads, state } = page.parts;
  if (!loads || !stiffness) return;
  const found = loads.loads.filter((load) => load.k_c);
  const theory = loads.theory;
  const all = [...theory.map((p) => [p.load_mn, p.k_c * 1e-6, null]), ...found.map((l) => [l.load_mn, null, l.k_c.value * 1e-6])].sort((p, q) => p[0] - q[0]);
  stiffness.set([all.map((p) => p[0]), all.map((p) => p[1]), all.map((p) => p[2])]);
  const zetas = loads.loads.filter((load) => load.zeta_c);
  damping.set([zetas.map((l) => l.load_mn), zetas.map((l) => l.zeta_c.value * 100)]);
  table.replaceChildren(...loads.loads.map((load) => make("tr", {}, make("td", {}, String(load.load_set + 1)), make("td", {}, load.load_mn.toFixed(1)), make("td", {}, String(load.used)),
    make("td", {}, within(load.f2_hz, 1, 1)), make("td", {}, within(load.zeta2, 100, 3)), make("td", {}, within(load.k_c, 1e-6, 3)))));
  if (state && state.state === "DONE" && state.session && !document_.firstChild)
    document_.append(sheet("Report", make("iframe", { class: "report", src: `/sessions/${state.session}/report`, sandbox: "", title: "report of this session" })));
}

export const loads = {
  show(root) {
    stiffness = plot({ title: "Contact stiffness against load", x: "load, mN", y: "k_c, MN/m", series: [{ colour: "third", spanGaps: true }, points("a")], height: 300 });
    damping = plot({ title: "Damping of the contact mode against load", x: "load, mN", y: "ζ2, %", series: [points("b")], height: 300 });
    table = make("tbody");
    document_ = make("div");
    root.append(make("div", { class: "two" }, sheet("Contact stiffness", stiffness.box), sheet("Contact damping", damping.box)),
      sheet("Loads", make("div", { class: "scroll" }, make("table", {}, make("thead", {}, make("tr", {}, ...["step", "load, mN", "taps", "f2, Hz", "ζ2, %", "k_c, MN/m"].map((h) => make("th", { scope: "col" }, h)))), table))),
      document_);
    show();
  },
  update(part) {
    if (part === "loads" || part === "state") show();
  },
  end() {
    stiffness.end();
    damping.end();
    stiffness = damping = null;
  },
};
