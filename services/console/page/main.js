// Puts the page's parts together.
import { watchCalibration } from "./calibration.js";
import { Connection } from "./connection.js";
import { watchControls } from "./controls.js";
import { watchFacts } from "./facts.js";
import { watchFrames } from "./frames.js";
import { listenForKeys } from "./keys.js";
import { byId } from "./make.js";
import { watchPlan } from "./plan.js";
import { watchProblems } from "./problems.js";
import { say } from "./say.js";
import { sessionForm } from "./session.js";
import { watchSettings } from "./settings.js";
import { makeTabs } from "./tabs.js";
import { watchTraces } from "./traces.js";

const connection = new Connection();
watchProblems(connection);
watchFrames(connection);
watchTraces(connection);
watchPlan(connection);
watchFacts(connection);
watchSettings(connection);
makeTabs();
const controls = watchControls(connection, sessionForm(connection));
const calibration = watchCalibration(connection);
byId("calibrate").addEventListener("click", calibration.open);
// A button that only asks names its request; what is replied is said.
document.addEventListener("click", async ({ target }) => {
  const request = target.closest("button[data-ask]")?.dataset.ask;
  if (request) say((await connection.ask(request)).reply);
});
listenForKeys({
  s: ["start or stop the session", controls.startOrStopByKey],
  r: ["start or stop recording", controls.recordOrNot],
  c: ["calibrate pupils", calibration.open],
  " ": ["pause the traces, or go on", () => byId("pause").click()],
});
connection.connect();
