"""Quality-of-service profiles of rclpy: for the topics of the table, and those in a bag."""

from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from cspr_msgs_py.bag.metadata import INFINITE, OfferedQos
from cspr_msgs_py.topics import Topic

_REPLAY_DEPTH = 10  # messages at least, where the topic is not latched


def _profile(depth: int, reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def qos_profile(topic: Topic) -> QoSProfile:
    """Return the profile with which `topic` is published and subscribed."""
    return _profile(topic.depth, topic.reliable, topic.latched)


def compatible_profile(offered: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return the strictest profile that every one of these publishers can serve."""
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in offered)
    latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
    return _profile(depth, reliable, latched)


def offered_qos(profile: QoSProfile, depth: int = 0) -> OfferedQos:
    """Return the profile of a publisher as a bag has it.

    Parameters
    ----------
    profile
        As the middleware reports it, which does not tell the history.
    depth
        Depth of the history, if it is known from elsewhere.
    """
    known = profile.history == HistoryPolicy.KEEP_LAST and profile.depth
    return OfferedQos(
        "keep_last" if depth else profile.history.name.lower(),
        profile.depth if known and not depth else depth,
        profile.reliability.name.lower(),
        profile.durability.name.lower(),
        profile.deadline.nanoseconds,
        profile.lifespan.nanoseconds,
        profile.liveliness.name.lower(),
        profile.liveliness_lease_duration.nanoseconds,
        bool(profile.avoid_ros_namespace_conventions),
    )


def replay_profile(offered: Sequence[OfferedQos]) -> QoSProfile:
    """Return the profile with which to publish a topic of a bag.

    What all of its publishers agreed on is offered again; where they differed or nothing is known, the profile
    is one that every subscriber accepts: reliable, and volatile.
    """
    reliable = {profile.reliability for profile in offered} != {"best_effort"}
    latched = {profile.durability for profile in offered} == {"transient_local"}
    if latched:
        # Of late subscribers each is given as many messages: one of each publisher if nothing is known.
        depth = sum(max(profile.depth, 1) for profile in offered)
    else:
        depth = max([_REPLAY_DEPTH, *(profile.depth for profile in offered)])
    profile = _profile(depth, reliable, latched)
    for name in ("deadline", "lifespan"):
        values = {getattr(each, name) for each in offered}
        if len(values) == 1 and (value := values.pop()) < INFINITE:
            setattr(profile, name, Duration(nanoseconds=value))
    return profile
