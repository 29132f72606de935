"""The shipped policies: they are those that are generated, are of SROS 2's form, and fit together."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from cspr_msgs_py.programs.security import main
from cspr_msgs_py.security.access import ENCLAVES, EVERYTHING, processes
from cspr_msgs_py.security.policy import policies
from cspr_msgs_py.topics import graph_topics

DIRECTORY = Path(__file__).parents[3] / "config" / "security"
FILES = sorted(DIRECTORY.iterdir())
COMMAND = "python -m cspr_msgs_py.programs.security"
PEOPLE = ("viewer", "operator", "maintenance")
RIGHTS = {"topics": {"publish", "subscribe"}, "services": {"request", "reply"}}


def grants(path: Path) -> dict[str, set[tuple[str, str]]]:
    """Read what a file grants to each enclave: pairs of right and name."""
    found: dict[str, set[tuple[str, str]]] = {}
    for enclave in ET.parse(path).getroot().iter("enclave"):
        found[enclave.attrib["path"]] = {
            (right, str(element.text))
            for group in enclave.findall("profiles/profile/*")
            for right in group.attrib
            for element in group
        }
    return found


GRANTS = {enclave: rights for path in FILES for enclave, rights in grants(path).items()}


def with_right(right: str, *, people: bool) -> set[str]:
    chosen = {path for path in GRANTS if (path.rpartition("/")[2] in PEOPLE) is people}
    return {name for path in chosen for kind, name in GRANTS[path] if kind == right}


def test_the_files_are_those_that_are_generated() -> None:
    shipped = {path.name: path.read_text(encoding="utf-8") for path in FILES}
    made = policies(8)
    different = sorted(name for name in shipped | made if shipped.get(name) != made.get(name))
    assert not different, f"config/security is not what the tables say; write it anew: {COMMAND}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_file_has_the_form_of_a_policy(path: Path) -> None:
    """As the schema of ros2/sros2 has it: policy, enclaves, enclave, profiles, profile, topics and services."""
    policy = ET.parse(path).getroot()
    assert (policy.tag, policy.attrib) == ("policy", {"version": "0.2.0"})
    (enclaves,) = policy
    assert enclaves.tag == "enclaves"
    for enclave in enclaves:
        assert (enclave.tag, set(enclave.attrib)) == ("enclave", {"path"})
        (profiles,) = enclave
        assert profiles.tag == "profiles"
        for profile in profiles:
            assert (profile.tag, set(profile.attrib)) == ("profile", {"ns", "node"})
            for group in profile:
                assert set(group.attrib) <= RIGHTS[group.tag]
                assert set(group.attrib.values()) == {"ALLOW"}
                assert {each.tag for each in group} == {group.tag.removesuffix("s")}
                names = [each.text or "" for each in group]
                assert names == sorted(set(names))
                assert all(re.fullmatch(r"\*|(/[a-z0-9_*]+)+", name) for name in names)


def test_every_enclave_is_in_one_file() -> None:
    assert sum(len(grants(path)) for path in FILES) == len(GRANTS)
    assert set(GRANTS) == {f"{ENCLAVES}/{name}" for name in processes(8)}


def test_a_topic_is_published_by_those_whom_the_table_of_topics_names() -> None:
    for name, nodes in processes(8).items():
        for node, access in nodes.items():
            for topic in graph_topics(8):
                if topic.writer != "*" and name not in PEOPLE:
                    assert (topic.name in access.publishes) is (topic.writer == node), (name, topic.name)


def test_no_person_publishes_what_a_node_does() -> None:
    own = {topic.name for topic in graph_topics(8) if topic.writer not in ("*", "demo")}
    assert not with_right("publish", people=True) & own


def test_what_is_heard_is_published_by_somebody_and_what_is_called_is_offered() -> None:
    published, offered = with_right("publish", people=False), with_right("reply", people=False)
    assert with_right("subscribe", people=False) - {EVERYTHING} <= published
    assert with_right("request", people=False) <= offered
    assert with_right("request", people=True) <= offered


def test_a_person_may_call_what_their_part_is() -> None:
    calls = {
        name: {service for right, service in GRANTS[f"{ENCLAVES}/{name}"] if right == "request"}
        for name in PEOPLE
    }
    assert calls["viewer"] == set()
    assert "/supervisor/stop" in calls["operator"]
    assert not any(fnmatchcase(service, "/can_drives/*") for service in calls["operator"])
    assert calls["maintenance"] == with_right("reply", people=False)


def test_only_the_motors_controllers_and_drivers_have_to_do_with_torques() -> None:
    may = {
        right: {path for path, rights in GRANTS.items() if (right, "/motor_3/command") in rights}
        for right in ("publish", "subscribe")
    }
    assert may["publish"] == {"/cspr/control", "/cspr/motor_controller_3"}
    assert may["subscribe"] == {"/cspr/drivers", "/cspr/can_drives", "/cspr/simulated_robot"}


def test_a_robot_with_other_motors_has_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--motors", "6", "--output", str(tmp_path / "six")]) == 0
    assert f"18 policies in {tmp_path / 'six'}" in capsys.readouterr().out
    text = (tmp_path / "six" / "control.xml").read_text(encoding="utf-8")
    assert "/motor_6/command" in text
    assert "/motor_7/command" not in text
    with pytest.raises(SystemExit):
        main(["--motors", "0"])
    assert "'0' is not a number of motors" in capsys.readouterr().err
