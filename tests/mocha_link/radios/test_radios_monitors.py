"""Wi-Fi stations and Rajant radios: from what their tools print to reports."""

import contextlib
import os
import queue
import socket
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading, Unit
from mocha_link.radios.rajant import MAX_PEERS, Monitor, RajantRadio
from mocha_link.radios.wifi import WifiRadio, parse_station_dump
from mocha_link.team.team_file import RadioUrl

DATA = Path(__file__).parents[2] / "data" / "radios"
SAMPLES = {path.name: path.read_text() for path in sorted(DATA.iterdir())}
WAIT_S = 60

A, A2, B = "04:f0:21:38:cf:5b", "04:f0:21:38:86:bd", "04:f0:21:38:d3:22"


def device(value):
    return Reading(float(value), Unit.DEVICE, "rajant")


def reports(text, *, step_s=1.0):
    """The reports in a monitor's output, whose lines come `step_s` apart."""
    monitor = Monitor()
    lines = (monitor.feed(line, index * step_s) for index, line in enumerate(text.splitlines()))
    return [report for report in lines if report]


# Wi-Fi.


def test_stations():
    assert parse_station_dump(SAMPLES["iw_mesh.txt"]) == {
        "02:ca:ff:ee:00:13": Reading(-60.0, Unit.DBM, "wifi"),
        "02:ca:ff:ee:00:14": Reading(-77.0, Unit.DBM, "wifi"),
    }  # the third has not been received for 41 s
    assert parse_station_dump(SAMPLES["iw_old_driver.txt"]) == {
        "02:ca:ff:ee:00:14": Reading(-83.0, Unit.DBM, "wifi")
    }
    assert parse_station_dump(SAMPLES["iw_multi_link.txt"]) == {
        "02:ca:ff:ee:00:13": Reading(-48.0, Unit.DBM, "wifi")
    }


def test_no_stations():
    for text in ("", "command failed: No such device (-19)\n", "\tsignal: -50 dBm\n"):
        assert parse_station_dump(text) == {}
    nowhere = "Station 02:ca:ff:ee:00:14 (on wlan0)\n\tsignal: -9999 dBm\n"
    assert parse_station_dump(nowhere) == {}


@pytest.fixture
def seen():
    return queue.SimpleQueue()


@pytest.fixture
def start(seen):
    """Starts a radio, whose reports are then `seen`; it ends with the test."""
    with contextlib.ExitStack() as stack:

        def start(radio):
            stack.callback(radio.close)
            radio.start(lambda peer, reading: seen.put((peer, reading)))

        yield start


def fake_iw(tmp_path, *answers):
    """A program in place of `iw` that gives one answer after the other, the last for ever."""
    folder = tmp_path / "answers"
    folder.mkdir()
    for index, answer in enumerate(answers):
        (folder / f"{index}").write_text(answer)
    program = tmp_path / "iw.py"
    program.write_text(
        "import pathlib, sys\n"
        "assert sys.argv[1:] == ['dev', 'wlan0', 'station', 'dump'], sys.argv\n"
        f"files = sorted(pathlib.Path({str(folder)!r}).iterdir())\n"
        "print(files[0].read_text())\n"
        "len(files) > 1 and files[0].unlink()\n"
    )
    return (sys.executable, str(program))


def test_a_wifi_radio(tmp_path, seen, start):
    command = fake_iw(tmp_path, SAMPLES["iw_mesh.txt"], SAMPLES["iw_old_driver.txt"])
    peers = {"02:ca:ff:ee:00:13": "titan", "02:ca:ff:ee:00:14": "io", "02:ca:ff:ee:00:15": "io"}
    radio = WifiRadio(RadioUrl.parse("wifi://wlan0"), peers, poll_s=0.01, command=command)
    start(radio)
    assert seen.get(timeout=WAIT_S) == ("titan", Reading(-60.0, Unit.DBM, "wifi"))
    assert seen.get(timeout=WAIT_S) == ("io", Reading(-77.0, Unit.DBM, "wifi"))
    assert seen.get(timeout=WAIT_S) == ("titan", None)
    assert seen.get(timeout=WAIT_S) == ("io", Reading(-83.0, Unit.DBM, "wifi"))


def test_an_interface_that_comes_up_late(tmp_path, seen, start):
    program = tmp_path / "iw.py"
    program.write_text("import sys; sys.exit('command failed: No such device (-19)')")
    radio = WifiRadio(
        RadioUrl.parse("wifi://wlan0"),
        {"02:ca:ff:ee:00:14": "io"},
        poll_s=0.01,
        command=(sys.executable, str(program)),
    )
    start(radio)
    program.write_text(f"print({SAMPLES['iw_old_driver.txt']!r})")
    assert seen.get(timeout=WAIT_S) == ("io", Reading(-83.0, Unit.DBM, "wifi"))


def test_an_iw_that_hangs_does_not_hold_up_the_end(tmp_path, start):
    flag = tmp_path / "runs"
    program = tmp_path / "iw.py"
    program.write_text(
        f"import pathlib, time; pathlib.Path({str(flag)!r}).touch(); time.sleep(600)"
    )
    radio = WifiRadio(RadioUrl.parse("wifi://wlan0"), {}, command=(sys.executable, str(program)))
    start(radio)
    while not flag.exists():
        pass
    radio.close()


def test_no_iw(start):
    radio = WifiRadio(RadioUrl.parse("wifi://wlan0"), {}, command=("no-such-program",))
    with pytest.raises(RadioError, match="no program no-such-program; install it"):
        start(radio)


# Rajant.


def test_lines_of_the_monitor():
    ips = "10.229.221.1", "10.229.222.1"
    assert reports(SAMPLES["rajant_lines.txt"]) == [
        {ips[0]: device(55)},  # the better of two interfaces
        {ips[0]: device(55), ips[1]: device(18)},
        {ips[0]: device(53), ips[1]: device(21)},
    ]


def test_protobuf_text_of_the_monitor():
    assert reports(SAMPLES["rajant_protobuf.txt"], step_s=0.01) == [
        {A: device(47), "10.229.221.1": device(47), A2: device(55)},
        {A: device(47), B: device(18)},  # A is there, and its strength has not changed
        {A: device(47), B: None},
    ]


def test_a_strength_that_is_not_repeated_stands_for_20_s():
    first, second, third = reports(SAMPLES["rajant_protobuf.txt"], step_s=0.55)
    assert (first[A], second[A]) == (device(47), device(47))
    assert third[A] is None


def test_what_the_ros_1_branch_publishes():
    assert reports(SAMPLES["rajant_published.txt"]) == [
        {A: device(47), A2: device(52)},
        {A: device(47), A2: device(51)},
    ]


def test_a_report_that_was_cut_off_spoils_only_itself():
    text = SAMPLES["rajant_protobuf.txt"]
    whole = reports(text, step_s=0)
    cut = text[: text.index("ipv4Address")]
    assert reports(cut + "\n" + text, step_s=0) == whole
    noise = '12:00:01 [main] INFO session {} opened: "x\n'
    assert reports(text.replace("      peer {", noise + "      peer {"), step_s=0) == whole


def test_the_monitor_lost_its_radio():
    with pytest.raises(RadioError, match="has lost its radio"):
        Monitor().feed("ERR\n", 0)


def test_what_a_monitor_may_remember_is_bounded():
    monitor = Monitor()
    for number in range(3 * MAX_PEERS):
        monitor.feed(f"Ts:1,Iface:wlan0,Peer:p{number},RSSI:3;", 0)
    assert len(monitor.feed("END,1;", 0)) == MAX_PEERS
    for _ in range(1000):
        monitor.feed("x {" * 10, 0)
    assert monitor.feed(SAMPLES["rajant_lines.txt"].splitlines()[1], 0) == {}


def mutated(text):
    """A sample with some of its text replaced."""
    return st.lists(
        st.tuples(st.integers(0, len(text)), st.integers(0, 30), st.text(max_size=6)), max_size=6
    ).map(lambda cuts: _cut(text, cuts))


def _cut(text, cuts):
    for place, length, other in cuts:
        text = text[:place] + other + text[place + length :]
    return text


@given(st.sampled_from(sorted(SAMPLES)).flatmap(lambda name: mutated(SAMPLES[name])))
def test_any_text_is_readings_or_a_radio_error(text):
    parse_station_dump(text)
    with contextlib.suppress(RadioError):
        for found in reports(text):
            assert all(value is None or value.unit is Unit.DEVICE for value in found.values())


@pytest.mark.parametrize("text", ['"\\' * 20_000, "'" * 60_000, "{" * 60_000, "a" * 60_000])
def test_no_text_takes_long(text):
    Monitor().feed(text, 0)


@pytest.mark.parametrize(
    "text", [" signal: -5 [" + "1" * 60_000, "\n" * 10**6, "signal:\n" * 10**5, " " * 10**6]
)
def test_no_dump_takes_long(text):
    assert parse_station_dump("Station 02:ca:ff:ee:00:14 (on w)\n" + text) == {}


def test_a_monitor_elsewhere(seen, start):
    with socket.create_server(("127.0.0.1", 0)) as monitor:
        port = monitor.getsockname()[1]
        radio = RajantRadio(
            RadioUrl.parse(f"rajant://127.0.0.1:{port}"),
            {"10.229.221.1": "io", "10.229.222.1": "titan", A: "io", A2: "io"},
            retry_s=0.01,
        )
        start(radio)
        with monitor.accept()[0] as connection:
            connection.sendall(SAMPLES["rajant_lines.txt"][:300].encode())
            assert seen.get(timeout=WAIT_S) == ("io", device(55))
        with monitor.accept()[0] as connection:  # it begins anew
            connection.sendall(SAMPLES["rajant_protobuf.txt"].encode())
            assert seen.get(timeout=WAIT_S) == ("io", device(55))
            connection.sendall(b"ERR\n")
        with monitor.accept()[0]:
            pass


def test_a_monitor_that_has_become_silent_is_queried_anew(seen, start):
    """Its machine has lost power: no end of the connection comes."""
    with socket.create_server(("127.0.0.1", 0)) as monitor:
        url = RadioUrl.parse(f"rajant://127.0.0.1:{monitor.getsockname()[1]}")
        start(RajantRadio(url, {"10.229.221.1": "io"}, retry_s=0.01, silent_s=0.2))
        with monitor.accept()[0]:
            monitor.settimeout(WAIT_S)
            with monitor.accept()[0] as connection:
                connection.sendall(SAMPLES["rajant_lines.txt"][:300].encode())
                assert seen.get(timeout=WAIT_S) == ("io", device(55))


def test_a_monitor_that_is_not_there_yet(seen, start):
    host = f"127.77.{os.getpid() // 254 % 254 + 1}.{os.getpid() % 254 + 1}"  # of no other test
    with socket.create_server((host, 0)) as monitor:
        port = monitor.getsockname()[1]
    radio = RajantRadio(
        RadioUrl.parse(f"rajant://{host}:{port}"), {"10.229.221.1": "io"}, retry_s=0.01
    )
    start(radio)
    with socket.create_server((host, port)) as monitor, monitor.accept()[0] as connection:
        connection.sendall(SAMPLES["rajant_lines.txt"].encode())
        assert seen.get(timeout=WAIT_S) == ("io", device(55))


def test_a_monitor_that_is_started_here(tmp_path, seen, start):
    jar = tmp_path / "monitor.jar"
    jar.write_text(
        "import sys, time\n"
        "assert sys.argv[1] == '10.229.221.1'\n"
        f"print({SAMPLES['rajant_lines.txt']!r}, flush=True)\n"
        "time.sleep(600)\n"
    )
    radio = RajantRadio(
        RadioUrl.parse(f"rajant://10.229.221.1?jar={jar}"),
        {"10.229.221.1": "io"},
        command=(sys.executable,),
    )
    start(radio)
    assert seen.get(timeout=WAIT_S) == ("io", device(55))


def test_a_monitor_without_its_program(tmp_path, start):
    url = RadioUrl.parse(f"rajant://10.229.221.1?jar={tmp_path}/none.jar")
    with pytest.raises(RadioError, match=r"no Rajant monitor at .*none\.jar"):
        start(RajantRadio(url, {}))
