"""Every way in which a file can fail to be a mapping of unique keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from cspr_kinematics.configuration.yaml_file import parse_yaml, read_yaml
from cspr_kinematics.errors import ConfigurationFileError


def test_a_mapping_is_returned(tmp_path: Path) -> None:
    path = tmp_path / "some.yaml"
    path.write_text("a: {b: [1, 2.5]}\nc: text\n", encoding="utf-8")
    assert read_yaml(path) == {"a": {"b": [1, 2.5]}, "c": "text"}
    assert parse_yaml(path.read_bytes(), "some.yaml") == read_yaml(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "some.yaml: is empty; it must be a mapping of keys to values; name another"),
        ("42", "some.yaml = 42: must be a mapping of keys to values; name another"),
        ("- a\n", "some.yaml = ['a']: must be a mapping"),
        (
            "a: 1\nb:\n  c: 1\n  c: 2\n",
            'found duplicate key "c" with value "2" (original value: "1") (line 4',
        ),
        ("a: [1, 2\n", "is not valid YAML: while parsing a flow sequence, "),
        (b"\xff\xfe\x00\xd8", "is not valid YAML: 'utf-8' codec"),
        ("a: !!timestamp 2001-99-99", "is not valid YAML: month must be"),
        ("[" * 1000, "is not valid YAML: maximum recursion depth"),
    ],
    ids=lambda value: str(value)[:12],
)
def test_what_is_refused(text: str | bytes, words: str) -> None:
    with pytest.raises(ConfigurationFileError) as caught:
        parse_yaml(text, "some.yaml", remedy="name another")
    assert words in str(caught.value)
    assert caught.value.source == "some.yaml"
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationFileError, match=r"none\.yaml: cannot be read: No such file.*; name another"
    ):
        read_yaml(tmp_path / "none.yaml", remedy="name another")
