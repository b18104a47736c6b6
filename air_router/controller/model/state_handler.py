"""What the vehicle flies in a state of the mission, and what it does on the way."""

from __future__ import annotations

from typing import Final, Protocol


class Journey(Protocol):
    """Asked while its state lasts, and never in another; how it begins, each has its own way."""

    def arrived(self) -> None:
        """The vehicle is where it was sent; said again as long as it stays there."""

    def stranded(self, refusal: str) -> None:
        """No clear way leads there from here, and why."""

    def try_again(self) -> None:
        """The pause is over after something that could not be done."""

    def fly_on(self) -> None:
        """Other zones count from now on, and nothing was commanded meanwhile: plan anew."""


class NoJourney:
    """That of states in which the vehicle is on the ground, or not ours to command."""

    def arrived(self) -> None:
        """Nothing."""

    def stranded(self, refusal: str) -> None:
        """Nothing."""

    def try_again(self) -> None:
        """Nothing."""

    def fly_on(self) -> None:
        """Nothing."""


NO_JOURNEY: Final = NoJourney()
