// Draws both pupils' last seconds: two strips above each other, fast movements below, one time axis.
import { EYES, SECONDS } from "./trace_store.js";

const AXIS_PX = 34, SCREENS_PX = 15, MOVES_PX = 16, TIMES_PX = 18, GAP_PX = 6, LABEL_PX = 11;
const NAMED_FROM_PX = 34;  // a narrower band has no room for its name; its hatching and the number's side say it
const SCREENS = { white: { ground: "#ffffff", ink: "#1b1f23" }, black: { ground: "#000000", ink: "#f2f2f2" } };
const BANDS = { closing: "closing", blink: "blink", opening: "opening", dropout: "no pupil", lost: "lost" };

export function colours(element) {
  const style = getComputedStyle(element);
  return (name) => style.getPropertyValue(`--${name}`).trim();
}

// `canvas` is as large as its place on the page; `now_s` stands at its right edge.
export function draw(context, width, height, store, now_s, colour) {
  const from_s = now_s - SECONDS;
  // A calibration's screens have a ribbon of their own above the strips: no line has to be seen on white and on black.
  const head_px = store.screens.some(({ screen }) => screen in SCREENS) ? SCREENS_PX : 0;
  const strip_px = (height - head_px - MOVES_PX - TIMES_PX - GAP_PX) / 2;
  const x = (t_s) => AXIS_PX + ((t_s - from_s) / SECONDS) * (width - AXIS_PX - 4);
  const range_mm = store.range_mm(from_s);
  context.clearRect(0, 0, width, height);
  context.font = `${LABEL_PX}px system-ui, sans-serif`;
  EYES.forEach((eye, place) => {
    const top = head_px + place * (strip_px + GAP_PX);
    const y = (mm) => top + strip_px * (1 - (mm - range_mm[0]) / (range_mm[1] - range_mm[0]));
    context.save();
    context.beginPath();
    context.rect(AXIS_PX, top, width - AXIS_PX - 4, strip_px);
    context.clip();
    bands(context, store, eye, from_s, now_s, x, top, strip_px, colour);
    grid(context, x, y, range_mm, now_s, top, strip_px, colour);
    samples(context, store, eye, from_s, x, y, colour);
    context.restore();
    axis(context, eye, y, range_mm, top, strip_px, colour);
  });
  if (head_px) screens(context, store, from_s, now_s, x, height - MOVES_PX - TIMES_PX, colour);
  movements(context, store, from_s, x, head_px + 2 * strip_px + GAP_PX, width, colour);
  times(context, x, now_s, height, colour);
}

function screens(context, store, from_s, now_s, x, bottom, colour) {
  store.screens.forEach(({ t_s, screen }, at) => {
    const until_s = store.screens[at + 1]?.t_s ?? now_s;
    if (!(screen in SCREENS) || until_s < from_s) return;
    const begin = x(Math.max(t_s, from_s)), wide = x(until_s) - begin;
    context.fillStyle = SCREENS[screen].ground;
    context.fillRect(begin, 0, wide, SCREENS_PX - 2);
    context.strokeStyle = colour("soft");
    context.strokeRect(begin + 0.5, 0.5, wide - 1, SCREENS_PX - 3);
    context.setLineDash([3, 3]);
    context.strokeRect(begin + 0.5, SCREENS_PX, wide - 1, bottom - SCREENS_PX);
    context.setLineDash([]);
    if (wide > NAMED_FROM_PX) named(context, screen, begin + 5, SCREENS_PX - 5, SCREENS[screen].ink);
  });
}

function bands(context, store, eye, from_s, now_s, x, top, height, colour) {
  for (const { phase, from_s: begin_s, to_s } of store.spans(eye, from_s, now_s)) {
    const begin = x(begin_s), wide = Math.max(x(to_s) - begin, 1);
    context.fillStyle = colour(phase === "lost" ? "band-lost" : "band");
    context.globalAlpha = phase === "closing" || phase === "opening" ? 0.55 : 0.85;
    context.fillRect(begin, top, wide, height);
    context.globalAlpha = 1;
    if (phase === "dropout" || phase === "lost") hatch(context, begin, top, wide, height, colour("band-ink"));
    // A blink also has a bar along its foot: it is told from a dropout without its colour.
    if (phase === "blink") { context.fillStyle = colour("band-ink"); context.fillRect(begin, top + height - 4, wide, 4); }
    if (wide > NAMED_FROM_PX) named(context, BANDS[phase] ?? phase, begin + 3, top + LABEL_PX, colour("band-ink"));
  }
}

function hatch(context, left, top, wide, height, ink) {
  context.save();
  context.beginPath();
  context.rect(left, top, wide, height);
  context.clip();
  context.strokeStyle = ink;
  context.globalAlpha = 0.35;
  context.beginPath();
  for (let at = left - height; at < left + wide; at += 9) { context.moveTo(at, top + height); context.lineTo(at + height, top); }
  context.stroke();
  context.restore();
}

function grid(context, x, y, [low, high], now_s, top, height, colour) {
  context.strokeStyle = colour("grid");
  context.beginPath();
  for (let mm = low; mm <= high; mm++) { context.moveTo(x(now_s - SECONDS), y(mm)); context.lineTo(x(now_s), y(mm)); }
  for (let back = 0; back <= SECONDS; back += 5) { context.moveTo(x(now_s - back), top); context.lineTo(x(now_s - back), top + height); }
  context.stroke();
}

function samples(context, store, eye, from_s, x, y, colour) {
  const { mm, measured_mm } = store.eyes[eye];
  const first = store.firstAfter(from_s);
  context.fillStyle = colour("measured");
  let last_x = NaN, last_y = NaN;
  for (let at = first; at < mm.length; at++) {
    const dot_x = Math.round(x(store.t_s[at])) - 1, dot_y = Math.round(y(measured_mm[at])) - 1;
    // Samples come faster than pixels: one dot is enough for those that fall on the same place.
    if (!(measured_mm[at] > 0) || (dot_x === last_x && dot_y === last_y)) continue;
    context.fillRect(dot_x, dot_y, 2, 2);
    [last_x, last_y] = [dot_x, dot_y];
  }
  context.strokeStyle = colour(`${eye}-eye`);
  context.lineWidth = 1.6;
  context.beginPath();
  let drawn = false;
  for (let at = first; at < mm.length; at++) {
    const gap = at > first && store.t_s[at] - store.t_s[at - 1] > 0.25;
    if (Number.isNaN(mm[at])) { drawn = false; continue; }
    if (drawn && !gap) context.lineTo(x(store.t_s[at]), y(mm[at])); else context.moveTo(x(store.t_s[at]), y(mm[at]));
    drawn = true;
  }
  context.stroke();
  context.lineWidth = 1;
}

function axis(context, eye, y, [low, high], top, height, colour) {
  const every = height / (high - low) < LABEL_PX + 1 ? 2 : 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (let mm = low; mm < high; mm += every) {
    named(context, String(mm), AXIS_PX - 5, Math.min(y(mm), top + height - LABEL_PX / 2), colour("soft"));
  }
  named(context, "mm", AXIS_PX - 5, top + LABEL_PX / 2, colour("soft"));
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
}

// A short tick for a microsaccade, a tall one with a head for a saccade.
function movements(context, store, from_s, x, top, width, colour) {
  context.fillStyle = colour("text");
  for (const { t_s, kind } of store.saccades) {
    if (t_s < from_s) continue;
    const small = kind === "microsaccade";
    context.fillRect(x(t_s), top + (small ? 9 : 3), 1.5, small ? 6 : 12);
    if (!small) context.fillRect(x(t_s) - 1.5, top + 2, 4.5, 3);
  }
}

function times(context, x, now_s, height, colour) {
  for (let back = SECONDS; back >= 0; back -= 5) {
    context.textAlign = back === SECONDS ? "left" : back ? "center" : "right";
    named(context, back ? `−${back} s` : "now", x(now_s - back), height - 4, colour("soft"));
  }
  context.textAlign = "left";
}

function named(context, text, left, bottom, ink) {
  context.fillStyle = ink;
  context.fillText(text, left, bottom);
}
