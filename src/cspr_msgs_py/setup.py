"""Install cspr_msgs_py as an ament_python package."""

from setuptools import find_packages, setup

PACKAGE = "cspr_msgs_py"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "numpy",
        "pyyaml",
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
            *(f"{name} = {PACKAGE}.nodes.{name}:main" for name in ("recorder", "replay")),
            f"recover = {PACKAGE}.bag.recover:main",
        ]
    },
)
