"""What a robot with an original node does, by rospy: publishes, triggers, reads the database.

Runs under the Python that has rospy; one JSON request per line on stdin, one reply on stdout.
"""

import base64
import io
import json
import random
import sys

import mocha_core.srv
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from sensor_msgs.msg import Image, NavSatFix
from std_msgs.msg import Int32, String, Time

done = []  # pulls that this robot has ended


def pose(number):
    message = PoseStamped()
    message.header.frame_id = "map"
    message.header.stamp = rospy.Time.now()
    message.pose.position.x = number
    message.pose.orientation.w = 1
    return message


def make(kind, size):
    if kind == "geometry_msgs/PoseStamped":
        return pose(size)
    if kind == "std_msgs/String":
        return String("a text, " * size)
    if kind == "sensor_msgs/NavSatFix":
        message = NavSatFix()
        message.latitude, message.longitude, message.altitude = 39.94, -75.2, size
    elif kind == "sensor_msgs/Image":
        message = Image()
        message.width = message.height = size
        message.step, message.encoding = size, "mono8"
        message.data = bytes((7919 * cell) % 251 for cell in range(size * size))
    elif kind == "nav_msgs/Path":
        message = Path()
        message.poses = [pose(number) for number in range(size)]
    else:
        message = OccupancyGrid()
        message.info.width = message.info.height = size
        message.info.resolution = 0.5
        message.data = random.Random(size).choices(range(101), k=size * size)  # hard to pack
    message.header = pose(0).header
    return message


def serialized(message):
    stream = io.BytesIO()
    message.serialize(stream)
    return base64.b64encode(stream.getvalue()).decode()


class Robot:
    def __init__(self):
        self.publishers = {}
        self.select = rospy.ServiceProxy("/integrate_database/SelectDB", mocha_core.srv.SelectDB)
        self.get = rospy.ServiceProxy(
            "/integrate_database/GetDataHeaderDB", mocha_core.srv.GetDataHeaderDB
        )

    def ready(self, peer):
        """Whether the node, its translator and its trigger are there."""
        services = [self.select, self.get]
        for each in services:
            each.wait_for_service(60)
        rospy.Subscriber(f"/ddb/client_sync_complete/{peer}", Time, done.append)
        self.rssi = rospy.Publisher(f"/ddb/rajant/rssi/{peer}", Int32, queue_size=1)
        return self._wait(lambda: self.rssi.get_num_connections() > 0)

    def publish(self, topic, kind, size):
        """Publish a message when the translator listens; returns its bytes."""
        message = make(kind, size)
        publisher = self.publishers.get(topic)
        if publisher is None:
            publisher = rospy.Publisher(topic, type(message), queue_size=1)
            self.publishers[topic] = publisher
        if not self._wait(lambda: publisher.get_num_connections() > 0):
            return None
        publisher.publish(message)
        return serialized(message)

    def make(self, kind, size):
        return serialized(make(kind, size))

    def trigger(self):
        """Have the node begin a pull."""
        self.rssi.publish(Int32(60))

    def pull(self):
        """Have the node pull; true when it has ended a pull."""
        before = len(done)
        self.trigger()
        return self._wait(lambda: len(done) > before)

    def database(self, robot_id, count):
        """Header to compressed message, when there are so many of a robot."""
        headers = b""

        def enough():
            nonlocal headers
            headers = self.select(robot_id, 0, rospy.Time(0)).headers
            return len(headers) >= 6 * count

        self._wait(enough)
        each = [headers[start : start + 6] for start in range(0, len(headers), 6)]
        return {
            header.hex(): base64.b64encode(self.get(header).msg_content).decode() for header in each
        }

    def _wait(self, condition):
        deadline = rospy.Time.now() + rospy.Duration(30)
        while not condition():
            if rospy.Time.now() > deadline:
                return False
            rospy.sleep(0.05)
        return True


rospy.init_node("test_robot", anonymous=True, disable_signals=True)
robot = Robot()
for line in sys.stdin:
    name, arguments = json.loads(line)
    sys.stdout.write(json.dumps(getattr(robot, name)(*arguments)) + "\n")
    sys.stdout.flush()
