"""Launches ``stereo-seecolor live`` on two topics.

ros2 launch seecolor.launch.py calib:=cam.yaml
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

PARAMETERS = {
    "left": "/stereo/left/image_raw",
    "right": "/stereo/right/image_raw",
    "calib": "cam.yaml",
    "namespace": "/seecolor",
    "budget_ms": "200",
    "frames_of_a_water": "20",
}


def generate_launch_description() -> LaunchDescription:
    """The arguments with their defaults, and the process."""
    value = {name: LaunchConfiguration(name) for name in PARAMETERS}
    command = ["stereo-seecolor", "live", "--left", ["ros2:", value["left"]]]
    command += ["--right", ["ros2:", value["right"]], "--calib", value["calib"]]
    command += ["--publish", value["namespace"], "--budget-ms", value["budget_ms"]]
    command += ["--set", ["color.lock=", value["frames_of_a_water"]]]
    arguments = [
        DeclareLaunchArgument(name, default_value=given) for name, given in PARAMETERS.items()
    ]
    return LaunchDescription([*arguments, ExecuteProcess(cmd=command, output="screen")])
