// The four panels beside the frames: one in sight, arrow keys between their tabs.
import { byId } from "./make.js";

const tabs = () => [...document.querySelectorAll('[role="tab"]')];

export function openTab(name, focus = false) {
  document.body.dataset.tab = name;
  for (const tab of tabs()) {
    const chosen = tab.id === `tab-${name}`;
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    byId(tab.getAttribute("aria-controls")).hidden = !chosen;
    if (chosen && focus) tab.focus();
  }
}

export function makeTabs() {
  const steps = { ArrowRight: 1, ArrowLeft: -1 };
  byId("tabs").addEventListener("keydown", (event) => {
    const all = tabs(), at = all.indexOf(document.activeElement);
    const to = event.key === "Home" ? 0 : event.key === "End" ? all.length - 1 : at + (steps[event.key] ?? NaN);
    if (Number.isNaN(to)) return;
    event.preventDefault();
    openTab(all[(to + all.length) % all.length].id.slice(4), true);
  });
  for (const tab of tabs()) tab.addEventListener("click", () => openTab(tab.id.slice(4)));
}
