"""Install cspr_kinematics as an ament_python package."""

from setuptools import find_packages, setup

PACKAGE = "cspr_kinematics"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed", "__init__.pyi"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy", "scipy", "numba", "ruamel.yaml", "msgspec"],
    zip_safe=False,  # compiled kernels are kept beside their sources
    maintainer="CSPR developers",
    maintainer_email="developers@example.org",
    description="Geometry, statics and dynamics of cable-suspended parallel robots",
    license="Apache-2.0",
    entry_points={"console_scripts": []},
)
