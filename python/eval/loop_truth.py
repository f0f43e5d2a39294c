# /// script
# requires-python = ">=3.11"
# dependencies = ["mcap-ros2-support>=0.5", "numpy>=2", "scipy>=1.14", "small_gicp>=1"]
# ///
"""Where a loop of a recording really closes, by somebody else's registration (small_gicp), where its odometry may have drifted.

    uv run python/eval/loop_truth.py ../shared/data/kitti00/map.mcap 216 550

Frames are counted from 1. The clouds of both are put together from the frames just before, and aligned twice: from the relative pose of
the recording's own odometry, and from a start beside it (--guess). Prints where both end, and how far
the odometry is off.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import small_gicp
from mcap_ros2.reader import read_ros2_messages
from scipy.spatial.transform import Rotation

F64 = npt.NDArray[np.float64]
RANGE_M = 40.0
FRAMES = 8


def matrix(pose: Any) -> F64:
    """A ROS pose as a 4 x 4 matrix."""
    q, t = pose.orientation, pose.position
    m = np.eye(4)
    m[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    m[:3, 3] = [t.x, t.y, t.z]
    return m


def quaternion(m: F64) -> F64:
    """x y z w, rounded."""
    return np.round(Rotation.from_matrix(m[:3, :3]).as_quat(), 5)


def points(cloud: Any) -> F64:
    """(n, 3) metres in the sensor frame; x y z are the first three floats of a point."""
    raw = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
    xyz = raw[:, :12].copy().view("<f4").astype(np.float64)
    return xyz[np.linalg.norm(xyz, axis=1) < RANGE_M]


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("frame_from", type=int)
    parser.add_argument("frame_to", type=int)
    parser.add_argument("--cloud-topic", default="/velodyne_points")
    parser.add_argument("--odometry-topic", default="/odometry")
    shift = {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")}
    parser.add_argument("--guess", default=(-1.0, 1.0, 1.0), help="of the second start beside the first, metres", **shift)
    options = parser.parse_args()
    clouds, poses = [], []
    for message in read_ros2_messages(str(options.recording), topics=[options.cloud_topic, options.odometry_topic]):
        if message.channel.topic == options.cloud_topic:
            clouds.append(message.ros_msg)
        else:
            poses.append(matrix(message.ros_msg.pose.pose))
        if min(len(clouds), len(poses)) >= max(options.frame_from, options.frame_to):
            break

    def gathered(frame: int) -> F64:
        newest = np.linalg.inv(poses[frame - 1])
        parts = []
        for i in range(max(frame - 1 - FRAMES, 0), frame):
            move = newest @ poses[i]
            parts.append(points(clouds[i]) @ move[:3, :3].T + move[:3, 3])
        return np.concatenate(parts)

    target, source = gathered(options.frame_from), gathered(options.frame_to)
    odometry = np.linalg.inv(poses[options.frame_from - 1]) @ poses[options.frame_to - 1]
    shifted = odometry.copy()
    shifted[:3, 3] += options.guess
    print(f"by odometry        {np.round(odometry[:3, 3], 3)} {quaternion(odometry)}")
    for name, start in (("odometry", odometry), ("another place", shifted)):
        for reach in (3.0, 0.6):
            result = small_gicp.align(
                target,
                source,
                init_T_target_source=start,
                registration_type="GICP",
                downsampling_resolution=0.3,
                max_correspondence_distance=reach,
            )
            start = result.T_target_source
        off = np.linalg.norm(start[:3, 3] - odometry[:3, 3])
        print(f"from {name:13s} {np.round(start[:3, 3], 3)} {quaternion(start)}: {off:.2f} m off the odometry")


if __name__ == "__main__":
    main()
