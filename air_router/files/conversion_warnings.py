"""What a file format cannot say of a mission: told when the mission is written into it."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, order=True)
class ConversionWarning:
    """Something that was not carried over.

    Attributes:
        what: What of the mission, in words.
        message: What became of it.
        code: The same for programs.
    """

    what: str
    message: str
    code: str

    def __str__(self) -> str:
        return f"{self.what}: {self.message} [{self.code}]"


@dataclass(slots=True)
class ConversionWarnings:
    """The losses of one conversion, each told once."""

    entries: list[ConversionWarning] = field(default_factory=list)  # in the order of their finding

    def add(self, what: str, message: str, code: str) -> None:
        """Note a loss."""
        loss = ConversionWarning(what, message, code)
        if loss not in self.entries:
            self.entries.append(loss)
