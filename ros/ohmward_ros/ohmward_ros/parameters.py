"""Parameters of the node: each with its default, whose type is that of the parameter, and what it is."""

from __future__ import annotations

from typing import Any

#: Values of these are topics.
IN = ("battery_state_in", "joint_states", "imu", "odometry_in", "twist_in", "home_path")
OUT = ("battery_state", "odometry", "twist", "diagnostics", "home")

PARAMETERS: dict[str, tuple[Any, str]] = {
    "battery": ("", "battery file; ~ is the home. `ohmward generic` or `ohmward identify` writes one"),
    "robot": ("", "robot file, or a packaged robot such as rlma; without it no speed, slip and pose"),
    "setup": ("", "setup of `ohmward run` with further sources and sinks, whose battery and robot count"),
    "bagfile": ("", "bag that is played: times are those of /clock, and nothing is kept for the robot"),
    "state": ("", "folder of what survives a restart; by default below ROS_HOME, one for each namespace and node"),
    "learn": (False, "the battery file learns from day to day, in that folder"),
    "delay_s": (0.0, "messages of the drive wait so long for others with an earlier time [s]"),
    "battery_state_in": ("battery/raw", "topic in, sensor_msgs/BatteryState; empty: none"),
    "joint_states": ("joint_states", "topic in, sensor_msgs/JointState: velocities of the wheels; empty: none"),
    "imu": ("imu/data", "topic in, sensor_msgs/Imu; empty: none"),
    "odometry_in": ("", "topic in, nav_msgs/Odometry of cameras, lidar or GNSS, never of wheels; empty: none"),
    "twist_in": ("", "topic in, geometry_msgs/TwistWithCovarianceStamped of the same, x along the robot; empty: none"),
    "home_path": ("", "topic in, nav_msgs/Path from the robot to where it charges: the way home; empty: none"),
    "joints": ([""], "wheel=joint, where front_left_wheel_joint is not the wheel front_left"),
    "imu_rpy": ([0.0, 0.0, 0.0], "roll, pitch and yaw of the inertial unit in base_frame [rad]"),
    "battery_state": ("battery_state", "topic out, sensor_msgs/BatteryState; empty: none"),
    "odometry": ("ohmward/odometry", "topic out, nav_msgs/Odometry; empty: none"),
    "twist": ("ohmward/twist", "topic out, geometry_msgs/TwistWithCovarianceStamped; empty: none"),
    "diagnostics": ("/diagnostics", "topic out, diagnostic_msgs/DiagnosticArray; empty: none"),
    "home": ("", "topic out, BatteryState whose percentage is the probability of reaching home; empty: none"),
    "odom_frame": ("odom", "frame of the pose"),
    "base_frame": ("base_link", "frame of the robot, between the driven or rear wheels; else at its centre of gravity"),
    "publish_tf": (False, "send the transform from odom_frame to base_frame on /tf; nobody else may"),
    "interval_s": (0.02, "least time between two messages of odometry and twist on average [s]"),
    "slow_s": (0.5, "the same of battery_state and diagnostics [s]"),
    "percentage": ("mean", "of battery_state: mean, or low for the low end of the 95 % band, as IsBatteryLow wants it"),
}


def descriptor_of(name: str) -> Any:
    """Descriptor of a parameter: read only, with its description."""
    from rcl_interfaces.msg import ParameterDescriptor  # the table alone needs no ROS

    return ParameterDescriptor(description=PARAMETERS[name][1], read_only=True)
