"""Several flights on one page: what goes through, what gets lost, and whom that costs nothing."""

import asyncio
import contextlib
import os
import signal
import threading

import aiohttp
import pytest
from aiohttp import WSCloseCode, WSMsgType, web

from air_router.cli import watch as watch_command
from air_router.cli.cli import main
from air_router.errors import ExitCode, UsageError
from air_router.live.joint import MOST_BYTES, JointPage
from air_router.web.serving import PageAddress, ServeError, Web, shown_beside
from air_router.web.site import Browsers, Site

LIMIT_S = 60


class FlightPage:
    """The page of a pretended flight: greets, and returns what it receives."""

    def __init__(self, name, token=None):
        self.name = name
        self.received = []
        self.audience = Browsers(self._receive, self._welcome)
        self._token = token

    def _welcome(self, outbox):
        outbox.post("welcome", f"{self.name} greets")

    def _receive(self, outbox, text):
        self.received.append(text)
        outbox.post(f"answer {len(self.received)}", f"{self.name}: {text[:10]}")

    @contextlib.asynccontextmanager
    async def serving(self, port=0):
        site = Site(Web(port=port, token=self._token), "air_router.live", "live")
        site.add_socket("/socket", self.audience.converse)
        async with site.serving() as address:
            yield PageAddress.of(address)


class Browser:
    """Looks at a joint page."""

    def __init__(self, session, address):
        self._session = session
        self._address = address

    async def flights(self):
        async with self._session.get(f"{self._address}flights") as answer:
            return (await answer.json())["flights"]

    @contextlib.asynccontextmanager
    async def looking(self, name):
        (flight,) = [flight for flight in await self.flights() if flight["name"] == name]
        url = f"{self._address}{flight['socket'][1:]}"
        async with self._session.ws_connect(url, max_msg_size=2 * MOST_BYTES) as socket:
            yield socket


@contextlib.asynccontextmanager
async def looking_at(places):
    page = JointPage(places)
    for name, place in places.items():
        if place is not None:
            page.found(name, place)
    async with page.serving(lambda _: None) as address, aiohttp.ClientSession() as session:
        browser = Browser(session, address)
        browser.page = page
        yield browser


async def text(socket):
    message = await socket.receive(LIMIT_S)
    assert message.type is WSMsgType.TEXT, message
    return message.data


async def why_closed(socket):
    message = await socket.receive(LIMIT_S)
    assert message.type is WSMsgType.CLOSE, message
    assert message.data == WSCloseCode.TRY_AGAIN_LATER
    return message.extra


def test_texts_go_to_one_flight_and_answers_come_back():
    async def look():
        titan, atlas = FlightPage("titan"), FlightPage("atlas", "secret")
        async with titan.serving() as one, atlas.serving() as other:
            assert other.token
            places = {"titan": one, "atlas": other, "io": None}
            async with (
                looking_at(places) as browser,
                browser.looking("titan") as first,
                browser.looking("atlas") as second,
                browser.looking("atlas") as third,
            ):
                assert [flight["name"] for flight in await browser.flights()] == list(places)
                assert await text(first) == "titan greets"
                assert await text(second) == await text(third) == "atlas greets"
                await second.send_str("hold")
                assert await text(second) == "atlas: hold"
                atlas.audience.broadcast("line", "landed")
                assert await text(second) == await text(third) == "landed"
                async with browser.looking("io") as unanswered:
                    assert await why_closed(unanswered) == "does not answer"
        return titan.received, atlas.received

    assert asyncio.run(look()) == ([], ["hold"])


def test_a_flight_that_goes_and_comes_back_disturbs_no_other():
    async def look():
        titan, atlas = FlightPage("titan"), FlightPage("atlas")
        async with titan.serving() as one, contextlib.AsyncExitStack() as stack:
            other = await stack.enter_async_context(atlas.serving())
            async with (
                looking_at({"titan": one, "atlas": other}) as browser,
                browser.looking("titan") as first,
            ):
                assert await text(first) == "titan greets"
                async with browser.looking("atlas") as second:
                    assert await text(second) == "atlas greets"
                    await stack.aclose()
                    assert await why_closed(second) == "does not answer"
                async with browser.looking("atlas") as second:
                    assert await why_closed(second) == "does not answer"
                async with atlas.serving() as again:
                    browser.page.found("atlas", again)
                    async with browser.looking("atlas") as second:
                        assert await text(second) == "atlas greets"
                await first.send_str("explore")
                assert await text(first) == "titan: explore"

    asyncio.run(look())


def test_what_is_no_flight_and_what_sends_too_much_is_given_up():
    """Also what closes at once, talks no HTTP, sends us elsewhere, or requires another token."""

    async def garbage(reader, writer):
        await reader.readline()
        writer.write(b"220 mail.example ready\r\n")
        writer.close()

    async def elsewhere(request):
        elsewhere.requested += 1
        raise web.HTTPFound("/other/socket")

    async def long(request):
        socket = web.WebSocketResponse(compress=False)
        await socket.prepare(request)
        await socket.send_str("x" * (MOST_BYTES + 1 if "other" not in request.path else 1))
        await socket.receive()
        return socket

    async def binary(request):
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        await socket.send_bytes(b"\0\1")
        await socket.receive()
        return socket

    async def serve(stack, handler):
        app = web.Application()
        app.add_routes([web.get("/socket", handler), web.get("/other/socket", long)])
        runner = web.AppRunner(app, shutdown_timeout=1.0)
        await runner.setup()
        stack.push_async_callback(runner.cleanup)
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        return PageAddress("127.0.0.1", runner.addresses[0][1])

    async def look():
        elsewhere.requested = 0
        async with contextlib.AsyncExitStack() as stack:
            titan = await stack.enter_async_context(FlightPage("titan", "secret").serving())
            mail = await asyncio.start_server(garbage, "127.0.0.1", 0)
            stack.push_async_callback(mail.wait_closed)
            stack.callback(mail.close)
            places = {
                "titan": titan,
                "intruder": PageAddress("127.0.0.1", titan.port, "guess"),
                "odd": PageAddress("127.0.0.1", titan.port, "a\r\nHost: b"),
                "mail": PageAddress("127.0.0.1", mail.sockets[0].getsockname()[1]),
                "elsewhere": await serve(stack, elsewhere),
                "long": await serve(stack, long),
                "binary": await serve(stack, binary),
            }
            browser = await stack.enter_async_context(looking_at(places))
            first = await stack.enter_async_context(browser.looking("titan"))
            assert await text(first) == "titan greets"
            reasons = {}
            for name in list(places)[1:]:
                async with browser.looking(name) as socket:
                    reasons[name] = await why_closed(socket)
            await first.send_str("resume")
            assert await text(first) == "titan: resume"
            return reasons

    assert asyncio.run(look()) == {
        "intruder": "requires another token",
        "odd": "is not the page of a flight",
        "mail": "is not the page of a flight",
        "elsewhere": "is not the page of a flight",
        "long": "sends messages that are too long",
        "binary": "does not answer",
    }
    assert elsewhere.requested == 1


def test_only_who_knows_the_token_of_the_joint_page_reaches_the_flights():
    async def look():
        titan = FlightPage("titan")
        page = JointPage(["titan"], Web("0.0.0.0"))
        async with (
            titan.serving() as place,
            page.serving(lambda _: None) as printed,
            aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session,
        ):
            page.found("titan", place)
            address = f"http://127.0.0.1:{PageAddress.of(printed).port}/"
            socket = f"{address}flights/titan/socket"
            for url in (f"{address}flights", socket, f"{socket}?token=guess"):
                async with session.get(url) as answer:
                    assert answer.status == 401
            async with session.get(f"{address}?{printed.partition('?')[2]}") as answer:
                assert answer.status == 200
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await session.ws_connect(socket, origin="http://evil.example")
            assert refused.value.status == 403
            async with session.ws_connect(socket) as socket:
                assert await text(socket) == "titan greets"

    asyncio.run(look())


@pytest.mark.parametrize(
    ("url", "place", "token"),
    [
        ("http://127.0.0.1:8426/", "127.0.0.1:8426", None),
        ("http://192.168.1.11:8425/?token=a-b_C", "192.168.1.11:8425", "a-b_C"),
        ("http://[::1]:99/", "[::1]:99", None),
        ("titan.local", "titan.local:8425", None),
        ("titan.local:8427/?token=x&token=y", "titan.local:8427", "x"),
        ("http://titan.local", "titan.local:80", None),
    ],
)
def test_addresses(url, place, token):
    address = PageAddress.of(url)
    assert (address.place, address.token) == (place, token)
    assert PageAddress.in_line(f"the flight is shown at {url}") == address
    assert PageAddress.in_line(f"shown at {url}") is None


@pytest.mark.parametrize(
    "text",
    ["", "/", "http://", "https://a/", "ftp://a", "http://a/b", "a:b", "http://[:1/", "a:99999"],
)
def test_what_is_no_address(text):
    with pytest.raises(UsageError, match="is not the address of a flight's page"):
        PageAddress.of(text)


def test_watch_prints_what_is_wrong_with_its_command_line(capsys):
    for arguments, message in (
        (["ftp://a"], "not the address"),
        (["a", "http://a:8425/"], "a:8425 is given twice"),
        (["a", "--web", "70000"], "not a port"),
    ):
        assert main(["watch", *arguments]) == ExitCode.USAGE
        assert message in capsys.readouterr().err
    nowhere = ["watch", "a", "--web-host", "192.0.2.7", "--web", "0"]
    assert main(nowhere) == ExitCode.ENDED_OTHERWISE
    assert "cannot serve the page on 192.0.2.7" in capsys.readouterr().err


def test_watch_serves_until_it_is_interrupted(monkeypatch):
    printed = []

    def say(text):
        printed.append(text)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(watch_command, "say", say)
    assert main(["watch", "titan.local", "atlas.local", "--web", "0"]) == ExitCode.DONE
    assert printed[0].startswith("the flights are shown at http://127.0.0.1:")


def test_beside_something_else_it_ends_with_it_and_a_port_that_is_taken_is_reported():
    printed = []
    with shown_beside(JointPage(["titan"], Web()), printed.append):
        port = PageAddress.of(printed[0].removeprefix("the flights are shown at ")).port
        taken = shown_beside(JointPage(["titan"], Web(port=port)), printed.append)
        with pytest.raises(ServeError, match=f"127.0.0.1:{port}"), taken:
            pass
    assert [thread.name for thread in threading.enumerate()].count("page") == 0
    with shown_beside(JointPage(["titan"], Web(port=port)), printed.append):
        assert len(printed) == 2
