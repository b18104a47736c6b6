"""A node's messages for programs on the same machine, over ZeroMQ: the requests and answers.

A request is a JSON object, and for ``publish`` a frame with the data; the answer is a JSON object,
followed by a frame of data for every message in it. docs/bridges.md describes them. Nothing here
knows sockets; `service_server` does.
"""

from __future__ import annotations

import json
import logging
import secrets
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, ValidationError

from mocha_link.errors import MochaLinkError
from mocha_link.node.node import Message, Node, NodeClosedError
from mocha_link.ros.typed import TypedError, Types

MAX_HEADER_BYTES = 64 * 1024
MAX_WAITING = 256  # requests that wait for a message
BATCH_BYTES = 8 * 1024 * 1024  # of data, after which an answer is full
TEXT = "std_msgs/String"  # what bridges carry JSON in
STEP = 32  # messages that are unpacked at once; they may be large
KEPT_KEYS = 4096  # of publish requests, so that one that is repeated is done once

LOG = logging.getLogger("mocha_link")

Ros = Literal[1, 2] | None


class RequestError(MochaLinkError):
    """A request that is not one, or cannot be done."""


class BusyError(MochaLinkError):
    """A request that cannot be done now."""


class _Request(BaseModel, extra="forbid", strict=True):
    request: str
    id: Annotated[str, Field(max_length=64)] | int | None = None


class _Team(_Request):
    pass


class _List(_Request):
    robot: str | None = None


class _Latest(_Request):
    robot: str
    topic: str
    ros: Ros = None


class _Publish(_Request):
    topic: str
    key: Annotated[str, Field(min_length=1, max_length=64)] | None = None
    now: bool = False
    ros: Ros = None


class _Since(_Request):
    epoch: Annotated[str, Field(max_length=64)] | None = None
    sequence: Annotated[int, Field(ge=0, lt=2**63)] = 0
    limit: Annotated[int, Field(ge=1, le=1000)] = 100
    wait_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    own: bool = False
    ros: Ros = None


@dataclass(slots=True)
class _Waiting:
    request: _Since
    until_s: float
    answer: Callable[[list[bytes]], None]


class Service:
    """Answers requests about one node. One thread may use it.

    Raises:
        RosError: the team brings along a definition that cannot be used.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._types = Types(node.team.definitions)
        self._waiting: list[_Waiting] = []
        self._done: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._run = secrets.token_hex(4)  # after a crash the last numbers may be given again

    def request(
        self, frames: Sequence[bytes], answer: Callable[[list[bytes]], None], now_s: float
    ) -> None:
        """Take in a request; `answer` is called once, now or by `tick`. `now_s` never goes back."""
        number: object = None
        try:
            values = _values(frames)
            number = values.get("id")
            number = number if isinstance(number, str | int) else None
            self._act(values, frames[1:], answer, now_s)
        except MochaLinkError as error:
            again = isinstance(error, BusyError | NodeClosedError)
            answer([_json({"ok": False, "id": number, "error": str(error), "again": again})])
        except Exception:  # a mistake of ours costs one request, not the service
            LOG.exception("a request failed: %.200r", frames[0] if frames else b"")
            error_text = "the node failed at this; its log says more"
            answer([_json({"ok": False, "id": number, "error": error_text, "again": False})])

    def tick(self, now_s: float, *, ending: bool = False) -> None:
        """Answer those that waited, if there is something for them or their time is over."""
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            late = ending or now_s >= one.until_s
            try:
                done = self._since(one.request, one.answer, even_if_empty=late)
            except MochaLinkError as error:
                one.answer(
                    [_json({"ok": False, "id": one.request.id, "error": str(error), "again": True})]
                )
                done = True
            if not done:
                self._waiting.append(one)

    @property
    def until_s(self) -> float | None:
        """When the next of those who wait has waited long enough."""
        return min((one.until_s for one in self._waiting), default=None)

    def _act(
        self,
        values: dict[str, Any],
        data: Sequence[bytes],
        answer: Callable[[list[bytes]], None],
        now_s: float,
    ) -> None:
        name = values.get("request")
        if not isinstance(name, str) or name not in _MODELS:
            raise RequestError(f"no request {str(name)[:40]!r}; use one of {', '.join(_MODELS)}")
        try:
            request = _MODELS[name].model_validate(values)
        except ValidationError as error:
            raise RequestError(f"{name}: {_complaint(error, _MODELS[name])}") from None
        if len(data) != (1 if isinstance(request, _Publish) else 0):
            raise RequestError(
                f"{name}: {len(data)} frames of data; publish has one (or, at a bridge, 'value'), "
                "others none"
            )
        match request:
            case _Publish():
                reply = self._publish(request, data[0])
            case _Latest():
                found = self._node.latest(request.robot, request.topic)
                fields, frames = self._shown([found] if found else [], request.ros)
                answer(_reply(request, frames, message=fields[0] if fields else None))
                return
            case _Since():
                if self._since(request, answer, even_if_empty=not request.wait_s):
                    return
                if len(self._waiting) >= MAX_WAITING:
                    raise BusyError(f"{MAX_WAITING} requests wait already; ask without wait_s")
                self._waiting.append(_Waiting(request, now_s + request.wait_s, answer))
                return
            case _List():
                messages = self._node.messages()
                wanted = [m for m in messages if request.robot in (None, m.robot)]
                reply = {"messages": [self._fields(message) for message in wanted]}
            case _:
                reply = self._team()
        answer(_reply(request, (), **reply))

    def _publish(self, request: _Publish, data: bytes) -> dict[str, Any]:
        if request.key is not None and request.key in self._done:
            return self._done[request.key]
        topic = self._node.team.topic(self._node.name, request.topic)
        ros = self._node.robot.ros
        if request.ros is not None:
            data = self._types.converted(topic.type, data, request.ros, ros)
        header = self._node.publish(request.topic, data, now=request.now)
        reply = {"header": str(header)}
        if request.key is not None:
            self._done[request.key] = reply
            if len(self._done) > KEPT_KEYS:
                self._done.popitem(last=False)
        return reply

    def _since(
        self, request: _Since, answer: Callable[[list[bytes]], None], *, even_if_empty: bool
    ) -> bool:
        """Answer if there is anything, or anyway; the request moves on behind what it skips."""
        epoch = f"{self._node.epoch:016x}-{self._run}"
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
        if not numbered and not even_if_empty:
            return False
        fields, frames = self._shown([message for _, message in numbered], request.ros)
        for about, (number, _) in zip(fields, numbered, strict=True):
            about["sequence"] = number
        answer(_reply(request, frames, epoch=epoch, sequence=request.sequence, messages=fields))
        return True

    def _shown(
        self, messages: Sequence[Message], ros: Ros
    ) -> tuple[list[dict[str, Any]], list[bytes]]:
        """What is said about messages, and their data as one version of ROS wants them."""
        fields, frames = [], []
        for message in messages:
            about = self._fields(message)
            parts = message.parts
            if "parts" in about and message.data and not parts:
                about["error"] = "not a batch of messages"
            elif ros is not None:
                sender = self._node.team.robot(message.robot).ros
                try:
                    parts = tuple(
                        self._types.converted(about["type"], part, sender, ros) for part in parts
                    )
                except TypedError as error:
                    about["error"] = str(error)
            if "parts" in about:
                about["parts"] = [len(part) for part in parts]
            fields.append(about)
            frames.append(b"".join(parts))
        return fields, frames

    def _fields(self, message: Message) -> dict[str, Any]:
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

    def _team(self) -> dict[str, Any]:
        team = self._node.team
        robots = {
            robot.name: {
                "ros": robot.ros,
                "topics": [
                    {
                        "name": topic.name,
                        "type": topic.type,
                        "priority": topic.priority.name.lower(),
                        "history": topic.history,
                    }
                    for topic in team.topics_of(robot.name)
                ],
            }
            for robot in team.robots.values()
        }
        kinds = {topic.type for topics in team.kinds.values() for topic in topics} | {TEXT}
        return {
            "robot": self._node.name,
            "robots": robots,
            "types": {kind: self._types.about(kind) for kind in sorted(kinds)},
            "has_ros": self._types.has_ros,
            "definitions": dict(team.definitions),
        }


_MODELS: dict[str, type[_Request]] = {
    "publish": _Publish,
    "latest": _Latest,
    "list": _List,
    "since": _Since,
    "team": _Team,
}


def _values(frames: Sequence[bytes]) -> dict[str, Any]:
    """The JSON object of a request. Raises RequestError."""
    if not frames or len(frames[0]) > MAX_HEADER_BYTES:
        raise RequestError(f"a request begins with a JSON object of up to {MAX_HEADER_BYTES} bytes")
    try:
        values = json.loads(frames[0])
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise RequestError("a request begins with a JSON object")
    return values


def _complaint(error: ValidationError, model: type[_Request]) -> str:
    """The first thing that is wrong with a request."""
    detail = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(map(str, detail["loc"]))
    if detail["type"] == "extra_forbidden" and where in ("value", "json"):
        return f"the node itself knows bytes only; for '{where}' ask a 'mocha-link bridge zmq'"
    if detail["type"] == "extra_forbidden":
        return f"unknown field '{where}'; use {', '.join(model.model_fields)}"
    if detail["type"] == "missing":
        return f"'{where}' is missing"
    return f"'{where}': {detail['msg']}"


def _reply(request: _Request, frames: Sequence[bytes], **fields: object) -> list[bytes]:
    return [_json({"ok": True, "id": request.id, **fields}), *frames]


def _json(fields: dict[str, Any]) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode()
