"""What an experiment claims, and how its runs will decide it: declared in its file before them.

A part of a claim is about one effect: a contrast, the weighted sum of the means of some rows. It
holds where the whole interval of the effect lies on the side of `more_than` or `less_than` that it
names, fails where it lies wholly on the other side, and is undecided otherwise.
"""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


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
        what: it says, in words.
        measure: the column of results.csv that it is about.
        share: instead: columns of successes and of failures, whose share is compared ...
        reference: ... with that of so many successes and failures elsewhere.
        contrast: the effect. Of a share: the rows.
        each: the rows of the last term count one at a time; the least effect of all decides.
        ratio: the effect is a factor: contrasts are of logarithms.
        more_than, less_than: what the effect is said to be.
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
            raise ValueError("say either more_than or less_than")
        if bool(self.measure) == bool(self.share) or (self.share and not all(self.reference)):
            raise ValueError("say either a measure or a share with its reference")
        return self


class ClaimRule(BaseModel):
    """A claim: its number, its words, and what it consists of."""

    model_config = ConfigDict(frozen=True)

    number: Annotated[int, Field(ge=1)]
    text: str
    parts: Annotated[tuple[PartRule, ...], Field(min_length=1)]
