"""Installs the package; run by colcon."""

from glob import glob

from dlokit_ros import __version__
from setuptools import setup

setup(
    name="dlokit_ros",
    version=__version__,
    license="Apache-2.0",
    packages=["dlokit_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/dlokit_ros"]),
        ("share/dlokit_ros", ["package.xml", *glob("config/*.rviz")]),
        ("share/dlokit_ros/launch", glob("launch/*.launch.py")),
    ],
    entry_points={"console_scripts": ["bridge = dlokit_ros.bridge:main", "check = dlokit_ros.check:main"]},
)
