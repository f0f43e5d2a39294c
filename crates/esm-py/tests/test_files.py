"""Clouds and trajectories in files, and recordings."""

from __future__ import annotations

import re
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

import esm_py
from conftest import World
from esm_py.errors import (
    EmptyError,
    MalformedError,
    MissingFileError,
    RecordingWarning,
    TopicError,
    UnsupportedError,
)

POINTS = np.array([[1.5, 2, 3], [4, 5, 6], [7, 8, 9.25]], np.float32)


def pcd(points: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> bytes:
    n = len(points)
    head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA binary\n"
    return head.encode() + points.astype("<f4").tobytes()


def write_all(folder: Path) -> list[Path]:
    rows = "\n".join(" ".join(map(str, p)) for p in POINTS.tolist())
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    (folder / "a.ply").write_text(head + rows + "\n")
    (folder / "a.pcd").write_bytes(pcd(POINTS))
    (folder / "a.bin").write_bytes(np.c_[POINTS, np.zeros(3)].astype("<f4").tobytes())
    (folder / "a.las").write_bytes(las(POINTS))
    return [folder / f"a.{e}" for e in ("ply", "pcd", "bin", "las")]


def las(points: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> bytes:
    """LAS 1.2, point format 0, in quarters of a metre."""
    head = bytearray(227)
    struct.pack_into("<4s", head, 0, b"LASF")
    struct.pack_into("<BB", head, 24, 1, 2)
    struct.pack_into("<HIIBHI5I", head, 94, 227, 227, 0, 0, 20, len(points), len(points), 0, 0, 0, 0)
    low, high = points.min(axis=0), points.max(axis=0)
    bounds = [v for pair in zip(high, low, strict=True) for v in pair]
    struct.pack_into("<12d", head, 131, 0.25, 0.25, 0.25, 0, 0, 0, *bounds)
    rows = [struct.pack("<3iHBBbBH", *(np.round(p * 4).astype(int)), 0, 9, 0, 0, 0, 0) for p in points]
    return bytes(head) + b"".join(rows)


def test_every_format_is_read(tmp_path: Path) -> None:
    for path in write_all(tmp_path):
        scan, prior = esm_py.read_scan(path), esm_py.read_prior_cloud(str(path))
        for cloud in (scan, prior):
            np.testing.assert_array_equal(cloud.points, POINTS, err_msg=path.name)
            assert cloud.points.dtype == np.float32 and len(cloud) == 3 and cloud.dropped == 0
        np.testing.assert_array_equal(prior.origin, [0, 0, 0])
        assert esm_py.classify(path) == "prior_cloud"
    assert esm_py.classify(tmp_path) == "scan_directory"


def test_projected_coordinates_keep_their_origin(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    (tmp_path / "utm.ply").write_text(head + "448262.25 5428123.5 112\n448263.25 nan 112\n")
    prior = esm_py.read_prior_cloud(tmp_path / "utm.ply")
    np.testing.assert_array_equal(prior.origin, [448_000, 5_428_000, 0])
    np.testing.assert_array_equal(prior.points, [[262.25, 123.5, 112]])
    assert prior.dropped == 1 and prior.origin.dtype == np.float64


def test_damaged_and_missing_clouds(tmp_path: Path) -> None:
    for path in write_all(tmp_path):
        torn = tmp_path / f"torn{path.suffix}"
        torn.write_bytes(path.read_bytes()[:-6])
        with pytest.raises(MalformedError, match=rf"{re.escape(str(torn))}: .*\nhint: ") as caught:
            esm_py.read_scan(torn)
        assert caught.value.path == str(torn) and caught.value.place and caught.value.hint
        with pytest.raises(MissingFileError, match=r"(?s)gone\..*\nhint: check the spelling") as missing:
            esm_py.read_prior_cloud(tmp_path / f"gone{path.suffix}")
        assert isinstance(missing.value, FileNotFoundError) and missing.value.errno == 2
        assert missing.value.filename == str(tmp_path / f"gone{path.suffix}")
    (tmp_path / "a.txt").write_text("1 2 3")
    with pytest.raises(UnsupportedError, match="'.txt' is no known kind"):
        esm_py.read_scan(tmp_path / "a.txt")
    (tmp_path / "nan.pcd").write_bytes(pcd(np.full((2, 3), np.nan, np.float32)))
    assert esm_py.read_scan(tmp_path / "nan.pcd").dropped == 2
    with pytest.raises(EmptyError, match="no usable point"):
        esm_py.read_prior_cloud(tmp_path / "nan.pcd")
    (tmp_path / "huge.pcd").write_bytes(
        pcd(POINTS).replace(b"POINTS 3", b"POINTS 999999999999").replace(b"WIDTH 3", b"WIDTH 999999999999")
    )
    with pytest.raises(MalformedError):
        esm_py.read_scan(tmp_path / "huge.pcd")
    for wrong in (3, None, b"a.pcd"):
        with pytest.raises(TypeError):
            esm_py.read_scan(wrong)  # type: ignore[arg-type]
    with pytest.raises(OSError, match="hint"):
        esm_py.read_scan("a\0.pcd")


def test_trajectories(tmp_path: Path) -> None:
    path = tmp_path / "poses.tum"
    poses = np.stack([np.eye(4)] * 3)
    poses[1, :3, 3] = [1, 2, 3]
    poses[2, :2, :2] = [[0, -1], [1, 0]]
    stamps = np.array([1_500_000_000, 1_600_000_001, 2_000_000_000])
    esm_py.write_tum(path, stamps, np.asfortranarray(poses))
    for read in (esm_py.read_tum, esm_py.read_poses):
        trajectory = read(path)
        assert len(trajectory) == 3 and trajectory.stamps_ns is not None and trajectory.stamps is not None
        np.testing.assert_array_equal(trajectory.stamps_ns, stamps)
        np.testing.assert_allclose(trajectory.stamps, stamps / 1e9)
        np.testing.assert_allclose(trajectory.poses, poses, atol=1e-8)
    kitti = tmp_path / "poses.txt"
    np.savetxt(kitti, poses[:, :3].reshape(3, 12))
    for read in (esm_py.read_kitti_poses, esm_py.read_poses):
        trajectory = read(kitti)
        assert trajectory.stamps is None and trajectory.stamps_ns is None
        np.testing.assert_allclose(trajectory.poses, poses, atol=1e-12)
    path.write_text("1 2 3\n")
    with pytest.raises(MalformedError, match="line 1"):
        esm_py.read_tum(path)
    for wrong, error, words in [
        ((stamps[:2], poses), ValueError, r"poses must have shape \(2, 4, 4\)"),
        ((stamps, poses[0]), ValueError, r"poses must have shape \(3, 4, 4\)"),
        ((stamps / 1e9, poses), TypeError, "stamps_ns must hold whole numbers"),
        ((stamps[None], poses), ValueError, r"stamps_ns must have shape \(N,\)"),
        ((stamps, 2 * poses), ValueError, r"poses\[0\] must end with the row"),
    ]:
        with pytest.raises(error, match=words):
            esm_py.write_tum(path, *wrong)


def test_poses_as_mcap(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    with esm_py.PoseWriter(path) as writer:
        writer.write(1_500_000_000, np.eye(4), np.eye(6))
        writer.write(1_600_000_000, np.eye(4))
        assert not path.exists()
    assert path.read_bytes().startswith(b"\x89MCAP")
    with pytest.raises(ValueError, match="finished"):
        writer.finish()
    with pytest.raises(ValueError, match=r"covariance must have shape \(6, 6\)"):
        esm_py.PoseWriter(tmp_path / "b.mcap").write(0, np.eye(4), np.eye(5))
    with pytest.raises(ZeroDivisionError), esm_py.PoseWriter(tmp_path / "c.mcap") as writer:
        raise ZeroDivisionError
    with pytest.raises(MissingFileError):
        esm_py.PoseWriter(tmp_path / "none" / "d.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["out.mcap"], "what was given up is gone"


def test_a_recording_is_read(world: World) -> None:
    recording = world.recording("map", labels=True)
    assert (recording.cloud_topic, recording.motion_topic, recording.has_motion) == ("/points", "/odometry", True)
    assert [t.name for t in recording.topics] == ["/odometry", "/points"]
    assert recording.topics[1].message_type == "sensor_msgs/msg/PointCloud2"
    sweeps = list(recording)
    assert len(sweeps) == recording.sweep_count_hint == recording.topics[1].messages
    assert [s.number for s in sweeps] == list(range(1, len(sweeps) + 1))
    first, last = sweeps[0], sweeps[-1]
    assert first.points.shape == (len(first), 3) and first.points.dtype == np.float32
    assert first.objects is not None and first.classes is not None
    assert first.objects.shape == first.classes.shape == (len(first),)
    assert {esm_py.CLASSES[int(c)] for c in np.unique(first.classes)} >= {"tree"}
    assert first.pose_odom_sensor is not None and last.pose_odom_sensor is not None
    assert 40 < np.linalg.norm((last.pose_odom_sensor - first.pose_odom_sensor)[:3, 3]) < 80
    assert first.stamp_ns / 1e9 == pytest.approx(first.stamp) and first.frame_id == "lidar"
    again = recording.sweeps()
    np.testing.assert_array_equal(next(again).points, first.points)
    assert next(world.recording("map").sweeps()).objects is None, "labels were not asked for"
    assert list(again)[-1].number == last.number and again.warnings == [] and again.damage is None
    with pytest.raises(StopIteration):
        next(again)


def test_directories_and_single_scans(tmp_path: Path) -> None:
    for n in (2, 10):
        (tmp_path / f"{n}.pcd").write_bytes(pcd(POINTS + n))
    recording = esm_py.Recording(tmp_path)
    assert not recording.has_motion and recording.topics == [] and recording.cloud_topic is None
    assert [s.points[0, 0] for s in recording] == [3.5, 11.5]
    assert next(iter(recording)).pose_odom_sensor is None
    poses = np.stack([np.eye(4)] * 2)
    poses[:, 0, 3] = [5, 6]
    np.savetxt(tmp_path / "poses.txt", poses[:, :3].reshape(2, 12))
    posed = list(esm_py.Recording(tmp_path, poses=tmp_path / "poses.txt"))
    assert [p[0, 3] for s in posed if (p := s.pose_odom_sensor) is not None] == [5, 6]
    assert len(list(esm_py.Recording(tmp_path / "2.pcd"))) == 1


def test_a_torn_recording_is_read_as_far_as_it_is_whole(world: World, tmp_path: Path) -> None:
    whole = (world.folder / "live.mcap").read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole[: len(whole) // 2])
    sweeps = esm_py.Recording(torn).sweeps()
    with pytest.warns(RecordingWarning, match="torn.mcap: the recording is damaged") as caught:
        count = sum(1 for _ in sweeps)
    assert 0 < count < 120 and [str(w.message) for w in caught] == sweeps.warnings
    damage = sweeps.damage
    assert damage is not None and damage.places and str(damage).startswith("the recording is damaged")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(sweeps) == [], "it is told once"
    torn.write_bytes(whole[:300])
    with pytest.raises((MalformedError, EmptyError, UnsupportedError, TopicError), match="(?s)torn.mcap: .*hint: "):
        list(esm_py.Recording(torn))


def test_recordings_that_are_none(world: World, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        esm_py.Recording(tmp_path / "none.mcap")
    with pytest.raises(EmptyError):
        esm_py.Recording(tmp_path)
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises((MalformedError, EmptyError, UnsupportedError)):
        list(esm_py.Recording(tmp_path / "empty.mcap"))
    with pytest.raises(TopicError, match="/nothing") as caught:
        esm_py.Recording(world.folder / "map.mcap", cloud_topic="/nothing")
    assert "/points" in caught.value.candidates
    with pytest.raises(MissingFileError):
        esm_py.Recording(world.folder / "map.mcap", poses=tmp_path / "none.tum")
    with pytest.raises(TypeError):
        esm_py.Recording(world.folder / "map.mcap", "/points")  # type: ignore[call-arg]
