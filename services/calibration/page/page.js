// Follows the screens that a calibration asks for, and says when each was really shown, on this page's own clock.
const element = (id) => document.getElementById(id);
const body = document.body;
const now = () => Math.round(performance.now() * 1e6);  // ns
const SILENT_MS = 4000;  // the calibration asks for the time every second
const CONNECT_AGAIN_MS = 1000;
const STAY_AWAY = 1008;
const NOTHING = { screen: "grey", id: 0, stage: "ready" };

let socket = null;
let current = NOTHING;
let shown = null;  // the answer to the current screen, once there is one
let heard_ms = 0;
let silent = true;
let lock = null;

const say = (message) => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

function tell(text) { element("message").textContent = text; }

function allow(label, start, stop) {
  element("start").textContent = label;
  element("start").disabled = !start;
  element("stop").disabled = !stop;
}

function running() { return current.screen !== "grey"; }

const WORDS = {
  "paused": "Paused. The screen that was shown starts again when you go on.",
  "ending": "That was all. Working it out…",
  "aborted": "Stopped. Nothing was changed.",
  "not shown": "Stopped: a screen could not be shown in time.",
};

function follow(command) {
  if (command.id === current.id && command.screen === current.screen) {
    // Asked for again: the answer got lost, or is still to come.
    if (shown) say(shown);
    return;
  }
  current = command;
  shown = null;
  // The first callback changes the colour of the coming frame; when the second is called, that frame is on its way to
  // the display, and its time is that of the frame.
  requestAnimationFrame(() => {
    body.className = command.screen;
    requestAnimationFrame((frame_ms) => {
      if (command !== current) return;
      shown = { shown: command.id, t_ns: Math.round(frame_ms * 1e6) };
      say(shown);
    });
  });
  if (running()) {
    keepAwake();
  } else {
    const paused = command.stage === "paused";
    tell(WORDS[command.stage] ?? "");
    allow(paused ? "Go on" : "Start", paused, paused);
    if (!paused) letSleep();
  }
}

// A sentence of the calibration's belongs to a grey screen, whatever was shown before it began again.
function read({ message, again }) {
  current = { ...current, screen: "grey" };
  body.className = "grey";
  tell(message);
  allow("Start", again, again);
}

async function keepAwake() {
  try { lock ??= await navigator.wakeLock?.request("screen"); } catch { /* then the display may dim; it is soon over */ }
}

function letSleep() {
  lock?.release();
  lock = null;
}

async function fill() {
  try { await document.documentElement.requestFullscreen(); } catch { /* a window does too, if it fills the view */ }
}

async function start() {
  allow("Start", false, false);
  tell("One moment…");
  await fill();
  say({ request: "start" });
}

const pause = () => { if (running()) say({ request: "pause" }); };

function connect() {
  const url = new URL(`display${location.search}`, location.href);
  url.protocol = url.protocol.replace("http", "ws");
  socket = new WebSocket(url);
  socket.onopen = () => { heard_ms = performance.now(); };
  socket.onmessage = (event) => {
    heard_ms = performance.now();
    silent = false;
    const message = JSON.parse(event.data);
    if ("ask" in message) say({ answer: message.ask, t_ns: now() });
    else if ("screen" in message) follow(message);
    else if ("message" in message) read(message);
  };
  socket.onclose = (event) => {
    const kept = element("message").textContent;
    rest(event.reason || (silent ? kept : `${kept} The calibration has ended: the page can be closed.`));
    silent = true;
    if (event.code !== STAY_AWAY) setTimeout(connect, CONNECT_AGAIN_MS);
  };
}

function rest(text) {
  current = NOTHING;
  shown = null;
  body.className = "grey";
  allow("Start", false, false);
  tell(text);
  letSleep();
  if (document.fullscreenElement) document.exitFullscreen();
}

// Whoever asks for screens is gone, or hangs: nobody shall sit before a white or black screen for it.
setInterval(() => {
  if (silent || performance.now() - heard_ms < SILENT_MS) return;
  pause();
  silent = true;
  rest("Nothing is heard of the calibration any more. This page goes on when it is back.");
}, 500);

element("start").addEventListener("click", start);
element("stop").addEventListener("click", () => say({ request: "abort" }));
element("fill").addEventListener("click", fill);
document.addEventListener("keydown", (event) => {
  if (event.code === "Space" && running()) { event.preventDefault(); pause(); }
});
document.addEventListener("fullscreenchange", () => {
  element("fill").hidden = document.fullscreenElement !== null;
  if (!document.fullscreenElement) pause();
});
document.addEventListener("visibilitychange", () => { if (document.hidden) pause(); });
connect();
