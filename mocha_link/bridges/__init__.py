"""Bridges between a node and what else runs on its robot: ROS 1, ROS 2, programs with ZeroMQ.

Each is a process of its own that asks the node's service. `bridge`, `progress`, `run`, `ros1` and
`ros2` also run in the Python of a ROS installation, from 3.8 on, that has nothing of ours but
`pyzmq` (see ``__main__``); so they import no more than that.
"""
