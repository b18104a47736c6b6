"""What a first mission is made from: each answer an option, or asked for on the terminal."""

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from air_router.cli.arguments import home, number
from air_router.errors import UsageError
from air_router.start.texts import MOST_ROBOTS, ROVERS

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")

altitude = number("an altitude between 2 and 500 m above home", 2.0, 500.0)


def name(text: str) -> str:
    """A robot's name."""
    if not _NAME.fullmatch(text) or yaml.safe_load(text) != text:  # YAML takes "on" for a switch
        raise argparse.ArgumentTypeError(f"'{text}' is no name; use letters, digits, _ and -")
    return text


def robots(text: str) -> dict[str, str]:
    """Names, and what each speaks: "rover=ros2, scout"."""
    found = {}
    for part in text.replace(",", " ").split():
        robot, _, kind = part.partition("=")
        kind = kind or "json"
        if kind not in ROVERS:
            known = ", ".join(ROVERS)
            raise argparse.ArgumentTypeError(f"{part}: a robot speaks one of {known}")
        if robot in found:
            raise argparse.ArgumentTypeError(f"'{robot}' is named twice")
        found[name(robot)] = kind
    if not 1 <= len(found) <= MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"name 1 to {MOST_ROBOTS} robots")
    return found


@dataclass(frozen=True, slots=True)
class Question:
    """One answer that is needed.

    Attributes:
        key: Its name among the arguments.
        text: How it is asked for.
        read: What makes a value of an answer; raises ArgumentTypeError.
        default: The answer if there is none; None: there has to be one.
    """

    key: str
    text: str
    read: Callable[[str], Any]
    default: str | None = None


QUESTIONS = (
    Question("folder", "Folder to make", Path, "mission"),
    Question("home", "Where does the vehicle take off (latitude,longitude)?", home),
    Question("altitude", "Cruise altitude in metres above that?", altitude, "30"),
    Question("uav", "Name of the vehicle in the team?", name, "titan"),
    Question(
        "robots",
        "Robots that it seeks, and what they speak (json, ros1, ros2)?",
        robots,
        "rover=json",
    ),
)


def answered(arguments: argparse.Namespace, ask: Callable[[str], str] | None) -> dict[str, Any]:
    """Every answer: as an option, else asked for, else its default.

    Args:
        arguments: What the command line says.
        ask: Asks on the terminal; None: there is no terminal.

    Raises:
        UsageError: one is missing that has no default.
    """
    answers = {}
    for question in QUESTIONS:
        value = getattr(arguments, question.key)
        if value is None and ask is not None:
            value = _asked(question, ask)
        elif value is None and question.default is None:
            raise UsageError(f"say --{question.key}, or answer on a terminal: {question.text}")
        elif value is None:
            value = question.read(str(question.default))
        answers[question.key] = value
    return answers


def _asked(question: Question, ask: Callable[[str], str]) -> Any:
    shown = "" if question.default is None else f" [{question.default}]"
    while True:
        try:
            given = ask(f"{question.text}{shown} ").strip() or question.default
        except EOFError:
            raise UsageError("no answer; nothing was made") from None
        try:
            if given is not None:
                return question.read(given)
        except argparse.ArgumentTypeError as error:
            sys.stderr.write(f"{error}\n")
