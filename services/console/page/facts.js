// How it goes in figures: source, clock, rates, latency, drops, processes, and where the files are.
import { histogram } from "./histogram.js";
import { byId, make, setText } from "./make.js";

const ROWS = ["Source", "Scene", "Samples", "Clock", "Frames", "Left out", "Processes", "Recording"];

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
    const now = `${status.recording} ${status.finishing} ${status.last_recording}`;
    if (now !== told) { told = now; list(files, status); }
  });
}

function facts({ host, bridge, worker, ...status }) {
  const scene = worker?.scene ?? host?.config?.view.scene, uncertainty_ms = bridge?.clock_uncertainty_ms ?? null;
  return {
    Source: bridge?.source ?? host?.config?.eyes.source ?? "–",
    Scene: scene ? `${scene}${worker?.preparing ? " (being prepared)" : ""}` : "–",
    Samples: `${known(bridge?.rate_hz, 0, "a second and eye")}, ${status.states_hz.toFixed(0)} states a second`,
    Clock: uncertainty_ms === null ? "uncertainty not known" : uncertainty_ms === 0 ? "this machine's own, exact" : `± ${uncertainty_ms.toPrecision(2)} ms`,
    Frames: worker ? `${known(worker.reached_fps, 1, "")} of ${known(worker.fps, 0, "a second")}` : "–",
    "Left out": `${worker?.dropped ?? 0} frames, ${bridge?.late_samples ?? 0} late samples`,
    Processes: `${processes(status.processes)}; ${status.pages} ${status.pages === 1 ? "page" : "pages"} open`,
    Recording: status.finishing ? `${status.finishing}, its report is being written` : status.recording === null ? "nothing now" : `${status.recording}, ${inTime(status.recording_s ?? 0)}`,
  };
}

const known = (value, digits, unit) => (value === null || value === undefined ? "–" : `${value.toFixed(digits)} ${unit}`.trim());

function processes(all) {
  const well = all.filter(({ state, restarts }) => state === "running" && !restarts);
  const told = all.filter((one) => !well.includes(one)).map(inWords);
  return [...(well.length ? [`${well.map(({ name }) => name).join(", ")} running`] : []), ...told].join("; ") || "none";
}

function inWords({ name, state, restarts, last_error }) {
  const again = restarts ? `, started again ${restarts === 1 ? "once" : `${restarts} times`}` : "";
  return `${name} ${state}${again}${last_error && state !== "running" ? ` (${last_error})` : ""}`;
}

function inParts({ sample_to_state_ms: state, state_to_frame_ms: frame, frame_to_sink_ms: sink }) {
  return `Medians: sample to state ${state.toFixed(1)} ms, state to frame ${frame.toFixed(1)} ms, frame to picture ${sink.toFixed(1)} ms.`;
}

export const inTime = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;

function list(files, { recording, finishing, last_recording, host }) {
  files.replaceChildren();
  if (recording === null && finishing === null && last_recording !== null) {
    files.append(make("p", {}, "Last recording: ", make("a", { href: `/sessions/${encodeURIComponent(last_recording)}/report.html`, target: "_blank", id: "report" }, "report"),
      ", folder ", make("span", { class: "path", id: "folder" }, `${host.root}/${last_recording}`)));
  }
}
