"""Install cspr_drivers as an ament_python package."""

from setuptools import find_packages, setup

PACKAGE = "cspr_drivers"
NODES = ("can_drives", "load_cells", "drivers", "simulated_robot", "emulated_robot")

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed", "canopen/emergency_codes.csv"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "numpy",
        "msgspec",
        "python-can",
        "canopen>=2.4",
        "cspr_kinematics",
        "cspr_msgs_py",
    ],
    extras_require={"simulation": ["mujoco"]},
    zip_safe=True,
    maintainer="CSPR developers",
    maintainer_email="developers@example.org",
    description="CiA 402 drives and CiA 404 load cells over CAN, and their simulation",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            *(f"{name} = {PACKAGE}.nodes.{name}:main" for name in NODES),
            "commission = cspr_msgs_py.programs.cspr:main_of_executable",
        ],
        "cspr.programs": [f"commission = {PACKAGE}.commission.program:main"],
    },
)
