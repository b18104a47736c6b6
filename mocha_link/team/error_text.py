"""Texts of pydantic errors for the author of a file: the mistake, and the correction."""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any

from pydantic import BaseModel, RootModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from mocha_link.sanitize import sanitize
from mocha_link.team.value_mistakes import (
    bool_advice,
    key_advice,
    list_advice,
    mapping_advice,
    number_advice,
    pair_advice,
)

Key = str | int

_WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "set_type": "a list",
    "dict_type": "a mapping (key: value)",
    "model_type": "a mapping (key: value)",
    "model_attributes_type": "a mapping (key: value)",
    "dataclass_type": "a mapping (key: value)",
}
_LIMITS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}

_PAIR = 2
_LENGTHS = {"too_short": ("at least", "min_length"), "too_long": ("at most", "max_length")}


UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls a key that a model, or a dataclass in one, has not."""

_CODES = {
    "missing": "missing-key",
    **dict.fromkeys(UNKNOWN, "unknown-key"),
    "literal_error": "unknown-word",
    "enum": "unknown-word",
    "string_pattern_mismatch": "wrong-form",
    "too_short": "wrong-length",
    "too_long": "wrong-length",
    **dict.fromkeys(_WANTED, "wrong-type"),
    **dict.fromkeys(_LIMITS, "out-of-range"),
}


def code_of(detail: ErrorDetails) -> str:
    """The code of a pydantic error; a model's own errors may be named in their `type`."""
    kind = detail["type"]
    return _CODES.get(kind, kind if "-" in kind else "invalid-value")


def as_label(key: Any) -> str:
    """A key as the text that JSON makes of it; how keys of a document are compared."""
    if isinstance(key, bool):
        return str(key).lower()
    return "null" if key is None else str(key)


def text_of_error(detail: ErrorDetails, model: type[BaseModel], written: Sequence[str] = ()) -> str:
    """One line about one pydantic error: the mistake and the correction.

    Args:
        detail: The error.
        model: What the document was to be.
        written: Of a list, its entries as they are written, if that is known.
    """
    kind, keys, found = detail["type"], detail["loc"], detail.get("input")
    context = detail.get("ctx", {})
    name = _name(keys)
    what = f"{name}: {detail['msg']}, found {_shown(found)}; change it"
    if kind == "missing":
        described = _described(model, keys)
        about = f" ({described})" if described else ""
        what = f"missing key '{keys[-1]}'{about}; add it"
    elif kind in UNKNOWN:
        known = _field_names(model, keys[:-1])
        advice = key_advice(str(keys[-1])) or _suggestion(str(keys[-1]), known)
        what = f"unknown key '{keys[-1]}'; {advice}"
    elif kind in _WANTED:
        keys_of = _field_names(model, keys) if isinstance(found, list) else set()
        advice = _advice(kind, found, keys_of)
        what = f"{name} must be {_WANTED[kind]}, found {_shown(found)}; {advice}"
    elif kind in _LIMITS:
        phrase, limit = _LIMITS[kind]
        what = f"{name} must be {phrase} {context.get(limit)}, found {_shown(found)}; change it"
    elif kind in ("literal_error", "enum"):
        choices = re.findall(r"'([^']*)'", str(context.get("expected", "")))
        what = f"{name} cannot be {_shown(found)}; {_suggestion(str(found), choices)}"
    elif kind == "string_pattern_mismatch" and (wanted := _described(model, keys)):
        what = f"{name} must be {wanted}, found {_shown(found)}; correct it"
    elif kind in ("too_short", "too_long"):
        phrase, limit = _LENGTHS[kind]
        count = context.get(limit)
        what = f"{name} must have {phrase} {count} {'entry' if count == 1 else 'entries'}, "
        advice = _length_advice(kind, count, found, written)
        what += f"found {context.get('actual_length') or 'none'}; {advice or 'change it'}"
    elif "-" in kind:  # an error of our own model; its text has the correction
        what = f"{name}: {detail['msg']}"
    elif kind == "value_error":
        what = f"{name}: {context.get('error', detail['msg'])}"
    return what


def _name(keys: Sequence[Key]) -> str:
    path = ""
    for key in keys:
        if isinstance(key, int):
            path += f"[{key}]"
        elif key != "[key]":
            path += f".{key}" if path else key
    return f"'{path}'" if path else "the document"


def _shown(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, str):
        return f"text '{value if len(value) <= 40 else value[:37] + '...'}'"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, dict):
        return "a mapping"
    label = as_label(value)
    return label if len(label) <= 40 else f"{label[:37]}..."


def _length_advice(kind: str, count: Any, found: Any, written: Sequence[str]) -> str:
    if kind != "too_long" or count != _PAIR or not isinstance(found, list):
        return ""
    return "there are brackets too many" if isinstance(found[0], list) else pair_advice(written)


def _advice(kind: str, found: Any, known: Iterable[str] = ()) -> str:
    """What to do about a value of another type; `known`: the keys that are wanted instead."""
    wanted, advice = _WANTED[kind], "correct it"
    if found is None:
        advice = "fill it in"
    elif isinstance(found, str):
        advice = _text_advice(kind, found) or advice
    elif kind == "string_type" and isinstance(found, bool | int | float):
        advice = "put it in quotes"
    elif wanted == "a list" and isinstance(found, dict):
        advice = "begin each entry with '- ', without a name"
    elif wanted.startswith("a mapping") and isinstance(found, list):
        shown = ", ".join(f"{key}: ..." for key in sorted(known)) or "name: ..."
        advice = f"write {{{shown}}}"
    elif wanted.startswith("a mapping") and isinstance(found, float):
        advice = "a place is a pair in brackets of its own, like [52.4736, 13.4017]"
    return advice


def _text_advice(kind: str, found: str) -> str:
    bare = _as_number(found) is not None and not re.search("[_ ]", found)
    if kind == "bool_type":
        quoted = found in ("true", "false")
        return "write the value without quotes" if quoted else bool_advice(found)
    if kind in ("float_type", "int_type"):
        return "write the value without quotes" if bare else number_advice(found)
    return list_advice(found) if _WANTED[kind] == "a list" else mapping_advice(found)


def _as_number(text: str) -> float | None:
    """The number in a text; None if the text is not a number."""
    try:
        return float(text)
    except ValueError:
        return None


def _suggestion(text: str, known: Iterable[str]) -> str:
    known = sorted(known)
    close = difflib.get_close_matches(text.lower(), known, n=1, cutoff=0.6)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"use one of {', '.join(known)}" if known else "remove it"


def _described(model: type[BaseModel], keys: Sequence[Key]) -> str:
    for parent in _models_at(model, keys[:-1]):
        for name, field in _fields_of(parent).items():
            if keys[-1] in (name, field.alias) and field.description:
                return field.description
    return ""


def _field_names(model: type[BaseModel], keys: Sequence[Key]) -> set[str]:
    return {
        field.alias or name
        for parent in _models_at(model, keys)
        for name, field in _fields_of(parent).items()
    }


def _fields_of(model: Any) -> dict[str, FieldInfo]:
    """The fields of a model, or of a dataclass in one; none of any other annotation."""
    if isinstance(model, type) and issubclass(model, BaseModel):
        return model.model_fields
    if isinstance(model, type) and dataclasses.is_dataclass(model):
        hints = typing.get_type_hints(model, include_extras=True)
        return {name: FieldInfo.from_annotation(hint) for name, hint in hints.items()}
    return {}


def _models_at(annotation: Any, keys: Sequence[Key]) -> Iterator[Any]:
    """The models that can stand at a key path below an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, RootModel):
        annotation = annotation.model_fields["root"].annotation
    if not keys and _fields_of(annotation):
        yield annotation
    for inner, rest in _steps(annotation, keys):
        yield from _models_at(inner, rest)


def _steps(annotation: Any, keys: Sequence[Key]) -> Iterator[tuple[Any, Sequence[Key]]]:
    """What an annotation is made of, each with the keys that are left to walk inside it."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        yield arguments[0], keys
    elif origin in (typing.Union, types.UnionType):
        for member in arguments:
            yield member, keys
            # pydantic puts the name of the tried member between the keys
            if keys and keys[0] == getattr(member, "__name__", None):
                yield member, keys[1:]
    elif origin is not None:  # a list, tuple or mapping: one step into it
        if keys:
            yield from ((item, keys[1:]) for item in arguments)
    elif keys:
        for name, field in _fields_of(annotation).items():
            if keys[0] in (name, field.alias):
                yield field.annotation, keys[1:]


def request_error_text(error: ValidationError, model: type[BaseModel]) -> str:
    """The first thing that is wrong with a request."""
    detail = error.errors(include_url=False, include_input=False)[0]
    where = sanitize(".".join(map(str, detail["loc"]))[:60])
    if detail["type"] == "extra_forbidden":
        known = (field.alias or name for name, field in model.model_fields.items())
        return f"unknown field '{where}'; use {', '.join(known)}"
    if detail["type"] == "missing":
        return f"'{where}' is missing"
    return f"'{where}': {detail['msg']}"
