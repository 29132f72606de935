"""Install cspr_msgs_py as an ament_python package."""

from setuptools import find_packages, setup

PACKAGE = "cspr_msgs_py"
PROGRAMS = {
    "replay": f"{PACKAGE}.nodes.replay:main",
    "recover": f"{PACKAGE}.programs.recover:main",
    "security": f"{PACKAGE}.programs.security:main",
}

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed", "security/loopback.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        # setup.cfg puts executables where `ros2 run` looks; from bin/ a sourced workspace has the command on PATH
        ("bin", ["scripts/cspr"]),
    ],
    install_requires=[
        "setuptools",
        "numpy",
        "pyyaml",
        "ruamel.yaml",
        "mcap>=1.5",
        "mcap-ros2-support>=0.5.5",
        "zstandard",
        "lz4",
    ],
    zip_safe=True,
    maintainer="CSPR developers",
    maintainer_email="developers@example.org",
    description="Topics, message conversion and MCAP bags of the cable robot",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            f"cspr = {PACKAGE}.programs.cspr:main",
            f"recorder = {PACKAGE}.nodes.recorder:main",
            *(f"{name} = {PACKAGE}.programs.cspr:main_of_executable" for name in PROGRAMS),
        ],
        "cspr.programs": [f"{name} = {main}" for name, main in PROGRAMS.items()],
    },
)
