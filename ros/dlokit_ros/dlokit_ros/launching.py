"""What the files in `launch/` share: they start the node, and dlokit in the environment of its own."""

import os
import shlex

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ROS_ONLY = ("PYTHONPATH", "LD_LIBRARY_PATH")
"""Variables with which ROS's libraries would be loaded into dlokit."""


def bridge_and_dlokit(command, options, defaults=None):
    """Launch the node and a command of dlokit; `options` are its options by launch argument, omitted where empty."""
    defaults = {"dlokit": "dlokit", "link": "dlokit", "arguments": "", **dict.fromkeys(options, ""), **(defaults or {})}

    def start(context):
        values = {name: LaunchConfiguration(name).perform(context) for name in defaults}
        line = [os.path.expanduser(values["dlokit"]), *command, "--ros2", "--ros2.link", values["link"]]
        for name, option in options.items():
            line += [option, values[name]] if values[name] else []
        line += shlex.split(values["arguments"])
        environment = {name: value for name, value in os.environ.items() if name not in ROS_ONLY}
        end = {"sigterm_timeout": "20", "on_exit": Shutdown()}  # an arm comes to rest first
        node = Node(package="dlokit_ros", executable="bridge", output="screen", parameters=[{"link": values["link"]}])
        return [node, ExecuteProcess(cmd=line, env=environment, output="screen", **end)]

    declared = [DeclareLaunchArgument(name, default_value=value) for name, value in defaults.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])
