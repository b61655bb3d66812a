// What a session is made of beside its settings, and the sessions that are there already.
import { control } from "./fields.js";
import { byId, make } from "./make.js";

const KEPT = "entoptic-session";

export function sessionForm(connection) {
  const chosen = kept();  // by path: what is not named has its default
  const lists = [];       // controls that offer what there is to choose from: [what, control]
  const form = make("form", { id: "session-form" });
  const name = make("input", { type: "text", id: "session-recording-name", pattern: "[A-Za-z0-9][A-Za-z0-9_\\-]*", maxlength: 64 });
  const named = make("div", { class: "field" }, make("label", { for: name.id }, "Name of the recording"),
    make("div", { class: "control" }, name), make("p", { class: "about" }, "letters, digits, - and _; the time unless given"));
  const sessions = make("ul", { id: "sessions" });
  let built = "";
  byId("panel-session").append(form, named, make("h3", {}, "Sessions kept"), sessions);
  form.addEventListener("submit", (event) => event.preventDefault());

  connection.on("fields", ({ session }) => {
    // The same ones after a connection was lost: what is being typed stays.
    if (JSON.stringify(session) === built) return;
    built = JSON.stringify(session);
    const more = make("details", {}, make("summary", {}, "More"));
    lists.length = 0;
    form.replaceChildren();
    for (const path of Object.keys(chosen)) if (!session.some((field) => field.path === path)) delete chosen[path];
    for (const field of session) {
      const made = control(field, (value) => {
        chosen[field.path] = value;
        localStorage.setItem(KEPT, JSON.stringify(chosen));
      }, { sliders: false });
      made.set(field.path in chosen ? chosen[field.path] : field.default);
      if (field.list) lists.push([field.list, made]);
      (field.first ? form : more).append(made.element);
    }
    form.append(more);
    refresh();
  });

  async function list(what) {
    const { done, data } = await connection.ask("list", { what });
    return done ? data : [];
  }
  async function refresh() {
    const [takes] = await Promise.all([list("sessions"), ...lists.map(async ([what, made]) => made.offer(await list(what)))]);
    sessions.replaceChildren(...takes.map(recording), ...(takes.length ? [] : [make("li", {}, "None yet.")]));
  }
  connection.on("open", refresh);
  return { config: () => config(chosen), recordingName: () => name.value, refresh, form };
}

function kept() {
  try { return JSON.parse(localStorage.getItem(KEPT)) ?? {}; } catch { return {}; }
}

// A SessionConfig, without its settings: those in force are the session's.
function config(chosen) {
  const tables = {};
  for (const [path, value] of Object.entries(chosen)) {
    const [table, key] = path.split(".");
    (tables[table] ??= {})[key] = value;
  }
  return tables;
}

function recording({ label, when, report_url, film_url, running }) {
  const link = (url, text) => (url ? [" ", make("a", { href: url, target: "_blank" }, text)] : []);
  return make("li", {}, label, running ? " (being written)" : when ? `, ${new Date(when).toLocaleString()}` : "",
    ...link(report_url, "report"), ...link(film_url, "film"));
}
