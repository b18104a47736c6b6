"""A flight on ROS 2, as a ROS program meets it: a DDS participant with types of its own."""

import asyncio
import dataclasses
import json
import math
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from types import new_class

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")
pytest.importorskip("cyclonedds", reason="CycloneDDS has no wheel for this machine")

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from air_router.control.command_request import command_request_of
from air_router.control.control import ControlClient, ControlError, ControlUnreachableError
from air_router.control.control_server import ControlServer
from air_router.controller.model.requests import ExploreNow
from air_router.controller.model.states import State
from air_router.flight.flight_loop import CommandService
from air_router.flight.flight_stats import FlightStats
from air_router.flight.flight_view import FlightView
from air_router.gossip.mapper import Mapper
from air_router.ros2.bridge import AnotherVehicleError, Ros2Bridge
from air_router.ros2.messages import TOPICS, Scene
from air_router.ros2.ros_graph import RosGraph
from air_router.ros2.sampler import MAP_POLLS
from geo.frame import Point
from geo.grid import GridPatch, Terrain
from mocha_link.bridges.dds import DdsTypes
from mocha_link.errors import RequestError
from mocha_link.links.metrics import LinkMetrics
from mocha_link.links.reading import Reading, Unit
from mocha_link.ros.ros import RosCodec
from tests.loopback_dds import taken

ROBOTS = {"io": Point(64.0, 0.0)}
NEAR, OUTSIDE = Point(75.0, -150.0), Point(0.0, 5000.0)
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
LASTING = Policy.Durability.TransientLocal
STANDARD, CODEC = DdsTypes({}), RosCodec()


class FakeClient(ControlClient):
    """Asks a pretended flight in this thread."""

    def __init__(self, flight):
        self.flight, self.gone = flight, False
        self.mapper = Mapper(flight.mission)
        stats = FlightStats.of(flight.mission, self.mapper, ROBOTS)
        view = FlightView(flight.mission, self.status, lambda: flight.controller.router, stats)
        self.commands = CommandService(
            flight.mission.frame, self.status, flight.deliver, view=view.fields_for
        )
        self.stats, self.taken, self._by = stats, 0, "ROS 2"

    def status(self):
        rajant = Reading(31, Unit.DEVICE, "rajant")
        links = {"io": LinkMetrics("io", signal=rajant), "europa": LinkMetrics("europa")}
        return dataclasses.replace(self.flight.controller.status(), links=links)

    def request(self, values):
        if self.gone:
            raise ControlUnreachableError("no answer")
        self.stats.step(None, self.flight.actions[self.taken :], 0.0)
        self.taken = len(self.flight.actions)
        fields = {key: value for key, value in values.items() if value is not None}
        try:
            return json.loads(
                json.dumps(self.commands.execute(command_request_of(fields), "a test"))
            )
        except RequestError as error:
            raise ControlError(str(error)) from None


# What a ROS program that was built with our package has, as rmw_cyclonedds serializes it.


def idl(name, **fields):
    """A dataclass of CycloneDDS's for a type of ROS, e.g. ``std_msgs.msg.String``."""
    space, _, kind = name.rpartition(".")
    typename = {"typename": f"{space}.dds_.{kind}_"}
    made = new_class(kind, (IdlStruct,), typename, lambda body: body.update(__annotations__=fields))
    return dataclass(made)


ASKED = {"client": types.uint64, "number": types.int64}
TriggerRequest = idl("std_srvs.srv.Trigger_Request", **ASKED, nothing=types.uint8)
TriggerResponse = idl("std_srvs.srv.Trigger_Response", **ASKED, success=bool, message=str)
String = idl("std_msgs.msg.String", data=str)
Uuid = idl("unique_identifier_msgs.msg.UUID", uuid=types.array[types.uint8, 16])
Time = idl("builtin_interfaces.msg.Time", sec=types.int32, nanosec=types.uint32)
GoalInfo = idl("action_msgs.msg.GoalInfo", goal_id=Uuid, stamp=Time)
GoalStatus = idl("action_msgs.msg.GoalStatus", goal_info=GoalInfo, status=types.int8)
GoalStatusArray = idl("action_msgs.msg.GoalStatusArray", status_list=types.sequence[GoalStatus])
CancelRequest = idl("action_msgs.srv.CancelGoal_Request", **ASKED, goal_info=GoalInfo)
CancelResponse = idl(
    "action_msgs.srv.CancelGoal_Response",
    **ASKED,
    return_code=types.int8,
    goals_canceling=types.sequence[GoalInfo],
)
GeoPoint = idl(
    "geographic_msgs.msg.GeoPoint",
    **dict.fromkeys(("latitude", "longitude", "altitude"), types.float64),
)
AltitudeRequest = idl("air_router_msgs.srv.Altitude_Request", **ASKED, altitude_m=types.float64)
AltitudeResponse = idl(
    "air_router_msgs.srv.Altitude_Response", **ASKED, success=bool, message=str, code=str
)
OURS = "air_router_msgs.action"
GoToGoal = idl(f"{OURS}.GoTo_Goal", points=types.sequence[GeoPoint], hold_s=types.float64)
GoToRequest = idl(f"{OURS}.GoTo_SendGoal_Request", **ASKED, goal_id=Uuid, goal=GoToGoal)
GoToResponse = idl(f"{OURS}.GoTo_SendGoal_Response", **ASKED, accepted=bool, stamp=Time)
ResultRequest = idl(f"{OURS}.GoTo_GetResult_Request", **ASKED, goal_id=Uuid)
Result = idl(f"{OURS}.GoTo_Result", message=str, code=str)
ResultResponse = idl(f"{OURS}.GoTo_GetResult_Response", **ASKED, status=types.int8, result=Result)
Feedback = idl(
    f"{OURS}.GoTo_Feedback",
    state=str,
    points_left=types.uint32,
    distance_m=types.float32,
    time_left_s=types.float32,
)
FeedbackMessage = idl(f"{OURS}.GoTo_FeedbackMessage", goal_id=Uuid, feedback=Feedback)


class RosProgram:
    """Another program in the domain; `serve` lets the bridge take one request."""

    def __init__(self, domain, serve):
        self.participant, self.serve = DomainParticipant(domain), serve
        self._number = 0

    def reader(self, topic, kind, *policies):
        made = Topic(self.participant, topic, kind)
        depth = Policy.History.KeepLast(10)
        return DataReader(self.participant, made, qos=Qos(RELIABLE, depth, *policies))

    def standard(self, topic):
        """The newest message of a standard type, also one that was there before."""
        kind = TOPICS[topic]
        name = f"rt{topic.replace('~', '/titan')}"
        data = taken(self.reader(name, STANDARD.of(kind), LASTING)).data
        return CODEC.decode(kind, data, 2)

    def client(self, service, request, response):
        """Calls a service: what is answered on its own number."""
        topic = Topic(self.participant, f"rq{service}Request", request)
        answers = self.reader(f"rr{service}Reply", response)
        writer = DataWriter(self.participant, topic, qos=Qos(RELIABLE))
        while not (writer.get_matched_subscriptions() and answers.get_matched_publications()):
            pass

        def call(*fields, later=False):
            self._number += 1
            writer.write(request(77, self._number, *fields))
            self.serve()
            return answers if later else self.answer(answers)

        return call

    def answer(self, answers):
        sample = taken(answers)
        assert (sample.client, sample.number) == (77, self._number)
        return sample


@pytest.fixture
def client(pretend):
    flight = pretend()
    flight.robots = dict(ROBOTS)
    flight.take_off()
    return FakeClient(flight)


@pytest.fixture
def bridge(client, domain):
    graph = RosGraph(domain)
    bridge = Ros2Bridge(client, graph, requests=True, say=lambda _: None, unix_s=lambda: 1.75e9)
    bridge.poll()
    yield bridge
    graph.close()


@pytest.fixture
def program(bridge, domain):
    def serve():
        job = bridge._jobs.get(timeout=60)
        job()

    return RosProgram(domain, serve)


def test_the_flight_in_standard_messages(client, bridge, program):
    flight = client.flight
    grid = client.mapper.grid
    cells = np.full((1, 2), Terrain.BUILDING, dtype=np.uint8)
    cells[0, 1] = Terrain.ROAD
    client.mapper.paint(GridPatch(grid.west_m + 3, grid.south_m + 2, 1.0, cells).encode())
    flight.fly_until(lambda: client.request({"request": "view"})["robots"])
    for _ in range(MAP_POLLS):
        bridge.poll()
    at = pytest.approx((*flight.position, flight.altitude_m), abs=0.02)
    pose = program.standard("~/pose")
    place = pose.pose.position
    assert ((place.x, place.y, place.z), pose.header.frame_id) == (at, "map")
    (turn,) = program.standard("/tf").transforms
    assert (turn.transform.translation.x, turn.child_frame_id) == (place.x, "titan/base_link")
    fix = program.standard("~/fix")
    assert client.flight.mission.frame.to_local(fix.latitude, fix.longitude) == pytest.approx(
        flight.position, abs=0.02
    )
    assert fix.header.stamp.sec == 1_750_000_000
    assert math.isnan(fix.altitude)
    assert program.standard("~/state").data == flight.controller.state.name
    assert program.standard("~/battery").percentage == 1.0
    chart = program.standard("~/map")
    assert (chart.info.height, chart.info.width) == grid.cells.shape
    assert chart.info.origin.position.x == grid.west_m
    row = 2 * chart.info.width
    assert [*chart.data[row + 2 : row + 6]] == [-1, 100, 0, -1]
    names = {marker.ns for marker in program.standard("~/areas").markers}
    assert {"fence", *(zone.name for zone in flight.mission.zones)} <= names
    team = program.standard("~/team").markers
    (io,) = (marker for marker in team if marker.ns == "robot")
    assert (io.pose.position.x, io.pose.position.y) == pytest.approx(ROBOTS["io"], abs=0.02)
    assert any(marker.ns == "link" and len(marker.points) == 2 for marker in team)
    statuses = {status.name: status for status in program.standard("/diagnostics").status}
    assert statuses["titan: link io"].message == "31 device"
    assert statuses["titan: link europa"].level == 3
    assert statuses["titan: mission"].level == 0


def test_diagnostics_have_what_keeps_the_mission_waiting(client):
    client.flight.take_off()
    client.flight.fix = False
    client.flight.fly_for(3.0)
    view = client.request({"request": "view"})
    _, message = Scene("titan", view["origin"]).diagnostics(view, 0.0)
    (mission, *_) = message["status"]
    assert mission["level"] == 1
    assert mission["message"].endswith("waiting: GPS has no fix")
    assert {"key": "waiting", "value": "INPUT_MISSING"} in mission["values"]


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0.0, 90), (90.0, 0), (180, -90), (None, 0)])
def test_where_it_looks(client, heading_deg, yaw_deg):
    client.flight.take_off()
    view = client.request({"request": "view"}) | {"heading_deg": heading_deg}
    scene = Scene("titan", view["origin"])
    turn = dict(scene.vehicle(view, 0.0))["~/pose"]["pose"]["orientation"]
    assert math.degrees(2 * math.atan2(turn["z"], turn["w"])) == pytest.approx(yaw_deg)


def test_services_reply_with_the_flights_text(client, program):
    call = {
        verb: program.client(f"/titan/{verb}", TriggerRequest, TriggerResponse)
        for verb in ("hold", "resume", "home", "land")
    }
    answer = call["resume"](0)
    assert (answer.success, answer.message) == (False, client.resume().why)
    answer = call["hold"](0)
    assert (answer.success, answer.message) == (True, "it stops and hovers")
    assert client.flight.controller.state is State.HOLD
    climb = program.client("/titan/altitude", AltitudeRequest, AltitudeResponse)
    assert climb(client.flight.altitude_m).success
    assert (climb(1.0).success, climb(1.0).code) == (False, "altitude")
    assert not climb(math.nan).success
    assert call["home"](0).success
    assert call["land"](0).message == client.land().why
    client.gone = True
    answer = call["hold"](0)
    assert (answer.success, answer.message) == (False, "no answer")


def test_text_requests_are_answered_to_programs_of_any_middleware(client, program):
    answers = program.reader("rt/titan/answer", String)
    requests = DataWriter(
        program.participant, Topic(program.participant, "rt/titan/ask", String), qos=Qos(RELIABLE)
    )
    while not (requests.get_matched_subscriptions() and answers.get_matched_publications()):
        pass

    def reply_to(text):
        requests.write(String(text))
        program.serve()
        return json.loads(taken(answers).data)

    assert reply_to("seek phantom")["code"] == "unknown-robot"
    assert reply_to("hold")["accepted"]
    assert reply_to("goto nowhere") == {
        "accepted": False,
        "why": "goto where? type 'goto LAT,LON', more places behind it, in degrees",
    }
    assert client.flight.controller.state is State.HOLD


ACTION = "/titan/goto/_action"


class GoTo:
    """The client of the action."""

    def __init__(self, program, frame):
        self.program, self.frame = program, frame
        self.send = program.client(f"{ACTION}/send_goal", GoToRequest, GoToResponse)
        self.result = program.client(f"{ACTION}/get_result", ResultRequest, ResultResponse)
        self.cancel = program.client(f"{ACTION}/cancel_goal", CancelRequest, CancelResponse)
        self.feedback = program.reader(f"rt{ACTION}/feedback", FeedbackMessage)

    def go(self, goal_id, *places, hold_s=2.0):
        points = [GeoPoint(*self.frame.to_geodetic(place), 0.0) for place in places]
        answer = self.send(goal_id, GoToGoal(points, hold_s))
        return answer.accepted

    def ended(self, goal_id):
        answer = self.result(goal_id)
        return answer.status, answer.result.message, answer.result.code

    def statuses(self):
        """As one sees them who comes now."""
        newest = self.program.reader(f"rt{ACTION}/status", GoalStatusArray, LASTING)
        return [goal.status for goal in taken(newest).status_list]


@pytest.fixture
def goto(program, client):
    return GoTo(program, client.flight.mission.frame)


def test_a_goal_is_flown_to_and_its_result_waited_for(client, bridge, program, goto):
    flight, goal_id = client.flight, Uuid(bytes([1] * 16))
    assert goto.go(goal_id, NEAR)
    assert not goto.go(goal_id, NEAR)  # the same once more
    assert flight.controller.state is State.GOTO
    results = goto.result(goal_id, later=True)
    for _ in range(5):
        bridge.poll()
    update = taken(goto.feedback)
    feedback = update.feedback
    assert (update.goal_id, feedback.state, feedback.points_left) == (goal_id, "GOTO", 1)
    assert feedback.distance_m == pytest.approx(math.dist(flight.position, NEAR), abs=0.1)
    assert goto.statuses() == [2]
    flight.fly_until(lambda: flight.controller.state is not State.GOTO)
    bridge.poll()
    answer = program.answer(results)
    message = "it flies to the point; it was at the last point"
    assert (answer.status, answer.result.message) == (4, message)
    assert goto.statuses() == [4]
    assert math.dist(flight.position, NEAR) < 5.0


def test_a_refusal_a_cancelled_goal_and_one_that_another_request_ends(client, bridge, goto):
    flight = client.flight
    one, two, three, four = (Uuid(bytes([number] * 16)) for number in (1, 2, 3, 4))
    assert goto.go(one, NEAR, OUTSIDE)
    why = "point 2 lies outside the fence"
    assert goto.ended(one) == (6, why, "outside-fence")
    latitude, longitude = flight.mission.frame.to_geodetic(NEAR)
    assert goto.send(two, GoToGoal([GeoPoint(latitude, longitude, 30.0)], 0.0)).accepted
    assert goto.ended(two)[0] == 6
    assert goto.go(three, NEAR)
    answer = goto.cancel(GoalInfo(three, Time(0, 0)))
    assert (answer.return_code, [info.goal_id for info in answer.goals_canceling]) == (0, [three])
    assert flight.controller.state is State.HOLD
    assert goto.ended(three) == (5, "it flies to the point; it stops and hovers", "")
    assert goto.cancel(GoalInfo(three, Time(0, 0))).return_code == 3
    assert goto.go(four, NEAR)
    flight.operator_requests(ExploreNow())
    bridge.poll()
    assert goto.ended(four) == (
        6,
        "it flies to the point; GOTO -> EXPL: exploration was requested",
        "",
    )
    assert goto.ended(Uuid(bytes([9] * 16)))[0] == 0


def test_the_command_beside_a_flight(client, domain):
    """Over the flight's own endpoint, until a signal ends it."""
    server = ControlServer("tcp://127.0.0.1:*", client.commands.execute)
    opened, loop = threading.Event(), asyncio.new_event_loop()

    async def serve():
        server.open()
        opened.set()
        await server.run()

    serving = loop.create_task(serve())
    thread = threading.Thread(target=lambda: loop.run_until_complete(asyncio.wait([serving])))
    thread.start()
    assert opened.wait(60)
    command = [sys.executable, "-m", "air_router", "ros2", server.endpoint]
    with subprocess.Popen(
        [*command, "--domain", str(domain)], stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert "ready: /titan is on ROS 2" in process.stderr.readline()
            program = RosProgram(domain, None)
            assert program.standard("~/state").data == client.flight.controller.state.name
        finally:
            process.send_signal(signal.SIGTERM)
            loop.call_soon_threadsafe(serving.cancel)
            thread.join()
            server.close()
            loop.close()
        assert process.wait(60) == 0


class Silent:
    """A graph that only notes."""

    def __init__(self):
        self.served, self.published = [], {}

    def advertise(self, topic, kind, depth=1, *, lasting=True):
        self.published.setdefault(topic, None)

    def publish(self, topic, kind, values):
        self.published[topic] = values

    def serve(self, service, kind, take):
        self.served.append(service)

    def subscribe(self, topic, kind, take):
        self.served.append(topic)


def test_nothing_is_served_unless_it_is_requested(client):
    graph = Silent()
    Ros2Bridge(client, graph, requests=False, say=lambda _: None).poll()
    assert graph.served == []
    assert not any("_action" in topic for topic in graph.published)


def test_a_flight_that_is_gone_is_printed_once_and_found_again(client):
    graph, printed = Silent(), []
    bridge = Ros2Bridge(client, graph, requests=True, say=printed.append)
    client.gone = True
    bridge.poll()
    assert graph.published == {}
    client.gone = False
    bridge.poll()
    goal = bridge._actions["goto"].goals.begin("id", 0.0, 0)
    client.gone = True
    bridge.poll()
    bridge.poll()
    assert graph.published["/diagnostics"]["status"][0]["level"] == 3
    client.gone = False
    bridge._view["changes"] = [{"number": 99}]  # as of a flight that had come farther
    graph.published["/titan/areas"] = None
    for _ in range(5):
        bridge.poll()
    assert printed == [
        "waiting for the flight: no answer",
        "ready: /titan is on ROS 2",
        "waiting for the flight: no answer",
        "the flight answers again",
    ]
    assert goal.message == "that flight has ended"
    assert graph.published["/titan/areas"] is not None
    bridge._name = "io"
    with pytest.raises(AnotherVehicleError, match="titan flies there now, not io"):
        bridge.poll()
