"""What rosbag2 writes beside and into a bag: ``metadata.yaml`` and the quality of service of each topic.

The layout is that of metadata version 9, which ROS 2 Jazzy writes and every later release reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import yaml

METADATA_FILE: Final = "metadata.yaml"
VERSION: Final = 9
ROS_DISTRO: Final = "jazzy"

_UNLIMITED: Final = {"sec": 9223372036, "nsec": 854775807}  # RMW_DURATION_INFINITE
_MAXIMUM_TIME: Final = 2**63 - 1


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as it stands in a bag.

    Attributes
    ----------
    name, type : str
        ``/motor_states`` and ``sensor_msgs/msg/JointState``.
    definition : str
        Definition of the type with all nested ones, as ``ros2msg`` text.
    reliability, durability : str
        What its publishers offer, by rmw's words: ``reliable``, ``best_effort``; ``volatile``,
        ``transient_local``; ``unknown`` if nobody said.
    depth : int
        Depth of the publishers' history; 0 if it is not known.
    type_hash : str
        ``RIHS01_...`` of the type, or empty.
    """

    name: str
    type: str
    definition: str
    reliability: str = "unknown"
    durability: str = "unknown"
    depth: int = 0
    type_hash: str = ""

    @property
    def offered_qos_profiles(self) -> list[dict[str, Any]]:
        """The profile as rosbag2 writes it, for replaying."""
        return [
            {
                "history": "keep_last" if self.depth else "unknown",
                "depth": self.depth,
                "reliability": self.reliability,
                "durability": self.durability,
                "deadline": dict(_UNLIMITED),
                "lifespan": dict(_UNLIMITED),
                "liveliness": "automatic",
                "liveliness_lease_duration": dict(_UNLIMITED),
                "avoid_ros_namespace_conventions": False,
            }
        ]

    @property
    def channel_metadata(self) -> dict[str, str]:
        """Metadata of the topic's channel in an MCAP file."""
        return {
            "offered_qos_profiles": dump(self.offered_qos_profiles),
            "topic_type_hash": self.type_hash,
        }


def bag_information(
    file_name: str,
    topics: Sequence[RecordedTopic],
    counts: Mapping[str, int],
    start_ns: int | None,
    end_ns: int | None,
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of ``metadata.yaml`` for a bag of one MCAP file.

    Parameters
    ----------
    file_name : str
        Name of the file inside the bag's directory.
    topics, counts
        The topics and the number of messages of each by name.
    start_ns, end_ns : int or None
        Log time of the first and the last message; None for a bag without any.
    custom_data
        Free-form strings by name.
    """
    total = sum(counts.values())
    start = _MAXIMUM_TIME if start_ns is None else start_ns
    duration = 0 if start_ns is None or end_ns is None else end_ns - start_ns
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": duration},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": total,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.offered_qos_profiles,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": counts.get(topic.name, 0),
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [
            {
                "path": file_name,
                "starting_time": {"nanoseconds_since_epoch": start},
                "duration": {"nanoseconds": duration},
                "message_count": total,
            }
        ],
        "custom_data": dict(custom_data),
        "ros_distro": ROS_DISTRO,
    }


def dump(content: object) -> str:
    """Return `content` as YAML in the order in which it was built."""
    text: str = yaml.dump(content, sort_keys=False, allow_unicode=True, default_flow_style=False)
    return text
