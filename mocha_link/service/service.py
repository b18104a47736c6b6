"""A node's messages for programs on the same machine, over ZeroMQ: a verb for each request.

`publish` has a frame with the data; a reply has a frame of data for every message in it. Programs
that do not want bytes send and get JSON values in their place. docs/ros.md describes them. A
program that reaches the endpoint may publish in the robot's name: keep it on this machine.
"""

from __future__ import annotations

import base64
import json
import logging
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from mocha_link.errors import MochaLinkError, RequestError
from mocha_link.links import LinkEvent, MessageStored
from mocha_link.node import IDLE_MS, Node, NodeClosedError
from mocha_link.ros import Typed, TypedError
from mocha_link.service import requests
from mocha_link.service.listener import Listener
from mocha_link.service.requests import Frames, Request, Response, Verb
from mocha_link.service.server import EndpointServer, snapshot
from mocha_link.service.service_client import TEXT
from mocha_link.store import MAX_BYTES, Message
from mocha_link.team import Ros

MAX_HEADER_BYTES = 8 * 1024 * 1024  # of the JSON object of a request
MAX_FRAMES = 8
MAX_HELD = 4  # times the largest request and reply: the memory for all clients together
MAX_WAITING = 256  # requests that wait for a message
BATCH_BYTES = 8 * 1024 * 1024  # of data, after which a reply is full
STEP = 32  # messages that are unpacked at once; they may be large
KEPT_KEYS = 4096  # of publish requests, so that one that is repeated is done once

LOG = logging.getLogger("mocha_link")

Send = Callable[[Frames], None]


class _List(Request):
    robot: str | None = None


class _Read(Request):
    ros: Ros | None = None  # data as this ROS serializes them; None: as their maker did
    # their values in place of data; `json` itself is a name of pydantic's
    as_json: Annotated[bool, Field(alias="json")] = False


class _Latest(_Read):
    robot: str
    topic: str


class _Publish(Request):
    topic: str
    # makes a request that is sent twice publish once
    key: Annotated[str, Field(min_length=1, max_length=64)] | None = None
    now: bool = False  # without the topic's interval
    ros: Ros | None = None
    value: Any = None  # in place of a frame of data


class _Since(_Read):
    # of the sequence; another one begins anew
    epoch: Annotated[str, Field(max_length=64)] | None = None
    sequence: Annotated[int, Field(ge=0, lt=2**63)] = 0
    limit: Annotated[int, Field(ge=1, le=1000)] = 100  # messages in a reply
    wait_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    own: bool = False  # the node's own messages too


@dataclass(slots=True)
class _Waiting:
    request: _Since
    until_s: float  # then the reply is empty
    send: Send


class Service:
    """Serves requests about one node. One thread may use it; sockets are the server's.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._typed = Typed(node.team)
        self._types = self._typed.types
        self._waiting: list[_Waiting] = []  # for messages
        self._done: OrderedDict[str, Response] = OrderedDict()  # by key, oldest first
        self._boot_id = secrets.token_hex(4)  # after a crash the last numbers may be given again
        self.verbs = {  # by name
            "publish": Verb(_Publish, self._publish, frames=1),
            "latest": Verb(_Latest, self._latest),
            "list": Verb(_List, self._list),
            "since": Verb(_Since, self._since),
            "team": Verb(Request, self._team),
            "links": Verb(Request, self._links),
        }

    def request(self, frames: Sequence[bytes], send: Send, now_s: float) -> None:
        """Take in a request; `send` is called once, now or by `tick`. `now_s` never goes back."""
        number: object = None
        try:
            values = requests.parse(frames, MAX_HEADER_BYTES)
            number = values.get("id")
            verb, request = requests.check(values, frames[1:], self.verbs)
            reply = verb.run(request, frames[1:])
            if reply is not None:
                send(requests.reply(number, reply))
            elif isinstance(request, _Since):
                self._wait(_Waiting(request, now_s + request.wait_s, send))
        except Exception as error:  # noqa: BLE001 - see there
            _refuse(number, send, error)

    def tick(self, now_s: float, *, ending: bool = False) -> None:
        """Send replies to waiting requests that have a result or whose time is over."""
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            if ending or now_s >= one.until_s:
                one.request.wait_s = 0.0
            try:
                reply = self._since(one.request)
                if reply is None:
                    self._waiting.append(one)
                else:
                    one.send(requests.reply(one.request.id, reply))
            except Exception as error:  # noqa: BLE001 - see there
                _refuse(one.request.id, one.send, error)

    def _wait(self, one: _Waiting) -> None:
        if len(self._waiting) >= MAX_WAITING:
            why = f"{MAX_WAITING} requests wait already; send it without wait_s"
            raise RequestError(why, again=True)
        self._waiting.append(one)

    @property
    def until_s(self) -> float | None:
        """When the next of those who wait has waited long enough."""
        return min((one.until_s for one in self._waiting), default=None)

    def _latest(self, request: _Latest, _data: Sequence[bytes]) -> Response:
        found = self._node.latest(request.robot, request.topic)
        fields, frames = self._shown([found] if found else [], request)
        return Response({"message": fields[0] if fields else None}, frames)

    def _list(self, request: _List, _data: Sequence[bytes]) -> Response:
        messages = self._node.messages()
        wanted = [m for m in messages if request.robot in (None, m.robot)]
        return Response({"messages": [self.fields(message) for message in wanted]})

    def _publish(self, request: _Publish, data: Sequence[bytes]) -> Response:
        if request.key is not None and request.key in self._done:
            return self._done[request.key]
        topic = self._node.team.topic(self._node.name, request.topic)
        if len(data) + ("value" in request.model_fields_set) != 1:
            raise RequestError("publish has either a value or a frame of data")
        if not data:
            value = _from_base64(request.value)
            body = self._typed.encode(self._node.name, request.topic, value)
        elif request.ros is None:
            [body] = data
        else:
            own_ros = self._node.robot.ros
            body = self._types.converted(topic.type, data[0], request.ros, own_ros)
        header = self._node.publish(request.topic, body, now=request.now)
        reply = Response({"header": str(header)})
        if request.key is not None:
            self._done[request.key] = reply
            if len(self._done) > KEPT_KEYS:
                self._done.popitem(last=False)
        return reply

    def _since(self, request: _Since, _data: Sequence[bytes] = ()) -> Response | None:
        """What is new; None to wait for something. The request moves on behind what it skips."""
        epoch = f"{self._node.epoch:016x}-{self._boot_id}"
        if request.epoch != epoch:
            request.epoch, request.sequence = epoch, 0
        numbered: list[tuple[int, Message]] = []
        size = 0
        while len(numbered) < request.limit and size < BATCH_BYTES:
            room = min(STEP, request.limit - len(numbered))
            found = self._node.stored_since(request.sequence, room)
            if not found:
                break
            for number, message in found:
                if request.own or message.robot != self._node.name:
                    size += len(message.data)
                    numbered.append((number, message))
                request.sequence = number
                if size >= BATCH_BYTES:
                    break
        if not numbered and request.wait_s:
            return None
        fields, frames = self._shown([message for _, message in numbered], request)
        for about, (number, _) in zip(fields, numbered, strict=True):
            about["sequence"] = number
        return Response({"epoch": epoch, "sequence": request.sequence, "messages": fields}, frames)

    def _shown(
        self, messages: Sequence[Message], request: _Read
    ) -> tuple[list[dict[str, Any]], list[bytes]]:
        """The fields of messages, and their payloads, unless values are requested."""
        found = [self._with_data(message, request) for message in messages]
        frames = [] if request.as_json else [data for _, data in found]
        return [about for about, _ in found], frames

    def _with_data(self, message: Message, request: _Read) -> tuple[dict[str, Any], bytes]:
        about, parts = self.fields(message), message.parts
        try:
            if request.as_json:
                value = self._typed.plain(message)
                values = [_as_base64(each) for each in (value if "parts" in about else [value])]
                json.dumps([[[values]]], allow_nan=False)  # as deep as in the reply
                about |= {"values": values} if "parts" in about else {"value": values[0]}
            elif "parts" in about and message.data and not parts:
                about["error"] = "not a batch of messages"
            elif request.ros is not None:
                kind, sender = about["type"], self._node.team.robot(message.robot).ros
                parts = tuple(
                    self._types.converted(kind, part, sender, request.ros) for part in parts
                )
        except (TypedError, ValueError, RecursionError) as error:
            about["error"] = str(error)
        if "parts" in about:
            about["parts"] = [len(part) for part in parts]
        return about, b"".join(parts)

    def fields(self, message: Message) -> dict[str, Any]:
        """The fields of a message."""
        topic = self._node.team.topic(message.robot, message.topic)
        about: dict[str, Any] = {
            "robot": message.robot,
            "topic": message.topic,
            "type": topic.type,
            "header": str(message.header),
            "priority": topic.priority.name.lower(),
            "stamp_s": message.stamp_s,
            "received_s": message.received_s,
            "size": len(message.data),
        }
        if topic.aggregate:
            about["parts"] = [len(part) for part in message.parts]
        return about

    def _team(self, _request: Request, _data: Sequence[bytes]) -> Response:
        team = self._node.team
        robots = {
            robot.name: {
                "ros": robot.ros,
                "topics": [
                    topic.model_dump(include={"name", "type", "priority", "history"})
                    for topic in team.topics_of(robot.name)
                ],
            }
            for robot in team.robots.values()
        }
        kinds = {topic.type for topics in team.kinds.values() for topic in topics} | {TEXT}
        fields = {
            "robot": self._node.name,
            "robots": robots,
            "types": {kind: self._types.about(kind) for kind in sorted(kinds)},
            "has_ros": self._types.has_ros,
            "definitions": dict(team.definitions),
        }
        return Response(fields)

    def _links(self, _request: Request, _data: Sequence[bytes]) -> Response:
        return Response(snapshot(self._node))


def _refuse(number: object, send: Send, error: Exception) -> None:
    """Reply to a failed request; an internal error ends that request, not the service."""
    why, again = str(error), isinstance(error, NodeClosedError) or getattr(error, "again", False)
    if not isinstance(error, MochaLinkError):
        LOG.error("a request failed", exc_info=error)
        why, again = "the node failed at this; its log has more", False
    send(requests.refusal(number, why, again=again))


def _as_base64(value: Any) -> Any:
    """Bytes as ``{"base64": text}``; any other value unchanged."""
    return {"base64": base64.b64encode(value).decode()} if isinstance(value, bytes) else value


def _from_base64(value: Any) -> Any:
    """Bytes that were sent as ``{"base64": text}``; any other value unchanged."""
    if not isinstance(value, dict) or set(value) != {"base64"}:
        return value
    try:
        return base64.b64decode(value["base64"], validate=True)
    except (TypeError, ValueError):
        raise TypedError("not Base64 text") from None


class ServiceServer(EndpointServer):
    """Serves a started node at an endpoint: ``ipc://path`` or ``tcp://127.0.0.1:port``.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, node: Node, endpoint: str) -> None:
        super().__init__(node, endpoint, "the node")
        self._service = Service(node)

    def _listen(self, endpoint: str, what: str) -> Listener:
        most = MAX_BYTES + MAX_HEADER_BYTES
        return Listener(endpoint, what, max_bytes=most, most_bytes=MAX_HELD * most)

    def _note(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            self._wake()

    def _wait_ms(self) -> int:
        until_s = self._service.until_s
        if until_s is None:
            return IDLE_MS
        return math.ceil(max(0.0, until_s - time.monotonic()) * 1000)

    def _turn(self, listener: Listener) -> None:
        for envelope, body in listener.requests():

            def send(reply: Frames, envelope: list[bytes] = envelope) -> None:
                listener.send(envelope, reply)

            self._service.request(body[:MAX_FRAMES], send, time.monotonic())
        self._service.tick(time.monotonic())

    def _end(self) -> None:
        self._service.tick(time.monotonic(), ending=True)
