"""`ros2 launch ohmward_ros ohmward.launch.py battery:=/robot/battery.toml robot:=/robot/robot.toml`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """The node, and a bag that is played where one is given."""
    defaults = PathJoinSubstitution([FindPackageShare("ohmward_ros"), "config", "ohmward.yaml"])
    bag = LaunchConfiguration("bagfile")
    arguments = [
        DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
        DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
        DeclareLaunchArgument("battery", default_value="", description="battery file"),
        DeclareLaunchArgument("robot", default_value="", description="robot file, rlma, robotino or seeder"),
        DeclareLaunchArgument("setup", default_value="", description="setup of `ohmward run`, instead of both"),
        DeclareLaunchArgument("bagfile", default_value="", description="a bag to play; nothing of it is kept"),
    ]
    files = {name: LaunchConfiguration(name) for name in ("battery", "robot", "setup", "bagfile")}
    node = Node(
        package="ohmward_ros",
        executable="ohmward_node",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[files, LaunchConfiguration("params_file")],
    )
    given = IfCondition(PythonExpression(["'", bag, "' != ''"]))
    play = ExecuteProcess(cmd=["ros2", "bag", "play", bag], output="screen", condition=given)
    return LaunchDescription([*arguments, node, play])
