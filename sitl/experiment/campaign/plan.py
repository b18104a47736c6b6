r"""What an experiment consists of: rows of settings, each run with several seeds.

A run is named by its row and its seed's number. Its seed follows from the experiment's name, the
row and that number alone, so it is the same on every machine, today and later:

    SHA-256 of "EXPERIMENT\nROW\nNUMBER", its first eight bytes as a number, halved

ROW is the JSON of those settings in which the experiment's rows differ, without the `paired`
ones, keys in alphabetical order. Rows that differ only in paired settings (the policy, say)
therefore meet the same seeds, and so the same start places and goals: their tests may be paired.

Numbers from `confirmation_seed` on are kept for confirmation: runs that answer a claim which was
declared before they were made. Whatever else is looked at comes from the exploration seeds below.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from sitl.experiment.campaign.claim_rules import ClaimRule

Settings = Mapping[str, Any]
"""A run's settings as the plain values that stand in the file."""

Record = Mapping[str, Any]
"""What is kept of a run, in plain values."""

Phase = Literal["exploration", "confirmation"]
"""What a run is for. One table is made of runs of one phase only."""


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
    """One run that is to be made: plain values, so it can travel to any process or machine.

    Paths in the settings count from `folder`; `rules` are those by which the run will be judged.
    """

    experiment: str
    row: Row
    number: int
    seed: int
    folder: str = "."
    phase: Phase = "exploration"
    rules: str = ""

    @property
    def name(self) -> str:
        """How the run is called in messages."""
        return f"{self.row.label}, seed {self.number}"


@dataclass(frozen=True, slots=True)
class Experiment:
    """Rows that are compared, and how often each is run.

    Attributes:
        name: short, for folders and seeds.
        title: one line for people.
        question: what it is to answer.
        rows: in the order of the table.
        seeds: how many runs of each row, unless the command line says otherwise.
        first_seed: the number of each row's first run, unless the command line says otherwise.
        confirmation_seed: from this number on runs are for confirmation.
        claims: what its runs are to decide, and how.
        paired: settings that do not go into the seed.
        varied: the settings in which rows differ, in the file's order.
        folder: where its file is.
    """

    name: str
    title: str
    question: str
    rows: tuple[Row, ...]
    seeds: int
    first_seed: int = 0
    confirmation_seed: int = 10_001
    claims: tuple[ClaimRule, ...] = ()
    paired: tuple[str, ...] = ()
    varied: tuple[str, ...] = ()
    folder: str = "."

    @property
    def rules(self) -> str:
        """Twelve hexadecimal digits that change with any claim."""
        declared = canonical([claim.model_dump(mode="json") for claim in self.claims])
        return hashlib.sha256(declared.encode()).hexdigest()[:12]

    def seed(self, row: Row, number: int) -> int:
        """The seed of a row's run."""
        kept = {k: row.settings.get(k) for k in self.varied if k not in self.paired}
        return seed_of(self.name, canonical(kept), number)

    def task(self, row: Row, number: int) -> Task:
        """A row's run."""
        seed, phase = self.seed(row, number), self.phase(number)
        return Task(self.name, row, number, seed, self.folder, phase, self.rules)

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


def seeds_of(records: Sequence[Record]) -> str:
    """Which seeds runs were made with, in words: `exploration seeds 0 to 29`."""
    numbers = [record["number"] for record in records]
    return f"{records[0]['phase']} seeds {min(numbers)} to {max(numbers)}"


def seed_of(experiment: str, row: str, number: int) -> int:
    """The seed of a run; see the module for the rule. Between 0 and 2^63."""
    digest = hashlib.sha256(f"{experiment}\n{row}\n{number}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def canonical(values: Mapping[str, Any] | Sequence[Any]) -> str:
    """Plain values as JSON that is the same wherever it is written."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def varied(rows: Iterable[Settings]) -> tuple[str, ...]:
    """The settings in which rows differ, in the order in which they come."""
    rows = list(rows)
    keys = dict.fromkeys(key for row in rows for key in row)
    return tuple(k for k in keys if len({canonical({k: row.get(k)}) for row in rows}) > 1)
