"""Strangers at every door of a flight: a web page, a socket, datagrams, a robot that went mad.

None of them moves the vehicle or ends the flight, and the operator goes on as if nothing were.
"""

import contextlib
import json
import re
import socket
import threading

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.control.control import ControlClient, ControlError
from air_router.mission.loading import load_mission
from air_router.sim.ports import free_port
from air_router.web.serving import SHOWN_AT, PageAddress
from geo.frame import Point
from mocha_link import ManualRadio, Node, Team
from mocha_link.links.metrics import Direction, SyncEnded
from tests.stray_post import SIZE, body, post

pytestmark = pytest.mark.xdist_group("flights 2")

HOME = b'{"request":"home"}'
POSITION_MODE, RETURN_MODE = 3 << 16, 0x05040000
POST = """async ([url, bytes]) => {
  const body = new Uint8Array(bytes);
  await fetch(url, {method: 'POST', mode: 'no-cors', body}).catch(() => 0);
}"""
SOCKET = """(url) => new Promise((done) => {
  const socket = new WebSocket(url);
  socket.onopen = () => done('open');
  socket.onerror = () => done('refused');
})"""


class Answerer:
    """A web server that sends the same to all; `heads` is what browsers began with."""

    def __init__(self):
        self.heads = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                head = b""
                with connection:
                    while b"\r\n\r\n" not in head and (piece := connection.recv(65536)):
                        head += piece
                    self.heads.append(head.partition(b"\r\n\r\n")[0] + b"\r\n\r\n")
                    connection.sendall(
                        b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 4\r\n"
                        b"Connection: close\r\n\r\npage"
                    )

    def close(self):
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()


def visit_a_bad_page(browser, control, live):
    """A page that the operator has open beside ours requests the flight to come home."""
    with contextlib.closing(Answerer()) as site, contextlib.closing(Answerer()) as other:
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{site.port}/")
        page.evaluate(POST, [f"http://127.0.0.1:{other.port}/x", list(bytes(SIZE))])
        (head,) = other.heads  # as the next one will be, but for the port
        head = head.replace(str(other.port).encode(), str(control).encode())
        page.evaluate(POST, [f"http://127.0.0.1:{control}/x", list(body(head, HOME))])
        assert page.evaluate(SOCKET, live.socket.replace("http:", "ws:")) == "refused"
        page.evaluate(POST, [live.socket, list(HOME)])
        page.close()


def post_without_a_browser(control):
    with socket.create_connection(("127.0.0.1", control)) as intruder:
        intruder.sendall(post(control, HOME))
        with contextlib.suppress(ConnectionError):
            while intruder.recv(4096):
                pass


def pretend_to_be_the_vehicle(port):
    """Datagrams of its system id: restarted, taken by the pilot, disarmed, far away, empty."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    here, away = (399410000, -751990000), (500000000, 80000000)
    messages = [
        mavlink.MAVLink_heartbeat_message(2, 12, 129, POSITION_MODE, 4, 3),
        mavlink.MAVLink_heartbeat_message(2, 12, 129, RETURN_MODE, 5, 3),
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3),
        mavlink.MAVLink_global_position_int_message(5, *here, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_global_position_int_message(2**32 - 1, *here, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_global_position_int_message(5, *away, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_extended_sys_state_message(0, 1),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_mission_current_message(9),
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as intruder:
        for message in messages * 20:
            intruder.sendto(message.pack(link), ("127.0.0.1", port))
        intruder.sendto(b"\xfd" * 700, ("127.0.0.1", port))


def go_mad(team):
    """A robot of the team publishes nonsense, each piece until the UAV has fetched it."""
    fetched = threading.Semaphore(0)

    def look(event):
        if isinstance(event, SyncEnded) and event.direction is Direction.OUT and event.messages:
            fetched.release()

    place = {"latitude_deg": 39.94, "longitude_deg": -75.2}
    nonsense = [
        json.dumps({"stamp_s": 9.9e10, **place}),
        '{"stamp_s": NaN, "latitude_deg": NaN, "longitude_deg": NaN}',
        json.dumps({"stamp_s": 1.0, "latitude_deg": -80.0, "longitude_deg": 170.0}),
        json.dumps({"stamp_s": -1e308, **place}),
        '{"points": ' + "[" * 5000,
        "\x00\x1b[2J",
    ]
    radio = ManualRadio()
    (host, _, port) = team.robot("titan").radio.removeprefix("udp://").rpartition(":")
    report = json.dumps({"peer": "io", "rssi_dbm": -40.0}).encode()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        for text in nonsense:  # a node of its own for each, since what is pushed ends no sync
            with Node(team, "io", radio=radio) as node:
                node.subscribe(look)
                for topic in team.topics_of("io"):
                    node.publish(topic.name, text.encode(), now=True)
                for _ in range(240):
                    radio.report("titan", -40.0)
                    reader.sendto(report, (host, int(port)))
                    if fetched.acquire(timeout=0.5):
                        break
                else:
                    pytest.fail("the UAV did not fetch what the mad robot publishes")


def without_relays(path):
    """The team of a simulation, whose robots reach each other directly."""
    team = Team.load(path)
    team = team.with_robots({r.name: {"address": r.listen} for r in team.robots.values()})
    path.write_text(team.dump(), encoding="utf-8")
    return Team.load(path)


def test_intruders_move_nothing_and_end_nothing(vehicle, command, short_mission, udp_port, browser):
    team = without_relays(short_mission.parent / "team.yaml")
    vehicle(speed=6)
    control = free_port(socket.SOCK_STREAM)
    flight = command(
        *("air-router", "fly", short_mission, "--arm", "--yes", "--json"),
        *(f"--connect=udpin://127.0.0.1:{udp_port}", "--web", "0", "--control", control),
    )
    flight.wait_for("INIT -> ")
    (shown,) = re.findall(rf"{SHOWN_AT}(\S+)", flight.printed)
    endpoint = f"tcp://127.0.0.1:{control}"
    for intrude in (
        lambda: visit_a_bad_page(browser, control, PageAddress.of(shown)),
        lambda: post_without_a_browser(control),
        lambda: pretend_to_be_the_vehicle(udp_port),
        lambda: go_mad(team),
    ):
        intrude()
        flight.read()
        assert ": accepted: " not in flight.printed
        assert flight.process.poll() is None, flight.printed[-3000:]
    with ControlClient(endpoint, by="the operator", timeout_s=60) as uav:
        now = uav.status()
        assert now["in_charge"]
        assert now["in_air"]
        assert now["state"] not in {"HOME", "PASSIVE", "DONE", "HOLD", "LANDING"}
        mission = load_mission(short_mission)
        inside = Point(*mission.zones[0].polygon.centroid.coords[0])
        beside = uav.goto([mission.frame.to_geodetic(inside)], hold_s=1)
        refused = uav.goto([mission.frame.to_geodetic(Point(0.0, 5000.0))])
        with pytest.raises(ControlError, match="no request 'dance'"):
            uav.request({"request": "dance"})
        flight.wait_for("GOTO -> EXPL")
        assert uav.home().accepted
    assert beside.accepted, beside
    hover = mission.frame.to_local(*beside.points[0])
    assert mission.planning_airspace.with_margin(-0.01).point_clear(hover)
    assert "it is inside no-fly zone" in beside.why
    assert (refused.accepted, refused.code) == (False, "outside-fence")
    code, out = flight.finish()
    report = json.loads(out)
    assert (code, report["outcome"]) == (0, "done"), flight.printed[-3000:]
    assert {"INIT", "GOTO", "EXPL", "HOME"} <= set(report["states_visited"])
    assert flight.printed.count("the operator: accepted: ") == 2, flight.printed[-3000:]
    assert flight.printed.count(": accepted: ") == 2, flight.printed[-3000:]
    assert "the operator: refused: the point lies outside the fence" in flight.printed
    assert "which is not the vehicle's address" in flight.printed
    assert report["closest_approach_m"] >= 5.0
    assert "Traceback" not in flight.printed
