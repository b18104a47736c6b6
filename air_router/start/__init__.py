"""Creates a first mission with team, world and example rover from a few answers."""

__all__: list[str] = []  # its commands are found by their modules' names
