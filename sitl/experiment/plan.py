"""What an experiment consists of: rows of settings, each run with several seeds, and its claims.

A run is named by its row and its seed's number. Its seed follows from the experiment's name, the
row and that number alone, so it is the same on every machine, today and later. Of the row those
settings count in which rows differ, without the `paired` ones: rows that differ only in paired
settings (the policy, for example) meet the same start places and goals, and their runs are pairs.

Numbers from `confirmation_seed` on are kept for confirmation: runs that answer a claim which was
declared before they were made. Whatever else is looked at comes from the exploration seeds below.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, model_validator

from air_router.errors import UsageError
from air_router.words import counted
from sitl.experiment.settings import Prior, draw, value_of, with_setting

Settings = Mapping[str, Any]
"""A run's settings as the plain values that stand in the file."""

Record = Mapping[str, Any]
"""What is kept of a run, in plain values."""

Phase = Literal["exploration", "confirmation"]
"""What a run is for. One table is made of runs of one phase only."""


class NoSuchRowError(UsageError):
    """No row of the experiment is meant."""


class Term(BaseModel):
    """Some rows of a contrast, which share a weight.

    Attributes:
        weight: of the mean over these rows.
        rows: settings that they have; a list names several values.
    """

    model_config = ConfigDict(frozen=True)

    weight: float = 1.0
    rows: dict[str, Any] = {}


class PartRule(BaseModel):
    """One statement of a claim.

    Attributes:
        what: its text.
        measure: the column of results.csv that it is about.
        share: instead: columns of successes and of failures, whose share is compared ...
        reference: ... with that of so many successes and failures elsewhere.
        contrast: the effect. Of a share: the rows.
        each: the rows of the last term count one at a time; the least effect of all decides.
        ratio: the effect is a factor: contrasts are of logarithms.
        more_than, less_than: bounds of the claimed effect.
    """

    model_config = ConfigDict(frozen=True)

    what: str
    measure: str = ""
    share: tuple[str, str] | None = None
    reference: tuple[int, int] = (0, 0)
    contrast: Annotated[tuple[Term, ...], Field(min_length=1)]
    each: bool = False
    ratio: bool = False
    more_than: float | None = None
    less_than: float | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.more_than is None) == (self.less_than is None):
            raise ValueError("set either more_than or less_than")
        if bool(self.measure) == bool(self.share) or (self.share and not all(self.reference)):
            raise ValueError("set either a measure or a share with its reference")
        return self


class ClaimRule(BaseModel):
    """A claim: its number, its text, and its parts."""

    model_config = ConfigDict(frozen=True)

    number: Annotated[int, Field(ge=1)]
    text: str
    parts: Annotated[tuple[PartRule, ...], Field(min_length=1)]


@dataclass(frozen=True, slots=True)
class Row:
    """One configuration of an experiment.

    Attributes:
        label: what it is called; no two rows of an experiment have the same.
        settings: all that a run needs but its seed, in plain values.
    """

    label: str
    settings: Settings = field(hash=False)

    @property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits that change with any setting."""
        return hashlib.sha256(canonical(self.settings).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Task:
    """One run that is to be made: plain values, so it can travel to other processes.

    Paths in the settings count from `folder`; `rules` are those by which the run will be judged,
    `declaration` is the SHA-256 of the file that has them.
    """

    experiment: str
    row: Row
    number: int
    seed: int
    folder: str = "."
    phase: Phase = "exploration"
    rules: str = ""
    declaration: str = ""

    @property
    def name(self) -> str:
        """How the run is called in messages."""
        return f"{self.row.label}, seed {self.number}"

    @property
    def key(self) -> tuple[str, int]:
        """What distinguishes it from the other runs of its experiment."""
        return self.row.label, self.number

    @property
    def identity(self) -> dict[str, Any]:
        """What is the same in a record of this very run."""
        return {
            "experiment": self.experiment,
            "row": self.row.label,
            "number": self.number,
            "phase": self.phase,
            "seed": self.seed,
            "fingerprint": self.row.fingerprint,
        }


class StopRule(BaseModel):
    """What may end a campaign before all declared runs are made: a clock, and no result.

    Attributes:
        begin_before: no seed number is begun at this time or later; one that was begun is made
            whole.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    begin_before: AwareDatetime


class Header(BaseModel):
    """An experiment's file without its rows.

    Attributes:
        name: short, for folders and seeds.
        title: one line for people.
        question: what it is to answer.
        seeds: how many runs of each row, unless the command line has another number.
        first_seed: the number of each row's first run, unless the command line has another one.
        confirmation_seed: from this number on runs are for confirmation.
        claims: what its runs are to decide, and how.
        space: settings that every run draws by its seed: between two numbers, or one of a list.
            `explorer.progress` is one within another.
        paired: settings that do not go into the seed.
        stop: what ends confirmation runs early.
        relevant: where seed numbers are scenarios, the smallest difference of the primary outcome
            that counts, in points.
    """

    model_config = ConfigDict(frozen=True)

    name: Annotated[
        str,
        Field(
            pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$",
            description="a short word of small letters, digits, - and _",
        ),
    ]
    title: str
    question: str = ""
    seeds: Annotated[int, Field(ge=1, le=100_000)] = 30
    first_seed: Annotated[int, Field(ge=0, le=1_000_000_000)] = 0
    confirmation_seed: Annotated[int, Field(ge=1, le=1_000_000_000)] = 10_001
    claims: tuple[ClaimRule, ...] = ()
    space: dict[str, Annotated[Prior, Field(union_mode="left_to_right")]] = {}
    paired: tuple[str, ...] = ("policy", "protocol", "passive")
    stop: StopRule | None = None
    relevant: Annotated[float, Field(gt=0)] = 1.0


class Experiment(Header):
    """Rows that are compared, and how often each is run.

    Attributes:
        rows: in the order of the table.
        varied: the settings in which rows differ, in the file's order.
        folder: where its file is.
        declaration: SHA-256 of its file; empty: it is not known.
    """

    rows: tuple[Row, ...]
    varied: tuple[str, ...]
    folder: str
    declaration: str = ""

    @property
    def rules(self) -> str:
        """Twelve hexadecimal digits that change with any claim, what is drawn, or what stops it."""
        plain = self.model_dump(mode="json", include={"claims", "space", "stop"})
        more = [plain[key] for key in ("space", "stop") if plain[key]]
        declared = canonical([*plain["claims"], *more])
        return hashlib.sha256(declared.encode()).hexdigest()[:12]

    def seed(self, row: Row, number: int) -> int:
        """The seed of a row's run: between 0 and 2^63, by the rule that the module states."""
        kept = {k: row.settings.get(k) for k in self.varied if k not in self.paired}
        digest = hashlib.sha256(f"{self.name}\n{canonical(kept)}\n{number}".encode()).digest()
        return int.from_bytes(digest[:8], "big") >> 1

    def task(self, row: Row, number: int) -> Task:
        """A row's run, with what it draws."""
        seed, phase = self.seed(row, number), self.phase(number)
        settings = row.settings
        for key, prior in self.space.items():
            chance = random.Random(f"{seed} {key}")  # noqa: S311 - repeatable on purpose
            settings = with_setting(settings, key, draw(prior, chance))
        row = Row(row.label, settings)
        rules, file = self.rules, self.declaration
        return Task(self.name, row, number, seed, self.folder, phase, rules, file)

    def phase(self, number: int) -> Phase:
        """What the runs with a seed's number are for."""
        return "exploration" if number < self.confirmation_seed else "confirmation"

    def called(self, phase: Phase) -> str:
        """The name of its runs of a phase, for folders and documents."""
        return self.name if phase == "exploration" else f"{self.name}-{phase}"

    def tasks(self, numbers: Iterable[int]) -> Iterator[Task]:
        """All runs: every row once, then every row again, so that a part is a fair part."""
        for number in numbers:
            yield from (self.task(row, number) for row in self.rows)

    def chosen(self, choices: Iterable[str]) -> tuple[Row, ...]:
        """The rows for which all `key=value[,value]` hold, and whose label fits a pattern.

        Raises:
            NoSuchRowError: a choice fits no row.
        """
        rows, patterns = self.rows, []
        for choice in choices:
            key, equals, values = choice.partition("=")
            if not equals:
                patterns.append(choice)
                continue
            written = {row: _written(row, key) for row in self.rows}
            if not any(written.values()):
                raise NoSuchRowError(f"no row has {choice}; '{key}' is no setting of these rows")
            rows = tuple(row for row in rows if written[row] in values.split(","))
            if not rows:
                among = ", ".join(dict.fromkeys(written.values()))
                raise NoSuchRowError(f"no row has {choice}; '{key}' is one of {among}")
        if patterns:
            rows = tuple(r for r in rows if any(fnmatch.fnmatchcase(r.label, p) for p in patterns))
        if not rows:
            labels = "', '".join(row.label for row in self.rows)
            raise NoSuchRowError(f"no row fits {' or '.join(patterns)}; there are '{labels}'")
        return rows


def seeds_of(records: Sequence[Record]) -> str:
    """The seeds of runs, as text: `exploration seeds 0 to 29`."""
    numbers = [record["number"] for record in records]
    return f"{records[0]['phase']} seeds {min(numbers)} to {max(numbers)}"


def canonical(values: Mapping[str, Any] | Sequence[Any]) -> str:
    """Plain values as JSON that is the same wherever it is written."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def varied(rows: Iterable[Settings]) -> tuple[str, ...]:
    """The settings in which rows differ, in the order in which they come."""
    rows = list(rows)
    keys = dict.fromkeys(key for row in rows for key in row)
    return tuple(k for k in keys if len({canonical({k: row.get(k)}) for row in rows}) > 1)


def rows_with(rows: Iterable[Row], settings: Settings) -> list[Row]:
    """The rows that have these settings; a list names several values."""
    wanted = {key: own if isinstance(own, list) else [own] for key, own in settings.items()}
    return [
        row
        for row in rows
        if all(value_of(flat(row.settings), key) in own for key, own in wanted.items())
    ]


# Settings as text, for labels, legends and tables.

_COUNTS: Final = {"uavs": "UAVs", "ugvs": "UGVs"}


def flat(settings: Settings) -> dict[str, Any]:
    """Settings without mappings in them: `timers.init_s`; where they come from is left out."""
    result: dict[str, Any] = {}
    for key, value in settings.items():
        if not isinstance(value, Mapping):
            result[key] = value
        elif key != "sources":
            result |= {f"{key}.{inner}": own for inner, own in value.items()}
    return result


def settings_text(settings: Settings, keys: Iterable[str]) -> str:
    """Some settings as text for labels; those without a value are left out."""
    parts = []
    for key in keys:
        value = settings.get(key)
        if value is None:
            continue
        shown = phrase(key, value)
        if key == "passive":
            shown = "passive" if value else "seeking"
        parts.append(f"radius {shown} m" if key == "radius_m" else shown)
    return ", ".join(parts)


def phrase(key: str, value: Any) -> str:
    """One setting's value, without a name or a unit unless it counts something."""
    if key in _COUNTS:
        return counted(value, _COUNTS[key])
    inner = flat(value).values() if isinstance(value, Mapping) else [value]
    return " ".join(map(value_text, inner)).replace("_", " ")


def _written(row: Row, key: str) -> str:
    """What a row has of a setting, as files write it; `timers.init_s` is one within another."""
    value = value_of(flat(row.settings), key)
    return str(value).lower() if isinstance(value, bool) else value_text(value)


def value_text(value: Any) -> str:
    """A setting's value as it is written, without trailing zeros."""
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
