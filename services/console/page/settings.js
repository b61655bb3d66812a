// Settings that act at once: of observer, display, plan and effects; kept as observers and taken from them.
import { control } from "./fields.js";
import { byId, make, setText } from "./make.js";
import { say } from "./say.js";

const EVERY_MS = 150;  // a slider that moves is told this often at most, and where it stops

export function watchSettings(connection) {
  const panel = byId("panel-settings");
  const controls = new Map();
  const body = make("div");
  const observer = observers(connection, settled);
  panel.append(observer.element, body);
  let waiting = {}, out = {}, timer = 0, asking = false, sending = null, in_force = null, built = "";

  function send() { sending = tell(); return sending; }

  async function tell() {
    clearTimeout(timer);
    timer = 0;
    asking = true;
    out = waiting;
    waiting = {};
    const { done, reply } = await connection.ask("change settings", { changes: out });
    const paths = Object.keys(out);
    out = {};
    asking = false;
    wrong(paths, done ? "" : reply);
    if (done) show(paths);
    soon();
  }

  // One request at a time: what moves on meanwhile goes with the next one.
  function soon() { if (!timer && !asking && Object.keys(waiting).length) timer = setTimeout(send, EVERY_MS); }

  // When all that was moved is in force: only then is it kept, or replaced.
  async function settled() { while (asking || Object.keys(waiting).length) await (asking ? sending : send()); }

  function changed(path, value) {
    waiting[path] = value;
    soon();
  }

  function show(paths) {
    if (in_force === null) return;
    for (const path of paths) {
      // What is being moved here is newer than what comes back.
      if (path in waiting || path in out) continue;
      controls.get(path)?.set(path.split(".").reduce((table, key) => table?.[key], in_force) ?? null);
    }
  }

  function wrong(paths, why) {
    for (const path of paths) {
      const { element } = controls.get(path);
      element.querySelector(".wrong")?.remove();
      if (why) element.append(make("p", { class: "wrong", role: "alert" }, why));
    }
  }

  connection.on("fields", ({ fields }) => {
    // The same ones after a connection was lost: what is folded open or being typed stays so.
    if (JSON.stringify(fields) === built) return;
    built = JSON.stringify(fields);
    body.replaceChildren();
    controls.clear();
    const folds = new Map();
    for (const field of fields) {
      const made = control(field, (value) => changed(field.path, value));
      controls.set(field.path, made);
      if (field.first) { body.append(made.element); continue; }
      if (!folds.has(field.group)) {
        const fold = make("details", {}, make("summary", {}, field.group));
        folds.set(field.group, fold);
        body.append(fold);
      }
      folds.get(field.group).append(made.element);
    }
    body.append(make("div", { class: "row" }, make("button", { id: "defaults", onclick: defaults }, "Back to defaults")));
  });

  async function defaults() {
    await settled();
    const { done, reply } = await connection.ask("change settings", { from_defaults: true });
    if (done) wrong([...controls.keys()], "");
    say(done ? "All settings have their defaults." : reply);
  }

  connection.on("settings", ({ settings, observer: name }) => {
    observer.in_force(name);
    in_force = settings;
    show(controls.keys());
  });
}

function observers(connection, settled) {
  const now = make("p", { class: "soft", id: "observer-now" }, "Not saved.");
  const name = make("input", { type: "text", id: "observer-name", pattern: "[A-Za-z0-9][A-Za-z0-9_\\-]*", maxlength: 64, autocomplete: "off" });
  const list = make("select", { id: "observer-list", "aria-label": "Saved observers" });
  const load = make("button", { id: "observer-load", onclick: take }, "Load");

  async function refresh() {
    const { done, data } = await connection.ask("list", { what: "observers" });
    if (!done) return;
    list.replaceChildren(...data.map(({ value, label }) => make("option", { value }, label)));
    load.disabled = list.disabled = data.length === 0;
  }

  async function keep() {
    if (!name.value || !name.checkValidity()) { say("A name has letters, digits, - and _ and begins with a letter or a digit."); name.focus(); return; }
    await settled();
    let answer = await connection.ask("save observer", { name: name.value });
    if (!answer.done && answer.data?.exists && confirm(`There is an observer ${name.value} already. Replace it?`)) {
      answer = await connection.ask("save observer", { name: name.value, overwrite: true });
    }
    say(answer.reply);
    refresh();
  }

  async function take() {
    await settled();
    const { reply } = await connection.ask("load observer", { name: list.value });
    say(reply);
  }

  connection.on("open", refresh);
  return {
    element: make("div", { id: "observers" }, now,
      make("div", { class: "row" }, make("label", { for: "observer-name" }, "Save as"), name, make("button", { id: "observer-save", onclick: keep }, "Save")),
      make("div", { class: "row" }, list, load)),
    in_force: (observer) => setText(now, observer ? `These are the settings of ${observer}.` : "Changed since they were saved or loaded, or never saved."),
  };
}
