// Keys of the whole page, and the list of them.
import { byId, make } from "./make.js";

// `actions`: key → [what it does, the function]. They rest while somebody types.
export function listenForKeys(actions) {
  const help = byId("help");
  const all = { ...actions, "?": ["this list", () => help.showModal()] };
  for (const [key, [what]] of Object.entries(all)) {
    byId("help-keys").append(make("dt", {}, make("kbd", {}, key === " " ? "Space" : key)), make("dd", {}, what));
  }
  byId("help-open").addEventListener("click", () => help.showModal());
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || help.open || typing(event)) return;
    const action = all[event.key];
    if (!action) return;
    event.preventDefault();
    action[1]();
  });
}

function typing({ target, key }) {
  if (target.matches("input:not([type=checkbox], [type=range]), select, textarea")) return true;
  // Whoever moves a slider or goes from tab to tab may hit a letter.
  if (/^[a-z]$/.test(key) && target.matches("input[type=range], [role=tab]")) return true;
  // Space presses what has the focus.
  return key === " " && target.matches("button, input, summary, a, [role=tab]");
}
