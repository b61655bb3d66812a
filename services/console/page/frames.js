// The newest frames: as perceived and as displayed. A picture that comes while another is decoded replaces the one waiting.
import { drawMarks } from "./marks.js";
import { byId, setText } from "./make.js";

const KINDS = { 1: "perceived", 2: "displayed" };
const HEADER_BYTES = 5;

class Stage {
  #canvas; #bitmap = null; #waiting = null; #busy = false; #shown = null; #marked = true;

  constructor(canvas) {
    this.#canvas = canvas;
    new ResizeObserver(() => this.#draw()).observe(canvas);
  }

  picture(frame, blob) {
    this.#waiting = { frame, blob };
    if (!this.#busy) this.#decode();
  }

  say(shown) { this.#shown = shown; }

  mark(marked) { this.#marked = marked; this.#draw(); }

  async #decode() {
    this.#busy = true;
    while (this.#waiting) {
      const { frame, blob } = this.#waiting;
      this.#waiting = null;
      try {
        const bitmap = await createImageBitmap(blob);
        this.#bitmap?.close();
        this.#bitmap = bitmap;
        this.#canvas.dataset.frame = frame;
        this.#draw();
      } catch { /* a picture that cannot be decoded is passed over: the next one comes at once */ }
    }
    this.#busy = false;
  }

  #draw() {
    const canvas = this.#canvas, bitmap = this.#bitmap;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    if (!bitmap) return;
    const scale = Math.min(width / bitmap.width, height / bitmap.height);
    const place = { width: bitmap.width * scale, height: bitmap.height * scale };
    place.left = (width - place.width) / 2;
    place.top = (height - place.height) / 2;
    context.imageSmoothingQuality = "high";
    context.drawImage(bitmap, place.left, place.top, place.width, place.height);
    if (this.#marked && this.#shown) drawMarks(context, place, this.#shown, ratio);
  }
}

export function watchFrames(connection) {
  const stages = Object.fromEntries(Object.values(KINDS).map((name) => [name, new Stage(byId(name))]));
  connection.on("picture", (data) => {
    const head = new DataView(data);
    stages[KINDS[head.getUint8(0)]]?.picture(head.getUint32(1), new Blob([new Uint8Array(data, HEADER_BYTES)], { type: "image/jpeg" }));
  });
  connection.on("shown", (shown) => {
    for (const stage of Object.values(stages)) stage.say(shown);
    setText(byId("eyes-said"), shown.eyes.map(inWords).join("; "));
  });
  const marks = byId("marks");
  marks.addEventListener("change", () => { for (const stage of Object.values(stages)) stage.mark(marks.checked); });
  // Nobody looks: the worker need not make pictures.
  document.addEventListener("visibilitychange", () => watch(connection));
  connection.on("open", () => { if (document.hidden) watch(connection); });
}

function watch(connection) {
  const seen = !document.hidden;
  connection.ask("watch", { perceived: seen, displayed: seen });
}

function inWords({ eye, gaze_deg: [right, up], adapted_cd_m2 }) {
  const towards = (value, more, less) => `${Math.abs(value).toFixed(1)}° ${value < 0 ? less : more}`;
  return `${eye} eye: ${towards(right, "right", "left")}, ${towards(up, "up", "down")}, adapted to ${adapted_cd_m2.toPrecision(2)} cd/m²`;
}
