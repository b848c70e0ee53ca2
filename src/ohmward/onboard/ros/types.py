"""Fields and hashes of the message types that go out or come in, as ros2/common_interfaces defines them."""

from __future__ import annotations

from ohmward.logs.bags.recording import Definitions, Several, Single

BATTERY_STATE = "sensor_msgs/msg/BatteryState"
JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TF = "tf2_msgs/msg/TFMessage"
CLOCK = "rosgraph_msgs/msg/Clock"
FLOATS = "std_msgs/msg/Float64MultiArray"
PATH = "nav_msgs/msg/Path"

#: Fields of each type, separated by commas: type and name; `[9]` is an array of nine, `[]` a sequence.
_TEXT = {
    "builtin_interfaces/msg/Time": "int32 sec, uint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/msg/Time stamp, string frame_id",
    BATTERY_STATE: "std_msgs/msg/Header header, float32 voltage, float32 temperature, float32 current, float32 charge, "
    "float32 capacity, float32 design_capacity, float32 percentage, uint8 power_supply_status, uint8 "
    "power_supply_health, uint8 power_supply_technology, bool present, float32[] cell_voltage, float32[] "
    "cell_temperature, string location, string serial_number",
    JOINT_STATE: "std_msgs/msg/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort",
    IMU: "std_msgs/msg/Header header, geometry_msgs/msg/Quaternion orientation, float64[9] orientation_covariance, "
    "geometry_msgs/msg/Vector3 angular_velocity, float64[9] angular_velocity_covariance, geometry_msgs/msg/Vector3 "
    "linear_acceleration, float64[9] linear_acceleration_covariance",
    "geometry_msgs/msg/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/msg/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Pose": "geometry_msgs/msg/Point position, geometry_msgs/msg/Quaternion orientation",
    "geometry_msgs/msg/Twist": "geometry_msgs/msg/Vector3 linear, geometry_msgs/msg/Vector3 angular",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/msg/Pose pose, float64[36] covariance",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/msg/Twist twist, float64[36] covariance",
    ODOMETRY: "std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/PoseWithCovariance pose, "
    "geometry_msgs/msg/TwistWithCovariance twist",
    TWIST: "std_msgs/msg/Header header, geometry_msgs/msg/TwistWithCovariance twist",
    "diagnostic_msgs/msg/KeyValue": "string key, string value",
    "diagnostic_msgs/msg/DiagnosticStatus": "byte level, string name, string message, string hardware_id, "
    "diagnostic_msgs/msg/KeyValue[] values",
    DIAGNOSTICS: "std_msgs/msg/Header header, diagnostic_msgs/msg/DiagnosticStatus[] status",
    TF: "geometry_msgs/msg/TransformStamped[] transforms",
    "geometry_msgs/msg/TransformStamped": "std_msgs/msg/Header header, string child_frame_id, "
    "geometry_msgs/msg/Transform transform",
    "geometry_msgs/msg/Transform": "geometry_msgs/msg/Vector3 translation, geometry_msgs/msg/Quaternion rotation",
    CLOCK: "builtin_interfaces/msg/Time clock",
    "std_msgs/msg/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/msg/MultiArrayDimension[] dim, uint32 data_offset",
    FLOATS: "std_msgs/msg/MultiArrayLayout layout, float64[] data",
    "geometry_msgs/msg/PoseStamped": "std_msgs/msg/Header header, geometry_msgs/msg/Pose pose",
    PATH: "std_msgs/msg/Header header, geometry_msgs/msg/PoseStamped[] poses",
}

#: REP-2011 hashes of the types, the same from Iron on; `ros2 topic info -v` shows them.
HASHES = {
    BATTERY_STATE: "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    IMU: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    TWIST: "RIHS01_77b67434531e6529b7a0091357b186b6ebdb17fd9ffd3e0c7ce9d3fb11a44563",
    DIAGNOSTICS: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    TF: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    CLOCK: "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    FLOATS: "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    PATH: "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
}


def definition_text(type_: str) -> str:
    """The definition of a type and of the types in it, in the form that recordings and viewers take."""
    texts, waiting = dict[str, str](), [type_]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = "".join(f"{field}\n" for field in _TEXT[name].split(", "))
            inner = [content.item if isinstance(content, Several) else content for _, content in DEFINITIONS[name]]
            waiting += [content.type for content in inner if content.type in _TEXT]
    first, *others = texts.values()
    headed = zip(list(texts)[1:], others, strict=True)
    return "".join([first, *(f"{'=' * 80}\nMSG: {name.replace('/msg/', '/')}\n{text}" for name, text in headed)])


def _content(type_: str) -> Single | Several:
    item, bracket, size = type_.removesuffix("]").partition("[")
    return Several(Single(item), int(size) if size else None) if bracket else Single(item)


DEFINITIONS: Definitions = {
    type_: [(name, _content(of_field)) for of_field, name in (field.split() for field in text.split(", "))]
    for type_, text in _TEXT.items()
}
