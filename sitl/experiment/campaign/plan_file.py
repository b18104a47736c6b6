"""Reads experiment files: YAML, checked, each problem told with its place (docs/experiments.md)."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Final, get_type_hints

from pydantic import BaseModel, Field, create_model

from air_router.files.settings import Timers
from mocha_link.team.document import Document, DocumentError, Problem
from sitl.experiment.campaign.claim_rules import ClaimRule
from sitl.experiment.campaign.plan import Experiment, Row, varied
from sitl.experiment.campaign.rows import phrase, rows_with
from sitl.experiment.settings import (
    ExplorerSettings,
    PaperModel,
    PathLossModel,
    Positive,
    RunSettings,
    TraceModel,
)
from sitl.experiment.shipped import (
    UnknownPlaceError,
    experiment_file,
    mission_file,
    town_file,
)

MOST_ROWS = 1000

_Name = Annotated[
    str,
    Field(
        pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$",
        description="a short word of small letters, digits, - and _",
    ),
]
_UNSET: Any = None
"""The default of what may be left out, and may not be `null`."""


def _model(name: str, kinds: Mapping[str, Any], base: type[BaseModel] = BaseModel) -> Any:
    """A model of fields that may all be left out."""
    fields: dict[str, Any] = {key: (kind, _UNSET) for key, kind in kinds.items()}
    return create_model(name, __base__=base, **fields)


def _kinds(made: type, *but: str) -> dict[str, Any]:
    """What a file may write for the fields of a dataclass."""
    hints = get_type_hints(made, include_extras=True)
    return {key: hint for key, hint in hints.items() if key not in but}


_SETTINGS: Final = _kinds(RunSettings, "keep_log") | {
    "town": str,
    "mission": str,
    "base_goals": list[str],
    "values": list[Positive],
    "explorer": _model("Explorer", _kinds(ExplorerSettings)),
    "paper": _model("Paper", _kinds(PaperModel)),
    "path_loss": _model("PathLoss", _kinds(PathLossModel)),
    "trace": create_model(
        "Trace", __base__=_model("Links", _kinds(TraceModel, "path")), path=(str, ...)
    ),
    "timers": _model("Timers", dict.fromkeys(_kinds(Timers, "hold_s"), Positive)),
}
"""What a run is made of; the names and meanings are those of `settings.RunSettings`."""

_Settings = _model("Settings", _SETTINGS)
_Row = _model("Row", {"label": Annotated[str, Field(min_length=1, max_length=60)]}, base=_Settings)
_Axes = _model(
    "Axes",
    {
        name: Annotated[GenericAlias(list, (kind,)), Field(min_length=1)]
        for name, kind in _SETTINGS.items()
    },
)


class _Model(BaseModel):
    name: _Name
    title: str
    question: str = ""
    seeds: Annotated[int, Field(ge=1, le=100_000)] = 30
    first_seed: Annotated[int, Field(ge=0, le=1_000_000_000)] = 0
    confirmation_seed: Annotated[int, Field(ge=1, le=1_000_000_000)] = 10_001
    settings: _Settings = _Settings()  # type: ignore[valid-type]  # made above
    cross: _Axes | None = None  # type: ignore[valid-type]
    rows: Annotated[list[_Row], Field(min_length=1)] | None = None  # type: ignore[valid-type]
    claims: list[ClaimRule] = []
    paired: list[str] = ["policy", "protocol", "passive"]


def load_experiment(name: str) -> tuple[Experiment, Path]:
    """Read an experiment by the name of a shipped one or by its file; also that file's path.

    Raises:
        UnknownPlaceError: there is no shipped experiment of this name.
        DocumentError: the file is wrong; with all problems.
    """
    path = experiment_file(name)
    return experiment_of(Document.load(path)), path


def experiment_of(document: Document) -> Experiment:
    """What a file says. Raises DocumentError."""
    return _Reading(document, document.parse(_Model)).experiment()


@dataclass(slots=True)
class _Reading:
    """Turns a checked file into rows and collects what is wrong with them."""

    document: Document
    model: _Model

    def experiment(self) -> Experiment:
        problems = list(self._problems())
        if problems:
            raise DocumentError(problems)
        model = self.model
        shared = _plain(model.settings)
        variants = list(self._variants())
        rows = [_merged(shared, variant) for _, variant in variants]
        for row in rows:
            row.setdefault("town", "urban")
        problems = [*self._file_problems(rows), *self._repeated(rows)]
        if problems:
            raise DocumentError(problems)
        differing = varied(rows)
        made = tuple(
            Row(label or _label(row, differing), {**row, "sources": self._sources(row)})
            for (label, _), row in zip(variants, rows, strict=True)
        )
        problems = list(self._claim_problems(made))
        if problems:
            raise DocumentError(problems)
        return Experiment(
            name=model.name,
            title=model.title,
            question=" ".join(model.question.split()),
            rows=made,
            seeds=model.seeds,
            first_seed=model.first_seed,
            confirmation_seed=model.confirmation_seed,
            claims=tuple(model.claims),
            paired=tuple(model.paired),
            varied=differing,
            folder=str(self.document.path.parent.absolute()),
        )

    def _problems(self) -> Iterator[Problem]:
        model = self.model
        if (model.rows or model.cross) is None:
            message = "write 'rows' (a list), 'cross' (lists of values to combine), or both"
            yield self.document.problem(("rows",), message, "one-rows-key")
        known = set(_SETTINGS)
        for index, name in enumerate(model.paired):
            if name not in known:
                message = f"'{name}' is no setting; remove it"
                yield self.document.problem(("paired", index), message, "unknown-word")
        if model.cross is not None:
            count = 1
            for values in _plain(model.cross).values():
                count *= len(values)
            if count > MOST_ROWS:
                message = f"{count} rows, at most {MOST_ROWS}; combine less"
                yield self.document.problem(("cross",), message, "out-of-range")

    def _claim_problems(self, rows: tuple[Row, ...]) -> Iterator[Problem]:
        for claim, rule in enumerate(self.model.claims):
            for part, said in enumerate(rule.parts):
                for index, term in enumerate(said.contrast):
                    if not rows_with(rows, term.rows):
                        keys = ("claims", claim, "parts", part, "contrast", index)
                        yield self.document.problem(keys, "no row has all of this", "unknown-word")

    def _variants(self) -> Iterator[tuple[str | None, dict[str, Any]]]:
        crossed = _plain(self.model.cross)
        axes = {key: crossed[key] for key in self.document.data.get("cross") or {}}
        for row in self.model.rows or [_Row()]:
            own = _plain(row)
            label = own.pop("label", None)
            for values in itertools.product(*axes.values()):
                combined = dict(zip(axes, values, strict=True))
                named = [label, *(_named(*each) for each in combined.items())]
                yield label and ", ".join(named), {**own, **combined}

    def _file_problems(self, rows: list[dict[str, Any]]) -> Iterator[Problem]:
        told = set()
        for index, row in enumerate(rows):
            try:
                files_of(row, self.document.path.parent)
            except UnknownPlaceError as error:
                keys = self._keys(index, error.key)
                if (keys, str(error)) not in told:
                    told.add((keys, str(error)))
                    yield self.document.problem(keys, str(error), "no-such-file")
            if row.get("channel") == "trace" and "path" not in row.get("trace", {}):
                message = "'channel: trace' needs 'trace.path', the recorded links; add it"
                yield self.document.problem(self._keys(index, "channel"), message, "missing-key")
            elif "path" in row.get("trace", {}) and not self._trace(row).is_file():
                message = f"there is no file {self._trace(row)}; correct the path"
                yield self.document.problem(self._keys(index, "trace"), message, "no-such-file")

    def _repeated(self, rows: list[dict[str, Any]]) -> Iterator[Problem]:
        labels: dict[str, int] = {}
        differing = varied(rows)
        given = [label for label, _ in self._variants()]
        for index, row in enumerate(rows):
            label = given[index] or _label(row, differing)
            if label in labels:
                message = f"row {index + 1} is called '{label}' like row {labels[label]}; "
                message += "remove it, or give it a label"
                yield self.document.problem(self._keys(index, "label"), message, "same-name")
            labels.setdefault(label, index + 1)

    def _keys(self, index: int, key: str) -> tuple[str | int, ...]:
        data = self.document.data
        if self.model.rows is not None:
            place = index * len(self.model.rows) // len(list(self._variants()))
            if key in {*data["rows"][place], "label"}:
                return ("rows", place, key)
        section = "cross" if key in (data.get("cross") or {}) else "settings"
        return (section, key)

    def _trace(self, row: Mapping[str, Any]) -> Path:
        return self.document.path.parent / str(row["trace"]["path"])

    def _sources(self, row: Mapping[str, Any]) -> dict[str, str]:
        """What the files that a row names contain, as hashes: another content is another row."""
        paths = files_of(row, self.document.path.parent)
        return {key: content_hash(path) for key, path in paths.items()}


def files_of(row: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """The files that a row's settings name: town, mission (unless there is none), trace.

    Raises:
        UnknownPlaceError: the town or the mission is not there.
    """
    town = town_file(row["town"], folder)
    mission = mission_file(row.get("mission"), town, folder)
    paths = {"town": town, **({"mission": mission} if mission is not None else {})}
    if "trace" in row:
        paths["trace"] = folder / str(row["trace"]["path"])
    return paths


def content_hash(path: Path) -> str:
    """Sixteen hexadecimal digits that change with a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _plain(model: BaseModel | None) -> dict[str, Any]:
    return model.model_dump(exclude_unset=True) if model else {}


def _merged(shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with some replaced; what is a mapping in both is merged."""
    merged = dict(shared)
    for key, value in own.items():
        before = merged.get(key)
        both = isinstance(before, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(before, value) if both else value  # type: ignore[arg-type]
    return merged


def _label(row: Mapping[str, Any], differing: tuple[str, ...]) -> str:
    """A row's name from the settings in which it differs from others."""
    return ", ".join(_named(key, row.get(key, "default")) for key in differing) or "all"


def _named(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return (key if value else f"not {key}").replace("_", " ")
    return f"{phrase(key, value)} m" if key == "radius_m" else phrase(key, value)
