"""A browser that looks at pages, as a person does.

Playwright is imported when a browser is requested: every worker collects these tests, and one or
two of them run any. While it runs, its thread can have no other event loop.
"""

import asyncio
import contextlib
import functools
import importlib
import os
import queue
import shutil
import threading
from collections.abc import Mapping
from pathlib import Path

import pytest

CHROMIUMS = ("chromium-headless-shell", "chromium", "chromium-browser")
"""The shell is the same browser without windows, which cost as much as the pages do."""


def installed(home: Path | None = None) -> str | None:
    """The system's Chromium, else one of `playwright install`; None: there is none."""
    found = next(filter(None, map(shutil.which, CHROMIUMS)), None)
    kept = Path(os.environ.get("PLAYWRIGHT_BROWSERS_PATH") or (home or Path.home()) / ".cache")
    names = ("headless_shell", "chrome-headless-shell", "chrome")
    fetched = (path for name in names for path in sorted(kept.glob(f"**/chromium*/*/{name}")))
    return found or next(map(str, fetched), None)


CHROMIUM = installed()


def lacking(environment: Mapping[str, str]) -> None:
    """Leave a test out that needs a browser; CI has one, or what it shows is not tested at all."""
    advice = "no Chromium: apt-get install chromium-headless-shell to test the pages"
    if environment.get("CI", "").lower() in ("true", "1"):
        pytest.fail(f"{advice}; CI must have one")
    pytest.skip(advice)


OPTIONS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LIMIT_MS = 120_000
POLL_MS = 100
"""So often a page is polled for what is waited for; at every frame, it would draw all the time."""

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
IS_ANSWERED = "(count) => document.querySelectorAll('#log li.answer').length >= count"


def expect(what):
    """Playwright's assertions of a page or what is on it, which wait until they hold."""
    return importlib.import_module("playwright.sync_api").expect(what)


class SharedBrowser:
    """One Chromium for the pages of many files; it begins with the first that requests it."""

    def __init__(self):
        self._playwright = self._browser = None

    def get(self):
        if CHROMIUM is None:
            lacking(os.environ)
        if self._browser is None:
            sync_api = pytest.importorskip("playwright.sync_api")
            wait = functools.partialmethod(sync_api.Page.wait_for_function, polling=POLL_MS)
            sync_api.Page.wait_for_function = wait
            self._playwright = sync_api.sync_playwright().start()
            chromium = self._playwright.chromium
            self._browser = chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        return self._browser

    def close(self):
        if self._playwright is not None:
            self._browser.close()
            self._playwright.stop()
            self._playwright = self._browser = None


@contextlib.contextmanager
def served(page):
    """Serve a page in a thread of its own; gives its address, and how to end it early."""
    addresses = queue.Queue()

    async def serve():
        ended = asyncio.Event()
        async with page.serving(lambda _: None) as address:
            addresses.put((address, asyncio.get_running_loop(), ended))
            await ended.wait()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    address, loop, ended = addresses.get(timeout=60)

    def end():
        if thread.is_alive():
            loop.call_soon_threadsafe(ended.set)
            thread.join()

    try:
        yield address, end
    finally:
        end()


class Looker:
    """The page; collects what must not happen. A script may be run in it before its own."""

    def __init__(self, page, address, script=""):
        self.page = page
        self.faults = []
        self.requested = []
        page.set_default_timeout(LIMIT_MS)
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on("console", lambda message: self.faults.append(message.text))
        page.on("request", lambda request: self.requested.append(request.url))
        page.on("websocket", lambda socket: self.requested.append(socket.url))
        page.add_init_script(SOCKETS + script)
        page.goto(address)

    def strangers(self, address):
        own = (address, address.replace("http:", "ws:"), "data:")
        return [url for url in self.requested if not url.startswith(own)]

    def shows(self, selector, text):
        """Wait until the page shows it; the error has what it shows instead."""
        sync_api = importlib.import_module("playwright.sync_api")  # there, or there is no page
        try:
            self.page.locator(selector, has_text=text).first.wait_for()
        except sync_api.TimeoutError as error:
            shown = [at.text_content() for at in self.page.locator(selector).all()]
            raise AssertionError(f"{selector} shows {shown} instead of '{text}'") from error

    def request(self, press, answers=1):
        """Press, and read the answers of the flights."""
        lines = self.page.locator("#log li.answer")
        count = lines.count()
        press()
        self.page.wait_for_function(IS_ANSWERED, arg=count + answers)
        return "\n".join(lines.all_inner_texts()[:answers])

    def confirm(self):
        self.page.locator("dialog button.main").click()
