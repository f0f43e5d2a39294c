"""What two independent readers find in an MCAP file, in one form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy.typing as npt

# sensor_msgs/msg/PointField's numbers.
KINDS = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4"}


@dataclass
class Cloud:
    """One PointCloud2."""

    stamp_ns: int
    log_ns: int
    frame: str
    size: tuple[int, int]
    steps: tuple[int, int]
    big_endian: bool
    dense: bool
    fields: list[tuple[str, int, int, int]]
    data: bytes

    def points(self) -> npt.NDArray[np.void]:
        """Decode the points as the fields say."""
        kinds = [f"{KINDS[kind]}" for _, _, kind, _ in self.fields]
        record = np.dtype(
            {
                "names": [name for name, _, _, _ in self.fields],
                "formats": kinds,
                "offsets": [offset for _, offset, _, _ in self.fields],
                "itemsize": self.steps[0],
            }
        )
        return np.frombuffer(self.data, record)


@dataclass
class Motion:
    """One Odometry message: seven numbers of the pose, position first, x y z w last."""

    stamp_ns: int
    frames: tuple[str, str]
    pose: list[float]


@dataclass
class Contents:
    """All messages of a file, in its order."""

    clouds: list[Cloud] = field(default_factory=list)
    motions: list[Motion] = field(default_factory=list)

    def take(self, topic: str, log_ns: int, message: Any) -> None:  # noqa: ANN401
        """Add a message; both readers give their fields the names of the ROS definitions."""
        head = message.header
        stamp = head.stamp.sec * 10**9 + head.stamp.nanosec
        if topic == "/points":
            fields = [(f.name, int(f.offset), int(f.datatype), int(f.count)) for f in message.fields]
            self.clouds.append(
                Cloud(
                    stamp_ns=stamp,
                    log_ns=log_ns,
                    frame=head.frame_id,
                    size=(int(message.width), int(message.height)),
                    steps=(int(message.point_step), int(message.row_step)),
                    big_endian=bool(message.is_bigendian),
                    dense=bool(message.is_dense),
                    fields=fields,
                    data=bytes(message.data),
                )
            )
        else:
            assert topic == "/odometry", topic
            p, q = message.pose.pose.position, message.pose.pose.orientation
            pose = [float(v) for v in (p.x, p.y, p.z, q.x, q.y, q.z, q.w)]
            self.motions.append(Motion(stamp, (head.frame_id, message.child_frame_id), pose))


def by_mcap_ros2(path: Path) -> Contents:
    """Read with `mcap-ros2-support`, by the definitions in the file."""
    contents = Contents()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            contents.take(channel.topic, message.log_time, decoded)
    return contents


def by_rosbags(path: Path) -> Contents:
    """Read with `rosbags`."""
    contents = Contents()
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, log_ns, raw in reader.messages():
            contents.take(connection.topic, log_ns, reader.deserialize(raw, connection.msgtype))
    return contents


READERS: dict[str, Callable[[Path], Contents]] = {"mcap-ros2-support": by_mcap_ros2, "rosbags": by_rosbags}
