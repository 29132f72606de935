import shutil
from pathlib import Path

import pytest

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.home_position import store_home, with_home
from cspr_drivers.errors import ConfigurationError

SHIPPED = Path(__file__).parents[3] / "config" / "can.yaml"
COUNTS = [7, -8, 9, 10, -11, 12, 13, 2_000_000]


@pytest.fixture
def path(tmp_path):
    return Path(shutil.copy(SHIPPED, tmp_path / "can.yaml"))


def test_only_the_numbers_change_and_the_old_file_is_kept(path):
    config = CanConfig.from_yaml(path)
    kept = store_home(config, COUNTS)
    assert kept.read_text() == SHIPPED.read_text()
    assert CanConfig.from_yaml(path) == with_home(config, COUNTS)
    changed = [
        new
        for old, new in zip(SHIPPED.read_text().splitlines(), path.read_text().splitlines(), strict=True)
        if old != new
    ]
    assert len(changed) == 8
    assert "home_counts: -11," in changed[4]


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("home_counts: 0", "home_counts: *home", 1),
        lambda text: text.replace("node_id: 3", "node_id: 33", 1),
        lambda text: text + "extra: {home_counts: 1}\n",
    ],
)
def test_a_file_that_has_changed_meanwhile_stays_as_it_is(path, change):
    config = CanConfig.from_yaml(path)
    path.write_text(change(path.read_text()))
    before = path.read_text()
    with pytest.raises(ConfigurationError, match="home_counts: has changed since it was read"):
        store_home(config, COUNTS)
    assert path.read_text() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_file_that_is_gone_is_named(path):
    config = CanConfig.from_yaml(path)
    path.unlink()
    with pytest.raises(ConfigurationError, match=r"can\.yaml: home_counts cannot be stored: No such file"):
        store_home(config, COUNTS)
