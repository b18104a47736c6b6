"""All browsers that show a page: what they are told, and what they say."""

import asyncio
from collections.abc import Callable

from aiohttp import WSMsgType, web

from air_router.web.outbox import PageOutbox

Receive = Callable[[PageOutbox, str], None]
"""Takes what a page has sent."""


class Browsers:
    """Every browser has an outbox.

    `receive` takes a text from a page, `welcome` tells a new page what there is; both are called
    in the server's event loop and must be quick. After each text a page is not read for `pause_s`.
    """

    def __init__(
        self, receive: Receive, welcome: Callable[[PageOutbox], None], *, pause_s: float = 0.0
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
