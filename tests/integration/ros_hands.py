"""The hands of a robot as a node of ROS 2: gives a goal, executes actions, prints them and the status.

    ros_hands.py GOAL ACT

The action number 2 fails the first time. Ends when the goal is reached, else after a minute with 1.
"""

import json
import subprocess
import sys
import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class Hands(Node):
    def __init__(self, act):
        super().__init__("hands")
        self.act, self.seen, self.is_over = act, 0, False
        self.results = self.create_publisher(String, "rmem/result", 10)
        self.goals = self.create_publisher(String, "rmem/goal", 10)
        self.create_subscription(String, "rmem/action", self.on_action, 10)
        self.create_subscription(String, "rmem/status", self.on_status, 10)

    def on_action(self, message):
        action = json.loads(message.data)
        self.seen += 1
        done = self.seen != 2 and subprocess.run([self.act, action["action"], *action["list"]]).returncode == 0
        print("did" if done else "failed", action["action"], *action["list"], flush=True)
        result = {"plan": action["plan"], "step": action["step"], "done": done}
        self.results.publish(String(data=json.dumps(result)))

    def on_status(self, message):
        print(message.data, flush=True)
        self.is_over = message.data == "reached"


def main(goal, act):
    rclpy.init()
    node, until = Hands(act), time.monotonic() + 60
    # A message is for those who are there: the executive subscribes and publishes two topics each.
    topics = ["rmem/goal", "rmem/result"]
    while not (
        all(node.count_subscribers(topic) for topic in topics)
        and all(node.count_publishers(topic) for topic in ["rmem/action", "rmem/status"])
        and node.goals.get_subscription_count()
        and node.results.get_subscription_count()
    ):
        rclpy.spin_once(node, timeout_sec=0.1)
        if time.monotonic() > until:
            sys.exit("there is no executive")
    rclpy.spin_once(node, timeout_sec=0.5)
    node.goals.publish(String(data=goal))
    while not node.is_over and time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.1)
    sys.exit(0 if node.is_over else 1)


main(*sys.argv[1:])
