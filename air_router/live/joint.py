"""One page for several flights, each of which serves a page of its own elsewhere."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import quote

from aiohttp import web

from air_router.live.page_address import PageAddress
from air_router.live.relay import Relay
from air_router.web.assets import Assets
from air_router.web.backdrop import Backdrop
from air_router.web.guard import Guard
from air_router.web.site import Site


class JointPage:
    """Shows flights side by side; it decides nothing, and knows nothing of them but where they are.

    Args:
        names: What each flight is called until it says its name itself; each is called otherwise.
        host: The address to serve on; anybody but this machine needs a token.
        port: 0 takes a free one.
        backdrop: A picture to lie under the map.
    """

    def __init__(
        self,
        names: Iterable[str],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        backdrop: Backdrop | None = None,
    ) -> None:
        self._places: dict[str, PageAddress | None] = dict.fromkeys(names)
        self._host, self._port = host, port
        self._backdrop = backdrop
        self._relay: Relay
        assets = Assets()
        assets.add("air_router.web", "page", "/page/")
        assets.add("air_router.live", "page", "/live/")
        self._site = Site(Guard(host), assets, "/live/index.html")
        self._site.add_values("/flights", self._flights)
        self._site.add_socket("/flights/{name}/socket", self._converse)
        if backdrop is not None:
            self._site.lay_under(backdrop)

    def found(self, name: str, address: PageAddress) -> None:
        """It is known where the flight's page is; may be called from any thread."""
        self._places[name] = address

    @asynccontextmanager
    async def serving(self, say: Callable[[str], None]) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address, and says it.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        async with (
            Relay.opened() as self._relay,
            self._site.serving(self._host, self._port) as address,
        ):
            say(f"the flights are shown at {address}")
            yield address

    def _flights(self) -> dict[str, Any]:
        """What flights there are, and where the page finds each."""
        return {
            "flights": [
                {"name": name, "socket": f"/flights/{quote(name, safe=':')}/socket"}
                for name in self._places
            ],
            "backdrop": self._backdrop.view() if self._backdrop else None,
        }

    async def _converse(self, request: web.Request, browser: web.WebSocketResponse) -> None:
        await self._relay.converse(browser, self._places.get(request.match_info["name"]))
