// One value as something to move: a slider with a number, a tick, a choice, ticks, a line of text, or one of a list.
import { make } from "./make.js";
import { LAST, placeOf, reach, stride, valueAt } from "./sliders.js";

// {element, set(value), offer(list)}; `changed(value)` is called for what a person chose, and only then.
export function control(field, changed, { sliders = true } = {}) {
  const id = `setting-${field.path}`;
  const about = field.help ? make("p", { class: "about", id: `${id}-about` }, field.help) : null;
  const made = (field.list ? listed : MADE[field.kind] ?? text)(field, id, changed, sliders);
  made.main.setAttribute("aria-describedby", about ? about.id : "");
  const label = field.kind === "choices" ? make("span", { id: `${id}-label` }, field.label) : make("label", { for: id }, field.label);
  const element = make("div", { class: "field", "data-path": field.path }, label, make("div", { class: "control" }, ...made.parts), about);
  return { element, set: made.set, offer: made.offer };
}

const MADE = { number, int: number, bool: tick, choice, choices, texts };

function number(field, id, changed, sliders) {
  const ends = sliders ? reach(field) : null;
  const box = make("input", { type: "number", id, step: "any", min: field.low, max: field.high, placeholder: field.optional ? "none" : null });
  const slider = ends && make("input", { type: "range", min: 0, max: LAST, step: stride(field), "aria-label": field.label });
  const set = (value) => {
    if (document.activeElement !== box) box.value = value ?? "";
    if (!slider) return;
    slider.value = value === null ? 0 : placeOf(field, value);
    slider.setAttribute("aria-valuetext", value === null ? "none" : String(value));
  };
  slider?.addEventListener("input", () => {
    const value = valueAt(field, Number(slider.value));
    box.value = value;
    slider.setAttribute("aria-valuetext", String(value));
    changed(value);
  });
  box.addEventListener("change", () => {
    if (box.value === "" && !field.optional) box.value = field.default;
    changed(box.value === "" ? null : field.kind === "int" ? Math.round(Number(box.value)) : Number(box.value));
  });
  return { main: box, parts: slider ? [slider, box] : [box], set };
}

function tick(field, id, changed) {
  const box = make("input", { type: "checkbox", id });
  box.addEventListener("change", () => changed(box.checked));
  return { main: box, parts: [box], set: (value) => { box.checked = value; } };
}

function choice(field, id, changed) {
  const none = field.optional ? [make("option", { value: "" }, "none")] : [];
  const list = make("select", { id }, ...none, ...field.options.map(([value]) => make("option", { value }, value)));
  const said = new Map(field.options);
  const explain = () => { list.title = said.get(list.value) ?? ""; };
  list.addEventListener("change", () => { explain(); changed(list.value === "" ? null : list.value); });
  return { main: list, parts: [list], set: (value) => { list.value = value ?? ""; explain(); } };
}

function choices(field, id, changed) {
  const boxes = field.options.map(([value]) => make("input", { type: "checkbox", value }));
  const group = make("div", { role: "group", id, "aria-labelledby": `${id}-label` },
    ...boxes.map((box) => make("label", { class: "tick" }, box, ` ${box.value.replaceAll("_", " ")} `)));
  group.addEventListener("change", () => changed(boxes.filter((box) => box.checked).map((box) => box.value)));
  return { main: group, parts: [group], set: (value) => { for (const box of boxes) box.checked = value.includes(box.value); } };
}

function text(field, id, changed) {
  const line = make("input", { type: "text", id });
  line.addEventListener("change", () => changed(line.value === "" && field.optional ? null : line.value));
  return { main: line, parts: [line], set: (value) => { if (document.activeElement !== line) line.value = value ?? ""; } };
}

function texts(field, id, changed) {
  const line = make("input", { type: "text", id, placeholder: "several with commas" });
  line.addEventListener("change", () => changed(line.value.split(",").map((one) => one.trim()).filter((one) => one)));
  return { main: line, parts: [line], set: (value) => { if (document.activeElement !== line) line.value = value.join(", "); } };
}

// One of what the server offers, or another text.
function listed(field, id, changed) {
  const OTHER = "another";
  const list = make("select", { id });
  const line = make("input", { type: "text", id: `${id}-other`, "aria-label": `${field.label}: another one` });
  let value = field.default, known = [];
  const show = () => {
    const other = value !== null && !known.some((one) => one.value === value);
    const options = [...(field.optional ? [{ value: "", label: "none" }] : []), ...known, { value: OTHER, label: "Another…" }];
    list.replaceChildren(...options.map((one) => make("option", { value: one.value }, one.label || one.value)));
    list.value = other ? OTHER : value ?? "";
    line.hidden = !other;
    if (document.activeElement !== line) line.value = other ? value : "";
  };
  const take = (now) => { value = now; changed(now); show(); };
  list.addEventListener("change", () => {
    if (list.value === OTHER) { line.hidden = false; line.focus(); } else take(list.value === "" ? null : list.value);
  });
  line.addEventListener("change", () => take(line.value.trim() || field.default));
  show();
  return { main: list, parts: [list, line], set: (now) => { value = now; show(); }, offer: (found) => { known = found; show(); } };
}
