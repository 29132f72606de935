"""Quality-of-service profiles of rclpy for the topics of the table."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from cspr_msgs_py.topics import Durability, Reliability, Topic

_RELIABILITY = {
    Reliability.RELIABLE: ReliabilityPolicy.RELIABLE,
    Reliability.BEST_EFFORT: ReliabilityPolicy.BEST_EFFORT,
}
_DURABILITY = {
    Durability.VOLATILE: DurabilityPolicy.VOLATILE,
    Durability.TRANSIENT_LOCAL: DurabilityPolicy.TRANSIENT_LOCAL,
}


def qos_profile(topic: Topic) -> QoSProfile:
    """Return the profile with which `topic` is published and subscribed."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=topic.depth,
        reliability=_RELIABILITY[topic.reliability],
        durability=_DURABILITY[topic.durability],
    )
