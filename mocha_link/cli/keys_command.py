"""The command `mocha-link keys`: make keys for the robots of a team; which links they protect."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click
import yaml

from mocha_link.cli.program import PATH, Options, command, examples, option
from mocha_link.errors import MochaLinkError, error_text
from mocha_link.path_safety import check_links, new_file
from mocha_link.team import (
    Document,
    DocumentError,
    KeyMismatchError,
    Robot,
    SecretKey,
    Team,
    as_label,
    keys,
)

ROBOT_FOLDER = "/etc/mocha-link"
"""Where a robot has its team file and its secret: that of our service."""

_BOM = b"\xef\xbb\xbf"


class TeamTextError(MochaLinkError):
    """A team file whose text cannot be changed."""


class _Plan(NamedTuple):
    """What becomes of one robot: `secret` is to be written, `public` goes into the team file."""

    robot: Robot
    summary: str  # the action, as text for the operator
    secret: SecretKey | None = None
    public: str | None = None


@command(
    "Make keys for the robots of a team, so that only their nodes can connect to each other.",
    examples(
        "mocha-link keys team.yaml",
        "mocha-link keys --team team.yaml                 # also a folder to copy to each robot",
        "mocha-link keys team.yaml --robot io --force     # io's secret is lost",
    ),
)
@click.argument("team", type=PATH, required=False, help="team file (YAML); the command changes it")
@option(
    "--team",
    "whole_team",
    type=PATH,
    metavar="TEAM",
    help="make the missing keys of this team, and for each robot a folder to copy to it; "
    "never overwrites a key",
)
@option(
    "--out",
    type=PATH,
    metavar="DIR",
    help="folder for the secret keys (default: keys, beside TEAM)",
)
@option(
    "--robot", multiple=True, metavar="NAME", help="make a key for this robot only; may be repeated"
)
@option("--force", is_flag=True, help="also replace existing keys, which become invalid")
@option("--print", is_flag=True, help="print the lines for TEAM instead of changing it")
def run(options: Options) -> int:
    """Make what is missing. Raises MochaLinkError of several kinds; nothing is written then."""
    keys.require()
    path = _team_path(options)
    text, start = _read(path)
    team = Team.from_document(Document.from_text(text, path))
    directory = options.out or path.parent / "keys"
    robots = [team.robot(name) for name in options.robot or team.robots]
    places = {robot.name: keys.path_of(robot.name, directory) for robot in robots}
    if options.whole_team:
        places = {name: _place(name, place) for name, place in places.items()}
    plans = [_plan(robot, places[robot.name], force=options.force) for robot in robots]
    public = {plan.robot.name: plan.public for plan in plans if plan.public}
    after = team.with_robots({name: {"key": key} for name, key in public.items()})
    changed = text if options.print else with_keys(text, path, public)
    _write_secrets(plans, places, force=options.force)
    if options.print:
        print("\n".join(_lines_to_add(public)))
    elif changed != text:
        _write(path, start + changed.encode())
    output = sys.stderr if options.print else sys.stdout
    print("\n".join([f"{plan.robot.name}: {plan.summary}" for plan in plans]), file=output)
    print("\n".join(["", *protection_lines(after)]), file=output)
    if options.whole_team:
        print("\ncopy to each robot, and start its node there:")
        for robot in robots:
            if not robot.original:
                print("\n".join(_lay_out(robot, path, directory)))
    elif public:
        print(
            "\ngive every robot the new team file, and each secret to its robot alone",
            file=sys.stderr,
        )
    return 0


def _team_path(options: Options) -> Path:
    """The team file. Raises UsageError unless one is named, with options that fit."""
    if bool(options.team) == bool(options.whole_team):
        raise click.UsageError("name one team file: TEAM, or --team TEAM for all robots at once")
    if options.whole_team and (options.robot or options.force or options.print):
        raise click.UsageError(
            "--team is for all robots and overwrites nothing; use TEAM with --robot, --force and "
            "--print"
        )
    path: Path = options.whole_team or options.team
    return path


def _place(name: str, earlier: Path) -> Path:
    """Where the secret of a robot is in the folder for it, or where an earlier command left it."""
    place = keys.path_of(name, earlier.parent / name)
    return earlier if earlier.exists() and not place.exists() else place


def _lay_out(robot: Robot, team: Path, directory: Path) -> list[str]:
    """Complete the folder for a robot; the commands that bring it there."""
    folder = directory / robot.name
    secret, earlier = keys.path_of(robot.name, folder), keys.path_of(robot.name, directory)
    content, copy = team.read_bytes(), folder / team.name
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        different = not copy.exists() or copy.read_bytes() != content
    except OSError as error:
        raise TeamTextError(f"cannot write {copy}: {error.strerror}") from None
    if different:
        _write(copy, content)
    if not secret.exists() and earlier.exists():
        keys.write(secret, robot.name, keys.read(earlier))
    if not secret.exists():
        return [f"  {robot.name}: its secret is not here; {copy} is its new team file"]
    there, name = f"{ROBOT_FOLDER}/{shlex.quote(team.name)}", shlex.quote(robot.name)
    host = robot.address or f"ADDRESS-OF-{robot.name}"  # it may be found by mDNS
    place = f"[{host}]" if ":" in host else host
    return [
        f"  scp -p {shlex.quote(str(folder))}/* {shlex.quote(f'{place}:{ROBOT_FOLDER}/')}",
        f"      mocha-link node {there} --robot {name} --keys {ROBOT_FOLDER}",
    ]


def links(team: Team) -> dict[tuple[str, str], str | None]:
    """Every link of the team once, by its robots: why keys do not protect it; None: they do.

    Raises:
        KeyMismatchError: the team file has an invalid key for a robot (checked if PyNaCl is
            installed).
    """
    for robot in team.robots.values() if keys.available() else ():
        keys.public_key(robot)
    return {
        (name, peer): keys.open_because(team.robot(name), team.robot(peer))
        for name in sorted(team.robots)
        for peer in sorted(team.robot(name).peers)
        if name < peer
    }


def protection_lines(team: Team) -> list[str]:
    """The protected links in one line, and each of the others with the reason."""
    if not any(robot.key for robot in team.robots.values()):
        return ["no link is protected by keys ('mocha-link keys' makes them)"]
    found = {" - ".join(robots): why for robots, why in links(team).items()}
    closed = [link for link, why in found.items() if why is None]
    lines = [f"protected by keys: {', '.join(closed)}" if closed else "no link is protected:"]
    return lines + [f"NOT protected: {link} ({why})" for link, why in found.items() if why]


def with_keys(text: str, path: Path, public: Mapping[str, str]) -> str:
    """The text of a team file with these public keys in it, otherwise unchanged.

    Raises:
        DocumentError: the text is not YAML.
        TeamTextError: it is written in a way that we do not know how to change.
    """
    document = Document.from_text(text, path)
    newline = "\r\n" if "\r\n" in text else "\n"
    edits: list[tuple[int, int, str]] = []
    for name, values in _robots(document).items():
        if name not in public:
            continue
        key, robot = f'"{public[name]}"', document.node("robots", name)
        if not isinstance(robot, yaml.MappingNode):
            continue
        known = {key_node.value: value_node for key_node, value_node in robot.value}
        if "key" in known:
            start, end = known["key"].start_mark.index, known["key"].end_mark.index
            edits.append((start, end, key if end > start else f" {key}"))
        else:
            first = robot.value[0][0].start_mark
            behind = ", " if robot.flow_style else newline + " " * first.column
            edits.append((first.index, first.index, f"key: {key}{behind}"))
        values["key"] = public[name]
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    if not _reads_as(text, path, document.data):
        raise TeamTextError(
            f"the robots in {path} are written in a way that keys cannot be added to; "
            "add the lines by hand that 'mocha-link keys --print' prints"
        )
    return text


def _lines_to_add(public: Mapping[str, str]) -> list[str]:
    robots = (f'  {name}:\n    key: "{key}"' for name, key in public.items())
    return ["robots:", *robots] if public else ["# every robot that can have a key has one"]


def _reads_as(text: str, path: Path, data: Any) -> bool:
    try:
        return bool(Document.from_text(text, path).data == data)
    except DocumentError:
        return False


def _robots(document: Document) -> dict[str, dict[str, Any]]:
    return {as_label(name): values for name, values in document.data["robots"].items()}


def _plan(robot: Robot, path: Path, *, force: bool) -> _Plan:
    if robot.original:
        return _Plan(robot, "runs the original MOCHA, which knows no keys")
    if path.exists() and not force:
        public = keys.read(path).public.text
        if robot.key is None:
            return _Plan(robot, f"key added; its secret was in {path}", public=public)
        if robot.key == public:
            return _Plan(robot, f"has its key; its secret is in {path}")
        raise KeyMismatchError(
            f"the secret in {path} is not of the key that the team file has for {robot.name}; "
            "take the file away, or make a new key with --force"
        )
    if robot.key is not None and not force:
        return _Plan(robot, f"has its key; its secret is not in {path.parent}")
    secret = SecretKey.generate()
    return _Plan(robot, f"new key; its secret is in {path}", secret, secret.public.text)


def _write_secrets(plans: list[_Plan], places: Mapping[str, Path], *, force: bool) -> None:
    made = {plan.robot.name: plan.secret for plan in plans if plan.secret}
    for folder in {places[name].parent for name in made}:
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise keys.KeyFileError(f"cannot make {folder}: {error.strerror}") from None
    for name, secret in made.items():
        keys.write(places[name], name, secret, replace=force)


def _read(path: Path) -> tuple[str, bytes]:
    """The text, and the bytes that stand before it."""
    Document.load(path)  # with its checks of size and encoding
    raw = path.read_bytes()
    start = _BOM if raw.startswith(_BOM) else b""
    return raw[len(start) :].decode(), start


def _write(path: Path, raw: bytes) -> None:
    """Write a file in one step; what was there stays until then. Raises TeamTextError."""
    try:
        check_links(path)
    except OSError as error:
        raise TeamTextError(error_text(error)) from None
    path = path.resolve()  # the file itself, not a link to it
    fresh = path.with_name(path.name + ".new")
    try:
        with new_file(fresh) as file:
            if path.exists():
                os.fchmod(file.fileno(), path.stat().st_mode & 0o777)
            file.write(raw)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise TeamTextError(f"cannot write {path}: {error.strerror}") from None
