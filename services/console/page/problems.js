// What is wrong and what to do, the worst first. Those who listen are told each one once, when it begins: the figures
// in its sentence go on changing.
import { byId, make, setText } from "./make.js";

const SIGNS = { error: ["bad", "Wrong: "], warning: ["warn", "Take care: "], note: ["note", "Note: "] };
const LOST = "connection lost";

export function watchProblems(connection) {
  const strip = byId("problems"), shown = new Map();
  let ours = [], theirs = [];

  function show() {
    const wanted = [...ours, ...theirs];
    const news = wanted.filter(({ code, severity }) => severity !== "note" && !shown.has(code));
    for (const [code, element] of shown) {
      if (!wanted.some((problem) => problem.code === code)) { element.remove(); shown.delete(code); }
    }
    for (const problem of wanted) {
      if (!shown.has(problem.code)) {
        shown.set(problem.code, entry(problem));
        strip.append(shown.get(problem.code));
      }
      const element = shown.get(problem.code);
      setText(element.querySelector(".what"), problem.what);
      setText(element.querySelector(".remedy"), problem.remedy);
    }
    if (news.length) byId("problems-said").textContent = news.map(inWords).join(" ");
    else if (wanted.every(({ severity }) => severity === "note")) byId("problems-said").textContent = "";
  }

  connection.on("status", ({ problems }) => { theirs = problems; show(); });
  connection.on("open", () => { ours = []; show(); });
  connection.on("lost", ({ reason, again }) => {
    theirs = [];  // nobody knows whether they last
    const remedy = again ? "It is being tried again. If it lasts, look whether the console still runs in its terminal." :
      "Open the address that the console printed when it started, with its token, or reload this page.";
    ours = [{ code: LOST, severity: "error", what: `No connection to the console's server${reason ? `: ${reason}` : ""}.`, remedy }];
    show();
  });
}

const inWords = ({ severity, what, remedy }) => `${(SIGNS[severity] ?? SIGNS.warning)[1]}${what} ${remedy}`;

function entry({ code, severity }) {
  const [state, said] = SIGNS[severity] ?? SIGNS.warning;
  return make("div", { class: "problem", "data-weight": state, "data-code": code },
    make("span", { class: "mark", "data-state": state, "aria-hidden": "true" }),
    make("p", {}, make("span", { class: "unseen" }, said), make("span", { class: "what" }), " ", make("span", { class: "remedy" })));
}
