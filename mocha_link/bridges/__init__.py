"""Bridges between a node and the ROS 1 or ROS 2 of its robot.

Each is a process of its own, a client of the node's service. `bridge`, `run` and
`ros_clients` also run in the Python of a ROS installation, from 3.8 on, that has nothing of ours
but `pyzmq` (see ``__main__``); so they import no more than that.
"""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "bridge": ("channel",),
        "dds": ("Dds",),
    },
    modules=("run",),
)
