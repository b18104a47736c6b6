"""Radios: what counts as a report, and how it gets to the node."""

import asyncio
import contextlib
import io
import json
import os
import queue
import socket
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading, Unit, as_reading
from mocha_link.radios import ManualRadio, UdpRadio, open_radio
from mocha_link.radios.peers import peers_by_radio
from mocha_link.radios.radio import BackgroundRadio
from mocha_link.radios.rajant import RajantRadio
from mocha_link.radios.reports import (
    MAX_LINE_BYTES,
    MavlinkRadio,
    StdinRadio,
    TcpRadio,
    parse_radio_status,
    parse_report,
)
from mocha_link.radios.wifi import WifiRadio
from mocha_link.team.document import DocumentError
from mocha_link.team.team import UnknownRobotError
from mocha_link.team.team_file import RadioUrl

WAIT_S = 60


def refused(name):
    """What is none, a line each."""
    return (Path(__file__).parents[2] / "data" / "refused" / f"{name}.txt").read_text().splitlines()


class Received:
    """What a radio reports, for a test to wait for."""

    def __init__(self):
        self._reports = queue.SimpleQueue()

    def __call__(self, peer, reading):
        if peer == "mars":
            raise UnknownRobotError(peer, ("io",), "among the clients")
        self._reports.put((peer, reading))

    def next(self):
        return self._reports.get(timeout=WAIT_S)


@pytest.fixture
def received():
    return Received()


def dbm(value, source="radio"):
    return Reading(value, Unit.DBM, source)


# Reports.


@pytest.mark.parametrize(
    ("raw", "reading"),
    [
        (b'{"peer": "io", "rssi_dbm": -61.5}', dbm(-61.5)),
        (b'{"peer": "io", "rssi_dbm": -61, "snr_db": 9}', dbm(-61.0)),
        (b'{"peer": "io", "rssi_dbm": null, "snr_db": 9}', Reading(9.0, Unit.SNR_DB, "radio")),
        (b'{"peer": "io", "device": 31, "source": "silvus"}', Reading(31.0, Unit.DEVICE, "silvus")),
        (b'{"peer": "io", "rssi_dbm": null}', None),
        (b"io -61.5\n", dbm(-61.5)),
        (b"io -61 dBm", dbm(-61.0)),
        (b"io 14 dB\r\n", Reading(14.0, Unit.SNR_DB, "radio")),
        (b"  io 31 device", Reading(31.0, Unit.DEVICE, "radio")),
        (b"io none", None),
    ],
)
def test_reports(raw, reading):
    assert parse_report(raw) == ("io", reading)


@pytest.mark.parametrize(
    "raw",
    [
        *map(str.encode, refused("reports")),
        b"",
        b'{"peer": "io", "rssi_dbm": ' + b"9" * 400 + b"}",
        b'{"peer": "io", "rssi_dbm": ' + b"9" * 5000 + b"}",
        b'{"peer": "io", "rssi_dbm": -50, "source": "' + b"x" * 33 + b'"}',
        b'{"peer": "io", "rssi_dbm": -50, "source": "a\\u001b[2J"}',
        b'{"a":' * 2000,
        b"\xff\xfe",
    ],
)
def test_what_is_no_report(raw):
    with pytest.raises(RadioError):
        parse_report(raw)


@given(
    st.one_of(
        st.binary(max_size=80),
        st.text(max_size=60).map(str.encode),
        st.dictionaries(
            st.sampled_from(["peer", "rssi_dbm", "snr_db", "device", "source"]),
            st.none() | st.text(max_size=4) | st.floats() | st.integers() | st.booleans(),
        ).map(lambda report: json.dumps(report).encode()),
    )
)
def test_any_line_is_a_report_or_a_radio_error(raw):
    with contextlib.suppress(RadioError):
        parse_report(raw)


@given(
    st.lists(st.binary(max_size=150).map(lambda line: line.replace(b"\n", b"")), max_size=8),
    st.lists(st.integers(1, 90), max_size=8),
)
def test_lines_are_the_same_however_they_are_cut(lines, sizes):
    radio = BackgroundRadio()

    async def read():
        stream, rest = asyncio.StreamReader(limit=50), b"\n".join(lines)
        found = asyncio.create_task(collect(radio.lines(stream)))
        for size in sizes:
            stream.feed_data(rest[:size])
            rest = rest[size:]
            await asyncio.sleep(0)
        stream.feed_data(rest)
        stream.feed_eof()
        return [line.removesuffix(b"\n") for line in await found]

    assert asyncio.run(read()) == [line for line in lines if line.strip() and len(line) <= 50]
    assert radio.refused == sum(len(line) > 50 for line in lines)


async def collect(items):
    return [item async for item in items]


# Readings.


def test_bare_numbers_are_dbm():
    assert as_reading(-60) == dbm(-60.0)
    assert as_reading(None) is None
    assert as_reading(Reading(3.0, Unit.DEVICE, "x")).unit is Unit.DEVICE


@pytest.mark.parametrize("value", ["-60", True, 1e9, float("nan"), float("inf"), 10**400, 1001])
def test_numbers_that_are_no_reading(value):
    with pytest.raises(RadioError):
        as_reading(value)
    with pytest.raises(RadioError):
        Reading(value, Unit.SNR_DB, "x")


# URLs.


@pytest.mark.parametrize(
    "url",
    [
        "udp://127.0.0.1:5",
        "tcp://0.0.0.0:5",
        "stdin:",
        "wifi://wlan0",
        "rajant://10.229.221.1:2300",
        "rajant://10.229.221.1?jar=/usr/local/lib/monitor.jar",
        "mavlink://127.0.0.1:14550?peer=io",
        "mavlink://127.0.0.1:14550",
    ],
)
def test_urls(url, team):
    assert str(RadioUrl.parse(url)) == url
    assert team.with_robots({"io": {"radio": url}}).robot("io").radio == url


@pytest.mark.parametrize(
    "url", [*refused("radio_urls"), "", "udp://" + "a" * 200, "rajant://" + "a" * 64 + ":5"]
)
def test_urls_that_are_none(url, team):
    with pytest.raises(RadioError, match="is no radio; write "):
        RadioUrl.parse(url)
    with pytest.raises(DocumentError, match="is no radio; write "):
        team.with_robots({"io": {"radio": url}})


@given(st.text(max_size=30) | st.from_regex(r"(udp|wifi|mavlink|rajant)://[a-z.]*:?\d*\??.*"))
def test_any_text_is_a_url_or_a_radio_error(text):
    with contextlib.suppress(RadioError):
        RadioUrl.parse(text)


def test_each_url_has_its_radio(team):
    team = team.with_robots({"titan": {"radio_id": "02:CA:FF:EE:00:13"}})
    for url, kind in {
        "udp://127.0.0.1:5": UdpRadio,
        "tcp://127.0.0.1:5": TcpRadio,
        "stdin:": StdinRadio,
        "wifi://wlan0": WifiRadio,
        "rajant://10.0.0.1:5": RajantRadio,
        "mavlink://127.0.0.1:5?peer=titan": MavlinkRadio,
    }.items():
        radio = open_radio(url, team, "io")
        assert isinstance(radio, kind)
        radio.close()
        radio.close()


def test_peers_go_by_the_ids_of_their_radios(team):
    team = team.with_robots(
        {
            "titan": {"radio_id": "02-CA-FF-EE-00-13, 10.229.221.1"},
            "callisto": {"radio_id": "SN-1234"},
        }
    )
    assert peers_by_radio(team, team.robot("io")) == {
        "02:ca:ff:ee:00:13": "titan",
        "10.229.221.1": "titan",
        "sn-1234": "callisto",
    }


def test_radios_that_cannot_tell_peers_apart(team):
    with pytest.raises(RadioError, match=r"no peer of io has a radio_id in .*team.yaml"):
        open_radio("wifi://wlan0", team, "io")
    same = team.with_robots({name: {"radio_id": "1"} for name in ("titan", "callisto")})
    with pytest.raises(RadioError, match="titan have the same radio_id '1'"):
        open_radio("rajant://a:5", same, "io")
    for url in ("mavlink://a:5", "mavlink://a:5?peer=mars", "mavlink://a:5?peer=io"):
        with pytest.raises(RadioError, match=r"write \?peer= and one of callisto, titan"):
            open_radio(url, team, "io")
    with pytest.raises(UnknownRobotError):
        open_radio("udp://a:5", team, "mars")


# Streams.


def test_a_manual_radio_reports_what_it_is_given():
    radio, received = ManualRadio(), []
    radio.report("io", -50)
    radio.start(lambda *report: received.append(report))
    radio.report("io", -51)
    radio.close()
    radio.report("io", -52)
    assert received == [("io", -51)]


def test_datagrams(received):
    radio = UdpRadio("udp://127.0.0.1:0")
    radio.start(received)
    with contextlib.closing(radio), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in (b"junk", b"mars -50", b"io -50", b""):
            sender.sendto(datagram, ("127.0.0.1", radio.port))
        sender.sendto(b"io none\n", ("127.0.0.1", radio.port))
        assert received.next() == ("io", dbm(-50.0, "udp"))
        assert received.next() == ("io", None)
        assert radio.refused == 3
        with pytest.raises(RadioError, match="cannot listen for radio reports on udp://"):
            UdpRadio(f"udp://127.0.0.1:{radio.port}").start(received)


def test_reports_by_ipv6(received):
    for radio, kind in (
        (UdpRadio("udp://[::1]:0"), socket.SOCK_DGRAM),
        (TcpRadio("tcp://[::1]:0"), socket.SOCK_STREAM),
    ):
        radio.start(received)
        with contextlib.closing(radio), socket.socket(socket.AF_INET6, kind) as sender:
            sender.connect(("::1", radio.port))
            sender.sendall(b"io -50\n")
            peer, reading = received.next()
            assert (peer, reading.value) == ("io", -50.0)


def test_lines_over_tcp(received, caplog):
    radio = TcpRadio("tcp://127.0.0.1:0")
    radio.start(received)
    place = ("127.0.0.1", radio.port)
    with contextlib.closing(radio), contextlib.ExitStack() as stack:
        programs = [stack.enter_context(socket.create_connection(place)) for _ in range(8)]
        programs[0].sendall(b'io -50\n{"peer": "io", "snr_')
        assert received.next() == ("io", dbm(-50.0, "tcp"))
        programs[7].sendall(b"x" * (MAX_LINE_BYTES + 1) + b"\nio -51\n")
        assert received.next() == ("io", dbm(-51.0, "tcp"))
        programs[0].sendall(b'db": 12}\n')
        assert received.next() == ("io", Reading(12.0, Unit.SNR_DB, "tcp"))
        with socket.create_connection(place) as ninth:
            assert ninth.recv(1) == b""
        assert radio.refused == 2  # it, and the line that was too long
        programs[1].setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        programs[1].close()  # a reset
        programs[2].close()
        programs[3].sendall(b"io -52\n")
        assert received.next() == ("io", dbm(-52.0, "tcp"))
        with pytest.raises(RadioError, match="cannot listen"):
            TcpRadio(f"tcp://127.0.0.1:{radio.port}").start(received)
        radio.close()  # while programs are connected
    assert "Traceback" not in caplog.text


def test_programs_that_are_connected_are_probed(received):
    """One that is gone without closing, e.g. out of range, would keep its place for ever."""
    radio = TcpRadio("tcp://127.0.0.1:0")
    radio.start(received)
    with contextlib.closing(radio), socket.create_connection(("127.0.0.1", radio.port)) as program:
        program.sendall(b"io -50\n")
        assert received.next() == ("io", dbm(-50.0, "tcp"))
        rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
        ours = f":{radio.port:04X}", f":{program.getsockname()[1]:04X}"
        (timer,) = [row[5] for row in rows if (row[1][8:], row[2][8:]) == ours]
    kind, hundredths = timer.split(":")
    assert kind == "02"  # keepalive
    assert int(hundredths, 16) <= 15 * 100


def test_lines_on_standard_input(received):
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb") as file, os.fdopen(writer, "wb", buffering=0) as program:
        radio = StdinRadio(file)
        radio.start(received)
        program.write(b"io -50\njunk\nio -5")
        assert received.next() == ("io", dbm(-50.0, "stdin"))
        program.close()
        assert received.next() == ("io", dbm(-5.0, "stdin"))  # its end stands for the line's
        assert radio.refused == 1
        radio.close()
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb") as file, os.fdopen(writer, "wb"):
        radio = StdinRadio(file)
        radio.start(received)
        radio.close()  # while nothing comes
    with pytest.raises(RadioError, match="no standard input"):
        StdinRadio(io.BytesIO()).start(received)


# MAVLink.


def status(rssi, remrssi, kind=mavlink.MAVLink_radio_status_message):
    sender = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    return kind(rssi, remrssi, 90, 30, 31, 2, 0).pack(sender)


def test_radio_status():
    assert parse_radio_status(status(120, 110)) == [Reading(110.0, Unit.DEVICE, "mavlink")]
    assert parse_radio_status(status(120, 255)) == [Reading(120.0, Unit.DEVICE, "mavlink")]
    assert parse_radio_status(status(255, 255)) == [None]
    two = status(7, 9, mavlink.MAVLink_radio_message) + b"\xfe\x09junk"
    assert parse_radio_status(two) == [Reading(7.0, Unit.DEVICE, "mavlink")]
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 0, 3).pack(mavlink.MAVLink(None))
    assert parse_radio_status(heartbeat) == []
    assert parse_radio_status(b"") == []


@given(
    st.binary(max_size=60),
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 255)), max_size=4),
)
def test_any_datagram_is_mavlink_or_a_radio_error(junk, changes):
    raw = bytearray(status(100, 90) + junk)
    for place, value in changes:
        raw[place % len(raw)] = value
    with contextlib.suppress(RadioError):
        parse_radio_status(bytes(raw))


def test_a_mavlink_radio(received):
    radio = MavlinkRadio(RadioUrl.parse("mavlink://127.0.0.1:0?peer=io"), "io")
    assert radio.port == 0
    radio.start(received)
    with contextlib.closing(radio), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in (b"junk", status(120, 110), status(255, 255)):
            sender.sendto(datagram, ("127.0.0.1", radio.port))
        assert received.next() == ("io", Reading(110.0, Unit.DEVICE, "mavlink"))
        assert received.next() == ("io", None)
