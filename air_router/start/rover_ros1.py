"""A rover with types of ROS 1, without a ROS: publishes its GPS fix, and fetches the UAV's map."""

import sys
import time

from mocha_link.ros import RosCodec
from mocha_link.service import ServiceClient

latitude, longitude = map(float, sys.argv[2].split(","))
codec = RosCodec()
with ServiceClient(sys.argv[1], timeout_s=60) as node:  # where its gossip node serves
    while True:
        header = {"stamp": {"sec": int(time.time())}, "frame_id": "gps"}
        fix = {"header": header, "latitude": latitude, "longitude": longitude}
        node.publish("/fix", codec.encode("sensor_msgs/NavSatFix", fix, ros=1))
        found = node.latest("titan", "/occupancy", ros=1)
        grid = codec.decode("nav_msgs/OccupancyGrid", found[1], ros=1) if found else None
        print("has a map of", 0 if grid is None else len(grid.data), "cells", flush=True)
        time.sleep(1)
