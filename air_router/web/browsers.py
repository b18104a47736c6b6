"""All browsers that show a page: what they are told, and what they say."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from aiohttp import ClientConnectionResetError, WSMsgType, web

_MOST_WAITING: Final = 1_000


class PageOutbox:
    """Sends texts to a page, in order; one that waits is replaced by a newer one of its kind.

    So a page that is slow is never behind. One that reads nothing is given up.
    """

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._waiting: dict[str, str] = {}  # text by kind, in order
        self._news = asyncio.Event()  # set while something waits
        self._full = False  # the page reads nothing

    def post(self, kind: str, text: str) -> None:
        """Send a text as soon as may be; replaces what still waits of that kind."""
        if len(self._waiting) >= _MOST_WAITING:
            self._full = True
        else:
            self._waiting.pop(kind, None)
            self._waiting[kind] = text
        self._news.set()

    async def run(self) -> None:
        """Send until the page is gone or reads no more."""
        with contextlib.suppress(ClientConnectionResetError, ConnectionResetError):
            while not self._socket.closed and not self._full:
                await self._news.wait()
                self._news.clear()
                while self._waiting and not self._full:
                    kind = next(iter(self._waiting))
                    await self._socket.send_str(self._waiting.pop(kind))
        await self._socket.close()


class Browsers:
    """Every browser has an outbox.

    `receive` takes a text from a page, `welcome` tells a new page what there is; both are called
    in the server's event loop and must be quick. After each text a page is not read for `pause_s`.
    """

    def __init__(
        self,
        receive: Callable[[PageOutbox, str], None],
        welcome: Callable[[PageOutbox], None],
        *,
        pause_s: float = 0.0,
    ) -> None:
        self._receive = receive
        self._welcome = welcome
        self._pause_s = pause_s
        self._outboxes: set[PageOutbox] = set()  # one for each browser

    def broadcast(self, kind: str, text: str) -> None:
        """Send a text to every page; one of its kind that still waits is replaced."""
        for outbox in self._outboxes:
            outbox.post(kind, text)

    async def converse(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Talk with a page until it has left."""
        del request
        outbox = PageOutbox(socket)
        self._outboxes.add(outbox)
        sending = asyncio.create_task(outbox.run())
        try:
            self._welcome(outbox)
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                self._receive(outbox, message.data)
                if self._pause_s:
                    await asyncio.sleep(self._pause_s)
        finally:
            self._outboxes.discard(outbox)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
