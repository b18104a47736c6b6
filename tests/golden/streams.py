"""Streams as files, and where a controller first decides otherwise. Knows no names of the program.

A stream is lines of JSON, compressed (`xzcat` shows them). The first is what the controller is made
of; every other is [time, event, decisions], decisions being left out where there are none. Of the
vehicle's telemetry only what has changed since the one before is written. A line {"reaction_s": n}
says how soon the vehicle is thought to follow commands from then on.
"""

import json
import lzma
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tests.golden.adapter import controller_of
from tests.golden.nodes import Node

FOLDER = Path(__file__).parent / "streams"
SUFFIX = ".jsonl.xz"


class Step(NamedTuple):
    """What happened, and what is decided; `reaction_s`: see the module."""

    t: float
    reaction_s: float | None
    event: dict[str, Any]
    decided: list[Any]


class Stream(NamedTuple):
    """What a controller is made of, its events, and its decisions."""

    setup: dict[str, Any]
    steps: list[Step]


def write(path: Path, stream: Stream) -> None:
    """Put a stream into a file, the same one for the same stream."""
    lines: list[Any] = [stream.setup]
    reaction_s, before = None, {}
    for step in stream.steps:
        if step.reaction_s != reaction_s:
            reaction_s = step.reaction_s
            lines.append({"reaction_s": reaction_s})
        event = step.event
        if event["kind"] == "telemetry":
            changed = {k: v for k, v in event.items() if k == "kind" or before.get(k, ...) != v}
            before, event = event, changed
        lines.append([step.t, event, step.decided] if step.decided else [step.t, event])
    text = "".join(
        json.dumps(line, separators=(",", ":"), allow_nan=False) + "\n" for line in lines
    )
    path.write_bytes(lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))


def read(path: Path) -> Stream:
    """What `write` has written."""
    lines = map(json.loads, lzma.decompress(path.read_bytes()).decode().splitlines())
    return Stream(next(lines), list(_steps(lines)))


def _steps(lines: Iterable[Any]) -> Iterator[Step]:
    reaction_s, telemetry = None, {}
    for line in lines:
        if isinstance(line, dict):
            reaction_s = line["reaction_s"]
            continue
        t, event, *decided = line
        if event["kind"] == "telemetry":
            event = telemetry = {**telemetry, **event}
        yield Step(t, reaction_s, event, decided[0] if decided else [])


def decided(stream: Stream) -> Iterator[list[Any]]:
    """What a fresh controller or node decides at each step; an error is its last decision."""
    node = "team" in stream.setup
    controller = Node(stream.setup) if node else controller_of(stream.setup)
    for step in stream.steps:
        if controller.reaction_s != step.reaction_s:
            controller.reaction_s = step.reaction_s
        try:
            yield controller.decide(step.t, step.event)
        except Exception as error:  # noqa: BLE001 - a decision that is another one, too
            yield [f"{type(error).__name__}: {error}"]
            return


def difference(name: str, stream: Stream) -> str | None:
    """Where a fresh controller first decides otherwise, in words; None: nowhere."""
    last = "nothing"
    for step, got in zip(stream.steps, decided(stream), strict=False):
        if got != step.decided:
            return "\n".join(
                [
                    f"{name}: another decision at {step.t:.3f} s",
                    f"  before:   {last}",
                    f"  event:    {_line(step.event)}",
                    *_column("expected", step.decided, got),
                    *_column("got", got, step.decided),
                ]
            )
        if got:
            last = f"{step.t:.3f} s: {', '.join(map(_line, got))}"
    return None


def _column(word: str, decided: list[Any], other: list[Any]) -> list[str]:
    heads = [f"{word}:", *[""] * len(decided)]
    marks = ["  " if each in other else "> " for each in decided]
    rows = [mark + _line(each) for mark, each in zip(marks, decided, strict=True)] or ["  nothing"]
    return [f"  {head:<9}{row}" for head, row in zip(heads, rows, strict=False)]


def _line(plain: Any) -> str:
    if not isinstance(plain, dict):
        return str(plain)
    fields = (
        f"{k}={json.dumps(v)[:200]}" for k, v in plain.items() if k != "kind" and v is not None
    )
    return " ".join([plain["kind"], *fields])
