// The page's connection to the program: comes back by itself, matches answers to questions.

const FIRST_RETRY_MS = 300;
const LAST_RETRY_MS = 2000;

/** The reason where the server gives none. */
export const NO_ANSWER = "does not answer";

/** What the program refused, and why. */
export class Refusal extends Error {
  /** @param {string} kind @param {string} why */
  constructor(kind, why) {
    super(why);
    this.kind = kind;
  }
}

export class Link {
  /** @param {(message: any) => void} receive takes what is no answer
   *  @param {(connected: boolean, why: string) => void} changed is called when the server is connected (it has sent
   *    something) or lost, and why
   *  @param {string} [path] where its socket is */
  constructor(receive, changed, path = "/socket") {
    this.receive = receive;
    this.changed = changed;
    this.path = path;
    this.retryMs = FIRST_RETRY_MS;
    this.sinceMs = Infinity;
    this.dropped = false;
    this.next = 1;
    /** @type {Map<number, {resolve: (answer: any) => void, reject: (error: Error) => void}>} */
    this.open = new Map();
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${this.path}`);
    this.socket = socket;
    this.sinceMs = Infinity;
    this.dropped = false;
    socket.onmessage = (event) => {
      const message = read(event.data);
      if (!message) {
        this.drop();
        return;
      }
      if (this.sinceMs === Infinity) {
        this.sinceMs = performance.now();
        this.changed(true, "");
      }
      this.take(message);
    };
    socket.onclose = (event) => {
      if (performance.now() - this.sinceMs > LAST_RETRY_MS) this.retryMs = FIRST_RETRY_MS; // it was connected for long enough
      this.changed(false, this.dropped ? "sent an invalid message" : event.reason || NO_ANSWER);
      for (const { reject } of this.open.values()) {
        reject(new Refusal("offline", "no connection to air-router"));
      }
      this.open.clear();
      setTimeout(() => this.connect(), this.retryMs);
      this.retryMs = Math.min(this.retryMs * 2, LAST_RETRY_MS);
    };
  }

  /** It sent an invalid message: connect again. */
  drop() {
    this.dropped = true;
    this.socket.close();
  }

  /** @param {any} message */
  take(message) {
    const waiting = message.id === undefined ? undefined : this.open.get(message.id);
    if (!waiting) {
      this.receive(message);
      return;
    }
    this.open.delete(message.id);
    if (message.type === "refused") waiting.reject(new Refusal(message.kind, message.why));
    else waiting.resolve(message);
  }

  /** Ask for something. @param {object} request @returns {Promise<any>} the answer */
  ask(request) {
    if (this.socket.readyState !== WebSocket.OPEN) {
      return Promise.reject(new Refusal("offline", "no connection to air-router"));
    }
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.open.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ ...request, id }));
    });
  }
}

/** @param {any} data @returns {any} the message, null if it is none */
function read(data) {
  try {
    const message = JSON.parse(data);
    return typeof message === "object" ? message : null;
  } catch {
    return null;
  }
}
