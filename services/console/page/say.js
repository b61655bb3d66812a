// Says shortly what was done, to the eye and to screen readers.
import { byId } from "./make.js";

const FOR_MS = 6000;
let timer = 0;

export function say(text) {
  byId("said").textContent = text;
  clearTimeout(timer);
  timer = setTimeout(() => { byId("said").textContent = ""; }, Math.max(FOR_MS, text.length * 80));
}
