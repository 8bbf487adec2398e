#!/usr/bin/env python3
"""An executive as a node of ROS 2: plans for goals, sends actions, notes how they went.

    ros_executive.py DOMAIN TEMPLATE

Topics, each of std_msgs/String:

    rmem/goal    in   a goal of PDDL, like (on A B)
    rmem/action  out  {"plan": ID, "step": 1, "action": "stack", "list": ["B", "C"]}
    rmem/result  in   {"plan": ID, "step": 1, "done": true}
    rmem/status  out  planned, reached, or why there is no plan

The memory is that of RMEM_MEMORY. It needs rclpy, as of `pip install ros-jazzy-rclpy "ros-rmw-fastrtps-cpp<9" "ros-std-msgs<5.4"`.
"""

import json
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

import rmem

ATTEMPTS = 10


class Executive(Node):
    """Executes one plan at a time; plans again where the rest of it does not reach the goal any more."""

    def __init__(self, domain, template):
        super().__init__("rmem_executive")
        self.domain, self.template = domain, template
        self.memory = rmem.Memory()
        self.goal, self.plan, self.attempts = None, None, 0
        self.actions = self.create_publisher(String, "rmem/action", 10)
        self.status = self.create_publisher(String, "rmem/status", 10)
        self.create_subscription(String, "rmem/goal", self.on_goal, 10)
        self.create_subscription(String, "rmem/result", self.on_result, 10)

    def on_goal(self, message):
        self.goal, self.attempts = message.data, 0
        self.find_plan()

    def find_plan(self):
        self.attempts += 1
        try:
            if self.attempts > ATTEMPTS:
                raise rmem.NoPlan("the goal was not reached with so many plans", 12)
            self.plan = self.memory.plan(self.domain, template=self.template, goal=self.goal)
        except rmem.RmemError as error:
            self.plan = None
            return self.report(str(error))
        self.report("planned")
        self.send(1)

    def send(self, number):
        """Sends a step of the plan, where the rest of the plan holds."""
        if not self.memory.check(self.plan.id):
            return self.find_plan()
        if number > len(self.plan.steps):
            return self.report("reached")
        step = self.plan.steps[number - 1]
        self.memory.step(self.plan.id, number, "started")
        action = {"plan": self.plan.id, "step": number, "action": step.action, "list": list(step.list)}
        self.actions.publish(String(data=json.dumps(action)))

    def on_result(self, message):
        result = json.loads(message.data)
        if self.plan is None or result["plan"] != self.plan.id:
            return
        self.memory.step(self.plan.id, result["step"], "done" if result["done"] else "failed")
        if result["done"]:
            self.send(result["step"] + 1)
        else:
            self.find_plan()

    def report(self, text):
        self.get_logger().info(text)
        self.status.publish(String(data=text))


def main(domain, template):
    rclpy.init()
    try:
        rclpy.spin(Executive(domain, template))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
