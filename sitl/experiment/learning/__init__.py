"""A run as an environment of PettingZoo: a step is a decision whom a UAV seeks next."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "decisions": ("Decision", "DecisionRun"),
        "environment": ("SeekEnvironment", "environment_of"),
    },
)
