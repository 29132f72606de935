"""ROS domains: claimed by one graph at a time."""

from __future__ import annotations

import os

import pytest

from cspr_control.demo.ros_domain import DEMO_DOMAINS, claim_domain
from cspr_control.errors import ControlError


def test_two_graphs_have_two_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID")
    with claim_domain():
        first = os.environ["ROS_DOMAIN_ID"]
        monkeypatch.delenv("ROS_DOMAIN_ID")
        with claim_domain():
            second = os.environ["ROS_DOMAIN_ID"]
    assert first != second
    assert {int(first), int(second)} <= set(DEMO_DOMAINS)


def test_a_domain_that_is_set_is_kept_and_not_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "97")
    with claim_domain():
        assert os.environ["ROS_DOMAIN_ID"] == "97"
        with pytest.raises(ControlError, match="ROS domain 97 is taken"):
            claim_domain()
    claim_domain().close()  # free again


def test_when_every_domain_is_taken_they_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "98")
    with claim_domain():
        monkeypatch.delenv("ROS_DOMAIN_ID")
        with pytest.raises(ControlError, match="ROS domain 98, 98"):
            claim_domain([98, 98])
