"""Public API for ground robots' policies of other packages: where an exploring robot drives.

A policy is a class that can be made without arguments, with `choose` (`RobotPolicy`), registered
as an entry point of the group `sitl.robot_policies`, or named by an experiment or a world file as
`package.module:Class`:

    explorer: {policy: "my_robots:ComesBack"}      # an experiment's settings
    explore: {town: town.yaml, policy: ...}        # a world file

`python -m sitl.robot_policies` prints one to begin with (`template.py`); `testing` has the contract
as checks for its tests.
"""

from sitl.world.explorers import (
    POLICY_TOPIC,
    Drive,
    Received,
    RobotPolicy,
    RobotPolicyError,
    RobotView,
)

__all__ = [
    "POLICY_TOPIC",
    "Drive",
    "Received",
    "RobotPolicy",
    "RobotPolicyError",
    "RobotView",
]
