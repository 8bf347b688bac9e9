"""Lists the units of ROS messages: SI by REP 103, and units in the messages' definitions."""

from __future__ import annotations

from collections.abc import Mapping

_PLACES = {"position": "m"}
_MOTION = {"linear": "m/s", "angular": "rad/s"}

UNITS: Mapping[str, Mapping[str, str]] = {
    "geometry_msgs/msg/Pose": _PLACES,
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "geometry_msgs/msg/Pose2D": {"x": "m", "y": "m", "theta": "rad"},
    "geometry_msgs/msg/PointStamped": {"point": "m"},
    "geometry_msgs/msg/Twist": _MOTION,
    "geometry_msgs/msg/Accel": {"linear": "m/s^2", "angular": "rad/s^2"},
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/msg/Inertia": {"m": "kg", "com": "m"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Illuminance": {"illuminance": "lx"},
    "sensor_msgs/msg/RelativeHumidity": {"relative_humidity": "1"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/Range": {
        "range": "m",
        "min_range": "m",
        "max_range": "m",
        "field_of_view": "rad",
    },
    "sensor_msgs/msg/LaserScan": {"ranges": "m", "range_min": "m", "range_max": "m"},
    "sensor_msgs/msg/BatteryState": {
        "voltage": "V",
        "temperature": "degC",
        "current": "A",
        "charge": "Ah",
        "capacity": "Ah",
        "design_capacity": "Ah",
        "percentage": "1",
        "cell_voltage": "V",
        "cell_temperature": "degC",
    },
    "ackermann_msgs/msg/AckermannDrive": {
        "steering_angle": "rad",
        "steering_angle_velocity": "rad/s",
        "speed": "m/s",
        "acceleration": "m/s^2",
        "jerk": "m/s^3",
    },
    "builtin_interfaces/msg/Time": {"sec": "s", "nanosec": "ns"},
    "builtin_interfaces/msg/Duration": {"sec": "s", "nanosec": "ns"},
}
"""Units of fields by message type.

Fields whose unit depends on the robot are omitted, such as the joints of `JointState`, which turn
or slide.
"""


def field_unit(message: str, field: str) -> str:
    """The unit of a field and of its sub-fields; empty if the definition states none."""
    return UNITS.get(message, {}).get(field, "")
