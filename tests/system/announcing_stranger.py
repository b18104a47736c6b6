"""Announces a robot by mDNS at an address of its own, where it takes connections and sends nothing.

Arguments: team file, robot, the peer whose connections it takes, its own address.
"""

import socket
import sys

from zeroconf import ServiceInfo, Zeroconf

from mocha_link import Team

path, name, peer, host = sys.argv[1:]
robot = Team.load(path).robot(name)
listener = socket.create_server((host, robot.port_for(peer)))
held = []
service = "_mocha-link._tcp.local."
info = ServiceInfo(
    service,
    f"stranger.{service}",
    addresses=[socket.inet_aton(host)],
    port=robot.base_port,
    properties={"robot": name, "key": robot.key or ""},
    server="stranger.local.",
)
with Zeroconf(interfaces=[host]) as daemon:
    daemon.register_service(info)
    print("ready", flush=True)
    while True:
        held.append(listener.accept())
        print("taken", flush=True)
