"""What babeld sends on its local socket, captured from babeld 1.12.1, and the radio made of it.

In the captures two nodes (10.9.0.1, ours, and 10.9.0.2) see each other by a relay (10.9.0.3) only.
In the first the relay is killed after some seconds and started again twenty seconds later.
"""

import contextlib
import queue
import random
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.errors import RadioError
from mocha_link.radios import open_radio
from mocha_link.radios.babel import (
    MAX_ENTRIES,
    BabelRadio,
    BabelTable,
    Neighbour,
    quality,
)
from mocha_link.radios.peers import peers_by_radio
from mocha_link.team import RadioUrl
from tests.mocha_link.fuzz import EXPLORE

DATA = Path(__file__).parents[2] / "data" / "mocha" / "babeld"
RELAY_GOES = (DATA / "relay_goes_and_returns.txt").read_text()
ROUND_TRIPS = (DATA / "round_trips.txt").read_text()
FAR, RELAY, FAR_6 = "10.9.0.2", "10.9.0.3", "fd00:9::2"
NEIGHBOUR, MAC = "fe80::28c0:7eff:fef8:4a8", "2a:c0:7e:f8:04:a8"
WAIT_S = 60


def percent(table):
    return {name: reading.value for name, reading in table.readings().items()}


def fed(text, table=None):
    table = table or BabelTable()
    for line in text.splitlines():
        table.feed(line)
    return table


# The lines


def test_neighbours_and_routes_are_readings_of_the_other_ends():
    begin = RELAY_GOES.split("change")[0]
    table = fed(begin)
    (neighbour,) = table.neighbours.values()
    assert neighbour == Neighbour(NEIGHBOUR, "vea", 16, 256, 256, None, 256)
    assert percent(table) == {
        NEIGHBOUR: 100.0,
        MAC: 100.0,
        RELAY: 100.0,
        FAR: 50.0,  # two transmissions
        FAR_6: 50.0,
    }
    assert {reading.source for reading in table.readings().values()} == {"babel"}


def test_peers_are_lost_with_the_relay_and_found_again_with_it():
    table, seen = BabelTable(), []
    for line in RELAY_GOES.splitlines():
        table.feed(line)
        now = sorted({FAR, RELAY, FAR_6, MAC} & percent(table).keys())
        if not seen or seen[-1] != now:
            seen.append(now)
    everything = [FAR, RELAY, MAC, FAR_6]
    assert seen[0] == []
    assert everything in seen
    gone = seen.index([], 1)
    assert seen.index(everything) < gone < len(seen) - 1
    assert seen[-1] == everything
    assert 0 < percent(table)[FAR] <= percent(table)[RELAY] <= 100


def test_round_trips_are_read_where_babeld_measures_them():
    table = fed(ROUND_TRIPS)
    (neighbour,) = table.neighbours.values()
    assert neighbour.rtt_s == pytest.approx(0.030627)
    assert (neighbour.rxcost, neighbour.txcost, neighbour.cost) == (96, 96, 114)
    assert percent(table)[FAR] == 100.0  # of cables, each cheaper than a perfect wireless link


def line(**changes):
    fields = {
        "address": NEIGHBOUR,
        "if": "wlan0",
        "reach": "ffff",
        "ureach": "0000",
        "rxcost": "256",
        "txcost": "256",
        "cost": "256",
    } | {name.rstrip("_"): value for name, value in changes.items()}
    return "add neighbour 55 " + " ".join(f"{name} {value}" for name, value in fields.items())


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"cost": "65535"}, None),  # it does not receive us
        ({"reach": "0000"}, None),  # nothing received of late
        ({"reach": "0000", "ureach": "8000"}, 100.0),
        ({"cost": "512"}, 50.0),
        ({"cost": "96"}, 100.0),
        ({"address": "192.168.1.7"}, 100.0),
    ],
)
def test_a_neighbour_is_as_good_as_its_link(changes, expected):
    assert percent(fed(line(**changes))).get(changes.get("address", NEIGHBOUR)) == expected


def test_the_best_of_two_links_to_a_neighbour_counts():
    table = fed(line(cost="512"))
    table.feed(line(cost="300", if_="wlan1").replace("neighbour 55", "neighbour 56"))
    assert percent(table)[MAC] == quality(300).value


ROUTE = (
    "add route 9 prefix {} from {} installed {} id 0c:e0 metric 512 refmetric 0 via fe80::1 if w"
)


@pytest.mark.parametrize(
    "route",
    [
        ("10.9.0.0/16", "0.0.0.0/0", "yes"),  # of a network
        ("10.9.0.2/32", "10.0.0.0/8", "yes"),  # for packets of some sources only
        ("10.9.0.2/32", "0.0.0.0/0", "no"),
    ],
)
def test_other_routes_measure_no_peer(route):
    assert percent(fed(ROUTE.format(*route))) == {}


@pytest.mark.parametrize(
    "broken",
    [
        "add neighbour",
        "add neighbour 55",
        line(address="nonsense"),
        line(reach="xyz"),
        line(cost="-5"),
        line(cost="1" * 400),
        line(cost="²"),
        line(rtt="nan"),
        ROUTE.format("10.9.0.2", "0.0.0.0/0", "yes").replace("512", "many"),
        ROUTE.format("10.9.0.2/99", "0.0.0.0/0", "yes"),
        "add route 9 prefix",
    ],
)
def test_a_line_that_is_none_is_a_radio_error_and_changes_nothing(broken):
    table = fed(line())
    with pytest.raises(RadioError, match="babeld's line is not understood"):
        table.feed(broken)
    assert percent(table) == {NEIGHBOUR: 100.0, MAC: 100.0}


@given(st.text(max_size=200))
def test_any_text_is_a_line_or_a_radio_error(text):
    with contextlib.suppress(RadioError):
        BabelTable().feed(text)


@pytest.mark.parametrize("seed", range(200 if EXPLORE else 10))
def test_garbled_lines_are_read_or_refused(seed):
    rng, table = random.Random(seed), BabelTable()
    for text in RELAY_GOES.splitlines():
        raw = bytearray(text.encode())
        for _ in range(rng.randrange(3)):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
        with contextlib.suppress(RadioError):
            table.feed(raw.decode(errors="replace"))
        assert all(0 < value <= 100 for value in percent(table).values())


def test_there_is_an_end_to_what_is_kept():
    table = BabelTable()
    for number in range(MAX_ENTRIES + 10):
        table.feed(line().replace("neighbour 55", f"neighbour {number}"))
    assert len(table.neighbours) == MAX_ENTRIES


# Whose address it is


def test_peers_go_by_address_and_by_the_ids_of_their_radios(team):
    team = team.with_robots(
        {
            "titan": {"address": "10.9.0.2", "radio_id": "FD00:9:0::2 2A-C0-7E-F8-04-A8"},
            "callisto": {"address": "callisto.local", "radio_id": "fe80::1%wlan0"},
        }
    )
    assert peers_by_radio(team, team.robot("io"), addresses=True) == {
        FAR: "titan",
        FAR_6: "titan",
        MAC: "titan",
        "fe80::1": "callisto",
    }


def test_without_an_address_nobody_is_found(team):
    team = team.with_robots({name: {"address": "host"} for name in ("titan", "callisto")})
    with pytest.raises(RadioError, match="no peer of io has an IP address or radio_id in"):
        open_radio("babel://localhost:33123", team, "io")
    team = team.with_robots({"titan": {"address": "10.9.0.2"}})
    radio = open_radio("babel:/run/babeld.sock", team, "io")
    assert isinstance(radio, BabelRadio)
    radio.close()


# The connection


class Babeld:
    """A socket on which the test sends as babeld does."""

    def __init__(self, path, stack):
        self.path = path
        self._stack = stack
        self.reports = queue.SimpleQueue()
        self._listener = None
        self.connection = None

    def listen(self):
        self.path.unlink(missing_ok=True)
        self._listener = self._stack.enter_context(socket.socket(socket.AF_UNIX))
        self._listener.bind(str(self.path))
        self._listener.listen()
        self._listener.settimeout(WAIT_S)

    def accept(self, text=""):
        connection, _ = self._listener.accept()
        self.connection = self._stack.enter_context(connection)
        connection.settimeout(WAIT_S)
        assert connection.recv(100).startswith(b"monitor\n")
        connection.sendall(text.encode())

    def end(self):
        """As when babeld is killed."""
        self.connection.close()
        self._listener.close()

    def wait(self, peer, expected):
        while True:
            reported, reading = self.reports.get(timeout=WAIT_S)
            if (reported, reading and reading.value) == (peer, expected):
                return


BEGIN = RELAY_GOES.split("change")[0]
PEERS = {FAR: "titan", RELAY: "callisto"}


@pytest.fixture
def made(tmp_path):
    with contextlib.ExitStack() as stack:

        def make(**settings):
            babeld = Babeld(tmp_path / "babeld.sock", stack)
            settings = {"poll_s": 0.01, "retry_s": 0.01} | settings
            radio = BabelRadio(RadioUrl.parse(f"babel:{babeld.path}"), PEERS, **settings)
            stack.callback(radio.close)
            radio.start(lambda peer, reading: babeld.reports.put((peer, reading)))
            return babeld, radio

        yield make


def test_readings_are_reported_again_and_again_and_follow_every_change(made):
    babeld, radio = made()
    babeld.listen()
    babeld.accept(BEGIN)
    for _ in range(3):
        babeld.wait("titan", 50.0)
        babeld.wait("callisto", 100.0)
    babeld.connection.sendall(RELAY_GOES.split("add neighbour")[1].partition("\n")[2].encode())
    babeld.wait("titan", None)
    assert radio.refused == 0


def test_babeld_may_come_later_and_restart(made):
    babeld, _ = made()
    babeld.listen()
    for _ in range(3):
        babeld.accept(BEGIN)
        babeld.wait("titan", 50.0)
        babeld.end()
        babeld.wait("titan", None)  # nobody knows
        babeld.listen()


def test_a_babeld_that_hangs_is_connected_to_again(made):
    babeld, _ = made(silent_s=0.1)
    babeld.listen()
    for _ in range(3):
        babeld.accept(BEGIN)  # the test holds every connection open


def test_a_babeld_that_answers_is_kept(made):
    babeld, _ = made(probe_s=0.0, silent_s=1000.0)
    babeld.listen()
    babeld.accept(BEGIN)
    for _ in range(3):
        assert b"dump\n" in babeld.connection.recv(5)
        babeld.connection.sendall(b"ok\n")
    babeld.wait("titan", 50.0)


@pytest.mark.parametrize(
    "sent", ["HTTP/1.1 400 Bad Request\n", "BABEL 1.0\nok\nbad\n", "BABEL 1.0\nok\nno memory\n"]
)
def test_what_is_not_babeld_or_refuses_is_logged_once_and_tried_again(made, caplog, sent):
    babeld, _ = made()
    babeld.listen()
    for _ in range(3):
        babeld.accept(sent)
    babeld.accept(BEGIN)
    babeld.wait("titan", 50.0)
    assert len([each for each in caplog.records if each.levelname == "WARNING"]) <= 2


def test_a_radio_that_is_closed_while_a_connection_ends_does_not_try_again(made):
    warnings = []

    class ClosingLog:
        """Closes the radio on its own thread, at the line before the one that ends it."""

        def log(self, *_):
            warnings.clear()  # of the time before babeld listened
            with contextlib.suppress(RuntimeError):  # a thread cannot wait for itself
                radio.close()

        def warning(self, *what):
            warnings.append(what)

    babeld, radio = made(log=ClosingLog())
    babeld.listen()
    babeld.accept("BABEL 1.0\nadd neighbour x\nno memory\n")
    while babeld.connection.recv(100):
        pass  # until it is closed
    radio.close()
    assert warnings == []


def test_noise_between_lines_is_counted_and_the_rest_is_read(made):
    babeld, radio = made()
    babeld.listen()
    babeld.accept(BEGIN)
    babeld.connection.sendall(b"add neighbour x\n" + b"\xff" * 5000 + b"\nchange route y prefix\n")
    better = RELAY_GOES.splitlines()[-2]
    babeld.connection.sendall(f"add neighbour z\n{better}\n".encode())
    babeld.wait("titan", 50.0)
    while radio.refused < 4:
        babeld.reports.get(timeout=WAIT_S)
