// The connection to the console: frames in, requests out.

const HEAD = 8;
const TICK_MS = 500;
const MOST_SILENT = 8; // ticks: the console says something every second
const AGAIN = 4001, FULL = 4002;

export const page = {
  key: sessionStorage.getItem("mesotap-page") || newKey(),
  number: null,
  parts: {},
  record: null,
  connected: false,
  full: false,
  latency: [],
};

const listeners = new Set();
let socket = null;
let silent = 0;

function newKey() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  const key = Array.from(bytes, (b) => b.toString(16).padStart(2, "0")).join("");
  sessionStorage.setItem("mesotap-page", key);
  return key;
}

export function listen(listener) {
  listeners.add(listener);
}

function tell(part) {
  for (const listener of listeners) listener(part);
}

function taken(buffer) {
  const view = new DataView(buffer);
  const length = view.getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, HEAD, length)));
  return [message, buffer, HEAD + length];
}

export function recordIn(buffer) {
  const [message, , at] = taken(buffer);
  const n = message.samples;
  message.a = new Float32Array(buffer, at, n);
  message.b = new Float32Array(buffer, at + 4 * n, n);
  message.spectrum = new Float32Array(buffer, at + 8 * n, message.bins);
  const after = at + 8 * n + 4 * message.bins;
  message.force = message.forces ? new Float32Array(buffer, after, n) : null;
  message.force_spectrum = message.forces ? new Float32Array(buffer, after + 4 * n, message.bins) : null;
  return message;
}

export function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const mine = new WebSocket(`${scheme}//${location.host}/ws?page=${page.key}`);
  mine.binaryType = "arraybuffer";
  mine.onmessage = (event) => {
    if (mine === socket) hear(event.data);
  };
  mine.onclose = (event) => {
    if (mine === socket) lost(event.code);
  };
  socket = mine;
  silent = 0;
}

function hear(data) {
  silent = 0;
  const [message, , at] = taken(data);
  if (message.part === "alive") {
    socket.send("here");
    return;
  }
  if (message.part === "you") {
    page.number = message.number;
    page.connected = true;
    page.full = false;
  } else if (message.part === "record") {
    page.record = recordIn(data);
    page.record.came = Date.now() / 1000;
  } else {
    page.parts[message.part] = message;
    if (at < data.byteLength) message.numbers = new Float32Array(data, at);
  }
  tell(message.part);
}

function lost(code) {
  socket = null;
  page.connected = false;
  page.full = code === FULL;
  delete page.parts.audience; // who drives then is told anew
  if (code === AGAIN) page.key = newKey(); // this tab was copied from another
  tell("connection");
  setTimeout(connect, page.full ? 10 * TICK_MS : TICK_MS);
}

// A connection that is lost without a word (radio gone, machine asleep) looks open: it is given up when nothing comes.
setInterval(() => {
  if (socket === null || ++silent <= MOST_SILENT) return;
  const gone = socket;
  lost(0);
  gone.close();
}, TICK_MS);

// STOP goes over the connection that is open already, and as a request: whichever arrives first.
export function stop() {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send("stop");
  return post("stop", {});
}

export async function post(what, content) {
  const response = await fetch(`/api/${what}`, {
    method: "POST",
    headers: { "Content-Type": "application/json", "X-Mesotap": "1", "X-Mesotap-Page": page.key },
    body: JSON.stringify(content),
    keepalive: what === "stop",
  });
  const answer = (response.headers.get("Content-Type") || "").startsWith("application/json")
    ? await response.json()
    : { error: await response.text() };
  return { ...answer, ok: response.ok };
}

export async function get(path) {
  const response = await fetch(path, { headers: { "X-Mesotap": "1" } });
  if (!response.ok) throw new Error(await response.text());
  return response;
}
