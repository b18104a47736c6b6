"""The warnings and alarms of docs/watching.md, as the code makes them.

They are found in the code: whatever is handed an `Instruction` is a warning or an alarm.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from air_router.vehicle import instructions
from air_router.vehicle.input_limits import LIMITS

ROOT = Path(__file__).parents[2]
# How each function that is handed an instruction announces it: where the text is among its
# arguments (and by which name), what is put before it, and how grave it is.
MAKERS = {
    "warn": (0, "text", "{}", "warning"),
    "alarm": (0, "text", "{}", "alarm"),
    "Announce": (0, "text", "{}", "alarm"),
    "alarm_until_over": (1, "text", "{}", "alarm"),
    "_final_announcement": (0, "text", "{}", "alarm"),
    "Deviation": (1, "words", "{}", "warning"),
    "Due": (0, "why", "coming home: {}", "warning"),
    "HandoverHold": (0, "why", "holding: {}", "alarm"),
    "InputAnnouncement": (0, "what", "{}", "warning"),
    "Watch": (0, "words", "{} … and has not moved for … s: …", "alarm"),
    "come_home": (0, "why", "coming home: {}", "warning"),
    "give_up": (0, "why", "hands off: {}", "alarm"),
    "take_over": (1, "why", "hands off: {}", "warning"),
    "Hover": (0, "why", "holding: {}", "warning"),
    "wait_here": (0, "why", "holding: {}", "warning"),
}
# The content of texts that come from elsewhere, by function and instruction.
FROM_ELSEWHERE = {
    ("observe", "FLY_OUT"): ["breach of …"],
    ("_differs", "UPLOAD_OURS"): ["another plan is on board (…)"],
    ("_differs", "TAKE_WHERE_IT_HOLDS"): ["another plan is on board (…)"],
    ("follow_order", "IN_YOUR_HANDS"): [
        "a pilot or ground station gave it another place to go to",
        "a pilot or ground station chose another plan item",
    ],
    ("fallen", "KEEP_CLEAR"): ["disarmed in the air at … m above home"],
    ("__init__", "CHECK_PEER"): ["… of … cannot be read …", "… published nothing on …"],
    ("inputs_missing", "BE_READY_AT_HOME"): ["… not received for … s"],
    ("command", "CLIMB_BY_HAND"): ["it is … m above home, too near to … to climb by itself …"],
    ("wait_for_way", "FLY_OUT_OR_RELOAD"): ["no clear way leads …"],
    ("_while_off", "WATCH_HEIGHT"): ["too low: …", "too high: …"],
    ("due", "TAKE_OVER_NOW"): ["a fault that was announced, and still lasts after 10 s, for … s"],
    ("_while_off", "CLEARANCE_UNCERTAIN"): [
        "the satellites' position is good to … m only, planned for … m",
        "wind of … m/s, planned for … m/s",
    ],
    ("another_vehicle", "CONNECT_ANOTHER"): ["no multicopter with PX4 is on the link (…)"],
    ("another_vehicle", "SEPARATE_TWINS"): ["two autopilots answer with the same system id …"],
    ("another_vehicle", "LAND_BY_HAND"): ["no multicopter with PX4 is on the link (…)"],
    ("update", "CLEARANCE_UNCERTAIN"): [
        "the satellites' position is good to … m only, planned for … m: holding",
        "wind of … m/s, planned for … m/s: holding",
    ],
    ("update", "WATCH_HEIGHT"): ["too low: …", "too high: …"],
}
UNSPECIFIC = {"…", "for", "s", "too"}
"""A text of these alone does not state what is announced."""
KNOWN = {name: value for name, value in vars(instructions).items() if name.isupper()}


class Row(NamedTuple):
    """A warning or alarm."""

    text: str
    severity: str
    instruction: str


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.Module]:
    yield tree
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def own(scope: ast.AST) -> Iterator[ast.AST]:
    """What stands in a function (or at the top of a file), and in no function within."""
    for node in ast.iter_child_nodes(scope):
        if not isinstance(node, ast.FunctionDef):
            yield node
            yield from own(node)


def texts_of(node: ast.AST, scope: ast.AST) -> list[str]:  # noqa: PLR0911 - one per expression
    """The texts that an expression may be, with … for what only the flight knows."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr(values=parts):
            texts = [""]
            for part in parts:
                texts = [text + more for text in texts for more in texts_of(part, scope)]
            return texts
        case ast.FormattedValue(value=ast.Name() | ast.IfExp() as value):
            return texts_of(value, scope)
        case ast.IfExp(body=first, orelse=other):
            texts = [*texts_of(first, scope), *texts_of(other, scope)]
            return [""] if "" in texts else texts
        case ast.Name(id=name):
            found = [
                text
                for each in own(scope)
                if isinstance(each, ast.Assign)
                and any(isinstance(t, ast.Name) and t.id == name for t in each.targets)
                for text in texts_of(each.value, scope)
            ]
            return list(dict.fromkeys(found)) or ["…"]
        case ast.BinOp(left=left, right=right):
            return [a + b for a in texts_of(left, scope) for b in texts_of(right, scope)]
    return ["…"]


def name_of(node: ast.AST) -> str:
    return getattr(node, "id", getattr(node, "attr", ""))


def handed(call: ast.Call, scope: ast.AST) -> list[str]:
    """The instructions that a call is handed, by their names in the module."""
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    names = [name_of(node) for each in given for node in _either(each, scope)]
    return [name for name in names if name in KNOWN]


def _either(node: ast.AST, scope: ast.AST) -> Iterator[ast.AST]:
    """An expression, or those that it may be."""
    if isinstance(node, ast.IfExp):
        yield from (node.body, node.orelse)
        return
    yield node
    if isinstance(node, ast.Name) and node.id not in KNOWN:
        for each in own(scope):
            if isinstance(each, ast.Assign) and node.id in {name_of(t) for t in each.targets}:
                yield from _either(each.value, scope)


def rows() -> list[Row]:
    """Every warning and alarm of the program, in alphabetical order."""
    found = []
    for path in sorted((ROOT / "air_router").rglob("*.py")):
        for scope in functions(ast.parse(path.read_text("utf-8"))):
            for call in own(scope):
                if isinstance(call, ast.Call) and name_of(call.func) in MAKERS:
                    found += _rows_of(call, scope)
    for limit in LIMITS:
        severity = "warning" if limit.stop_s is None else "warning; alarm once the vehicle stops"
        found.append(Row(f"{limit.words} not received for … s: …", severity, limit.instruction))
    return sorted(set(found))


def _rows_of(call: ast.Call, scope: ast.AST) -> Iterator[Row]:
    at, name, pattern, severity = MAKERS[name_of(call.func)]
    alarms = any(k.arg == "alarms" for k in call.keywords)
    text = next((k.value for k in call.keywords if k.arg == name), None)
    if text is None and len(call.args) > at:
        text = call.args[at]
    for instruction in handed(call, scope):
        grave = "alarm" if alarms or instruction == "WATCH_FAILSAFE" else severity
        texts = [] if text is None else texts_of(text, scope)
        if not any(set(words.split()) - UNSPECIFIC for words in texts):
            texts = FROM_ELSEWHERE[getattr(scope, "name", ""), instruction]
        for words in texts:
            yield Row(pattern.format(words).replace("……", "…"), grave, KNOWN[instruction])


def table() -> list[str]:
    """The lines of the table."""
    head = ["| announcement | severity | what to do |", "|---|---|---|"]
    return head + [
        f"| {row.text.replace('|', '/')} | {row.severity} | {row.instruction} |" for row in rows()
    ]
