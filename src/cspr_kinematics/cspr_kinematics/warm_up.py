"""Compile, or load from the cache, the kernels of a control cycle before the first cycle needs them.

`python -m cspr_kinematics.warm_up ROBOT_FILE` does so after an installation, and compiles those of the exploration of
the workspace besides; that takes a minute, up to two on a busy computer.
"""

from __future__ import annotations

import sys
from time import perf_counter

import numpy as np

from cspr_kinematics.dynamics.dynamics import required_wrench, static_wrench
from cspr_kinematics.dynamics.rope_weight import rope_wrench
from cspr_kinematics.kinematics.cable_follower import CableFollower
from cspr_kinematics.kinematics.forward import forward_kinematics
from cspr_kinematics.kinematics.inverse import inverse_kinematics, length_accelerations
from cspr_kinematics.motion.motion import motion_from_euler
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.tensions.distribute import bounded_methods, distribute_tensions
from cspr_kinematics.workspace.exploration import explore_workspace
from cspr_kinematics.workspace.wrench_set import available_wrenches


def warm_up(robot: Robot) -> None:
    """Run each function of a control cycle once, at the home pose, with every method that may be selected later."""
    home = Pose.from_quaternion(robot.home.position, robot.home.quaternion)
    motion_from_euler(home.position, np.zeros(3), np.zeros(3), home.euler, np.zeros(3), np.zeros(3))
    cables, limits = inverse_kinematics(robot, home), (robot.tension_min, robot.tension_max)
    required_wrench(robot, home, Twist.zero(), Acceleration.zero())
    length_accelerations(robot, home, Twist.zero(), Acceleration.zero())
    wrench = static_wrench(robot, home)
    for method in bounded_methods(robot.number_of_cables):
        distribute_tensions(cables.wrench_matrix, wrench, *limits, method)
    available_wrenches(cables.wrench_matrix, *limits)
    forward_kinematics(robot, cables.lengths, home)
    rope_wrench(robot, cables)
    CableFollower(robot).follow(np.zeros(robot.number_of_cables), robot.home_tensions)


def main() -> int:
    """Compile for the robot of a file."""
    if len(sys.argv) != 2:
        print("usage: python -m cspr_kinematics.warm_up ROBOT_FILE", file=sys.stderr)
        return 2
    start = perf_counter()
    robot = Robot.from_yaml(sys.argv[1])
    warm_up(robot)
    explore_workspace(robot, spacing=10.0)
    print(f"kernels of cspr_kinematics are ready ({perf_counter() - start:.1f} s)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
