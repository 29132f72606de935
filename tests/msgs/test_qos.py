import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

from cspr_msgs_py.bag.metadata import INFINITE, OfferedQos
from cspr_msgs_py.qos import compatible_profile, offered_qos, replay_profile

RELIABLE = OfferedQos(reliability="reliable", durability="volatile")
BEST_EFFORT = OfferedQos(reliability="best_effort", durability="volatile")
LATCHED = OfferedQos("keep_last", 3, reliability="reliable", durability="transient_local")


def test_a_publisher_as_a_bag_has_it() -> None:
    profile = QoSProfile(depth=4, deadline=Duration(seconds=1, nanoseconds=5))
    offered = offered_qos(profile)
    assert (offered.history, offered.depth) == ("keep_last", 4)
    assert (offered.reliability, offered.durability) == ("reliable", "volatile")
    assert offered.deadline == 1_000_000_005
    assert offered.lifespan in (0, INFINITE)


def test_a_depth_that_the_middleware_does_not_tell() -> None:
    offered = offered_qos(qos_profile_sensor_data, depth=9)
    assert (offered.history, offered.depth, offered.reliability) == ("keep_last", 9, "best_effort")


@pytest.mark.parametrize(
    ("offered", "reliability", "durability"),
    [
        ((), "RELIABLE", "VOLATILE"),
        ((RELIABLE,), "RELIABLE", "VOLATILE"),
        ((BEST_EFFORT, BEST_EFFORT), "BEST_EFFORT", "VOLATILE"),
        ((RELIABLE, BEST_EFFORT), "RELIABLE", "VOLATILE"),
        ((LATCHED,), "RELIABLE", "TRANSIENT_LOCAL"),
        ((LATCHED, RELIABLE), "RELIABLE", "VOLATILE"),
    ],
)
def test_what_a_replay_offers(offered: tuple[OfferedQos, ...], reliability: str, durability: str) -> None:
    profile = replay_profile(offered)
    assert profile.reliability == ReliabilityPolicy[reliability]
    assert profile.durability == DurabilityPolicy[durability]


def test_a_replay_keeps_as_many_states_as_there_were() -> None:
    assert replay_profile([LATCHED]).depth == 3
    assert replay_profile([OfferedQos(durability="transient_local")] * 2).depth == 2
    assert replay_profile([RELIABLE]).depth == 10


def test_a_recorder_accepts_what_all_publishers_can_serve() -> None:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    both = compatible_profile([latched, qos_profile_sensor_data], depth=5)
    assert both.reliability == ReliabilityPolicy.BEST_EFFORT
    assert both.durability == DurabilityPolicy.VOLATILE
    assert both.depth == 5
    assert compatible_profile([latched], depth=1).durability == DurabilityPolicy.TRANSIENT_LOCAL
