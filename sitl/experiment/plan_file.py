"""Reads experiment files: YAML, checked, problems with places (docs/evidence/experiments.md).

Experiments, towns and missions that come with the program are known by a name; others by a path.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Final

from pydantic import BaseModel, Field, ValidationError, create_model

from air_router.errors import UsageError
from mocha_link.team import Document, DocumentError, Problem
from sitl.experiment.plan import Experiment, Header, Row, phrase, rows_with, varied
from sitl.experiment.settings import RunSettings, with_setting

MOST_ROWS: Final = 1000

_HERE: Final = Path(__file__).parent
_PLANS: Final = _HERE / "plans"


class _Row(RunSettings):
    label: Annotated[str, Field(min_length=1, max_length=60)] = ""


_LISTS: Final[dict[str, Any]] = {
    name: (GenericAlias(list, (kind.rebuild_annotation(),)), Field([], min_length=1))
    for name, kind in RunSettings.model_fields.items()
}
_Axes: Final = create_model("_Axes", **_LISTS)  # lists of what a row may have


class _File(Header):
    settings: RunSettings = RunSettings()
    cross: _Axes | None = None  # type: ignore[valid-type]  # made above
    rows: Annotated[list[_Row], Field(min_length=1)] | None = None


class UnknownPlaceError(UsageError):
    """No shipped file has this name, and no file is there; `key` is the setting that names it."""

    def __init__(self, message: str, key: str = "") -> None:
        super().__init__(message)
        self.key = key


def experiment_names() -> list[str]:
    """The experiments that come with the program."""
    return sorted(path.stem for path in _PLANS.glob("*.yaml"))


def load_experiment(name: str) -> tuple[Experiment, Path]:
    """Read an experiment by the name of a shipped one or by its file; also that file's path.

    Raises:
        UnknownPlaceError: there is no shipped experiment of this name.
        DocumentError: the file is wrong; with all problems.
    """
    path = _PLANS / f"{name}.yaml" if name in experiment_names() else Path(name)
    if _is_name(name) and not path.is_file():
        raise UnknownPlaceError(
            f"there is no experiment '{name}'; give a file, or one of "
            f"{', '.join(experiment_names())}"
        )
    experiment = experiment_of(Document.load(path))
    declaration = hashlib.sha256(path.read_bytes()).hexdigest()
    return experiment.model_copy(update={"declaration": declaration}), path


def experiment_of(document: Document) -> Experiment:
    """The experiment in a file. Raises DocumentError."""
    return _Reading(document, document.parse(_File)).experiment()


@dataclass(slots=True)
class _Reading:
    """Turns a checked file into rows and collects what is wrong with them."""

    document: Document
    model: _File

    def experiment(self) -> Experiment:
        _refuse(self._problems())
        model, folder = self.model, self.document.path.parent
        shared = _plain(model.settings)
        variants = list(self._variants())
        rows = [_merged(shared, variant) for _, variant in variants]
        for row in rows:
            row.setdefault("town", "urban")
        differing = varied(rows)
        labels = [
            label or ", ".join(_named(key, row.get(key, "default")) for key in differing) or "all"
            for (label, _), row in zip(variants, rows, strict=True)
        ]
        _refuse(itertools.chain(self._file_problems(rows), self._repeated(labels)))
        made = tuple(
            Row(label, {**row, "sources": sources(row, folder)})
            for label, row in zip(labels, rows, strict=True)
        )
        _refuse(self._claim_problems(made))
        header = {name: getattr(model, name) for name in Header.model_fields}
        return Experiment(**header, rows=made, varied=differing, folder=str(folder.absolute()))

    def _problems(self) -> Iterator[Problem]:
        model = self.model
        if (model.rows or model.cross) is None:
            message = "write 'rows' (a list), 'cross' (lists of values to combine), or both"
            yield self.document.problem(("rows",), message, "one-rows-key")
        for index, name in enumerate(model.paired):
            if name not in RunSettings.model_fields:
                message = f"'{name}' is no setting; remove it"
                yield self.document.problem(("paired", index), message, "unknown-word")
        for key, prior in model.space.items():
            try:
                for value in prior if isinstance(prior, list) else (prior.low, prior.high):
                    RunSettings.model_validate(with_setting({}, key, value))
            except ValidationError as error:
                message = f"{key}: {error.errors()[0]['msg']}"
                yield self.document.problem(("space", key), message, "out-of-range")
        count = math.prod(map(len, _plain(model.cross).values()))
        if count > MOST_ROWS:
            message = f"{count} rows, at most {MOST_ROWS}; combine less"
            yield self.document.problem(("cross",), message, "out-of-range")

    def _variants(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Each row's label, if it was given one, and its own settings."""
        crossed = _plain(self.model.cross)
        axes = {key: crossed[key] for key in self.document.data.get("cross") or {}}
        for row in self.model.rows or [_Row()]:
            own = _plain(row)
            label = own.pop("label", "")
            for values in itertools.product(*axes.values()):
                combined = dict(zip(axes, values, strict=True))
                named = [label, *(_named(*each) for each in combined.items())]
                yield label and ", ".join(named), {**own, **combined}

    def _file_problems(self, rows: list[dict[str, Any]]) -> Iterator[Problem]:
        missing: dict[tuple[tuple[str | int, ...], str], None] = {}
        for index, row in enumerate(rows):
            try:
                files_of(row, self.document.path.parent)
            except UnknownPlaceError as error:
                missing[self._keys(index, len(rows), error.key), str(error)] = None
        yield from (self.document.problem(*problem, "no-such-file") for problem in missing)

    def _repeated(self, labels: list[str]) -> Iterator[Problem]:
        for index, label in enumerate(labels):
            first = labels.index(label)
            if first < index:
                message = f"row {index + 1} is called '{label}' like row {first + 1}; "
                message += "remove it, or give it a label"
                yield self.document.problem(
                    self._keys(index, len(labels), "label"), message, "same-name"
                )

    def _claim_problems(self, rows: tuple[Row, ...]) -> Iterator[Problem]:
        for claim, rule in enumerate(self.model.claims):
            for number, part in enumerate(rule.parts):
                for index, term in enumerate(part.contrast):
                    if not rows_with(rows, term.rows):
                        keys = ("claims", claim, "parts", number, "contrast", index)
                        yield self.document.problem(keys, "no row has all of this", "unknown-word")

    def _keys(self, index: int, count: int, key: str) -> tuple[str | int, ...]:
        """Where in the file a setting of one of so many rows stands."""
        data = self.document.data
        if self.model.rows is not None:
            place = index * len(self.model.rows) // count
            if key in {*data["rows"][place], "label"}:
                return ("rows", place, key)
        return ("cross" if key in (data.get("cross") or {}) else "settings", key)


def _refuse(problems: Iterable[Problem]) -> None:
    if found := list(problems):
        raise DocumentError(found)


def files_of(row: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """The files that a row's settings name: the town, and the mission unless there is none.

    Without a name the mission is the `mission.yaml` beside the town's file.

    Raises:
        UnknownPlaceError: one of them is not there.
    """
    town = _place(row["town"], folder, "town")
    name = row.get("mission")
    mission = town.with_name("mission.yaml") if name is None else _place(name, folder, "mission")
    return {"town": town, **({"mission": mission} if mission.is_file() else {})}


def sources(row: Mapping[str, Any], folder: Path) -> dict[str, str]:
    """What the files that a row names contain, as hashes: another content is another row.

    Raises:
        UnknownPlaceError: one of them is not there.
    """
    paths = files_of(row, folder)
    return {key: hashlib.sha256(path.read_bytes()).hexdigest()[:16] for key, path in paths.items()}


def _place(name: str, folder: Path, key: str) -> Path:
    if not _is_name(name):
        path = folder / name
        if not path.is_file():
            raise UnknownPlaceError(f"there is no file {path}; correct the path", key)
        return path
    # In the installed package, or beside it in a checkout.
    roots = [root for root in (_HERE / "missions", _HERE.parents[1] / "missions") if root.is_dir()]
    shipped = {
        path.parent.name: path for root in roots[::-1] for path in root.glob(f"*/{key}.yaml")
    }
    if name not in shipped:
        raise UnknownPlaceError(
            f"there is no {key} '{name}'; give a path, or one of {', '.join(sorted(shipped))}", key
        )
    return shipped[name]


def _is_name(name: str) -> bool:
    return "/" not in name and not name.endswith((".yaml", ".yml"))


def _plain(model: BaseModel | None) -> dict[str, Any]:
    """The fields of a model that its file sets, as plain values."""
    return model.model_dump(mode="json", exclude_unset=True) if model else {}


def _merged(shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with some replaced; what is a mapping in both is merged."""
    merged = dict(shared)
    for key, value in own.items():
        before = merged.get(key)
        both = isinstance(before, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(before, value) if both else value  # type: ignore[arg-type]
    return merged


def _named(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return (key if value else f"not {key}").replace("_", " ")
    return f"{phrase(key, value)} m" if key == "radius_m" else phrase(key, value)
