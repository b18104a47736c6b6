"""The root of the package's errors; each cause has its own class in the module that finds it."""


class MochaLinkError(Exception):
    """Anything that mocha_link reports: the message says what, where, and what to do."""


class NotInTeamError(MochaLinkError):
    """A caller names what the team does not have: of a command, wrong usage."""


class RadioError(MochaLinkError):
    """A radio that cannot be used, or a report that is none."""


class PortInUseError(MochaLinkError):
    """A port that the node needs is taken by another process or node."""


class ListenError(MochaLinkError):
    """A port or address on which the node cannot listen for another reason."""
