"""The pre-flight card: its checks, their verdicts, and their presentation."""

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Final

from air_router.errors import RefusedError
from air_router.words import counted


class CheckVerdict(Enum):
    """The verdict of a check."""

    GOOD = "ok"
    LOOK = "look"  # the pilot should check it
    BAD = "stop"  # prevents the take-off


GOOD, LOOK, BAD = CheckVerdict


@dataclass(frozen=True, slots=True)
class Check:
    """One check: subject, verdict, finding, advice."""

    name: str  # the first column of the card
    verdict: CheckVerdict
    found: str  # for people
    advice: str = ""  # what to do; empty: nothing

    def __str__(self) -> str:
        return f"{self.name}: {self.found}" + (f"; {self.advice}" if self.advice else "")

    def line(self, width: int, *, coloured: bool) -> str:
        """The check as text; `width`: of the first column."""
        mark = self.verdict.value.ljust(4)
        if coloured:
            mark = f"{_COLOURS[self.verdict]}{mark}{_PLAIN}"
        text = f"{mark}  {self.name.ljust(width)}  {self.found}"
        return text + (f"\n{' ' * (width + 8)}-> {self.advice}" if self.advice else "")


_COLOURS: Final = {GOOD: "\x1b[32m", LOOK: "\x1b[33m", BAD: "\x1b[31m"}
_PLAIN: Final = "\x1b[0m"


@dataclass(frozen=True, slots=True)
class Card:
    """All checks before a flight."""

    checks: tuple[Check, ...]

    @property
    def bad(self) -> tuple[Check, ...]:
        """The checks that prevent the take-off."""
        return tuple(check for check in self.checks if check.verdict is BAD)

    @property
    def ready(self) -> bool:
        """Whether no check is bad."""
        return not self.bad

    @property
    def summary(self) -> str:
        """The number of passed checks, as text."""
        total, bad = len(self.checks), len(self.bad)
        warned = sum(check.verdict is LOOK for check in self.checks)
        others = [counted(warned, "warnings")] if warned else []
        others += [f"{bad} to be fixed before the flight"] if bad else []
        passed = f"{total - warned - bad} of {total} checks passed"
        return "; ".join((passed, ", ".join(others))) if others else passed

    def lines(self, *, coloured: bool = False, all_of_them: bool = True) -> list[str]:
        """The card as lines of text; `all_of_them`: also the good checks."""
        shown = [check for check in self.checks if all_of_them or check.verdict is not GOOD]
        width = max((len(check.name) for check in shown), default=0)
        return [check.line(width, coloured=coloured) for check in shown]

    def as_json(self) -> dict[str, object]:
        """For scripts."""
        checks = [asdict(check) | {"verdict": check.verdict.value} for check in self.checks]
        return {"ready": self.ready, "checks": checks}


class PreflightRefusedError(RefusedError):
    """A check of the pre-flight card prevents the take-off."""

    def __init__(self, card: Card) -> None:
        self.card = card
        reasons = "\n".join(f"  {check}" for check in card.bad)
        super().__init__(f"not ready to fly:\n{reasons}")
