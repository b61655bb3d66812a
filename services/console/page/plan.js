// The plan of the moment: each effect, its level, why, and its milliseconds against the budget or a frame's time.
import { byId, make, setText } from "./make.js";

const EVERY_MS = 250;  // faster than that nobody reads
const NOT_WORK = new Set(["sink", "displayed"]);  // keeping and publishing a frame is no part of a budget
const NOT_RUNNING = { skipped: "skipped", off: "off" };

export function watchPlan(connection) {
  const body = byId("plan-rows"), rows = new Map();
  let last_ms = 0;
  connection.on("shown", (shown) => {
    if (performance.now() - last_ms < EVERY_MS) return;
    last_ms = performance.now();
    const limit_ms = shown.budget_ms ?? 1000 / shown.fps;
    for (const step of shown.plan) {
      if (!rows.has(step.effect)) rows.set(step.effect, row(body, step.effect));
      fill(rows.get(step.effect), step, limit_ms);
    }
    const parts = Object.entries(shown.milliseconds).filter(([part]) => !NOT_WORK.has(part));
    const sum_ms = parts.reduce((sum, [, ms]) => sum + ms, 0), scene_ms = shown.milliseconds.scene ?? 0;
    const scene = scene_ms > sum_ms / 2 ? `; the scene alone takes ${scene_ms.toFixed(1)} ms` : "";
    const of = shown.budget_ms === null ? `${limit_ms.toFixed(1)} ms, one frame` : `a budget of ${number(limit_ms)} ms`;
    setText(byId("plan-sum"), `${sum_ms.toFixed(1)} ms of ${of}${scene}`);
    byId("plan-sum").dataset.state = sum_ms > limit_ms ? "warn" : "good";
    const most = shown.bound_code_values;
    setText(byId("plan-hides"), most === 0 ? "Nothing that can be seen is left out." :
      `What is left out changes a pixel by ${most < 0.01 ? "under 0.01" : number(most)} code values at most.`);
  });
  const whole = byId("whole");
  whole.addEventListener("change", () => byId("plan").classList.toggle("whole", whole.checked));
}

function row(body, effect) {
  const level = make("td", { class: "level" }), ms = make("span", { class: "number" }), fill_ = make("i");
  const meter = make("span", { class: "meter", "aria-hidden": "true" }, fill_);
  const fading = make("b"), why = make("span"), mark = make("span", { class: "onoff", "aria-hidden": "true" });
  const first = make("tr", { "data-effect": effect },
    make("th", { scope: "row", class: "effect" }, mark, effect.replaceAll("_", " ")), level, make("td", { class: "ms" }, meter, ms));
  const second = make("tr", {}, make("td", { class: "reason", colspan: 3 }, make("span", { class: "clamp" }, fading, why)));
  body.append(first, second);
  return { first, second, level, ms, meter, fill: fill_, fading, why, mark };
}

function fill(row, step, limit_ms) {
  row.first.classList.toggle("resting", !step.runs);
  setText(row.mark, step.runs ? "● " : "○ ");
  setText(row.level, NOT_RUNNING[step.level] ?? `on: ${step.level}`);
  setText(row.fading, step.fading_from ? `Fading from ${step.fading_from}, ${Math.round(step.fade * 100)} % there. ` : "");
  setText(row.ms, step.runs ? step.ms.toFixed(1) : "–");
  row.fill.style.width = `${Math.min(100, (100 * step.ms) / limit_ms)}%`;
  row.meter.classList.toggle("over", step.ms > limit_ms);
  setText(row.why, step.reason);
  row.why.title = step.reason;
}

const number = (value) => String(Number(value.toPrecision(3)));
