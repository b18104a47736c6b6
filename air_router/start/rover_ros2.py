"""A rover with types of ROS 2 on DDS, without a ROS: publishes odometry, fetches the UAV's map."""

import sys
import time

from mocha_link.bridges import Dds
from mocha_link.ros import RosCodec

x, y = map(float, sys.argv[2].split(","))  # metres from the datum
codec, dds = RosCodec(), Dds({}, domain=int(sys.argv[1]))
ODOMETRY, GRID = "nav_msgs/Odometry", "nav_msgs/OccupancyGrid"


def show(data):
    """Take a map of the UAV's."""
    print("has a map of", len(codec.decode(GRID, data, ros=2).data), "cells", flush=True)


dds.subscribe("/titan/occupancy", GRID, 1, show)
while True:
    header = {"stamp": {"sec": int(time.time())}, "frame_id": "map"}
    odometry = {"header": header, "pose": {"pose": {"position": {"x": x, "y": y}}}}
    dds.publish("/odom", ODOMETRY, 1, codec.encode(ODOMETRY, odometry, ros=2))
    time.sleep(1)
