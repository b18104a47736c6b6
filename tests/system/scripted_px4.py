"""A PX4 that acts and answers by the script of a test, over UDP; and records the orders."""

import contextlib
import socket
import threading
import time

from pymavlink.dialects.v20 import common as mavlink

from sitl.mavlink.codec import Sender

TURN_S = 0.05
COPTER, PX4 = 2, 12
CUSTOM_MODE, ARMED = 1, 128
GROUND, AIR = 1, 2
POSITION, HOLD, MISSION, LAND = 3 << 16, 0x03040000, 0x04040000, 0x06040000
LAND_NOW, SET_MODE, CHANGE_SPEED, REPOSITION, ARM_DISARM = 21, 176, 178, 192, 400
HEALTHY = 1 << 28
US = (1, 191)


class ScriptedPx4:
    """Sends the same state again and again, as a PX4 does.

    Args:
        port: Where it sends to.
        place: Latitude and longitude in degrees.
        script: Called with it and every order, on its thread.
        version: That it reports.

    Attributes:
        orders: What moves it or changes its mode, in order.
        heartbeats: How many it has sent.
        rate: Of its clock against ours.
        later: What happens once its clock shows so many milliseconds: (ms, callable).
    """

    def __init__(self, port, place, script, version=(1, 17)):
        self._to = ("127.0.0.1", port)
        self._place = tuple(round(degrees * 1e7) for degrees in place)
        self._script = script
        self._version = version
        self.mode, self.armed, self.landed = MISSION, True, AIR
        self.item, self.target, self.plan_id = 3, None, 1
        self.talks = True
        self.others = []  # (system id, component id, name, fields) that are sent beside it
        self.orders = []
        self.heartbeats = 0
        self.rate, self.later = 1.0, []
        self._clock = (time.monotonic(), 1000.0)  # our time and its own, in seconds and ms
        self._link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._packer = Sender(1)  # of what pymavlink knows without its extensions
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(TURN_S)
        self._stop = threading.Event()
        self._heartbeat_sent = threading.Condition()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def commands(self):
        """Name and number of the orders that it received."""
        return [(order.get_type(), getattr(order, "command", None)) for order in self.orders]

    def acknowledge(self, order, result, to=US):
        self.send("command_ack", order.command, result, 0, 0, *to)

    def send(self, name, *fields):
        message = getattr(self._link, f"{name}_encode")(*fields)
        self._socket.sendto(message.pack(self._link), self._to)

    def wait_for_heartbeats(self, number, limit_s=60.0):
        """So many more."""
        with self._heartbeat_sent:
            end = self.heartbeats + number
            assert self._heartbeat_sent.wait_for(lambda: self.heartbeats >= end, limit_s)

    def _run(self):
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while not self._stop.is_set():
            self.report()
            with contextlib.suppress(TimeoutError):
                for message in parser.parse_buffer(self._socket.recv(65536)) or ():
                    self._take(message)

    def _take(self, message):
        match message.get_type():
            case "COMMAND_LONG" if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
                self.acknowledge(message, 0)
                if message.param1 == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
                    zeros = bytes(8)
                    version = (self._version[0] << 24) | (self._version[1] << 16)
                    self.send(
                        "autopilot_version", 0, version, 0, 0, 0, zeros, zeros, zeros, 0, 0, 1
                    )
                if message.param1 == mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION:
                    self.send("flight_information", self.boot_ms(), 0, 0, 1)
            case "TIMESYNC" if message.tc1 == 0:
                self.send("timesync", self.boot_ms() * 1_000_000, message.ts1)
            case "COMMAND_LONG" if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.acknowledge(message, 0)
            case "COMMAND_LONG" | "COMMAND_INT" | "MISSION_SET_CURRENT":
                self.orders.append(message)
                self._script(self, message)

    def boot_ms(self):
        now_s = time.monotonic()
        since_s, boot_ms = self._clock
        self._clock = now_s, boot_ms + (now_s - since_s) * self.rate * 1e3
        return round(self._clock[1])

    def report(self):
        latitude, longitude = self._place
        boot_ms = self.boot_ms()
        for due_ms, act in list(self.later):
            if boot_ms >= due_ms:
                self.later.remove((due_ms, act))
                act()
        self.send("global_position_int", boot_ms, latitude, longitude, 40000, 30000, 0, 0, 0, 0)
        if not self.talks:
            return
        self.send("extended_sys_state", 0, self.landed)
        self.send("sys_status", 0, 0, HEALTHY, 0, 16000, 0, 90, 0, 0, 0, 0, 0, 0)
        self.send("home_position", latitude, longitude, 10000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
        plan = {"total": 12, "mission_state": 2, "mission_mode": 1, "mission_id": self.plan_id}
        self._socket.sendto(
            self._packer.pack_values("MISSION_CURRENT", {"seq": self.item} | plan), self._to
        )
        if self.target is not None:
            latitude, longitude = (round(degrees * 1e7) for degrees in self.target)
            zeros = (0.0,) * 8
            self.send(
                "position_target_global_int", boot_ms, 5, 0, latitude, longitude, 40.0, *zeros
            )
        for system, component, name, fields in self.others:
            frame = Sender(system, component).pack_values(name, fields)
            self._socket.sendto(frame, self._to)
        base_mode = CUSTOM_MODE | (ARMED if self.armed else 0)
        self.send("heartbeat", COPTER, PX4, base_mode, self.mode, 4)
        with self._heartbeat_sent:
            self.heartbeats += 1
            self._heartbeat_sent.notify_all()
