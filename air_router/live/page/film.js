// The bar below a recorded flight: pause, speed, where it is.

import { byId, setText } from "/page/element.js";

export class Film {
  /** @param {() => import("/page/socket.js").Link} link to the flight that is shown */
  constructor(link) {
    this.link = link;
    this.paused = false;
    this.dragged = false;
    byId("pause").addEventListener("click", () => this.ask({ ask: "pause", paused: !this.paused }));
    byId("speed").addEventListener("change", (event) => {
      this.ask({ ask: "speed", speed: Number(event.target.value) });
    });
    const when = byId("when");
    when.addEventListener("input", () => {
      this.dragged = true;
    });
    when.addEventListener("change", () => {
      this.dragged = false;
      this.ask({ ask: "go", to_s: Number(when.value) });
    });
  }

  /** @param {{begin_s: number, end_s: number, now_s: number, speed: number, paused: boolean} | null} film
   *   null for a flight that is not recorded */
  show(film) {
    byId("film").hidden = !film;
    document.body.classList.toggle("recorded", Boolean(film));
    if (!film) return;
    this.paused = film.paused;
    setText(byId("pause"), film.paused ? "▶" : "❚❚");
    byId("pause").setAttribute("aria-label", film.paused ? "Go on" : "Pause");
    const when = byId("when");
    [when.min, when.max] = [String(film.begin_s), String(film.end_s)];
    if (!this.dragged) when.value = String(film.now_s);
    setText(byId("clock"), `${film.now_s.toFixed(0)} s of ${film.end_s.toFixed(0)} s`);
    const speed = byId("speed");
    if (![...speed.options].some((one) => Number(one.value) === film.speed)) {
      speed.add(new Option(`${film.speed} ×`, String(film.speed)));
    }
    if (speed !== document.activeElement) speed.value = String(film.speed);
  }

  /** @param {object} request */
  ask(request) {
    this.link().ask(request).catch(() => {}); // the page says already that no program answers
  }
}
