// Follows the screens that a calibration asks for, and says when each was really shown, on this page's own clock.
const element = (id) => document.getElementById(id);
const body = document.body;
const now = () => Math.round(performance.now() * 1e6);  // ns

const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/display`);
const say = (message) => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

let current = { screen: "grey", id: 0, stage: "ready" };
let shown = null;  // the answer to the current screen, once there is one

function tell(text) { element("message").textContent = text; }

function running() { return current.screen !== "grey"; }

const WORDS = {
  "ready": "Ready when you are.",
  "paused": "Paused. The screen that was shown starts anew when you go on.",
  "ending": "That was all. Working it out…",
  "aborted": "Stopped. Nothing was changed.",
  "not shown": "Stopped: a screen could not be shown in time.",
};

function follow(command) {
  if (command.id === current.id) {  // asked for again: the answer got lost, or is still to come
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
      if (command.id !== current.id) return;
      shown = { shown: command.id, t_ns: Math.round(frame_ms * 1e6) };
      say(shown);
    });
  });
  if (!running()) {
    tell(WORDS[command.stage] ?? "");
    const over = command.stage !== "paused";
    element("start").textContent = over ? "Start" : "Go on";
    element("start").disabled = over;
    element("stop").disabled = over;
  }
}

let lock = null;
async function start() {
  element("start").disabled = true;
  element("stop").disabled = true;
  tell("One moment…");
  try { await document.documentElement.requestFullscreen(); } catch { /* a window does too, if it fills the view */ }
  try { lock = await navigator.wakeLock?.request("screen"); } catch { /* then the display may dim; it is soon over */ }
  say({ request: "start" });
}

const pause = () => { if (running()) say({ request: "pause" }); };

socket.onopen = () => {
  tell(WORDS.ready);
  element("start").disabled = false;
  element("stop").disabled = false;
};
socket.onmessage = (event) => {
  const message = JSON.parse(event.data);
  if ("ask" in message) say({ answer: message.ask, t_ns: now() });
  else if ("screen" in message) follow(message);
  else if ("message" in message) {
    tell(message.message);
    element("start").textContent = "Again";
    element("start").disabled = !message.again;
    lock?.release();
  }
};
socket.onclose = (event) => {
  body.className = "grey";
  current = { screen: "grey", id: 0, stage: "ready" };
  element("start").disabled = element("stop").disabled = true;
  const kept = element("message").textContent;
  tell(event.code === 1008 ? event.reason : `${kept} This calibration has ended: the page can be closed.`);
  if (document.fullscreenElement) document.exitFullscreen();
};

element("start").addEventListener("click", start);
element("stop").addEventListener("click", () => say({ request: "abort" }));
document.addEventListener("keydown", (event) => {
  if (event.code === "Space" && running()) { event.preventDefault(); pause(); }
});
document.addEventListener("fullscreenchange", () => { if (!document.fullscreenElement) pause(); });
document.addEventListener("visibilitychange", () => { if (document.hidden) pause(); });
