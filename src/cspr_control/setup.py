"""Install cspr_control as an ament_python package."""

from setuptools import find_packages, setup

PACKAGE = "cspr_control"
COMPONENT_NODES = ("trajectory_publisher", "feedforward", "pose_estimator", "mass_estimator", "supervisor")
NODES = [
    *(f"{name} = {PACKAGE}.nodes.control_nodes:{name}" for name in COMPONENT_NODES),
    *(f"{name} = {PACKAGE}.nodes.{name}:main" for name in ("motor_controller", "robot_markers", "control")),
]
PROGRAMS = ("demo", "closed_loop", "analyze", "identify", "rerun", "workspace", "faults", "stability")

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed", "analysis/page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "numpy",
        "scipy",
        "matplotlib",
        "msgspec",
        "cspr_drivers",
        "cspr_kinematics",
        "cspr_msgs_py",
    ],
    zip_safe=True,
    maintainer="CSPR developers",
    maintainer_email="developers@example.org",
    description="Trajectories, feed-forward, motor control, payload estimation and supervision",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            *NODES,
            *(f"{name} = cspr_msgs_py.programs.cspr:main_of_executable" for name in PROGRAMS),
        ],
        "cspr.programs": [f"{name} = {PACKAGE}.programs.{name}:main" for name in PROGRAMS],
    },
)
