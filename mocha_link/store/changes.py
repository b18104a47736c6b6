"""What is to be written to a database's file, and the transactions in which it is."""

from __future__ import annotations

from dataclasses import dataclass, field

from mocha_link.store.record import Knowledge, Record

PIECE_BYTES = 1024 * 1024  # in the journal, about: a larger transaction makes a larger journal
_ROW_BYTES = 64  # of a record beside its body
_DROP_BYTES = 2048  # a page of the file has at least two rows, mostly many


@dataclass(slots=True)
class Changes:
    """Messages, and numbers of those that are dropped; one may be dropped and then put anew."""

    drops: dict[int, int] = field(default_factory=dict)  # topic keys by the records' numbers
    puts: dict[int, Record] = field(default_factory=dict)  # by number
    knowledge: dict[str, Knowledge] = field(default_factory=dict)

    def put_back(self, earlier: Changes) -> None:
        """Take in what was to be written before and was not."""
        for number in earlier.puts.keys() - self.drops.keys():
            self.puts[number] = earlier.puts[number]
        self.drops |= earlier.drops
        self.knowledge = earlier.knowledge | self.knowledge

    def pieces(self, most_bytes: int = PIECE_BYTES) -> list[Changes]:
        """The same as transactions of bounded size, mostly one; a large body is a larger one.

        Whichever of them was the last before a crash, nothing is lost: messages go together with
        the last one that has replaced them, and what a peer has brought is there before it counts
        as known.
        """
        if self.drops.keys() & self.puts.keys():  # another file: its messages get other numbers
            return [self]
        pieces, room = [Changes()], most_bytes
        drops: dict[int, list[int]] = {}  # numbers by topic key
        for number, key in sorted(self.drops.items()):
            drops.setdefault(key, []).append(number)
        numbers = sorted(self.puts)
        last = {self.puts[number].header.key: number for number in numbers}
        for number in numbers:
            record = self.puts[number]
            key = record.header.key
            gone = drops.pop(key, []) if last[key] == number else []
            size = _ROW_BYTES + len(record.body) + _DROP_BYTES * len(gone)
            if size > room and room < most_bytes:
                pieces.append(Changes())
                room = most_bytes
            pieces[-1].puts[number] = record
            pieces[-1].drops.update(dict.fromkeys(gone, key))
            room -= size
        for key, gone in drops.items():
            for number in gone:
                if room < _DROP_BYTES:
                    pieces.append(Changes())
                    room = most_bytes
                pieces[-1].drops[number] = key
                room -= _DROP_BYTES
        pieces[-1].knowledge = dict(self.knowledge)
        return pieces

    def settle(self, piece: Changes) -> None:
        """Take out what has been written."""
        for number in piece.drops.keys() | piece.puts.keys():
            self.drops.pop(number, None)
            self.puts.pop(number, None)
        for peer in tuple(piece.knowledge):
            del self.knowledge[peer]
