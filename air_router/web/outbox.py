"""What waits to be sent to one page: the newest of each kind, so a slow one is never behind."""

import asyncio
import contextlib

from aiohttp import ClientConnectionResetError, web

_MOST_WAITING = 1_000


class PageOutbox:
    """Sends texts to a page, in order; one that waits is replaced by a newer one of its kind."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._waiting: dict[str, str] = {}  # text by kind, in order
        self._news = asyncio.Event()  # set while something waits
        self.full = False  # the page reads nothing; it is given up

    def post(self, kind: str, text: str) -> None:
        """Send a text as soon as may be; replaces what still waits of that kind."""
        if len(self._waiting) >= _MOST_WAITING:
            self.full = True  # it reads nothing: give it up
        else:
            self._waiting.pop(kind, None)
            self._waiting[kind] = text
        self._news.set()

    async def run(self) -> None:
        """Send until the page is gone or reads no more."""
        with contextlib.suppress(ClientConnectionResetError, ConnectionResetError):
            while not self._socket.closed:
                await self._news.wait()
                self._news.clear()
                while self._waiting and not self.full:
                    kind = next(iter(self._waiting))
                    await self._socket.send_str(self._waiting.pop(kind))
                if self.full:
                    break
        await self._socket.close()
