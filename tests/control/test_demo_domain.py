"""The ROS domain of a demo: taken by one demo at a time."""

from __future__ import annotations

import os

import pytest

from cspr_control.demo_domain import DOMAINS, claim_domain
from cspr_control.demo_scenario import DemoError


@pytest.fixture
def no_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "")  # so that it is put back
    monkeypatch.delenv("ROS_DOMAIN_ID")


def test_two_demos_have_two_domains(no_domain: None, monkeypatch: pytest.MonkeyPatch) -> None:
    with claim_domain():
        first = os.environ["ROS_DOMAIN_ID"]
        monkeypatch.delenv("ROS_DOMAIN_ID")
        with claim_domain():
            second = os.environ["ROS_DOMAIN_ID"]
    assert first != second
    assert {int(first), int(second)} <= set(DOMAINS)


def test_a_domain_that_is_set_is_kept_and_not_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "97")
    with claim_domain():
        assert os.environ["ROS_DOMAIN_ID"] == "97"
        with pytest.raises(DemoError, match="another demo runs in ROS domain 97"):
            claim_domain()
    claim_domain().close()  # free again
