"""One page for several flights, each with its own page elsewhere.

Messages are relayed between browsers and those pages, without being stored or parsed. Each browser
has its own connection to the flight, so it is served as if connected directly. A slow receiver
slows the reading from the sender.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import quote

import aiohttp
from aiohttp import ClientWSTimeout, WSCloseCode, WSMsgType, web

from air_router.web import HERE, PageAddress, Say, Site, Web, cookie_of

MOST_BYTES: Final = 16 * 1024 * 1024
"""Longest message of a flight: its map, or the track of a long day."""

ANSWER_S: Final = 5.0
"""Time-out for the answer of a flight's page."""

_HEARTBEAT_S: Final = 10.0
_CLOSE_S: Final = 1.0

# Why a flight's page cannot be reached, shown after the flight's name.
_NO_ANSWER: Final = "does not answer"
_NO_FLIGHT: Final = "is not the page of a flight"
_NO_TOKEN: Final = "requires another token"  # noqa: S105 - a message
_TOO_LONG: Final = "sends messages that are too long"

_Socket = aiohttp.ClientWebSocketResponse | web.WebSocketResponse


class JointPage:
    """Shows flights side by side; it knows only their addresses.

    Args:
        names: Unique names of the flights, until each reports its own.
        web: Where the page is served.
    """

    def __init__(self, names: Iterable[str], web: Web = HERE) -> None:
        self._places: dict[str, PageAddress | None] = dict.fromkeys(names)  # None until known
        self._web = web
        self._session: aiohttp.ClientSession  # while it serves
        self._site = Site(web, "air_router.live", "live")
        self._site.add_values("/flights", self._flights)
        self._site.add_socket("/flights/{name}/socket", self._converse)

    def found(self, name: str, address: PageAddress) -> None:
        """Set the address of a flight's page; may be called from any thread."""
        self._places[name] = address

    @asynccontextmanager
    async def serving(self, say: Say) -> AsyncIterator[str]:
        """Serve while in the context; yield and print the page's address.

        Raises:
            ServeError: The address is in use, or not this machine's.
        """
        # Cookies and redirects are ignored.
        async with (
            aiohttp.ClientSession(
                cookie_jar=aiohttp.DummyCookieJar(),
                middlewares=(_stay,),
                connector=aiohttp.TCPConnector(limit=0),
            ) as self._session,
            self._site.serving() as address,
        ):
            say(f"the flights are shown at {address}")
            yield address

    def _flights(self) -> dict[str, Any]:
        """The flights with their addresses."""
        return {
            "flights": [
                {"name": name, "socket": f"/flights/{quote(name, safe=':')}/socket"}
                for name in self._places
            ],
            "backdrop": self._web.backdrop,
        }

    async def _converse(self, request: web.Request, browser: web.WebSocketResponse) -> None:
        """Relay between a browser and a flight until one disconnects; then close both."""
        address, why = self._places.get(request.match_info["name"]), _NO_ANSWER
        try:
            if address is not None:
                async with await self._reach(address) as flight:
                    why = await _carry(browser, flight)
        except aiohttp.ClientResponseError as error:
            why = _NO_TOKEN if error.status == HTTPStatus.UNAUTHORIZED else _NO_FLIGHT
        except (aiohttp.ClientError, OSError, TimeoutError):
            pass  # no answer
        except ValueError:  # an invalid address or token
            why = _NO_FLIGHT
        await browser.close(code=WSCloseCode.TRY_AGAIN_LATER, message=why.encode())

    async def _reach(self, address: PageAddress) -> aiohttp.ClientWebSocketResponse:
        headers = {}
        if address.token is not None:
            headers["Cookie"] = f"{cookie_of(address.port)}={address.token}"
        async with asyncio.timeout(ANSWER_S):
            return await self._session.ws_connect(
                address.socket,
                headers=headers,
                heartbeat=_HEARTBEAT_S,
                max_msg_size=MOST_BYTES,
                timeout=ClientWSTimeout(ws_close=_CLOSE_S),
            )


async def _carry(browser: web.WebSocketResponse, flight: aiohttp.ClientWebSocketResponse) -> str:
    """Relay messages both ways until one end closes; return the reason."""
    ways = [
        asyncio.create_task(_forward(browser, flight)),
        asyncio.create_task(_forward(flight, browser)),
    ]
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
    return _TOO_LONG if flight.close_code == WSCloseCode.MESSAGE_TOO_BIG else _NO_ANSWER


async def _forward(source: _Socket, target: _Socket) -> None:
    try:
        async for message in source:
            if message.type is not WSMsgType.TEXT:
                return
            await target.send_str(message.data)
    except (aiohttp.ClientError, OSError):
        return  # the other end has just disconnected


async def _stay(
    request: aiohttp.ClientRequest, handler: aiohttp.ClientHandlerType
) -> aiohttp.ClientResponse:
    """Reject redirects: a flight's page never redirects."""
    response = await handler(request)
    if HTTPStatus.MULTIPLE_CHOICES <= response.status < HTTPStatus.BAD_REQUEST:
        response.close()
        raise aiohttp.ClientResponseError(
            response.request_info, response.history, status=response.status
        )
    return response
