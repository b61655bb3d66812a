// What the tracker does by itself: gaze calibration and a recording of its own, started, stopped and followed from here.
import { make } from "./make.js";

const TASKS = [
  ["Gaze, by the tracker", "start calibration", "stop calibration", "gaze"],
  ["Recording, by the tracker", "start tracker recording", "stop tracker recording", "tracker-recording"],
];
const KEPT = 6;

// A section for the panel.
export function gaze(connection) {
  const said = make("ul", { id: "tracker-said", "aria-live": "polite" });
  const button = (text, request, id) => make("button", { id, "data-ask": request }, text);
  connection.on("marks", ({ marks }) => {
    for (const mark of marks) {
      if (mark.what !== "tracker task" && mark.what !== "tracker status") continue;
      const words = mark.what === "tracker task" ? `${mark.task} ${mark.outcome}` : "tracker";
      said.prepend(make("li", {}, `${new Date().toLocaleTimeString()} ${words}${mark.text ? `: ${mark.text}` : ""}`));
      while (said.children.length > KEPT) said.lastChild.remove();
    }
  });
  return make("section", {},
    make("h3", {}, "The tracker's own"),
    make("p", { class: "soft" }, "Pupil Capture shows its own green dots on its own display; what became of them is said here."),
    ...TASKS.map(([label, start, stop, id]) => make("div", { class: "row" }, make("span", { class: "task" }, label), button("Start", start, `${id}-start`), button("Stop", stop, `${id}-stop`))),
    said);
}
