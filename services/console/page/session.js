// What a session is made of: eyes, scene and view; and the sessions that are there already.
import { byId, make } from "./make.js";

// Kinds of eyes: what stands for them in a choice, and which fields they have.
const EYES = {
  simulated: ["Simulated eyes", ["seed"]],
  capture: ["Pupil Capture", ["remote"]],
  usb: ["USB eye tracker", ["usb_id"]],
  recording: ["A recording, played", ["recording", "table_map"]],
  "usb-simulated": ["A recording, as if by USB", ["recording", "usb_fault"]],
};
const FILE = "file";
const TEXTS = {
  recording: ["Recording", "Folder or table on the console's machine"],
  remote: ["Capture's address", "tcp://127.0.0.1:50020 unless given"],
  usb_id: ["USB device", "VID:PID; the first one unless given"],
  table_map: ["Column map", "TOML file, for tables of an unknown form"],
  usb_fault: ["Faults", "to try what happens: drop, unplug…, with commas"],
  scene_file: ["Scene file", ".hdr, .exr or a folder of them"],
  head: ["Head", "look-around, still, gaze, or a CSV file"],
  take: ["Name of the take", "letters, digits, - and _; the time unless given"],
};
const NUMBERS = {
  seed: ["Which person", 0, null, 1], mean_luminance: ["Mean, cd/m²", 1e-9, 1e9, null], fps: ["Frames a second", 0.1, 1000, null],
  width: ["Width of an eye, px", 1, 16384, 1], height: ["Height, px", 1, 16384, 1], fov: ["Field of view, °", 1, 175, null],
  seconds: ["Seconds", 0.001, null, null],
};
const NONE_YET = { seed: "0", fps: "24", fov: "104", head: "look-around" };
const KEPT = "entoptic-session";

export function sessionForm(connection) {
  const fields = {}, rows = {};
  const add = (name, label, input, about) => {
    fields[name] = input;
    rows[name] = make("div", { class: "field" }, make("label", { for: input.id }, label), make("div", { class: "control" }, input),
      about ? make("p", { class: "about" }, about) : null);
    return rows[name];
  };
  const text = (name) => add(name, TEXTS[name][0], make("input", { type: "text", id: `session-${name}`, list: `known-${name}`, value: NONE_YET[name] ?? "" }), TEXTS[name][1]);
  const number = (name) => {
    const [label, min, max, step] = NUMBERS[name];
    return add(name, label, make("input", { type: "number", id: `session-${name}`, min, max, step: step ?? "any", value: NONE_YET[name] ?? "" }));
  };
  const select = (name, label, options) => add(name, label, make("select", { id: `session-${name}` }, ...options.map(option)));
  const known = { recording: make("datalist", { id: "known-recording" }), scene_file: make("datalist", { id: "known-scene_file" }) };
  const sessions = make("ul", { id: "sessions" });

  const form = make("form", { id: "session-form" },
    select("kind", "Eyes", Object.entries(EYES).map(([value, [label]]) => ({ value, label }))),
    text("recording"), text("remote"), text("usb_id"), text("table_map"), text("usb_fault"), number("seed"),
    select("pupil_map", "Pupil map", [{ value: "", label: "none" }]),
    select("scene", "Scene", [{ value: "night-street", label: "Street at night" }, { value: FILE, label: "A file or folder" }]),
    text("scene_file"), number("mean_luminance"),
    select("eyes", "Rendered", ["left", "right", "both"].map((value) => ({ value, label: value === "both" ? "both eyes" : `${value} eye` }))),
    number("fps"), number("width"), number("height"), number("fov"), number("seconds"), text("head"), text("take"), ...Object.values(known));
  byId("panel-session").append(form, make("h3", {}, "Sessions kept"), sessions);

  fields.take.pattern = "[A-Za-z0-9][A-Za-z0-9_\\-]*";
  fields.take.maxLength = 64;

  function show() {
    const wanted = EYES[fields.kind.value][1];
    // What is hidden is disabled too: it must not keep a session from starting.
    const row = (name, shown) => { rows[name].hidden = fields[name].disabled = !shown; };
    for (const name of ["recording", "remote", "usb_id", "table_map", "usb_fault", "seed"]) row(name, wanted.includes(name));
    for (const name of ["scene_file", "mean_luminance"]) row(name, fields.scene.value === FILE);
  }
  form.addEventListener("change", () => { show(); localStorage.setItem(KEPT, JSON.stringify(values(fields))); });
  form.addEventListener("submit", (event) => event.preventDefault());
  Object.entries(kept()).forEach(([name, value]) => { if (fields[name] && value) fields[name].value = value; });
  // What another version of this page remembered may be no choice any more.
  for (const input of form.querySelectorAll("select")) if (input.selectedIndex < 0) input.selectedIndex = 0;
  show();

  async function list(what) {
    const { done, data } = await connection.ask("list", { what });
    return done ? data : [];
  }
  async function refresh() {
    const [sources, scenes, maps, takes] = await Promise.all(["sources", "scenes", "pupil maps", "sessions"].map(list));
    known.recording.replaceChildren(...sources.filter(({ value }) => !(value in EYES)).map(option));
    known.scene_file.replaceChildren(...scenes.filter(({ value }) => value !== "night-street").map(option));
    const chosen = fields.pupil_map.value || kept().pupil_map;
    fields.pupil_map.replaceChildren(option({ value: "", label: "none" }), ...maps.map(option));
    fields.pupil_map.value = maps.some(({ value }) => value === chosen) ? chosen : "";
    sessions.replaceChildren(...takes.map(take), ...(takes.length ? [] : [make("li", {}, "None yet.")]));
  }
  connection.on("open", refresh);
  return { choice: () => choice(fields), takeName: () => fields.take.value, refresh, form };
}

const option = ({ value, label }) => make("option", { value }, label || value);
const values = (fields) => Object.fromEntries(Object.entries(fields).map(([name, input]) => [name, input.value]));

function kept() {
  try { return JSON.parse(localStorage.getItem(KEPT)) ?? {}; } catch { return {}; }
}

// A SessionChoice: what is left empty has its default.
function choice(fields) {
  const said = values(fields), chosen = {};
  const wanted = EYES[said.kind][1];
  chosen.source = said.kind === "recording" ? said.recording : said.kind === "usb-simulated" ? `usb-simulated:${said.recording}` : said.kind;
  chosen.scene = said.scene === FILE ? said.scene_file : said.scene;
  for (const name of ["remote", "usb_id", "table_map"]) if (wanted.includes(name) && said[name]) chosen[name] = said[name];
  if (wanted.includes("usb_fault") && said.usb_fault) chosen.usb_fault = said.usb_fault.split(",").map((fault) => fault.trim());
  for (const name of ["pupil_map", "eyes", "head"]) if (said[name]) chosen[name] = said[name];
  for (const name of ["fps", "width", "height", "fov", "seconds"]) if (said[name]) chosen[name] = Number(said[name]);
  if (wanted.includes("seed") && said.seed) chosen.seed = Number(said.seed);
  if (said.scene === FILE && said.mean_luminance) chosen.mean_luminance = Number(said.mean_luminance);
  return chosen;
}

function take({ label, when, report_url, film_url, running }) {
  const link = (url, text) => (url ? [" ", make("a", { href: url, target: "_blank" }, text)] : []);
  return make("li", {}, label, running ? " (being written)" : when ? `, ${new Date(when).toLocaleString()}` : "",
    ...link(report_url, "report"), ...link(film_url, "film"));
}
