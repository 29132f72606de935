"""Who publishes on topics that have one writer, as discovery knows it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rclpy.node import Node

from cspr_msgs_py.topics import Topic

_LINGERS = 20  # s for which Fast DDS still announces a process that was killed


def doubled_topics(node: Node, topics: Iterable[Topic]) -> Sequence[str]:
    """Return, in words, the topics that have more than one publisher, and whose these are.

    Quick, for it may be asked between two control cycles: some microseconds a topic.
    """
    return [_in_words(node, topic) for topic in topics if node.count_publishers(topic.name) > 1]


def _in_words(node: Node, topic: Topic) -> str:
    ends = node.get_publishers_info_by_topic(topic.name)
    names = sorted(f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends)
    return (
        f"{topic.name} has {len(names)} publishers, {' and '.join(names)}: end all but one (one that was killed is "
        f"announced for another {_LINGERS} s)"
    )
