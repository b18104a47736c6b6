"""A robot's program: publishes the steady time 20 times a second, prints what others publish.

Arguments: team file, robot, folder of its key or "-".
A line is: robot, when it published, when we received that.
"""

import sys
import time

from mocha_link import MessageStored, Node, Team

path, name, keys = sys.argv[1:]
node = Node(Team.load(path), name, keys=None if keys == "-" else keys)


def received(event):
    if isinstance(event, MessageStored) and event.robot != name:
        sent_s = node.latest(event.robot, event.topic).data.decode()
        print(event.robot, sent_s, time.monotonic(), flush=True)


node.subscribe(received)
with node:
    print("ready", flush=True)
    while True:
        node.publish("/count", str(time.monotonic()).encode())
        time.sleep(0.05)
