// What the operator can ask for, with a question before it is done; only a hold comes at once.

import { byId, setText } from "/page/element.js";
import { number, question } from "/page/question.js";

const L = globalThis.L;
const SURE = {
  resume: ["Resume?", "the vehicle resumes what it did before.", "Resume"],
  explore: ["Explore?", "the vehicle resumes exploration at the next waypoint.", "Explore"],
  home: ["Come home?", "the mission ends: the vehicle flies home along the graph, and lands.", "Come home"],
  land: ["Land here?", "the mission ends: the vehicle lands where it hovers, on whatever is below it.", "Land here"],
};

export class Verbs {
  /** @param {any} map @param {() => import("./flight.js").Flight} chosen whom requests go to
   *  @param {(text: string, stays?: boolean) => void} say */
  constructor(map, chosen, say) {
    this.map = map;
    this.chosen = chosen;
    this.say = say;
    /** @type {any[]} */
    this.wanted = [];
    this.choosing = false;
    for (const button of document.querySelectorAll("[data-verb]")) {
      button.addEventListener("click", () => this.pressed(button.dataset.verb));
    }
    byId("cancel").addEventListener("click", () => this.stop());
    map.on("click", ({ latlng }) => this.choosing && this.add(latlng));
    document.addEventListener("keydown", (event) => {
      if (!this.choosing || document.querySelector("dialog[open]")) return;
      if (event.key === "Escape") this.stop();
      if (event.key !== "Enter" || !this.wanted.length) return;
      event.preventDefault(); // or the button that was pressed last is pressed again
      this.fly();
    });
  }

  /** Requests need a connected flight that would not refuse them now; a disabled button shows the reason.
   *  @param {import("./flight.js").Flight} flight */
  allow(flight) {
    const unavailable = flight.isOver ? "the flight is over" : flight.connected ? "" : "no connection to the flight";
    if (unavailable && this.choosing) this.stop();
    for (const button of document.querySelectorAll("#verbs [data-verb], #robots button")) {
      refuse(button, unavailable, reason(flight, button.dataset.verb ?? "seek"));
    }
    setText(byId("why"), unavailable && `Requests are disabled: ${unavailable}.`);
  }

  /** Whether a request would be refused now; then the reason is shown. @param {string} verb */
  isRefused(verb) {
    const flight = this.chosen();
    const why = reason(flight, verb);
    if (why) this.say(`${who(flight)}Not now: ${why}.`);
    return Boolean(why);
  }

  /** @param {string} verb */
  async pressed(verb) {
    if (this.isRefused(verb)) return;
    if (verb === "goto") {
      if (this.choosing && this.wanted.length) await this.fly();
      else if (this.choosing) this.stop();
      else this.choose();
    } else if (verb === "altitude") {
      await this.changeAltitude();
    } else {
      const flight = this.chosen();
      if (verb === "hold" || (await sure(flight, ...SURE[verb]))) await this.ask(flight, { request: verb });
    }
  }

  /** @param {string} robot */
  async seek(robot) {
    if (this.isRefused("seek")) return;
    const flight = this.chosen();
    const what = `the vehicle stops its present task and flies to where ${robot} should be.`;
    if (await sure(flight, `Seek ${robot} now?`, what, "Seek")) await this.ask(flight, { request: "seek", robot });
  }

  /** Between the altitudes that all zones are checked for. */
  async changeAltitude() {
    const flight = this.chosen();
    const [low, high] = flight.scenery.altitudes_m;
    const label = `Metres above home, ${low} to ${high}`;
    const range = { min: low, max: high, value: Math.round(flight.vehicle.altitude_m) };
    const altitude_m = await number(`${who(flight)}Change altitude?`, label, range, "Change");
    if (altitude_m !== null) await this.ask(flight, { request: "altitude", altitude_m });
  }

  /** Have all UAVs hold, and name those that do not answer. @param {import("./flight.js").Flight[]} flights */
  async holdAll(flights) {
    this.stop();
    const answers = await Promise.all(flights.map((flight) => answerOf(flight, { request: "hold" })));
    this.say(answers.map(({ text }) => text).join(" "));
  }

  choose() {
    this.mark(true);
    this.say("Click the map to add points, then press Fly there (Enter) or Cancel (Esc).", true);
  }

  /** @param {any} latlng */
  add(latlng) {
    const html = String(this.wanted.length + 1);
    const icon = L.divIcon({ className: "wanted", iconSize: [24, 24], html });
    this.wanted.push(L.marker(latlng, { icon, interactive: false }).addTo(this.map));
    byId("verbs").querySelector('[data-verb="goto"]').textContent = "Fly there";
  }

  async fly() {
    if (!this.wanted.length) return;
    const points = this.wanted.map((marker) => marker.getLatLng().wrap()).map(({ lat, lng }) => [lat, lng]);
    const what = points.length === 1 ? "the point" : `${points.length} points`;
    const flight = this.chosen();
    if (await sure(flight, "Fly there?", `the vehicle flies to ${what}, hovers, and resumes exploration.`, "Fly")) {
      await this.ask(flight, { request: "goto", points });
    }
    this.stop();
  }

  stop() {
    for (const marker of this.wanted) marker.remove();
    this.wanted = [];
    this.mark(false);
  }

  /** @param {boolean} choosing */
  mark(choosing) {
    this.choosing = choosing;
    const button = byId("verbs").querySelector('[data-verb="goto"]');
    button.setAttribute("aria-pressed", String(choosing));
    button.textContent = "Go to …";
    byId("cancel").hidden = !choosing;
    this.map.getContainer().classList.toggle("drawing", choosing);
    if (!choosing) this.say("");
  }

  /** @param {import("./flight.js").Flight} flight @param {object} request */
  async ask(flight, request) {
    const { text, code } = await answerOf(flight, request);
    const title = "Put this mission's plan on board?";
    if (code === "other-plan" && (await sure(flight, title, text, "Upload"))) {
      return this.ask(flight, { ...request, upload: true });
    }
    setTimeout(() => this.say(text)); // after what stops choosing
  }
}

/** Why a flight would refuse a request now; "" if it may accept it.
 *  @param {import("./flight.js").Flight} flight @param {string} verb @returns {string} */
function reason(flight, verb) {
  return flight.vehicle?.refused?.[verb] ?? "";
}

/** Show that a button is disabled, and why. One whose request would be refused can still be pressed, which shows
 *  the reason: a disabled button shows none to touch or keyboard.
 *  @param {any} button @param {string} unavailable why there is no flight to send requests to @param {string} why it would refuse */
function refuse(button, unavailable, why) {
  button.disabled = Boolean(unavailable);
  button.title = unavailable || why;
  for (const [name, value] of [["aria-disabled", unavailable || !why ? "" : "true"], ["aria-description", unavailable || why]]) {
    if (value) button.setAttribute(name, value);
    else button.removeAttribute(name);
  }
}

/** @param {import("./flight.js").Flight} flight @returns {string} the flight's name, if there are several */
function who(flight) {
  return flight.colour ? `${flight.name}: ` : "";
}

/** @param {import("./flight.js").Flight} flight @param {object} request
 *  @returns {Promise<{text: string, code: string | null}>} */
async function answerOf(flight, request) {
  try {
    const { accepted, why, code } = await flight.link.ask(request);
    return { text: `${who(flight)}${accepted ? "Accepted" : "Refused"}: ${why}.`, code };
  } catch (error) {
    return { text: `${who(flight)}${/** @type {Error} */ (error).message}`, code: null };
  }
}

/** @param {import("./flight.js").Flight} flight
 *  @param {string} title @param {string} text @param {string} label @returns {Promise<boolean>} */
async function sure(flight, title, text, label) {
  const choices = [{ label: "Cancel", value: "" }, { label, value: "yes", main: true }];
  return (await question(`${who(flight)}${title}`, text, choices)) === "yes";
}
