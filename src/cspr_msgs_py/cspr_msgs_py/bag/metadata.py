"""What rosbag2 writes beside and into a bag: ``metadata.yaml`` and the quality of service of each topic.

The layout is that of metadata version 9, which ROS 2 Jazzy writes and every later release reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import yaml

from cspr_msgs_py.errors import BagError
from cspr_msgs_py.wire.cdr import NANOSECONDS

METADATA_FILE: Final = "metadata.yaml"
COMPRESSED_SUFFIX: Final = ".zstd"  # of a file that rosbag2 compressed as a whole
VERSION: Final = 9
ROS_DISTRO: Final = "jazzy"

INFINITE: Final = 2**63 - 1  # ns; rmw's RMW_DURATION_INFINITE, and the start of a bag without messages

# The words of each policy in the order of rmw's numbers, which stand in bags before version 9.
_POLICIES: Final = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown"),
    "durability": ("system_default", "transient_local", "volatile", "unknown"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown"),
}

_DURATIONS: Final = ("deadline", "lifespan", "liveliness_lease_duration")

_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # the second one without libyaml
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class OfferedQos:
    """The quality of service that one publisher offers, by rmw's words, in rosbag2's order.

    Attributes
    ----------
    history, reliability, durability, liveliness : str
        ``unknown`` where the middleware does not tell, as is usual for the history.
    depth : int
    deadline, lifespan, liveliness_lease_duration : int
        ns; `INFINITE` for none.
    avoid_ros_namespace_conventions : bool
    """

    history: str = "unknown"
    depth: int = 0
    reliability: str = "unknown"
    durability: str = "unknown"
    deadline: int = INFINITE
    lifespan: int = INFINITE
    liveliness: str = "automatic"
    liveliness_lease_duration: int = INFINITE
    avoid_ros_namespace_conventions: bool = False

    def as_mapping(self) -> dict[str, Any]:
        """Return the profile in rosbag2's spelling."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return values | {name: _duration(values[name]) for name in _DURATIONS}


def _duration(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return {"sec": seconds, "nsec": rest}


def parse_offered_qos(text: str) -> tuple[OfferedQos, ...]:
    """Return the profiles that stand in the metadata of a channel, whatever version of rosbag2 wrote them.

    A profile that cannot be read is left out: the messages can be read without.
    """
    try:
        content = yaml.load(text, _Loader)
    except yaml.YAMLError:
        return ()
    profiles = []
    for entry in content if isinstance(content, list) else ():
        try:
            values: dict[str, Any] = {name: _word(name, entry[name]) for name in _POLICIES}
            for name in _DURATIONS:
                values[name] = min(entry[name]["sec"] * NANOSECONDS + entry[name]["nsec"], INFINITE)
            profiles.append(OfferedQos(depth=int(entry["depth"]), **values))
        except (KeyError, TypeError, ValueError, IndexError):
            continue
    return tuple(profiles)


def _word(policy: str, value: str | int) -> str:
    return _POLICIES[policy][value] if isinstance(value, int) else str(value)


@dataclass(frozen=True)
class RecordedTopic:
    """A topic as it stands in a bag.

    Attributes
    ----------
    name, type : str
        ``/motor_states`` and ``sensor_msgs/msg/JointState``.
    definition : str
        Definition of the type with all nested ones.
    qos : tuple of OfferedQos
        What each of its publishers offers.
    type_hash : str
        ``RIHS01_...`` of the type, or empty.
    definition_language : str
        ``ros2msg``, or ``ros2idl`` for a bag that somebody else recorded.
    """

    name: str
    type: str
    definition: str
    qos: tuple[OfferedQos, ...] = ()
    type_hash: str = ""
    definition_language: str = "ros2msg"

    @property
    def offered_qos_profiles(self) -> list[dict[str, Any]]:
        """The profiles as rosbag2 writes them, for replaying."""
        return [profile.as_mapping() for profile in self.qos]

    @property
    def channel_metadata(self) -> dict[str, str]:
        """Metadata of the topic's channel in an MCAP file."""
        return {
            "offered_qos_profiles": dump(self.offered_qos_profiles),
            "topic_type_hash": self.type_hash,
        }


@dataclass
class FileSummary:
    """What ``metadata.yaml`` says of one file: its name, log times (ns) and number of messages."""

    name: str
    start: int | None = None
    end: int | None = None
    count: int = 0

    def times(self) -> dict[str, Any]:
        """Return start and duration as rosbag2 writes them."""
        start, end = (
            (INFINITE, INFINITE) if self.start is None or self.end is None else (self.start, self.end)
        )
        return {
            "starting_time": {"nanoseconds_since_epoch": start},
            "duration": {"nanoseconds": end - start},
        }


def bag_information(
    files: Sequence[FileSummary],
    topics: Sequence[RecordedTopic],
    counts: Mapping[str, int],
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of ``metadata.yaml`` for a bag of MCAP files.

    Parameters
    ----------
    files
        In the order in which they were written.
    topics, counts
        The topics and the number of messages of each by name.
    custom_data
        Free-form strings by name.
    """
    starts = [file.start for file in files if file.start is not None]
    ends = [file.end for file in files if file.end is not None]
    whole = FileSummary("", min(starts, default=None), max(ends, default=None)).times()
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": whole["duration"],
        "starting_time": whole["starting_time"],
        "message_count": sum(file.count for file in files),
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
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **file.times(), "message_count": file.count} for file in files],
        "custom_data": dict(custom_data),
        "ros_distro": ROS_DISTRO,
    }


def dump(content: object) -> str:
    """Return `content` as YAML in the order in which it was built."""
    text: str = yaml.dump(
        content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=False
    )
    return text


def find_files(path: Path) -> tuple[list[Path], bool, dict[str, int]]:
    """Return the files of a bag in the order of time, whether each message is compressed, and announced counts."""
    if not path.exists():
        raise BagError(f"there is no bag {path}")
    if not path.is_dir():
        return [path], False, {}
    names: list[Path] = []
    mode = ""
    counts: dict[str, int] = {}
    try:
        content = yaml.safe_load((path / METADATA_FILE).read_text())
        information = content["rosbag2_bagfile_information"]
        if information["storage_identifier"] != "mcap":
            raise BagError(
                f"{path} is a bag in {information['storage_identifier']} and not in mcap: convert it with "
                "`ros2 bag convert`"
            )
        names = [path / Path(name).name for name in information["relative_file_paths"]]
        mode = str(information.get("compression_mode", "")).lower()
        for topic in information["topics_with_message_count"]:
            counts[topic["topic_metadata"]["name"]] = int(topic["message_count"])
    except FileNotFoundError:  # left by a recording that was cut off at its very start
        pass
    except KeyError as error:
        raise BagError(f"{path / METADATA_FILE} is not the metadata of a bag: it lacks {error}") from error
    except (OSError, yaml.YAMLError, TypeError, ValueError) as error:
        raise BagError(f"{path / METADATA_FILE} is not the metadata of a bag: {error}") from error
    if mode == "file":  # depending on its version rosbag2 lists the files without what compression appends
        names = [_compressed(name) for name in names]
    # a recording that was killed has files which its metadata do not name yet
    named = {name.name for name in names}
    names += [file for file in sorted(path.glob("*.mcap"), key=_number) if file.name not in named]
    if not names:
        raise BagError(f"{path} is not a bag: it has neither {METADATA_FILE} nor an .mcap file")
    return names, mode == "message", counts


def _compressed(name: Path) -> Path:
    appended = name.with_name(name.name + COMPRESSED_SUFFIX)
    return appended if not name.exists() and appended.exists() else name


def _number(path: Path) -> tuple[int, str]:
    """Order files by the number at the end of their names: 2 before 10."""
    digits = path.stem.rpartition("_")[2]
    return (int(digits) if digits.isdigit() else 0, path.name)
