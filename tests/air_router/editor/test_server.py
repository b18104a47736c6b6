"""The edit page over real HTTP and WebSockets; and those who should not get in."""

import asyncio
import contextlib
import socket
import threading
from http import HTTPStatus
from pathlib import Path

import aiohttp
import pytest
from yarl import URL

from air_router.cli.cli import main
from air_router.editor.server import EditorServer
from air_router.editor.session import EditSession, MissionFile
from air_router.errors import ExitCode
from air_router.web import guard
from air_router.web.guard import cookie_of
from air_router.web.serving import ServeError, Web
from air_router.web.site import MAX_MESSAGE_BYTES
from air_router.web.tile_file import TileFile
from mocha_link.loopback import is_loopback
from tests.air_router.tile_maker import around, write_tiles

ROOT = Path(__file__).parents[3]
LIMIT_S = 60
OPEN_FILES = Path("/proc/self/fd")
TILES = around(17, 39.942, -75.2, reach=0)
FREE = [39.9426, -75.2002]
MOVE = {"do": "move", "keys": ["waypoints", 0, "position"], "to": FREE}


@pytest.fixture
def tiles(tmp_path):
    return write_tiles(tmp_path / "site.MBTILES", TILES, attribution="&copy; <i>City</i> &lt;1>")


class Page:
    """A browser, as the server sees it."""

    def __init__(self, client, address):
        self.client = client
        self.address = address

    async def get(self, target, **options):
        async with self.client.get(self.address.partition("?")[0] + target, **options) as answer:
            return answer, await answer.read()

    @contextlib.asynccontextmanager
    async def socket(self, **options):
        url = (
            self.address.replace("/?", "/socket?")
            if "?" in self.address
            else self.address + "socket"
        )
        async with self.client.ws_connect(url, **options) as socket:
            yield socket


async def until(socket, kind, number=None):
    """The next message of a kind."""
    while True:
        message = await socket.receive_json()
        if message["type"] in kind and (number is None or message.get("id") == number):
            return message


async def request(socket, number, what, **more):
    await socket.send_json({"ask": what, "id": number, **more})
    return await until(socket, ("done", "refused"), number)


def visit(path, talk, *, host="127.0.0.1", token=None, backdrop=None):
    """Run a conversation with a server of its own."""

    async def run():
        server = EditorServer(EditSession(MissionFile(path)), Web(host, 0, backdrop, token))
        async with server.serving(lambda _: None) as address, aiohttp.ClientSession() as client:
            await talk(Page(client, address))

    asyncio.run(asyncio.wait_for(run(), LIMIT_S))


def test_the_page_and_all_its_parts_come_from_the_package(path):
    async def talk(page):
        answer, body = await page.get("")
        assert answer.status == HTTPStatus.OK
        assert b"/edit/main.js" in body
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        assert b"http" not in body.replace(b"http-equiv", b"")
        for part, kind in (
            ("edit/main.js", "text/javascript"),
            ("page/leaflet/leaflet.js", "text/javascript"),
            ("page/leaflet/leaflet.css", "text/css"),
            ("page/leaflet/images/layers.png", "image/png"),
            ("page/icon.svg", "image/svg+xml"),
        ):
            answer, body = await page.get(part)
            assert (answer.status, answer.content_type) == (HTTPStatus.OK, kind)
            tag = answer.headers["ETag"]
            answer, body = await page.get(part, headers={"If-None-Match": tag})
            assert (answer.status, body) == (HTTPStatus.NOT_MODIFIED, b"")

    visit(path, talk)


def test_nothing_else_can_be_had(path):
    async def talk(page):
        for target in (
            "edit/../../../mission.yaml",
            "edit/%2e%2e/%2e%2e/session.py",
            "page/..%2f..%2fguard.py",
            "edit//etc/passwd",
            "backdrop",
            "session.py",
        ):
            answer, _ = await page.get(target)
            assert answer.status == HTTPStatus.NOT_FOUND, target
        answer, _ = await page.get("socket")
        assert answer.status == HTTPStatus.BAD_REQUEST

    visit(path, talk)


@pytest.mark.parametrize("line", ["/ HTTP/1.1", f"/{'a' * 9000} HTTP/1.1", "/\xff HTTP/1.1"])
def test_what_is_no_request_is_refused_without_a_line_in_the_log(path, caplog, line):
    async def talk(page):
        host, port = page.address.split("/")[2].split(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(f"GET {line}\r\n\r\n".encode("latin-1"))
        assert b" 400 Bad Request" in await reader.readline()
        writer.close()

    visit(path, talk)
    assert not caplog.records


def test_other_sites_pages_are_kept_out(path):
    async def talk(page):
        for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[", "a:b"):
            answer, _ = await page.get("", headers={"Host": host})
            assert answer.status == HTTPStatus.FORBIDDEN, host
        answer, _ = await page.get("", headers={"Host": "localhost:1"})
        assert answer.status == HTTPStatus.OK
        for origin in ("https://evil.example", "null", "http://127.0.0.1:1", "http://["):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                async with page.socket(headers={"Origin": origin}):
                    pass
            assert refused.value.status == HTTPStatus.FORBIDDEN
        own = page.address.rstrip("/")
        async with page.socket(headers={"Origin": own}) as socket:
            assert await until(socket, ("state",))
        async with page.client.post(page.address, headers={"Origin": "https://evil.example"}) as no:
            assert no.status == HTTPStatus.FORBIDDEN

    visit(path, talk)


def test_others_need_the_token(path):
    async def talk(page):
        assert "0.0.0.0" not in page.address
        for target in ("", "?token=wrong", "edit/main.js", "socket"):
            answer, _ = await page.get(target)
            assert answer.status == HTTPStatus.UNAUTHORIZED
        with pytest.raises(aiohttp.WSServerHandshakeError):
            async with page.client.ws_connect(page.address.partition("?")[0] + "socket"):
                pass
        jar = aiohttp.CookieJar(unsafe=True)  # takes cookies of addresses, as browsers do
        async with aiohttp.ClientSession(cookie_jar=jar) as browser:
            async with browser.get(page.address) as answer:
                assert answer.status == HTTPStatus.OK
                assert "token" not in str(answer.url)
            async with browser.ws_connect(page.address.partition("?")[0] + "socket") as socket:
                assert await until(socket, ("state",))

    visit(path, talk, host="0.0.0.0")


def test_connections_that_are_left_open_cost_the_others_nothing(path, monkeypatch, caplog):
    monkeypatch.setattr(guard, "PER_ADDRESS", 5)
    monkeypatch.setattr(guard, "IN_ALL", 8)

    async def is_closed(reader):
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""

    async def talk(page):
        port, writers = URL(page.address).port, []

        async def left_open(host):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(host, 0))
            writers.append(writer)
            return reader

        first = [await left_open("127.0.0.2") for _ in range(5)]
        await left_open("127.0.0.2")
        await is_closed(first[0])  # it has had its share
        for host in ("127.0.0.3", "127.0.0.4"):
            for _ in range(2):
                await left_open(host)
        await is_closed(first[1])  # the oldest goes when there is no room
        answer, _ = await page.get("")
        assert answer.status == HTTPStatus.OK
        for writer in writers:
            writer.close()

    visit(path, talk)
    assert caplog.text == ""


def test_connections_that_are_held_keep_no_page_of_this_machine_out(path, monkeypatch, caplog):
    """All programs of this machine, whichever user's, have one address."""
    monkeypatch.setattr(guard, "PER_ADDRESS", 5)

    async def talk(page):
        port, held = URL(page.address).port, []
        async with page.socket() as socket:  # a page that is open, for longer than all of them
            assert (await request(socket, 1, "undo"))["id"] == 1
            for raw in (b"", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"):
                for _ in range(12):
                    reader, writer = await asyncio.open_connection("127.0.0.1", port)
                    held.append(writer)
                    writer.write(raw)
                    if raw:  # answered, and kept alive
                        assert b"200 OK" in await reader.readline()
                answer, _ = await page.get("")
                assert answer.status == HTTPStatus.OK
            assert (await request(socket, 2, "undo"))["id"] == 2
        for writer in held:
            writer.close()

    visit(path, talk)
    assert caplog.text == ""


@pytest.mark.skipif(not OPEN_FILES.is_dir(), reason="what is open can be listed on Linux only")
def test_many_connections_at_once_do_not_take_the_descriptors(path, monkeypatch, caplog):
    """A connection is accepted before it can be refused: so a few at a time."""
    monkeypatch.setattr(guard, "PER_ADDRESS", 5)
    enter, opened, all_in = guard.ConnectionLimit.enter, [], asyncio.Event()

    def count():
        return len(list(OPEN_FILES.iterdir()))

    def counted(limit, transport):
        opened.append(count())
        if len(opened) == guard.BACKLOG:
            all_in.set()
        enter(limit, transport)

    monkeypatch.setattr(guard.ConnectionLimit, "enter", counted)

    async def talk(page):
        with contextlib.ExitStack() as stack:
            crowd = [stack.enter_context(socket.socket()) for _ in range(90)]
            before = count()
            for each in crowd:
                each.setblocking(False)
                each.connect_ex(("127.0.0.1", URL(page.address).port))
            await all_in.wait()
            assert max(opened) - before < 40

    visit(path, talk)
    assert caplog.text == ""


def test_a_connection_that_requests_nothing_is_closed(path, monkeypatch):
    monkeypatch.setattr(guard, "REQUEST_S", 0.05)

    async def talk(page):
        for begun in (b"", b"GET / HTTP/1.1\r\nHost: "):
            reader, writer = await asyncio.open_connection("127.0.0.1", URL(page.address).port)
            writer.write(begun)
            with contextlib.suppress(ConnectionError):
                assert await reader.read() == b""
            writer.close()
        async with page.socket() as socket:  # one that has requested something stays
            await asyncio.sleep(0.1)
            assert (await request(socket, 1, "undo"))["id"] == 1

    visit(path, talk)


def test_an_edit_is_sent_to_every_page_and_saved(path):
    before = path.read_text()

    async def talk(page):
        async with page.socket() as one, page.socket() as other:
            state = await until(one, ("state",))
            await until(other, ("state",))
            answer = await request(one, 1, "edit", edit=MOVE, revision=state["revision"])
            assert answer["type"] == "done"
            update = await until(other, ("state",))
            assert update["revision"] == state["revision"] + 1
            assert update["dirty"]
            stale = await request(other, 5, "edit", edit=MOVE, revision=state["revision"])
            assert (stale["type"], stale["kind"]) == ("refused", "stale")
            answer = await request(one, 2, "route", start=1, end=34)
            assert answer["route"]["length_m"] > 100
            assert (await request(one, 3, "save"))["type"] == "done"
            assert not (await until(other, ("state",)))["dirty"]

    visit(path, talk)
    assert path.read_text() == before.replace(
        "[39.9422294, -75.2001338]", "[39.9426000, -75.2002000]"
    )


def test_a_page_that_missed_updates_gets_the_whole(path):
    async def talk(page):
        async with page.socket() as one:
            first = await until(one, ("state",))
            await request(one, 1, "edit", edit=MOVE)
            removal = {"do": "remove", "keys": ["waypoints", 7, "position"]}
            await request(one, 2, "edit", edit=removal)
            whole = (await request(one, 3, "state"))["state"]
            assert (first["revision"], whole["revision"]) == (1, 3)
            assert len(whole["places"]) == len(first["places"]) - 1
            async with page.socket() as other:
                assert await until(other, ("state",)) == whole
            await request(one, 4, "undo")
            async with page.socket() as other:
                move = {**MOVE, "to": [FREE[0] + 1e-5, FREE[1]]}
                await until(other, ("state",))
                await request(one, 5, "edit", edit=move)
                assert (await until(other, ("state",)))["since"] == 4

    visit(path, talk)


def test_saving_a_draft_or_over_others_work_is_confirmed_first(path):
    async def talk(page):
        async with page.socket() as socket:
            inside = {**MOVE, "to": [39.94248, -75.20055]}
            assert (await request(socket, 1, "edit", edit=inside))["type"] == "done"
            assert (await request(socket, 2, "save"))["kind"] == "unconfirmed"
            path.write_text(path.read_text() + "# by hand\n")
            assert (await until(socket, ("disk",)))["changed"] in (False, True)
            assert (await request(socket, 3, "save", confirmed=True))["kind"] == "changed"
            assert (await request(socket, 4, "undo"))["type"] == "done"
            assert (await request(socket, 5, "reload"))["type"] == "done"
            assert (await request(socket, 6, "undo"))["kind"] == "edit"

    visit(path, talk)
    assert path.read_text().endswith("# by hand\n")


def test_hostile_messages_cost_their_sender_an_answer(path):
    async def talk(page):
        async with page.socket() as socket:
            state = await until(socket, ("state",))
            for text in (
                "",
                "null",
                "[]",
                "{",
                '{"id": "x"}',
                '{"ask": "edit"}',
                '{"ask": "rm -rf"}',
                '{"ask": "edit", "edit": {"do": "move", "keys": ["__class__"], "to": [0, 0]}}',
                '{"ask": "route", "start": "1", "end": 1e99}',
                "[" * 5000,
                '{"ask": "route", "start": 1, "end": 99999}',
                '{"ask": "edit", "edit": NaN}',
            ):
                await socket.send_str(text)
                assert (await until(socket, ("refused", "done")))["type"] in ("refused", "done")
            answer = await request(socket, 9, "route", start=0, end=99999)
            assert answer["route"].keys() == {"reason"}
            await socket.send_str("x" * (MAX_MESSAGE_BYTES + 1))
            while (message := await socket.receive()).type is aiohttp.WSMsgType.TEXT:
                pass
            assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        async with page.socket() as socket:
            await socket.send_bytes(b"\x00")
            while (message := await socket.receive()).type is aiohttp.WSMsgType.TEXT:
                pass
        async with page.socket() as socket:
            assert (await until(socket, ("state",)))["revision"] == state["revision"]

    visit(path, talk)


def test_a_fault_of_ours_costs_no_work(path, monkeypatch, caplog):
    async def talk(page):
        async with page.socket() as socket:
            await request(socket, 1, "edit", edit=MOVE)
            monkeypatch.setattr(EditSession, "undo", lambda _: 1 / 0)
            assert (await request(socket, 2, "undo"))["kind"] == "fault"
            assert (await request(socket, 3, "save"))["type"] == "done"

    visit(path, talk)
    assert "ZeroDivisionError" in caplog.text


def test_tiles_lie_under_the_map_and_what_is_not_there_is_an_empty_picture(path, tiles, caplog):
    async def talk(page):
        async with page.socket() as socket:
            facts = (await until(socket, ("setting",)))["backdrop"]
        assert (facts["lowest"], facts["highest"], facts["attribution"]) == (17, 17, "© City <1>")
        assert facts["bounds"] is None

        async def get(*place, address=facts["address"], **options):
            target = address.format(**dict(zip("zxy", place, strict=True)))[1:]
            answer, body = await page.get(target, **options)
            assert (answer.status, answer.content_type) == (HTTPStatus.OK, "image/png")
            return body, answer.headers["Cache-Control"]

        zoom, column, row, data = TILES[0]
        assert await get(zoom, column, row) == (data, "private, max-age=3600")
        empty, kept = await get(zoom, column, row - 1)
        assert (len(empty), kept) == (68, "private, max-age=3600")
        assert await get(10**8, 10**8, 10**8) == (empty, kept)
        assert await get(zoom, column, row, address="/backdrop/other/{z}/{x}/{y}") == (
            empty,
            "no-store",
        )
        for wrong in ("-1/0/0", "1/2", "1/2/x", "1/2/3/4", "\u0661/0/0"):
            answer, _ = await page.get(f"backdrop/{facts['address'][10:22]}/{wrong}")
            assert answer.status == HTTPStatus.NOT_FOUND
        target = facts["address"].format(z=zoom, x=column, y=row)[1:]
        answer, _ = await page.get(target, headers={"Host": "evil.example"})
        assert answer.status == HTTPStatus.FORBIDDEN
        tiles.rename(tiles.with_name("gone"))
        assert await get(zoom, column, row) == (empty, "no-store")
        assert await get(zoom, column, row) == (empty, "no-store")

    visit(path, talk, backdrop=TileFile.read(tiles))
    assert caplog.text.count("the map stays empty in places") == 1


def test_tiles_need_the_token_and_a_slow_one_keeps_no_other_waiting(path, tiles, monkeypatch):
    requested, go_on = threading.Event(), threading.Event()
    read = TileFile.tile

    def wait(*place):
        requested.set()
        assert go_on.wait(LIMIT_S)
        return read(*place)

    monkeypatch.setattr(TileFile, "tile", wait)
    backdrop = TileFile.read(tiles)
    zoom, column, row, data = TILES[0]
    target = backdrop.view()["address"].format(z=zoom, x=column, y=row)[1:]

    async def talk(page):
        answer, _ = await page.get(target)
        assert answer.status == HTTPStatus.UNAUTHORIZED
        cookies = {cookie_of(URL(page.address).port): "secret"}
        async with asyncio.TaskGroup() as tasks:
            tile = tasks.create_task(page.get(target, cookies=cookies))
            await asyncio.to_thread(requested.wait, LIMIT_S)
            answer, _ = await page.get("", cookies=cookies)
            assert answer.status == HTTPStatus.OK
            assert not tile.done()
            go_on.set()
            assert (await tile)[1] == data

    visit(path, talk, host="0.0.0.0", token="secret", backdrop=backdrop)  # noqa: S106


def test_a_taken_port_is_reported(path):
    async def talk(page):
        port = int(page.address.rstrip("/").rpartition(":")[2])
        taken = EditorServer(EditSession(MissionFile(path)), Web(port=port)).serving(print)
        with pytest.raises(ServeError, match="another port"):
            await contextlib.AsyncExitStack().enter_async_context(taken)

    visit(path, talk)


def test_only_this_machine_is_loopback():
    assert all(map(is_loopback, ("127.0.0.1", "127.9.9.9", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "10.0.0.1", "example.org", "")))


def test_wrong_usage_and_unreadable_files_end_the_command(path, capsys):
    assert main(["edit", str(path), "--image", str(path)]) == ExitCode.USAGE
    assert "is not an MBTiles file" in capsys.readouterr().err
    assert main(["edit", str(path), "--port", "70000"]) == ExitCode.USAGE
    path.write_text("home: [1,\n")
    assert main(["edit", str(path), "--port", "0"]) == ExitCode.INVALID_FILE
    assert "mission.yaml:1:7: '[' opens here and is not closed" in capsys.readouterr().err
    assert main(["edit", str(path.with_name("none.yaml"))]) == ExitCode.INVALID_FILE
