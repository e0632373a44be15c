// What a hammer showed in the taps so far: force spectrum of the last one, its frequency response with the average, coherence.

import { page } from "./wire.js";
import { make, put } from "./parts.js";
import { plot } from "./plots.js";

// What each estimator takes out, for whoever chooses one.
const ESTIMATORS = {
  h1: ["H1", "H1 takes noise of the accelerometers out of the average: noise of the force makes it too small."],
  h2: ["H2", "H2 takes noise of the force out of the average: noise of the accelerometers makes it too large. It is H1 over the coherence."],
  hv: ["Hv", "Hv shares the noise between force and accelerometers: it lies halfway between H1 and H2 on the logarithmic scale."],
};

let chosen = "h1"; // until the page is left

export function responses({ heading = "h2" } = {}) {
  const f = "frequency, Hz";
  const force = plot({ title: "Spectrum of the force of the last tap", x: f, y: "N per Hz", series: [{ colour: "third" }], log: true, height: 170 });
  const size = plot({ title: "Frequency response of the last tap and of the average", x: f, y: "m/s² per N", series: [{ colour: "b", dash: [6, 3], width: 1 }, { colour: "a", width: 2 }], log: true, height: 230 });
  const coherence = plot({ title: "Coherence", x: f, y: "coherence", series: [{ colour: "a" }], height: 150, range: () => [0, 1.05] });
  const words = make("p", { role: "status", class: "response-words" });
  const window = make("p", { class: "small" });
  const none = make("p", { class: "small", hidden: true }, "The coherence is shown from the second tap on: that of one tap is 1 whatever the noise.");
  const averaged = make("span", { class: "response-taps" });
  const about = make("p", { class: "small" });
  const estimator = make("select", { class: "estimator", onchange: () => { chosen = estimator.value; draw(); } },
    ...Object.entries(ESTIMATORS).map(([name, [shown]]) => make("option", { value: name, selected: name === chosen }, shown)));
  const draw = () => {
    const r = page.parts.response || {};
    about.textContent = `${ESTIMATORS[chosen][1]} For one tap all three are the same.`;
    if (!r.taps) return;
    const x = r.mean.h1.map((_, i) => (i + 1) * r.bin_hz);
    size.set([x, r.last.length ? r.last : x.map(() => null), r.mean[chosen]]);
  };
  const forced = make("div", {}, make(heading, {}, "Spectrum of the last tap's force"), force.box);
  const shown = make("div", { class: "responses" }, forced,
    make(heading, {}, "Frequency response, mean of A and B over the force ", make("span", { class: "key" }, make("span", { class: "item" }, make("i", { class: "b dashed" }), "last tap"), make("span", { class: "item" }, make("i", { class: "a" }), "average of ", averaged))),
    make("p", {}, make("label", {}, "average by ", estimator)), size.box, about,
    make(heading, {}, "Coherence"), none, coherence.box, window);
  const box = make("div", {}, words, shown);
  return {
    box,
    // Draw the part that came last; nothing without a tap.
    update(idle) {
      const r = page.parts.response || {};
      const taps = r.taps || 0;
      put(words, r.words || idle, () => [r.words || idle]);
      words.classList.toggle("bad", Boolean(r.words) && !(r.last || []).length);
      shown.hidden = !taps;
      if (!taps) return;
      const x = r.mean.h1.map((_, i) => (i + 1) * r.bin_hz);
      forced.hidden = !r.force.length;
      if (r.force.length) force.set([x, r.force]);
      draw();
      none.hidden = r.coherence.length > 0;
      coherence.box.hidden = !r.coherence.length;
      if (r.coherence.length) coherence.set([x, r.coherence]);
      averaged.textContent = `${taps} tap${taps === 1 ? "" : "s"}`;
      window.textContent = `Drawn up to ${Math.round(r.excited_hz)} Hz, where the force has fallen by 20 dB; the coherence in words is the lowest from 50 Hz on. ${r.window[0].toUpperCase()}${r.window.slice(1)}.`;
    },
    end() {
      for (const each of [force, size, coherence]) each.end();
    },
  };
}
