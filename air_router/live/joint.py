"""One page for several flights, each of which serves a page of its own elsewhere."""

from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import quote

from aiohttp import web

from air_router.live.page_address import PageAddress
from air_router.live.relay import PageRelay
from air_router.web.serving import HERE, Say, Web
from air_router.web.site import Site


class JointPage:
    """Shows flights side by side; it decides nothing, and knows nothing of them but where they are.

    Args:
        names: What each flight is called until it says its name itself; each is called otherwise.
        web: Where the page is served.
    """

    def __init__(self, names: Iterable[str], web: Web = HERE) -> None:
        self._places: dict[str, PageAddress | None] = dict.fromkeys(names)  # None until it is known
        self._web = web
        self._relay: PageRelay  # while it serves
        self._site = Site(web, "air_router.live", "live")
        self._site.add_values("/flights", self._flights)
        self._site.add_socket("/flights/{name}/socket", self._converse)

    def found(self, name: str, address: PageAddress) -> None:
        """It is known where the flight's page is; may be called from any thread."""
        self._places[name] = address

    @asynccontextmanager
    async def serving(self, say: Say) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address, and says it.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        async with (
            PageRelay.opened() as self._relay,
            self._site.serving() as address,
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
            "backdrop": self._web.backdrop,
        }

    async def _converse(self, request: web.Request, browser: web.WebSocketResponse) -> None:
        await self._relay.converse(browser, self._places.get(request.match_info["name"]))
