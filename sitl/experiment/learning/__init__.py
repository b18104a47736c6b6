"""A run as a PettingZoo environment: in each step a UAV chooses the next robot."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "decisions": ("Decision", "DecisionRun"),
        "environment": ("SeekEnvironment", "environment_of"),
    },
)
