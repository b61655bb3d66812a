// Pupil calibration: begins it, opens the participant's screens, follows it and shows what came of it.
import { gaze } from "./gaze_calibration.js";
import { byId, make, setText } from "./make.js";
import { say } from "./say.js";
import { openTab } from "./tabs.js";

const STAGES = {
  ready: "Waiting for Start, on the participant's screens or here.", "waiting for the display": "Waiting for the participant's screens.",
  paused: "Paused; Go on, there or here, starts the screen again.", ending: "That was all. Working it out…",
  "working it out": "Working it out…",
};

const WAITS = ["ready", "paused"];  // for Start, there or here

export function watchCalibration(connection) {
  let screens_url = null, running = false, calibrating = null, told = null;
  const protocol = choice("calibration-protocol", { robust: "robust (34 s)", luidolt: "luidolt (10 s)" });
  const eyes = choice("calibration-eyes", { both: "both eyes", left: "left eye", right: "right eye" });
  const white_s = seconds("calibration-white"), black_s = seconds("calibration-black");
  const map_mm = make("input", { type: "checkbox", id: "calibration-map" });
  const name = make("input", { type: "text", id: "calibration-name", pattern: "[A-Za-z0-9][A-Za-z0-9_\\-]*", maxlength: 64, placeholder: "the time" });
  const begin = make("button", { id: "calibration-begin", class: "main", onclick: start }, "Begin and open the screens");
  const stop = make("button", { id: "calibration-stop", "data-ask": "stop calibrating pupils", disabled: true }, "Cancel");
  const open = make("a", { id: "calibration-screens", target: "entoptic-screens" }, "Open the screens again");
  const go = make("button", { id: "calibration-go", "data-ask": "start screens", disabled: true }, "Start the screens");
  const stage = make("span", { id: "calibration-stage", role: "status" }), left = make("span", { id: "calibration-left" });
  const bar = make("progress", { id: "calibration-bar", max: 1, value: 0, "aria-label": "Progress of the calibration" });
  const result = make("section", { id: "calibration-result", "aria-label": "Result" });
  const hint = make("p", { class: "soft" }, "Both pupils are to be seen in the traces, below the screens that are shown. ", open);
  const going = make("div", {}, make("p", {}, stage, " ", left), bar, hint);
  const wishes = make("section", { "aria-label": "How" }, field("Protocol", protocol), field("Eyes", eyes), field("White, s", white_s),
    field("Black, s", black_s), field("Map millimetres", map_mm), field("Name", name));
  byId("panel-calibration").append(
    make("p", { class: "soft" }, "White and black screens on a display before the participant. Dim the room; the screens open in a window of their own: move it there, then press Start in it."),
    make("div", { class: "row" }, begin, go, stop), going, result, wishes, gaze(connection));

  async function start() {
    for (const input of [white_s, black_s, name]) if (!input.reportValidity()) return;
    // At once, or the browser takes the window for one that nobody wanted.
    if (screens_url) window.open(screens_url, "entoptic-screens", "popup,width=900,height=700");
    const number = (input) => (input.value === "" ? null : Number(input.value));
    const wish = {
      name: name.value, protocol: protocol.value, eyes: eyes.value, map_mm: map_mm.checked, white_s: number(white_s), black_s: number(black_s),
    };
    let { done, reply, data } = await connection.ask("calibrate pupils", wish);
    if (!done && data?.exists && confirm(`There is a pupil map ${name.value} already. Replace it, if this run is valid?`)) {
      ({ done, reply } = await connection.ask("calibrate pupils", { ...wish, overwrite: true }));
    }
    say(reply);
    if (!done) setText(stage, reply);
  }

  function show() {
    const busy = calibrating !== null;
    begin.disabled = !running || busy || screens_url === null;
    stop.disabled = !busy;
    go.disabled = !busy || !WAITS.includes(calibrating.stage) || calibrating.display === false;
    setText(go, calibrating?.stage === "paused" ? "Go on" : "Start the screens");
    bar.hidden = hint.hidden = !busy;
    wishes.hidden = busy;
    setText(left, "");
    if (!busy) { setText(stage, running ? "" : "Start a session first: its tracker sees the pupils."); return; }
    const { screen, step, steps, seconds_done, seconds: all } = calibrating;
    bar.value = all ? seconds_done / all : 0;
    const words = STAGES[calibrating.stage] ?? `Screen ${step} of ${steps}: ${screen}.`;
    // Beside what is read aloud: it changes all the time.
    if (!(calibrating.stage in STAGES)) setText(left, `${Math.max(all - seconds_done, 0).toFixed(0)} s left.`);
    setText(stage, calibrating.display === false ? `${words} No screens are open yet.` : words);
  }

  connection.on("open", (hello) => {
    screens_url = hello.screens_url;
    if (screens_url) open.href = screens_url;
    show();
  });
  connection.on("lost", () => { running = false; calibrating = null; show(); });
  connection.on("status", (status) => {
    running = status.running;
    calibrating = status.bridge?.calibrating ?? null;
    const calibrated = status.bridge?.calibrated ?? null;
    show();
    const key = JSON.stringify(calibrated);
    if (key !== told) {
      told = key;
      result.replaceChildren(...(calibrated ? outcome(calibrated, start) : []));
      if (calibrated) result.scrollIntoView({ block: "nearest" });
    }
  });
  return { open: () => { openTab("calibration"); (begin.disabled ? byId("tab-calibration") : begin).focus(); } };
}

function outcome({ ok, eyes, problems, plot, out }, retry) {
  const plot_url = plot && `/pupil-maps/${encodeURIComponent(plot.split("/").at(-1))}`;
  const figure = (value, digits, unit) => (value === null || value === undefined ? "–" : `${value.toFixed(digits)} ${unit}`);
  const row = ([eye, { white, black, span, unit, tracked_share, slope_mm_s }]) => make("tr", {}, make("th", { scope: "row" }, eye),
    ...[figure(white, 2, ""), figure(black, 2, ""), figure(span, 2, unit),
      figure(tracked_share === null ? null : 100 * tracked_share, 0, "%"), figure(slope_mm_s, 2, "mm/s")].map((text) => make("td", {}, text)));
  return [
    make("h3", {}, ok ? "Calibrated: it is in use now" : "No result"),
    ...problems.map((problem) => make("div", { class: "problem", "data-weight": "bad" }, make("p", {},
      make("span", { class: "what" }, `${problem.name}: ${problem.detail}.`), ` To do: ${problem.remedy}.`))),
    Object.keys(eyes).length ? make("table", { class: "result" },
      make("thead", {}, make("tr", {}, ...["eye", "white", "black", "span", "seen", "drift"].map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...Object.entries(eyes).map(row))) : null,
    plot_url ? make("a", { href: plot_url, target: "_blank" }, make("img", { class: "plot", src: plot_url, alt: "Both pupils before white and black screens; the table above says the values" })) : null,
    out ? make("p", {}, "Saved in ", make("span", { class: "path" }, out)) : null,
    ok ? null : make("div", { class: "row" }, make("button", { id: "calibration-retry", onclick: retry }, "Try again")),
  ].filter(Boolean);
}

function choice(id, options) {
  return make("select", { id }, ...Object.entries(options).map(([value, label]) => make("option", { value }, label)));
}

const seconds = (id) => make("input", { type: "number", id, min: 1, max: 120, step: "any", placeholder: "as of the protocol" });
const field = (label, input) => make("div", { class: "field" }, make("label", { for: input.id }, label), make("div", { class: "control" }, input));
