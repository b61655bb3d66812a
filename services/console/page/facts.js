// How it goes in figures: source, clock, rates, latency, drops, processes, and where the files are.
import { histogram } from "./histogram.js";
import { byId, make, setText } from "./make.js";

const ROWS = ["Source", "Scene", "Samples", "Clock", "Frames", "Left out", "Processes", "Kept in"];

export function watchFacts(connection) {
  const cells = Object.fromEntries(ROWS.map((name) => [name, make("dd", {}, "–")]));
  const bars = make("canvas", { id: "histogram", role: "img", "aria-label": "How often each latency came in the last minute; the line above says it in numbers" });
  const parts = make("p", { class: "soft" }), typical = make("span", { id: "latency" });
  const files = make("div", { id: "files" });
  byId("panel-facts").append(
    files,
    make("dl", { class: "facts" }, ...ROWS.flatMap((name) => [make("dt", {}, name), cells[name]])),
    make("h3", {}, "Sample to light: ", typical), bars, parts);
  let told = "";
  connection.on("status", (status) => {
    for (const [name, text] of Object.entries(facts(status))) setText(cells[name], text);
    setText(parts, status.latency === null ? "No latency is known: no states, or another machine's clock." : inParts(status.latency));
    const { latency } = status;
    setText(typical, latency === null ? "–" : `median ${latency.p50_ms.toFixed(0)}, 95 % in ${latency.p95_ms.toFixed(0)} ms`);
    histogram(bars, latency);
    const now = `${status.take} ${status.finishing} ${status.last_take} ${status.root}`;
    if (now !== told) { told = now; list(files, status); }
  });
}

function facts(status) {
  return {
    Source: status.source ?? "–",
    Scene: status.scene === null ? "–" : `${status.scene}${status.preparing ? " (being prepared)" : ""}`,
    Samples: `${known(status.sample_rate_hz, 0, "a second and eye")}, ${status.states_hz.toFixed(0)} states a second`,
    Clock: status.clock_uncertainty_ms === null ? "uncertainty not known" : status.clock_uncertainty_ms === 0 ? "this machine's own, exact" : `± ${status.clock_uncertainty_ms.toPrecision(2)} ms`,
    Frames: status.fps === null ? "–" : `${known(status.reached_fps, 1, "")} of ${status.fps.toFixed(0)} a second`,
    "Left out": `${status.dropped ?? 0} frames, ${status.late_samples} late samples`,
    Processes: `${processes(status.processes)}; ${status.pages} ${status.pages === 1 ? "page" : "pages"} open`,
    "Kept in": status.finishing ? `${status.finishing}, its report is being written` : status.take === null ? "nothing is kept now" : `${status.take}, ${inTime(status.take_s ?? 0)}`,
  };
}

const known = (value, digits, unit) => (value === null ? "–" : `${value.toFixed(digits)} ${unit}`.trim());

function processes(all) {
  const well = all.filter(({ state, restarts }) => state === "running" && !restarts);
  const told = all.filter((one) => !well.includes(one)).map(inWords);
  return [...(well.length ? [`${well.map(({ name }) => name).join(", ")} running`] : []), ...told].join("; ") || "none";
}

function inWords({ name, state, restarts, last_error }) {
  const again = restarts ? `, started anew ${restarts === 1 ? "once" : `${restarts} times`}` : "";
  return `${name} ${state}${again}${last_error && state !== "running" ? ` (${last_error})` : ""}`;
}

function inParts({ sample_to_state_ms: state, state_to_frame_ms: frame, frame_to_sink_ms: sink }) {
  return `Medians: sample to state ${state.toFixed(1)} ms, state to frame ${frame.toFixed(1)} ms, frame to picture ${sink.toFixed(1)} ms.`;
}

export const inTime = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;

function list(files, { take, finishing, last_take, root }) {
  files.replaceChildren();
  if (take === null && finishing === null && last_take !== null) {
    files.append(make("p", {}, "Last take: ", make("a", { href: `/sessions/${encodeURIComponent(last_take)}/report.html`, target: "_blank", id: "report" }, "report"),
      ", folder ", make("span", { class: "path", id: "folder" }, root === null ? last_take : `${root}/${last_take}`)));
  }
}
