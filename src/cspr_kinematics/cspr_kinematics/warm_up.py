"""Compile, or load from the cache, what a control cycle needs, before the first cycle asks for it.

`python -m cspr_kinematics.warm_up ROBOT_FILE` does so after an installation, when compiling takes a minute.
"""

from __future__ import annotations

import sys
from time import perf_counter

from .dynamics import balance_regressor, static_wrench
from .feedforward_tensions import feedforward_tensions
from .forward_kinematics import forward_kinematics
from .inverse_kinematics import inverse_kinematics
from .pose import Acceleration, Pose, Twist
from .rigid_body import Payload
from .robot import Robot
from .tensions import bounded_methods, distribute_tensions
from .wrench_set import available_wrenches


def warm_up(robot: Robot) -> None:
    """Run each function of a control cycle once, at the home pose, with every choice that may be made meanwhile."""
    home = Pose.from_quaternion(robot.home.position, robot.home.quaternion)
    lengths = inverse_kinematics(robot, home).lengths
    asked = feedforward_tensions(robot, home, Twist.zero(), Acceleration.zero(), Payload.none())
    for method in bounded_methods(robot.number_of_cables):
        distribute_tensions(asked.wrench_matrix, asked.wrench, robot.tension_min, robot.tension_max, method)
    available_wrenches(asked.wrench_matrix, robot.tension_min, robot.tension_max)
    forward_kinematics(robot, lengths, home)


def main() -> int:
    """Compile for the robot of a file."""
    if len(sys.argv) != 2:
        print("usage: python -m cspr_kinematics.warm_up ROBOT_FILE", file=sys.stderr)
        return 2
    start = perf_counter()
    robot = Robot.from_yaml(sys.argv[1])
    warm_up(robot)
    static_wrench(robot, robot.home)  # these two are asked for when a run is analysed
    balance_regressor(robot.home, Twist.zero(), Acceleration.zero())
    print(f"kernels of cspr_kinematics are ready ({perf_counter() - start:.1f} s)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
