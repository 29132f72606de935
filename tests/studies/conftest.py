"""What takes seconds and more than one module needs."""

import pytest
from studies.geometries import SHIPPED, second_geometry
from studies.paper_results import TensionResults


@pytest.fixture(scope="session")
def second(tmp_path_factory):
    """The second geometry with a configuration of its own."""
    return second_geometry(tmp_path_factory.mktemp("second_geometry"))


@pytest.fixture(scope="session")
def tension_results(second):
    """Figures 8 to 10 with both geometries, by their names."""
    return {geometry.name: TensionResults.compute(geometry.robot) for geometry in (SHIPPED, second)}
