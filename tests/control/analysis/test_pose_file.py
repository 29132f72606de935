"""Files of a total station: what is in them, and what is wrong with them, by line and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cspr_control.analysis.pose_file import read_pose_file
from cspr_control.errors import ControlError


def written(directory: Path, text: str) -> Path:
    path = directory / "prism.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    time, position, rotation = read_pose_file(
        written(tmp_path, "# TS16, prism 3\n x,y, z,time\n1,2,3,10.5\n\n# lost\n4,5,6,11\n")
    )
    np.testing.assert_array_equal(time, [10.5, 11.0])
    np.testing.assert_array_equal(position, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert rotation is None


def test_orientation(tmp_path: Path) -> None:
    text = "time,x,y,z,qx,qy,qz,qw\n0,1,2,3,0,0,0.7071,0.7071\n"
    *_, rotation = read_pose_file(written(tmp_path, "\ufeff" + text))
    assert rotation is not None
    np.testing.assert_allclose(rotation.apply([1.0, 0.0, 0.0]), [[0.0, 1.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no line that names its columns"),
        ("time,x,y,z\n", "has no pose"),
        (
            "time,x,y\n1,2,3\n",
            r"line 1: the columns are time, x, y; they must be time, x, y, z, or these and qx",
        ),
        ("t;x;y;z\n1;2;3;4\n", "line 1: the columns are t;x;y;z"),
        ("time,x,y,z,qx\n1,2,3,4,5\n", "line 1: the columns are"),
        ("time,x,y,z,name\n1,2,3,4,5\n", "line 1: the columns are"),
        ("time,x,x,z\n1,2,3,4\n", "line 1: the columns are"),
        ("#\ntime,x,y,z\n1,2,3\n", "line 3 has 3 values for 4 columns"),
        ("time,x,y,z\n1,2,3,4\n\n2,2,?,4\n", r"line 4, column y: '\?' is not a finite number"),
        ("time,x,y,z\n1,2,3,nan\n", "line 2, column z: 'nan' is not a finite number"),
        ("time,x,y,z\n1,2,3,4\n#\n1,2,3,4\n", "line 4, column time: 1 s is not later than 1 s in line 2"),
        ("time,x,y,z,qx,qy,qz,qw\n1,2,3,4,0,0,0,2\n", "line 2, columns qx, qy, qz, qw: the norm is 2"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ControlError, match=words):
        read_pose_file(written(tmp_path, text))


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ControlError, match=r"prism\.csv cannot be read: No such file"):
        read_pose_file(tmp_path / "prism.csv")
    (tmp_path / "prism.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ControlError, match="not text in UTF-8"):
        read_pose_file(tmp_path / "prism.csv")
