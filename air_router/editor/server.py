"""The edit page's server: takes edits from browsers, answers with the new state of the mission."""

import asyncio
import json
import logging
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any

from air_router.editor.edits import read_edit
from air_router.editor.parts import EditError
from air_router.editor.session import (
    ChangedOnDiskError,
    EditSession,
    SaveError,
    StaleError,
    UnconfirmedError,
)
from air_router.errors import AirRouterError
from air_router.web import HERE, Browsers, PageOutbox, Say, Site, Web, as_json
from mocha_link.team import DocumentError

_LOG = logging.getLogger(__name__)
_WATCH_S = 1.0
_MOST_WAITING = 200

_REFUSALS = {
    StaleError: "stale",
    UnconfirmedError: "unconfirmed",
    ChangedOnDiskError: "changed",
    SaveError: "unsaved",
    DocumentError: "unreadable",
}


class EditorServer:
    """Serves one session to any number of pages; all of them see the same mission."""

    def __init__(self, session: EditSession, web: Web = HERE) -> None:
        self._session = session
        self._web = web
        # page, its request
        self._requests: asyncio.Queue[tuple[PageOutbox, str]] = asyncio.Queue(_MOST_WAITING)
        self._changed_on_disk = False  # as the pages were informed
        self._state = session.view()  # as the pages have it
        self._browsers = Browsers(self._receive, self._welcome)  # all pages
        self._site = Site(web, "air_router.editor", "edit")
        self._site.add_socket("/socket", self._browsers.converse)

    @asynccontextmanager
    async def serving(self, say: Say) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address, and prints it.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        with ThreadPoolExecutor(1, "air-router edit") as worker:
            async with self._site.serving() as address, asyncio.TaskGroup() as tasks:
                say(address)
                jobs = [tasks.create_task(job(worker)) for job in (self._work, self._watch)]
                try:
                    yield address
                finally:
                    for job in jobs:
                        job.cancel()

    def _welcome(self, outbox: PageOutbox) -> None:
        setting = {"type": "setting", "backdrop": self._web.backdrop}
        outbox.post("setting", as_json(setting))
        outbox.post("state", as_json({"type": "state", **self._state}))
        outbox.post("disk", as_json({"type": "disk", "changed": self._changed_on_disk}))

    def _receive(self, outbox: PageOutbox, text: str) -> None:
        try:
            self._requests.put_nowait((outbox, text))
        except asyncio.QueueFull:
            outbox.post("busy", as_json(_refused(None, "busy", "too much at a time; slow down")))

    async def _work(self, worker: ThreadPoolExecutor) -> None:
        """Apply requests, one after the other."""
        loop = asyncio.get_running_loop()
        while True:
            outbox, text = await self._requests.get()
            answer, state = await loop.run_in_executor(worker, self._answered, text)
            if state is not None:
                update = {"type": "state", "since": self._state["revision"]}
                update |= changes_of(self._state, state)
                self._state = state
                self._browsers.broadcast("state", as_json(update))
            outbox.post(f"answer {answer['id']}", as_json(answer))

    async def _watch(self, worker: ThreadPoolExecutor) -> None:
        """Send the pages a notice when another program has changed the file."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_WATCH_S)
            changed = await loop.run_in_executor(worker, self._session.file.changed)
            if changed != self._changed_on_disk:
                self._changed_on_disk = changed
                self._browsers.broadcast("disk", as_json({"type": "disk", "changed": changed}))

    def _answered(self, text: str) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """The answer to a request, and the mission's state if it has changed."""
        before = self._session.revision, self._session.dirty
        start_s = time.perf_counter()
        answer = self._answer(text)
        _LOG.debug("%.1f ms for %s", (time.perf_counter() - start_s) * 1000, text[:200])
        changed = before != (self._session.revision, self._session.dirty)
        return answer, self._session.view() if changed else None

    def _answer(self, text: str) -> dict[str, Any]:
        """The answer to one request, whatever it is."""
        number = None
        try:
            request = json.loads(text)
            if not isinstance(request, dict):
                raise EditError("not a request")  # noqa: TRY301
            number = request.get("id") if isinstance(request.get("id"), int) else None
            return {"type": "done", "id": number, **self._do(request)}
        except (AirRouterError, DocumentError) as error:
            kinds = (kind for cause, kind in _REFUSALS.items() if isinstance(error, cause))
            kind = next(kinds, "edit")
            return _refused(number, kind, str(error))
        except (ValueError, RecursionError):
            return _refused(number, "edit", "not a request")
        except Exception:  # noqa: BLE001 - a fault of ours must not cost the user's work
            _LOG.exception("a request of the page failed: %s", text[:500])
            why = "this failed, the mission is as it was; see the program's log"
            return _refused(number, "fault", why)

    def _do(self, request: dict[str, Any]) -> dict[str, Any]:
        session = self._session
        match request.get("ask"):
            case "edit":
                revision, gesture = request.get("revision"), request.get("gesture")
                session.edit(
                    read_edit(json.dumps(request.get("edit"))),
                    revision=revision if isinstance(revision, int) else None,
                    gesture=gesture if isinstance(gesture, str) else None,
                )
            case "undo":
                session.undo()
            case "redo":
                session.redo()
            case "save":
                session.save(
                    confirmed=request.get("confirmed") is True,
                    overwrite=request.get("overwrite") is True,
                )
                _LOG.info("saved")
            case "reload":
                session.reload()
            case "state":  # from a page that missed an update
                return {"state": {"type": "state", **session.view()}}
            case "route":
                start, end = request.get("start"), request.get("end")
                if not (isinstance(start, int) and isinstance(end, int)):
                    raise EditError("a route leads from one waypoint's number to another's")
                return {"route": session.route(start, end)}
            case _:
                raise EditError("the page sent an unknown request; load it again")
        return {}


def changes_of(before: dict[str, Any], now: dict[str, Any]) -> dict[str, Any]:
    """The changed parts of a state; of a list its length, and the changed items by index."""
    update: dict[str, Any] = {}
    for name, value in now.items():
        old = before[name]
        if not isinstance(value, list):
            update |= {} if value == old else {name: value}
        elif value != old:
            same = len(old)
            at = {i: one for i, one in enumerate(value) if i >= same or one != old[i]}
            update[name] = {"length": len(value), "at": at}
    return update


def _refused(number: int | None, kind: str, why: str) -> dict[str, Any]:
    return {"type": "refused", "id": number, "kind": kind, "why": why}
