// The WebSocket to the console's server: hands messages on by their type, asks, and connects again when it is lost.
// services/console/protocol.py says what is sent.

const VERSION = 2;
const AGAIN_MS = [300, 600, 1200, 2500, 5000];
const SILENT_MS = 6000;  // the status comes twice a second: a line that is dead longer is given up
const RELOADED = "entoptic-reloaded";

export class Connection {
  #handlers = new Map();
  #waiting = new Map();  // id → resolve
  #next = 1;
  #tries = 0;
  #socket = null;
  #heard_ms = 0;
  #timer = 0;

  constructor() { setInterval(() => this.#watch(), 1000); }

  // Types are those of the protocol, and `picture`, `open` and `lost`.
  on(type, handler) {
    if (!this.#handlers.has(type)) this.#handlers.set(type, []);
    this.#handlers.get(type).push(handler);
  }

  connect() {
    clearTimeout(this.#timer);
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    this.#heard_ms = performance.now();
    let goodbye = null;
    socket.onmessage = ({ data }) => {
      this.#heard_ms = performance.now();
      if (typeof data !== "string") { this.#tell("picture", data); return; }
      for (const message of JSON.parse(data)) {
        if (message.type === "bye") goodbye = message;
        else if (message.type === "reply") this.#answered(message);
        else if (message.type === "hello") this.#welcome(message);
        else this.#tell(message.type, message);
      }
    };
    socket.onclose = (event) => { if (socket === this.#socket) this.#lost(goodbye, event); };
  }

  // Resolves to {done, reply, data}; a lost connection is an answer too.
  ask(what, values = {}) {
    if (this.#socket?.readyState !== WebSocket.OPEN) {
      return Promise.resolve({ done: false, reply: "Not done: there is no connection to the console's server.", data: null });
    }
    const id = this.#next++;
    this.#socket.send(JSON.stringify({ id, request: { do: what, ...values } }));
    return new Promise((resolve) => this.#waiting.set(id, resolve));
  }

  #welcome(hello) {
    if (hello.version !== VERSION && sessionStorage.getItem(RELOADED) !== String(hello.version)) {
      sessionStorage.setItem(RELOADED, hello.version);  // once: a page that stays old must not reload for ever
      location.reload();
      return;
    }
    this.#tries = 0;
    this.#tell("open", hello);
  }

  #answered(reply) {
    this.#waiting.get(reply.re)?.(reply);
    this.#waiting.delete(reply.re);
  }

  #lost(goodbye, event) {
    this.#socket = null;
    for (const resolve of this.#waiting.values()) {
      resolve({ done: false, reply: "The connection was lost before the answer came: look whether it was done.", data: null });
    }
    this.#waiting.clear();
    const again = goodbye?.again ?? event.code !== 1008;
    const wait_ms = AGAIN_MS[Math.min(this.#tries++, AGAIN_MS.length - 1)];
    if (again) this.#timer = setTimeout(() => this.#again(), wait_ms);
    this.#tell("lost", { reason: goodbye?.reason || event.reason || "", again });
  }

  // A socket that is refused says no reason; a page that is refused does.
  async #again() {
    try {
      const { status } = await fetch("/", { method: "HEAD", cache: "no-store", signal: AbortSignal.timeout(SILENT_MS) });
      if (status === 401) {
        this.#tell("lost", { reason: "it asks for another token than this page has", again: false });
        return;
      }
    } catch { /* nobody answers: the socket will say so */ }
    this.connect();
  }

  #watch() {
    if (this.#socket && performance.now() - this.#heard_ms > SILENT_MS) {
      const socket = this.#socket;
      socket.onmessage = socket.onclose = null;
      socket.close();
      this.#lost({ reason: `nothing came for ${SILENT_MS / 1000} seconds`, again: true }, {});
    }
  }

  #tell(type, message) { for (const handler of this.#handlers.get(type) ?? []) handler(message); }
}
