"""Teams of the original MOCHA nodes: their YAML files, as they are, become a team file.

Reads ``robot_configs.yaml``, ``topic_configs.yaml`` and, if given, ``radio_configs.yaml``. Ids and
ports come out as the original nodes have them. What those nodes would stop over is refused with
its place, and so is what YAML 1.1, which they follow, takes for something else than we do: a name
``no`` is false there, ``010`` is eight, ``12:30`` is a number. What those nodes pass over (clients
that are no robots, unknown keys) is passed over with a notice.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from itertools import zip_longest
from operator import getitem
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, RootModel, StringConstraints
from pydantic import Field as Key

from mocha_link.hosts import NAME
from mocha_link.team.document import Document, DocumentError, Problem, as_yaml
from mocha_link.team.team import Team, UnknownRobotError
from mocha_link.team.team_file import IDS, LAST_PORT, MAX_RADIO_ID, Name, PortRange, TypeName

PRIORITIES = {
    "NO_PRIORITY": "none",
    "LOW_PRIORITY": "low",
    "MEDIUM_PRIORITY": "medium",
    "HIGH_PRIORITY": "high",
}

Keys = tuple[str | int, ...]


def _a_port(value: object) -> object:
    """The original nodes convert it by int(...), so text is valid too."""
    try:
        return int(value) if isinstance(value, str) else value
    except ValueError:
        return value


_Text = Annotated[str, StringConstraints(min_length=1, max_length=256)]


class _Topic(BaseModel):
    name: Annotated[_Text, Key(alias="msg_topic")]
    type: Annotated[TypeName, Key(alias="msg_type")]
    priority: Annotated[
        Literal["NO_PRIORITY", "LOW_PRIORITY", "MEDIUM_PRIORITY", "HIGH_PRIORITY"],
        Key(alias="msg_priority"),
    ]
    history: Annotated[Any, Key(alias="msg_history")] = None  # not of the wire


class _Robot(BaseModel):
    kind: Annotated[_Text, Key(alias="node-type")]
    address: Annotated[
        Annotated[str, StringConstraints(pattern=rf"^{NAME}$")],
        Key(alias="IP-address", description="an IPv4 address or a host name"),
    ]
    radio: Annotated[Any, Key(alias="using-radio")] = None
    base_port: Annotated[int, BeforeValidator(_a_port), Key(alias="base-port", ge=1, le=LAST_PORT)]
    clients: list[Any]  # names, as the file has them


class _Radio(BaseModel):
    addresses: Annotated[
        list[Annotated[str, StringConstraints(min_length=1)]], Key(alias="MAC-address")
    ]
    computed: Annotated[Any, Key(alias="computed-IP-address")] = None


class _Robots(RootModel[Annotated[dict[Name, _Robot], Key(min_length=1, max_length=IDS)]]):
    """``robot_configs.yaml``."""


class _Kinds(RootModel[Annotated[dict[str, list[_Topic]], Key(min_length=1)]]):
    """``topic_configs.yaml``."""


class _Radios(RootModel[Annotated[dict[str, _Radio], Key(min_length=1)]]):
    """``radio_configs.yaml``."""


@dataclass(frozen=True, slots=True)
class Import:
    """A team of the original nodes, the text of its team file, and what to know about it."""

    team: Team
    text: str  # YAML
    notices: tuple[Problem, ...]  # what was left out or assumed


def load(
    robots: Path,
    topics: Path,
    radios: Path | None = None,
    *,
    ours: Collection[str] = (),
    ros: int = 1,
) -> Import:
    """Read the files of the original nodes.

    Args:
        robots: ``robot_configs.yaml``.
        topics: ``topic_configs.yaml``.
        radios: ``radio_configs.yaml``; without it radios are not checked, and not known by address.
        ours: names of the robots that run our node; all others run the original one.
        ros: 1 or 2, the ROS of all these robots.

    Raises:
        DocumentError: with every problem of all files.
        UnknownRobotError: one of `ours` is no robot.
    """
    documents: list[Document] = []
    parsed: list[dict[str, Any]] = []
    problems: list[Problem] = []
    models: tuple[type[RootModel[Any]], ...] = (_Robots, _Kinds, _Radios)
    for path, model in zip((robots, topics, radios), models, strict=True):
        if path is None:
            continue
        try:
            documents.append(Document.load(path))
            problems += [*_other_readings(documents[-1]), *_other_names(documents[-1])]
            parsed.append(documents[-1].parse(model, extra="ignore").root)
        except DocumentError as error:
            problems += error.problems
    if problems:
        raise DocumentError(problems)
    radio_table = parsed[2] if radios else {}
    converter = _Converter(documents[0], documents[1], parsed[0], parsed[1], radio_table)
    text = as_yaml(converter.data(ours, ros))
    team = Team.from_document(Document.from_text(text, robots))
    return Import(team, text, tuple(sorted(converter.notices)))


def configuration(path: Path) -> tuple[Path, Path, Path | None, int]:
    """Files of robots, topics and radios, and the ROS, of the package that the original node is.

    The branches for ROS 1 and ROS 2 have the same files; `package.xml` names the build system.

    Args:
        path: The package, the folder of its files, or the file of robots.
    """
    folder = path if path.is_dir() else path.parent
    config = folder / "config" if (folder / "config").is_dir() else folder
    robots = config / "robot_configs.yaml" if path.is_dir() else path
    radios = config / "radio_configs.yaml"
    ros = 1
    for package in (config, *config.absolute().parents[:2]):
        try:
            text = (package / "package.xml").read_text("utf-8", errors="replace")
        except OSError:
            continue
        ros = 2 if "ament_" in text else 1
        break
    return robots, config / "topic_configs.yaml", radios if radios.exists() else None, ros


@dataclass(slots=True)
class _Converter:
    """Checks what must fit together between the files, and makes a team file's data of them."""

    robot_file: Document
    topic_file: Document
    robots: Mapping[str, _Robot]
    kinds: Mapping[str, list[_Topic]]
    radios: Mapping[str, _Radio]  # empty: they stay unknown
    problems: list[Problem] = field(default_factory=list)
    notices: list[Problem] = field(default_factory=list)  # for the user

    def data(self, ours: Collection[str], ros: int) -> dict[str, Any]:
        """The team of the files. Raises DocumentError or UnknownRobotError."""
        self._check_topics()
        radio_ids = {name: self._radio_id(name) for name in self.radios}
        self._check_robots()
        clients = {name: self._clients(name) for name in self.robots}
        self._check_ports(clients)
        if self.problems:
            raise DocumentError(self.problems)
        for name in ours:
            if name not in self.robots:
                raise UnknownRobotError(name, self.robots, f"in {self.robot_file.path}")
        return {
            "robots": {
                name: {
                    "kind": robot.kind,
                    "address": robot.address,
                    "base_port": robot.base_port,
                    "clients": clients[name],
                    **({"radio_id": radio_ids[robot.radio]} if radio_ids else {}),
                    **({} if name in ours else {"original": True}),
                    **({} if ros == 1 else {"ros": ros}),
                }
                for name, robot in self.robots.items()
            },
            "kinds": {
                kind: {
                    "topics": [
                        {"name": t.name, "type": t.type, "priority": PRIORITIES[t.priority]}
                        for t in topics
                    ]
                }
                for kind, topics in self.kinds.items()
            },
        }

    def _check_topics(self) -> None:
        for kind, topics in self.kinds.items():
            names: set[str] = set()
            for index, topic in enumerate(topics):
                if topic.name in names:
                    message = f"topic '{topic.name}' is listed twice; remove one"
                    keys = (kind, index, "msg_topic")
                    self.problems.append(self.topic_file.problem(keys, message, "named-twice"))
                names.add(topic.name)
                self._note_unknown(self.topic_file, (kind, index), _Topic)
        count = sum(map(len, self.kinds.values()))
        if count > IDS:
            message = f"{count} topics, at most {IDS} have ids; remove some"
            self.problems.append(self.topic_file.problem((), message, "too-many"))

    def _radio_id(self, name: str) -> str | None:
        """By what the radios of others know this one: as many of its addresses as fit."""
        ids = [*self.radios[name].addresses, self.radios[name].computed]
        text = ",".join(one for one in ids if isinstance(one, str) and one)
        while len(text) > MAX_RADIO_ID:
            message = f"radio '{name}' has too many addresses; the last is left out"
            self._note((), message, "left-out")
            text = text.rpartition(",")[0]
        return text or None

    def _check_robots(self) -> None:
        users: dict[str, str] = {}
        for name, robot in self.robots.items():
            self._note_unknown(self.robot_file, (name,), _Robot)
            if robot.kind not in self.kinds:
                kinds = ", ".join(self.kinds)
                message = f"no '{robot.kind}' in {self.topic_file.path}; use one of {kinds}"
                self._refuse((name, "node-type"), message, "unknown-kind")
            if not self.radios:
                continue
            keys, radio = (name, "using-radio"), robot.radio
            if radio is None:
                self._refuse((name,), "missing key 'using-radio'; add it", "missing-key")
            elif not isinstance(radio, str) or radio not in self.radios:
                message = f"no radio '{radio}' in the radio file; correct it, or add it there"
                self._refuse(keys, message, "unknown-radio")
            elif users.setdefault(radio, name) != name:
                message = f"{users[radio]} has this radio as well; others cannot tell them apart"
                self._note(keys, message, "radio-shared")

    def _clients(self, name: str) -> list[str | None]:
        """The clients of a robot in the order of its ports; None where no link comes about."""
        made: list[str | None] = []
        given = self.robots[name].clients
        for index, client in enumerate(given):
            reason = ""
            if not isinstance(client, str) or client not in self.robots:
                reason = f"'{str(client)[:40]}' is no robot here"
            elif client in given[:index]:
                reason = f"'{client}' is listed before"
            elif name not in (client, *self.robots[client].clients):
                reason = f"'{client}' does not list '{name}', so the two never sync"
            if reason:
                message = f"{reason}; its port stays unused"
                self._note((name, "clients", index), message, "left-out")
            made.append(None if reason else client)
        while made and made[-1] is None:
            made.pop()
        return made

    def _check_ports(self, clients: Mapping[str, list[str | None]]) -> None:
        before: dict[str, PortRange] = {}
        for name, robot in self.robots.items():
            ports = PortRange(robot.address, robot.base_port, len(clients[name]))
            for code, message in ports.faults(before, "base-port"):
                self._refuse((name, "base-port"), message, code)
            before[name] = ports

    def _note_unknown(self, document: Document, keys: Keys, model: type[BaseModel]) -> None:
        known = {about.alias or name for name, about in model.model_fields.items()}
        for key in reduce(getitem, keys, document.data):
            if key not in known:
                place = document.place_of_key(*keys, key)
                message = f"'{key}' is not read by the original nodes"
                self.notices.append(Problem(document.path, *place, message, "not-read"))

    def _refuse(self, keys: Keys, message: str, code: str) -> None:
        self.problems.append(self.robot_file.problem(keys, message, code))

    def _note(self, keys: Keys, message: str, code: str) -> None:
        self.notices.append(self.robot_file.problem(keys, message, code))


def _other_names(document: Document) -> Iterator[Problem]:
    """Names that are no text to the original nodes."""
    for name in document.data if isinstance(document.data, dict) else ():
        if not isinstance(name, str):
            place = document.place_of_key(name)
            message = f"the name '{name}' is no text; put it in quotes"
            yield Problem(document.path, *place, message, "wrong-type")


def _other_readings(document: Document) -> Iterator[Problem]:
    """Where YAML 1.1, which the original nodes follow, means something else. Reads the file."""
    text = document.path.read_text(encoding="utf-8-sig")
    try:
        theirs = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        message = f"the original nodes cannot read this: {str(error).partition(chr(10))[0]}"
        yield Problem(document.path, line, column, message, "read-otherwise")
        return
    yield from _differences(document, (), document.data, theirs)


def _differences(document: Document, keys: Keys, ours: Any, theirs: Any) -> Iterator[Problem]:
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for mine, other in zip_longest(ours, theirs):
            if type(mine) is not type(other) or mine != other:
                place = document.place_of_key(*keys, mine)
                message = f"the original nodes read '{other}' here; put the key in quotes"
                yield Problem(document.path, *place, message, "read-otherwise")
                return
            yield from _differences(document, (*keys, mine), ours[mine], theirs[mine])
    elif isinstance(ours, list) and isinstance(theirs, list):
        for index, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            yield from _differences(document, (*keys, index), mine, other)
    elif type(ours) is not type(theirs) or ours != theirs:
        message = f"the original nodes read '{theirs}' here; put it in quotes"
        yield document.problem(keys, message, "read-otherwise")
