"""`ros2 launch ohmward_ros ohmward.launch.py battery:=/robot/battery.toml robot:=/robot/robot.toml`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

#: Parameters of the node that are arguments of the launch file too, with their defaults and descriptions; the file of
#: parameters wins over them.
TEXTS = {
    "battery": ("", "battery file"),
    "robot": ("", "robot file, or a packaged robot such as rlma"),
    "setup": ("", "setup of `ohmward run`, instead of both"),
    "bagfile": ("", "a bag to play, with its clock; nothing of it is kept"),
    "battery_state_in": ("battery/raw", "topic of the driver of the battery"),
    "joint_states": ("joint_states", "topic of the wheels"),
    "imu": ("imu/data", "topic of the inertial unit"),
}


def generate_launch_description() -> LaunchDescription:
    """The node, and a bag that is played where one is given."""
    defaults = PathJoinSubstitution([FindPackageShare("ohmward_ros"), "config", "ohmward.yaml"])
    bag = LaunchConfiguration("bagfile")
    played = PythonExpression(["'", bag, "' != ''"])
    arguments = [
        DeclareLaunchArgument("params_file", default_value=defaults, description="parameters of the node"),
        DeclareLaunchArgument("name", default_value="ohmward", description="of the node"),
        DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
        DeclareLaunchArgument("use_sim_time", default_value=played, description="true: the time is that of /clock"),
        *(DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in TEXTS.items()),
    ]
    texts = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in TEXTS}
    sim_time = {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}
    node = Node(
        package="ohmward_ros",
        executable="ohmward_node",
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[texts, sim_time, LaunchConfiguration("params_file")],
    )
    play = ExecuteProcess(
        cmd=["ros2", "bag", "play", "--clock", "200", bag], output="screen", condition=IfCondition(played)
    )
    return LaunchDescription([*arguments, node, play])
