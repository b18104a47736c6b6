// The page's connection to the program: comes back by itself, matches answers to questions.

const FIRST_RETRY_MS = 300;
const LAST_RETRY_MS = 5000;

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
   *  @param {(connected: boolean) => void} changed is told when the connection comes or goes */
  constructor(receive, changed) {
    this.receive = receive;
    this.changed = changed;
    this.retryMs = FIRST_RETRY_MS;
    this.next = 1;
    /** @type {Map<number, {resolve: (answer: any) => void, reject: (error: Error) => void}>} */
    this.open = new Map();
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    this.socket = socket;
    socket.onopen = () => {
      this.retryMs = FIRST_RETRY_MS;
      this.changed(true);
    };
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = () => {
      this.changed(false);
      for (const { reject } of this.open.values()) {
        reject(new Refusal("gone", "the program does not answer"));
      }
      this.open.clear();
      setTimeout(() => this.connect(), this.retryMs);
      this.retryMs = Math.min(this.retryMs * 2, LAST_RETRY_MS);
    };
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
      return Promise.reject(new Refusal("gone", "the program does not answer"));
    }
    const id = this.next++;
    return new Promise((resolve, reject) => {
      this.open.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ ...request, id }));
    });
  }
}
