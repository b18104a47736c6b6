"""A browser that looks at a flight's page, as a person does."""

import importlib
import shutil

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
OPTIONS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
LIMIT_MS = 120_000

# The page's sockets, so that one can be dropped, and where new ones lead, if that is elsewhere.
SOCKETS = """
globalThis.sockets = [];
globalThis.elsewhere = (where) => where;
globalThis.WebSocket = class extends WebSocket {
  constructor(where) {
    super(elsewhere(where));
    sockets.push(this);
  }
};
"""
IS_ANSWERED = "(count) => document.querySelectorAll('#news li.answer').length >= count"


class Looker:
    """The page; collects what must not happen."""

    def __init__(self, page, address):
        self.page = page
        self.faults = []
        self.asked = []
        page.set_default_timeout(LIMIT_MS)
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on(
            "console", lambda said: self.faults.append(said.text) if said.type == "error" else 0
        )
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("websocket", lambda socket: self.asked.append(socket.url))
        page.add_init_script(SOCKETS)
        page.goto(address)

    def strangers(self, address):
        own = (address, address.replace("http:", "ws:"), "data:")
        return [url for url in self.asked if not url.startswith(own)]

    def shows(self, selector, text):
        """Wait until the page shows it; says what it shows instead."""
        sync_api = importlib.import_module("playwright.sync_api")  # there, or there is no page
        try:
            self.page.locator(selector, has_text=text).first.wait_for()
        except sync_api.TimeoutError as error:
            shown = [at.text_content() for at in self.page.locator(selector).all()]
            raise AssertionError(f"{selector} shows {shown} instead of '{text}'") from error

    def ask(self, press, answers=1):
        """Ask, and read the answers."""
        lines = self.page.locator("#news li.answer")
        count = lines.count()
        press()
        self.page.wait_for_function(IS_ANSWERED, arg=count + answers)
        return "\n".join(lines.all_inner_texts()[:answers])

    def confirm(self):
        self.page.locator("dialog button.main").click()
