"""Tiles that are fetched from a server on this machine: which, how politely, and again."""

import http.server
import socket
import threading
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.errors import ExitCode, UsageError
from air_router.mission.loading import load_mission
from air_router.web.fetch_command import (
    FetchError,
    TileArea,
    TileFetcher,
    TileKey,
    bounds_of,
    fetch,
    zooms_for,
    zooms_of,
)
from air_router.web.tile_file import TileFile
from tests.air_router.tile_maker import picture, tile_at

PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"
BOUNDS = (39.939, -75.204, 39.945, -75.196)
WORDS = ",".join(map(str, BOUNDS))


class MapServer(http.server.ThreadingHTTPServer):
    """Has every tile but one; is busy, or tired, when set so."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Answers)
        self.requested, self.agents, self.busy, self.left = [], set(), 0, 10**6
        self.template = f"http://127.0.0.1:{self.server_port}/{{z}}/{{x}}/{{y}}.png?key=secret"


class Answers(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        server = self.server
        zoom, column, row = map(int, self.path.split(".")[0].strip("/").split("/"))
        server.agents.add(self.headers["User-Agent"])
        code = 200
        if server.busy:
            server.busy -= 1
            code = 429
        elif server.left <= 0:
            code = 403
        elif (column, row) == tile_at(zoom, BOUNDS[2], BOUNDS[1]) and zoom == 15:
            code = 404
        server.left -= 1
        server.requested.append((zoom, column, row, code))
        self.send_response(code)
        if code == 429:
            self.send_header("Retry-After", "7")
        self.end_headers()
        if code == 200:
            self.wfile.write(picture(column, row))

    def log_message(self, *_):
        pass


@pytest.fixture
def server():
    with MapServer() as made:
        thread = threading.Thread(target=made.serve_forever, args=(0.01,))
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def test_what_is_fetched_lies_under_the_map_and_a_broken_fetch_goes_on(server, tmp_path):
    area, path, pauses = TileArea(BOUNDS, range(15, 18)), tmp_path / "site.mbtiles", []
    fetcher = TileFetcher(server.template, 5.0, "field@example.org", pause=pauses.append)
    server.left, server.busy = 4, 1
    with pytest.raises(FetchError, match=r"tile 1\d/\d+/\d+: the server answered 403 .*to go on"):
        fetch(path, area, fetcher, "© City")
    assert 7.0 in pauses  # as long as the server wants
    assert all(pause <= 1 / 5 for pause in pauses if pause != 7.0)
    assert sum(pauses) > 7.0  # and between any two
    server.left = 10**6
    result = fetch(path, area, fetcher, "© City")
    assert (result.before, result.none) == (2, 1)
    assert result.new + result.before + result.none == len(area)
    good = [key for *key, code in server.requested if code == 200]
    assert len(good) == len({tuple(key) for key in good}) == len(area) - 1
    (agent,) = server.agents
    assert agent.startswith("air-router/")
    assert "field@example.org" in agent
    tiles = TileFile.read(path)
    assert (tiles.lowest, tiles.highest, tiles.attribution) == (15, 17, "© City")
    assert tiles.bounds == BOUNDS
    column, row = tile_at(17, 39.942, -75.2)
    assert tiles.tile(17, column, row).data == picture(column, row)
    assert b"secret" not in path.read_bytes()
    other = TileFetcher(server.template.replace("secret", "other"), 5.0, pause=pauses.append)
    with pytest.raises(UsageError, match="tiles of another server"):
        fetch(path, area, other, "")


def test_an_area_has_the_tiles_that_touch_it():
    keys = list(TileArea(BOUNDS, range(16, 17)))
    assert len(keys) == len(TileArea(BOUNDS, range(16, 17)))
    north_west, south_east = keys[0], keys[-1]
    assert north_west == TileKey(16, *tile_at(16, BOUNDS[2], BOUNDS[1]))
    assert south_east == TileKey(16, *tile_at(16, BOUNDS[0], BOUNDS[3]))
    assert len(TileArea((-90.0, -180.0, 90.0, 180.0), range(2))) == 1 + 4


def test_absurd_numbers_of_tiles_and_what_is_no_server_are_refused(server, tmp_path, capsys):
    path = tmp_path / "site.mbtiles"

    def run(*options):
        common = ["tiles", "fetch", str(path), "--url", server.template, "--attribution", "City"]
        code = main([*common, *options])
        return code, capsys.readouterr()

    code, printed = run("--bounds", "39,-76,40,-75", "--zooms", "10-19")
    assert code == ExitCode.USAGE
    assert "--most" in printed.err
    assert not path.exists()
    code, printed = run("--bounds", WORDS, "--zooms", "15", "--most", "1")
    assert code == ExitCode.USAGE
    code, printed = run("--bounds", WORDS, "--zooms", "15-16", "--per-second", "10")
    assert code == ExitCode.DONE
    assert "tiles fetched, 0 were there, 1 the server does not have" in printed.out
    assert run("--bounds", WORDS, "--zooms", "25")[0] == ExitCode.USAGE
    assert run("--bounds", WORDS, "--zooms", "15", "--per-second", "0")[0] == ExitCode.USAGE
    for address in ("ftp://x/{z}/{x}/{y}", "https://x/{z}/{x}.png"):
        with pytest.raises(UsageError, match="not the address of tiles"):
            TileFetcher(address, 1.0)
    assert zooms_of("15") == range(15, 16)
    assert bounds_of("39,-76,40.5,-75") == (39.0, -76.0, 40.5, -75.0)
    for bounds in ("1,2,3", "1,2,3,4,5", "a,b,c,d", "2,0,1,1", "0,0,91,1"):
        with pytest.raises(UsageError, match="S,W,N,E"):
            bounds_of(bounds)


def test_the_ground_of_a_mission_is_fetched_from_its_file_alone(server, tmp_path, capsys):
    path, mission = tmp_path / "site.mbtiles", load_mission(PENNOVATION)
    common = ["tiles", "fetch", str(path), "--url", server.template, "--per-second", "10"]
    named = [*common, "--mission", str(PENNOVATION), "--attribution", "© City"]
    assert main([*named, "--zooms", "16-17", "--around", "100"]) == ExitCode.DONE
    assert "MB)" in capsys.readouterr().out
    south, west, north, east = TileFile.read(path).bounds
    metres = [mission.frame.to_local(*corner) for corner in ((south, west), (north, east))]
    fence = mission.fences[0].polygon.bounds
    assert metres[0] == pytest.approx((fence[0] - 100, fence[1] - 100), abs=0.5)
    assert metres[1] == pytest.approx((fence[2] + 100, fence[3] + 100), abs=0.5)
    zooms = zooms_for((south, west, north, east))
    assert zooms[-1] == 19
    assert len(TileArea((south, west, north, east), zooms[:1])) <= 4
    assert main([*named, "--around", "-1"]) == ExitCode.USAGE
    assert main([*named, "--most-mb", "nan"]) == ExitCode.USAGE
    assert main([*common, "--mission", str(PENNOVATION), "--attribution", " "]) == ExitCode.USAGE
    assert "whom the map has to name" in capsys.readouterr().err
    nothing = [*named[:-4], "--mission", str(tmp_path / "none.yaml"), "--attribution", "City"]
    assert main(nothing) == ExitCode.INVALID_FILE
    assert "none.yaml" in capsys.readouterr().err


def test_no_more_bytes_are_fetched_than_were_requested(server, tmp_path):
    area, path = TileArea(BOUNDS, range(17, 18)), tmp_path / "site.mbtiles"
    limit = 2.5 * len(picture(0, 0))
    fetcher = TileFetcher(server.template, 10.0, pause=lambda _: None, most_bytes=limit)
    with pytest.raises(FetchError, match=r"more than .* MB have come; .*--most-mb; what was"):
        fetch(path, area, fetcher, "© City")
    assert len(server.requested) == 3  # the third is one too many, and is not kept
    fetcher.most_bytes = 1e6
    result = fetch(path, area, fetcher, "© City")  # it goes on
    assert result.before == 2
    assert result.bytes == sum(len(picture(x, y)) for _, x, y, code in server.requested[3:])


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"HTTP/1.1 200 OK\r\nContent-Length: 5000\r\n\r\n\x89PNG", "4 bytes read, 4996 more"),
        (b"what?\r\n\r\n", "not HTTP .what"),
        (b"", "closed connection"),
        (b"HTTP/1.1 200 OK\r\n\r\n<html>login</html>", "no picture"),
    ],
)
def test_what_a_broken_server_answers_is_one_clear_error(answer, why):
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            with listening.accept()[0] as connection:
                connection.recv(4096)
                connection.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        template = f"http://127.0.0.1:{listening.getsockname()[1]}/{{z}}/{{x}}/{{y}}"
        with pytest.raises(FetchError, match=rf"tile 3/1/2: .*{why}.*run the command again"):
            TileFetcher(template, 10.0, pause=lambda _: None).tile(TileKey(3, 1, 2))
        thread.join()


def test_a_server_whose_terms_forbid_it_is_not_queried():
    for host in ("tile.openstreetmap.org", "a.tile.openstreetmap.org"):
        with pytest.raises(UsageError, match="forbid copies for use offline"):
            TileFetcher(f"https://{host}/{{z}}/{{x}}/{{y}}.png", 1.0)
    TileFetcher("https://notopenstreetmap.org/{z}/{x}/{y}.png", 1.0)
