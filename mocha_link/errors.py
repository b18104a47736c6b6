"""The root of the package's errors; each cause has its own class in the module that finds it."""


class MochaLinkError(Exception):
    """Anything that mocha_link reports: the message says what, where, and what to do."""


class UsageError(MochaLinkError):
    """Somebody asks for what the team does not have: of a command, wrong usage."""
