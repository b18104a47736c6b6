"""A rover in plain Python: publishes its position, and fetches the UAV's map."""

import json
import sys
import time

import zmq

latitude_deg, longitude_deg = map(float, sys.argv[2].split(","))
node = zmq.Context().socket(zmq.REQ)
node.connect(sys.argv[1])  # where its gossip node serves
while True:
    pose = {"stamp_s": time.time(), "latitude_deg": latitude_deg, "longitude_deg": longitude_deg}
    node.send_multipart([b'{"request": "publish", "topic": "/pose"}', json.dumps(pose).encode()])
    print("position published", node.recv_json()["ok"])
    node.send_json({"request": "latest", "robot": "titan", "topic": "/map"})
    about, *grid = node.recv_multipart()
    print("has a map of", sum(map(len, grid)), "bytes", flush=True)
    time.sleep(1)
