"""Package of ROS 2: `colcon build` in a workspace."""

from setuptools import find_packages, setup

NAME = "ohmward_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/ohmward.launch.py"]),
        (f"share/{NAME}/config", ["config/ohmward.yaml"]),
    ],
    install_requires=["setuptools"],
    tests_require=["pytest"],  # without it colcon runs no test and says nothing
    zip_safe=True,
    description="State of charge, wheel slip, odometry and range of a wheeled robot, by ohmward.",
    entry_points={"console_scripts": [f"ohmward_node = {NAME}.node:main"]},
)
