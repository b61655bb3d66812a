// Start, stop and record; and one line that says how it stands.
import { inTime } from "./facts.js";
import { byId, setText } from "./make.js";
import { say } from "./say.js";
import { openTab } from "./tabs.js";

const SURE_MS = 4000;

export function watchControls(connection, session) {
  const start = byId("start"), record = byId("record");
  let hello = null, status = null, busy = null, came = false, sure_ms = -Infinity;

  async function doing(what, request, values) {
    busy = what;
    show();
    const { done, reply } = await connection.ask(request, values);
    busy = null;
    say(reply);
    show();
    session.refresh();
    return done;
  }

  async function startOrStop() {
    if (start.disabled || start.hidden) return;
    if (status.running) { await doing("Stopping", "stop session"); openTab("facts"); return; }
    if (!session.form.checkValidity()) { openTab("session"); session.form.reportValidity(); return; }
    if (!(await doing("Starting", "start session", { config: session.config() }))) openTab("session");
    else openTab("facts");
  }

  // A key is pressed sooner by mistake than a button: while a recording runs it takes two.
  async function startOrStopByKey() {
    const sure = performance.now() - sure_ms < SURE_MS;
    sure_ms = -Infinity;
    if (status?.running && status.recording !== null && !sure && !start.disabled && !start.hidden) {
      sure_ms = performance.now();
      say("A recording runs. Press s once more to end it and the session.");
    } else await startOrStop();
  }

  async function recordOrNot() {
    if (record.disabled || record.hidden) return;
    if (status.recording === null) await doing("Beginning to record", "record", { name: session.recordingName() });
    else await doing("Finishing the recording", "stop record");
  }

  function show() {
    const connected = hello !== null && status !== null;
    const running = connected && status.running, recording = connected && status.recording !== null;
    start.hidden = record.hidden = connected && !hello.hosted;
    start.disabled = !connected || busy !== null;
    record.disabled = !running || busy !== null;
    setText(byId("start-text"), running ? "Stop" : "Start");
    setText(byId("start-sign"), running ? "■" : "▶");
    start.classList.toggle("main", !running);
    record.setAttribute("aria-pressed", String(recording));
    setText(byId("record-text"), recording ? `Stop recording ${inTime(status.recording_s ?? 0)}` : "Record");
    byId("calibrate").disabled = !running;
    const [state, words] = connected ? (busy ? ["waiting", `${busy}…`] : standing(status)) : ["waiting", "Connecting…"];
    byId("now-mark").dataset.state = state;
    setText(byId("now-text"), words);
    document.body.dataset.live = !connected ? "lost" : !running ? "stopped" : (status.worker?.preparing ?? true) ? "preparing" : "live";
  }

  connection.on("open", (message) => { hello = message; show(); });
  connection.on("status", (message) => {
    // Somebody who comes before anything runs wants to start something.
    if (!came && !message.running && hello.hosted) openTab("session");
    came = true;
    status = message;
    show();
  });
  connection.on("lost", ({ again }) => {
    status = null;
    show();
    byId("now-mark").dataset.state = "bad";
    setText(byId("now-text"), again ? "Not connected; trying again…" : "Not connected");
  });
  start.addEventListener("click", startOrStop);
  record.addEventListener("click", recordOrNot);
  return { startOrStopByKey, recordOrNot };
}

function standing(status) {
  if (!status.running) return ["idle", "Nothing runs. Choose eyes and a scene under Session, then Start."];
  const what = `${status.bridge?.source ?? status.host?.config?.eyes.source ?? "eyes"} viewing ${status.worker?.scene ?? status.host?.config?.view.scene ?? "a scene"}`;
  if (status.host?.state === "stopping") return ["waiting", "Ending; what was recorded is being made whole."];
  if (status.worker === null) return ["waiting", "Starting: eyes and scene are being opened."];
  if (status.worker.preparing) return ["waiting", `Being prepared: ${what}. The first frame takes up to a minute.`];
  if (status.problems.some(({ severity }) => severity === "error")) return ["bad", `Running, but something is wrong: ${what}`];
  const well = status.problems.every(({ severity }) => severity === "note");
  return [well ? "good" : "warn", `${status.recording === null ? "Running" : `Recording into ${status.recording}`}: ${what}`];
}
