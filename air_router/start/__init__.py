"""A first mission with its team, world and rover, made from a few answers."""

__all__: list[str] = []  # its commands are found by their modules' names
