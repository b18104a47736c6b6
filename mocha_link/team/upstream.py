"""Teams of the original MOCHA nodes: their YAML files, as they are, become a team file.

Reads ``robot_configs.yaml``, ``topic_configs.yaml`` and, if given, ``radio_configs.yaml``. Ids and
ports come out as the original nodes have them. What those nodes would stop over is refused with
its place; what they pass over (clients that are no robots, unknown keys) is passed over with a
notice.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mocha_link.team.document import Document, DocumentError, Problem, as_yaml
from mocha_link.team.error_text import Key
from mocha_link.team.team import Team, UnknownRobotError
from mocha_link.team.team_file import IDS, MAX_RADIO_ID, PortRange
from mocha_link.team.yaml_readings import other_readings

PRIORITIES = {
    "NO_PRIORITY": "none",
    "LOW_PRIORITY": "low",
    "MEDIUM_PRIORITY": "medium",
    "HIGH_PRIORITY": "high",
}
ROBOT_KEYS = ("node-type", "IP-address", "using-radio", "base-port", "clients")
TOPIC_KEYS = ("msg_topic", "msg_type", "msg_priority", "msg_history")
MAX_TEXT = 256

_NAME = re.compile(r"[^\s/:]{1,64}")
_HOST = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_TYPE = re.compile(r"[A-Za-z0-9_]+/[A-Za-z0-9_]+")


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
    paths = [path for path in (robots, topics, radios) if path]
    documents: list[Document] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            documents.append(Document.load(path))
            problems += other_readings(documents[-1])
        except DocumentError as error:
            problems += error.problems
    if problems:
        raise DocumentError(problems)
    data, notices = _Converter(documents, ours, ros).data()
    text = as_yaml(data)
    team = Team.from_document(Document.from_text(text, robots))
    return Import(team, text, tuple(sorted(notices)))


def configuration(path: Path) -> tuple[Path, Path, Path | None, int]:
    """Files of robots, topics and radios, and the ROS, of the package that the original node is.

    The branches for ROS 1 and ROS 2 have the same files; `package.xml` says which builds them.

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
class _Robot:
    kind: str
    address: str
    base_port: int
    clients: list[Any]  # names, as the file has them
    radio_id: str | None = None  # hardware address of a Rajant radio


class _Converter:
    def __init__(self, documents: Sequence[Document], ours: Collection[str], ros: int) -> None:
        self._robot_file, self._topic_file = documents[0], documents[1]  # and the topics' file
        self._radio_file = documents[2] if len(documents) > 2 else None  # None: radios stay unknown
        self._ours = ours
        self._ros = ros
        self._problems: list[Problem] = []  # of all files
        self._notices: list[Problem] = []  # for the user

    def data(self) -> tuple[dict[str, Any], list[Problem]]:
        """What the team file says, and notices. Raises DocumentError or UnknownRobotError."""
        kinds = dict(self._kinds())
        radios = dict(self._radios())
        robots = dict(self._robots(kinds, radios))
        if not self._problems:
            clients = {name: self._clients(name, robots) for name in robots}
            for name, robot in robots.items():
                robot.clients = clients[name]
            self._check_ports(robots)
        if self._problems:
            raise DocumentError(self._problems)
        for name in self._ours:
            if name not in robots:
                raise UnknownRobotError(name, robots, f"in {self._robot_file.path}")
        data = {
            "robots": {name: self._robot_data(name, robot) for name, robot in robots.items()},
            "kinds": {name: {"topics": topics} for name, topics in kinds.items()},
        }
        return data, self._notices

    def _robot_data(self, name: str, robot: _Robot) -> dict[str, Any]:
        data: dict[str, Any] = {
            "kind": robot.kind,
            "address": robot.address,
            "base_port": robot.base_port,
            "clients": robot.clients,
        }
        if robot.radio_id:
            data["radio_id"] = robot.radio_id
        if name not in self._ours:
            data["original"] = True
        if self._ros != 1:
            data["ros"] = self._ros
        return data

    def _kinds(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        document = self._topic_file
        count = 0
        for kind, topics in self._items(document, (), "kinds of robots"):
            if not isinstance(topics, list):
                message = f"'{kind}' must be a list of topics"
                self._refuse(document, (kind,), message, "wrong-type")
                continue
            names: set[str] = set()
            made = []
            for index, topic in enumerate(topics):
                count += 1
                keys = (kind, index)
                fields = self._fields(document, keys, topic, TOPIC_KEYS, TOPIC_KEYS[:3])
                if fields is None:
                    continue
                name = self._text(document, (*keys, "msg_topic"), fields["msg_topic"])
                if name in names:
                    message = f"topic '{name}' is listed twice; remove one"
                    self._refuse(document, (*keys, "msg_topic"), message, "named-twice")
                names.add(name)
                made.append(
                    {
                        "name": name,
                        "type": self._text(
                            document, (*keys, "msg_type"), fields["msg_type"], _TYPE
                        ),
                        "priority": self._priority(keys, fields["msg_priority"]),
                    }
                )
            yield kind, made
        if count > IDS:
            message = f"{count} topics, at most {IDS} have ids; remove some"
            self._refuse(document, (), message, "too-many")

    def _priority(self, keys: tuple[Key, ...], value: object) -> str:
        if not isinstance(value, str) or value not in PRIORITIES:
            message = f"unknown priority {_shown(value)}; use one of {', '.join(PRIORITIES)}"
            self._refuse(self._topic_file, (*keys, "msg_priority"), message, "unknown-word")
            return "none"
        return PRIORITIES[value]

    def _radios(self) -> Iterator[tuple[str, str | None]]:
        """Name of every radio, and its addresses."""
        document = self._radio_file
        if document is None:
            return
        for name, radio in self._items(document, (), "radios"):
            fields = radio if isinstance(radio, dict) else {}
            addresses = fields.get("MAC-address")
            if not isinstance(addresses, list) or not all(
                isinstance(address, str) and address for address in addresses
            ):
                message = f"'{name}' must have a MAC-address: a list of addresses in quotes"
                self._refuse(document, (name, "MAC-address"), message, "wrong-type")
                addresses = []
            ids = [*addresses, fields.get("computed-IP-address")]
            text = ",".join(one for one in ids if isinstance(one, str) and one)
            while len(text) > MAX_RADIO_ID:
                message = "too many addresses; the last is left out"
                self._note(document, (name, "MAC-address"), message, "left-out")
                text = text.rpartition(",")[0]
            yield name, text or None

    def _robots(
        self, kinds: dict[str, Any], radios: dict[str, str | None]
    ) -> Iterator[tuple[str, _Robot]]:
        document = self._robot_file
        users: dict[str, str] = {}
        robots = list(self._items(document, (), "robots"))
        if len(robots) > IDS:
            message = f"{len(robots)} robots, at most {IDS} have ids; remove some"
            self._refuse(document, (), message, "too-many")
        for name, robot in robots:
            keys = (name,)
            if not _NAME.fullmatch(name):
                message = f"'{name}' must be up to 64 characters without spaces, / and :; rename it"
                place = document.place_of_key(name)
                self._problems.append(Problem(document.path, *place, message, "wrong-form"))
            needed = tuple(key for key in ROBOT_KEYS if radios or key != "using-radio")
            fields = self._fields(document, keys, robot, ROBOT_KEYS, needed)
            if fields is None:
                continue
            kind = self._text(document, (name, "node-type"), fields["node-type"])
            if kind and kind not in kinds:
                message = (
                    f"no '{kind}' in {self._topic_file.path}; use one of {', '.join(kinds) or '-'}"
                )
                self._refuse(document, (name, "node-type"), message, "unknown-kind")
            radio = str(fields.get("using-radio"))
            if radios and radio not in radios:
                message = f"no radio '{radio}' in the radio file; correct it, or add it there"
                self._refuse(document, (name, "using-radio"), message, "unknown-radio")
            elif radios and radio in users:
                message = f"{users[radio]} has this radio as well; others cannot tell them apart"
                self._note(document, (name, "using-radio"), message, "radio-shared")
            users[radio] = name
            clients = fields["clients"]
            if not isinstance(clients, list):
                message = "clients must be a list; write [] for none"
                self._refuse(document, (name, "clients"), message, "wrong-type")
                clients = []
            address = self._text(document, (name, "IP-address"), fields["IP-address"], _HOST)
            port = self._port((name, "base-port"), fields["base-port"])
            yield name, _Robot(kind, address, port, clients, radios.get(radio))

    def _port(self, keys: tuple[Key, ...], value: object) -> int:
        try:  # the original nodes say int(...) to it, so text does, too
            port = int(value) if type(value) in (int, str) else 0  # type: ignore[call-overload]
        except ValueError:
            port = 0
        if port not in range(1, 65536):
            message = f"base-port must be 1 to 65535, found {_shown(value)}; correct it"
            self._refuse(self._robot_file, keys, message, "out-of-range")
            return 1
        return int(port)

    def _clients(self, name: str, robots: dict[str, _Robot]) -> list[str | None]:
        """The clients of a robot in the order of its ports; None where no link comes about."""
        made: list[str | None] = []
        given = robots[name].clients
        for index, client in enumerate(given):
            keys = (name, "clients", index)
            reason = ""
            if not isinstance(client, str) or client not in robots:
                reason = f"{_shown(client)} is no robot here"
            elif client in given[:index]:
                reason = f"'{client}' is listed before"
            elif name not in (client, *robots[client].clients):
                reason = f"'{client}' does not list '{name}', so the two never sync"
            if reason:
                message = f"{reason}; its port stays unused"
                self._note(self._robot_file, keys, message, "left-out")
            made.append(None if reason else client)
        while made and made[-1] is None:
            made.pop()
        return made

    def _check_ports(self, robots: dict[str, _Robot]) -> None:
        before: dict[str, PortRange] = {}
        for name, robot in robots.items():
            ports = PortRange(robot.address, robot.base_port, len(robot.clients))
            for code, message in ports.faults(before, "base-port"):
                self._refuse(self._robot_file, (name, "base-port"), message, code)
            before[name] = ports

    def _items(
        self, document: Document, keys: tuple[Key, ...], what: str
    ) -> Iterator[tuple[str, Any]]:
        """The entries of a mapping that has names as keys."""
        if not isinstance(document.data, dict) or not document.data:
            self._refuse(document, keys, f"the file must be a mapping of {what}", "wrong-type")
            return
        for name, value in document.data.items():
            if not isinstance(name, str):
                message = f"the name {_shown(name)} is no text; put it in quotes"
                place = document.place_of_key(*keys, name)
                self._problems.append(Problem(document.path, *place, message, "wrong-type"))
                continue
            yield name, value

    def _fields(
        self,
        document: Document,
        keys: tuple[Key, ...],
        value: object,
        known: tuple[str, ...],
        needed: tuple[str, ...],
    ) -> dict[str, Any] | None:
        """A mapping that has all the keys that are needed; None if it is not."""
        if not isinstance(value, dict):
            message = f"must be a mapping with {', '.join(needed)}"
            self._refuse(document, keys, message, "wrong-type")
            return None
        for key in value:
            if key not in known:
                place = document.place_of_key(*keys, key)
                message = f"'{key}' is not read by the original nodes"
                self._notices.append(Problem(document.path, *place, message, "not-read"))
        missing = [key for key in needed if key not in value]
        for key in missing:
            self._refuse(document, keys, f"missing key '{key}'; add it", "missing-key")
        return None if missing else value

    def _text(
        self,
        document: Document,
        keys: tuple[Key, ...],
        value: object,
        pattern: re.Pattern[str] | None = None,
    ) -> str:
        if not isinstance(value, str) or not value or len(value) > MAX_TEXT:
            message = f"'{keys[-1]}' must be text, found {_shown(value)}"
            self._refuse(document, keys, message, "wrong-type")
            return ""
        if pattern and not pattern.fullmatch(value):
            wanted = "package/Type" if pattern is _TYPE else "an IPv4 address or a host name"
            message = f"'{keys[-1]}' must be {wanted}, found {_shown(value)}"
            self._refuse(document, keys, message, "wrong-form")
        return value

    def _refuse(self, document: Document, keys: tuple[Key, ...], message: str, code: str) -> None:
        self._problems.append(document.problem(keys, message, code))

    def _note(self, document: Document, keys: tuple[Key, ...], message: str, code: str) -> None:
        self._notices.append(document.problem(keys, message, code))


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    return f"'{str(value)[:40]}'"
