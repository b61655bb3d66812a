// Both pupils, scrolling: keeps what comes, draws at most 30 times a second, and says the newest in numbers.
import { byId, make, setText } from "./make.js";
import { colours, draw } from "./trace_plot.js";
import { EYES, TraceStore } from "./trace_store.js";

const BEHIND_S = 0.1;  // so that a state that takes this long to come still appears at the edge and not inside
const SCREEN_LATE_S = 0.2;  // the status comes twice a second: on average a screen is known this much too late
const FRAME_MS = 33, STILL_MS = 500;
const PHASES = {
  tracking: ["tracked", "good"], closing: ["lid closing", "warn"], blink: ["blink", "warn"], opening: ["lid opening", "warn"],
  dropout: ["no pupil", "warn"], lost: ["lost", "bad"],
};

export function watchTraces(connection) {
  const store = new TraceStore();
  const canvas = byId("traces-canvas"), pause = byId("pause");
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let ahead_s = null;  // the server's clock less this page's
  let paused_s = null, held = null, drawn_ms = 0, changed = true;

  const now_s = () => (ahead_s === null ? 0 : performance.now() / 1000 + ahead_s - BEHIND_S);

  connection.on("open", () => { store.clear(); ahead_s = null; });
  connection.on("traces", (traces) => {
    const offset_s = traces.now_s - performance.now() / 1000;
    // The least delayed message is the best clock; 1 ms of drift a message lets it follow a clock that runs slower.
    ahead_s = ahead_s === null || Math.abs(offset_s - ahead_s) > 1 ? offset_s : Math.max(offset_s, ahead_s - 0.001);
    traces.t_s.forEach((t_s, at) => {
      const one = ({ pupil_diameter_mm, measured_mm, phase }) => ({ mm: pupil_diameter_mm[at], measured_mm: measured_mm[at], phase: phase[at] });
      store.add({ t_s, right: one(traces.right), left: one(traces.left) });
    });
    if (traces.t_s.length) {
      for (const eye of EYES) read(eye, traces[eye]);
      canvas.dataset.newest = store.newest_s;
    }
    store.trim(now_s());
    changed = true;
  });
  connection.on("marks", ({ marks }) => {
    for (const { what, t_s } of marks) if (what === "saccade" || what === "microsaccade") store.addSaccade({ t_s, kind: what });
  });
  connection.on("status", ({ bridge, running }) => {
    const screen = bridge?.calibrating?.screen ?? "none";
    store.addScreen(now_s() - SCREEN_LATE_S, screen);
    if (!running && store.newest_s !== null && now_s() - store.newest_s > 2) for (const eye of EYES) nothing(eye);
  });

  function paint(at_ms) {
    requestAnimationFrame(paint);
    if (at_ms - drawn_ms < (calm.matches ? STILL_MS : FRAME_MS) || (ahead_s === null && !changed) || (paused_s !== null && !changed)) return;
    drawn_ms = at_ms;
    changed = false;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw(context, canvas.clientWidth, canvas.clientHeight, held ?? store, paused_s ?? now_s(), inks);
  }

  let inks = palette(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { inks = palette(canvas); changed = true; });
  new ResizeObserver(() => { changed = true; }).observe(canvas);
  pause.addEventListener("click", () => {
    paused_s = paused_s === null ? now_s() : null;
    held = paused_s === null ? null : store.copy();
    pause.setAttribute("aria-pressed", String(paused_s !== null));
    setText(pause, paused_s === null ? "Pause" : "Go on");
    changed = true;
  });
  legend();
  requestAnimationFrame(paint);
}

// Looked up once: asking the style sheet for each line of each frame is slow.
function palette(canvas) {
  const look = colours(canvas), known = new Map();
  return (name) => {
    if (!known.has(name)) known.set(name, look(name));
    return known.get(name);
  };
}

function read(eye, trace) {
  const mm = trace.pupil_diameter_mm.at(-1), phase = trace.phase.at(-1);
  setText(byId(`${eye}-mm`), mm === null ? "–" : mm.toFixed(2));
  const [words, state] = PHASES[phase] ?? [phase, "warn"];
  setText(byId(`${eye}-phase`), trace.borrowed.at(-1) ? `${words}; from the other eye` : words);
  byId(`${eye}-phase`).dataset.state = state;
}

function nothing(eye) {
  setText(byId(`${eye}-mm`), "–");
  setText(byId(`${eye}-phase`), "no data");
  delete byId(`${eye}-phase`).dataset.state;
}

function legend() {
  const words = ["• measured", "— trusted", "▁ blink", "▨ no pupil, lost", "ı microsaccade", "┃ saccade"];
  byId("legend").append(...words.map((text) => make("span", {}, text)));
}
