// Elements: what came from elsewhere is only ever text.

export function make(tag, options = {}, ...inner) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (name === "class") element.className = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...inner.filter((part) => part !== null && part !== undefined));
  return element;
}

export function sheet(title, ...inner) {
  return make("section", { class: "sheet" }, make("h2", {}, title), ...inner);
}

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return value.toPrecision(digits).replace(/e\+?(-?)(\d+)$/, "·10^$1$2");
}

export function fixed(value, digits = 0) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
}

const MOST_DECIMALS = 12;

// A value with the half width of its 95 % interval: that with two significant digits, the value with as many decimals.
export function within(estimate, scale = 1) {
  if (!estimate || !Number.isFinite(estimate.value * scale)) return "–";
  const value = estimate.value * scale;
  const half = Number((estimate.half * scale).toPrecision(2)); // 0.0996 is 0.10: rounded before its decimals are counted
  if (!Number.isFinite(half) || half <= 0) return `${value.toPrecision(4)} ± ${half === 0 ? "0" : "–"}`;
  const decimals = Math.min(MOST_DECIMALS, Math.max(0, 1 - Math.floor(Math.log10(half))));
  return `${value.toFixed(decimals)} ± ${half.toFixed(decimals)}`;
}

export function figure(name, value, unit, id) {
  return make("div", {}, make("span", { class: "small" }, name), make("b", id ? { id } : {}, value, make("span", { class: "unit" }, ` ${unit}`)));
}

// Put parts into a place only when what they say has changed: a button that is pressed, or has the focus, stays the same
// one. Those that come anew find the focus again by their data-key.
export function put(place, said, parts) {
  const text = JSON.stringify(said);
  if (place.dataset.said === text) return;
  place.dataset.said = text;
  const key = place.contains(document.activeElement) ? document.activeElement.dataset.key : undefined;
  place.replaceChildren(...parts());
  if (key !== undefined) [...place.querySelectorAll("[data-key]")].find((element) => element.dataset.key === key)?.focus();
}

export function alertWith(text) {
  const box = document.getElementById("alert");
  box.textContent = text;
  box.hidden = !text;
}
