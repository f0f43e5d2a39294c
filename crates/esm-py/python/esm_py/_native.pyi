"""The native half of esm_py."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Self, SupportsIndex, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

_StrPath: TypeAlias = str | PathLike[str]
_Float32: TypeAlias = NDArray[np.float32]
_Float64: TypeAlias = NDArray[np.float64]
_UInt32: TypeAlias = NDArray[np.uint32]

CLASSES: Final[dict[int, str]]
DESCRIPTORS: Final[tuple[str, ...]]
PRESETS: Final[tuple[str, ...]]
UNKNOWN_CLASS: Final[int]
__version__: Final[str]

__all__ = [
    "CLASSES",
    "DESCRIPTORS",
    "PRESETS",
    "UNKNOWN_CLASS",
    "Accumulator",
    "Candidates",
    "Config",
    "Damage",
    "Descriptions",
    "Descriptor",
    "DescriptorInfo",
    "Found",
    "Hypothesis",
    "Identities",
    "Index",
    "LiveCloud",
    "Localization",
    "Localizer",
    "LoopAnswer",
    "LoopClosure",
    "LoopFinder",
    "Map",
    "MapBuilder",
    "MatchedSegment",
    "PoseWriter",
    "Preset",
    "PriorCloud",
    "Progress",
    "Recording",
    "Scan",
    "Segment",
    "SegmentSetWriter",
    "Segmentation",
    "SequenceLocalizer",
    "Standardizer",
    "Summary",
    "Surveyor",
    "Sweep",
    "Sweeps",
    "Topic",
    "Trajectory",
    "XConv",
    "__version__",
    "candidates",
    "classify",
    "euclidean_clusters",
    "finite",
    "ground_flags",
    "read_kitti_poses",
    "read_poses",
    "read_prior_cloud",
    "read_scan",
    "read_tum",
    "search",
    "segment",
    "segments_of",
    "simulate",
    "voxel_filter",
    "write_tum",
]

@final
class Config:
    """Everything that can be set, a table for each step, with the keys of `esm-cli config`.

    `Config({"accumulate": {"distance_m": 6.0}})` changes what is given and leaves the rest at its default. Unknown keys and
    values outside their range raise `ConfigError`.
    """

    def __new__(cls, settings: Mapping[str, Any] | None = None) -> Self: ...
    @staticmethod
    def from_toml(text: str) -> Config:
        """Make one from TOML text."""

    @staticmethod
    def read(path: _StrPath) -> Config:
        """Read a TOML file, as `--config FILE` does."""

    def replace(self, settings: Mapping[str, Any]) -> Config:
        """Make another one that differs in what is given, key by key."""

    def to_toml(self) -> str:
        """Write all of it as TOML."""

    def to_dict(self) -> dict[str, Any]:
        """Give all of it as dictionaries."""

    @property
    def descriptor(self) -> str:
        """Name of the descriptor, one of `DESCRIPTORS`."""

    @property
    def seed(self) -> int:
        """Seed of everything random."""

    def __reduce__(self) -> tuple[Any, tuple[str]]: ...
    def __hash__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...

@final
class Scan:
    """One scan of a file, in its sensor's frame."""

    @property
    def points(self) -> _Float32:
        """Points, shape (N, 3), metres, sensor frame."""

    @property
    def dropped(self) -> int:
        """Points left out: NaN, infinite, or exactly (0, 0, 0), which is how sensors write "no return"."""

    def __len__(self) -> int: ...

@final
class PriorCloud:
    """A survey somebody else made: one cloud in its own frame. A point's coordinates in the file are `origin + point`."""

    @property
    def origin(self) -> _Float64:
        """What to add to every point, shape (3,), metres, a multiple of 1000 on each axis."""

    @property
    def points(self) -> _Float32:
        """Points relative to the origin, shape (N, 3), metres."""

    @property
    def dropped(self) -> int:
        """Points left out: NaN, infinite, or exactly (0, 0, 0)."""

    def __len__(self) -> int: ...

def read_scan(path: _StrPath) -> Scan:
    """Read one scan: `.las`, `.laz`, `.pcd`, `.ply` or KITTI's `.bin`, told apart by extension. It may hold no point."""

def read_prior_cloud(path: _StrPath) -> PriorCloud:
    """Read one prior cloud, of the formats of `read_scan`, projected coordinates included."""

def classify(path: _StrPath) -> Literal["recording", "scan_directory", "prior_cloud"]:
    """Tell what an input is, by its name and first bytes."""

def finite(points: ArrayLike) -> tuple[_Float32, int]:
    """Keep the finite points, shape (N, 3), in their order, and tell how many were dropped."""

@final
class Trajectory:
    """Poses of a file."""

    @property
    def stamps_ns(self) -> NDArray[np.int64] | None:
        """Times in nanoseconds, shape (N,); None for KITTI files, which have a pose for each sweep in order."""

    @property
    def stamps(self) -> _Float64 | None:
        """The same in seconds."""

    @property
    def poses(self) -> _Float64:
        """Poses, shape (N, 4, 4), metres, in the frame the file is about."""

    def __len__(self) -> int: ...

def read_tum(path: _StrPath) -> Trajectory:
    """Read a TUM trajectory: `stamp x y z qx qy qz qw` a line."""

def read_kitti_poses(path: _StrPath) -> Trajectory:
    """Read a KITTI trajectory: the upper 3 x 4 numbers of a pose a line."""

def read_poses(path: _StrPath) -> Trajectory:
    """Read a TUM or KITTI trajectory, told apart by its first line."""

def write_tum(path: _StrPath, stamps_ns: ArrayLike, poses: ArrayLike) -> None:
    """Write a TUM trajectory, whole or not at all.

    `stamps_ns`: nanoseconds, integers of shape (N,). `poses`: shape (N, 4, 4).
    """

@final
class PoseWriter:
    """Writes poses to an MCAP file (`PoseWithCovarianceStamped`) that appears when it is finished, and not before.

    As a context manager it finishes at the end, and gives the file up after an exception.
    """

    def __new__(cls, path: _StrPath, topic: str = "/localization", frame_id: str = "map") -> Self: ...
    def write(self, stamp_ns: int, pose_map_sensor: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Write one pose, shape (4, 4), and its covariance, shape (6, 6), as `Localization` gives them."""

    def finish(self) -> None:
        """Complete the file and move it into place."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
        /,
    ) -> None: ...

@final
class Recording:
    """An opened recording: one `.mcap`, a directory of scans, or a single scan. Iterating over it reads its sweeps.

    `cloud_topic` and `motion_topic` choose where several topics are of a kind; `poses` is a TUM or KITTI file that gives the
    sensor's pose at each sweep instead of a topic; `labels` reads what each point was hit on, as simulators tell it.
    """

    def __new__(
        cls,
        path: _StrPath,
        *,
        cloud_topic: str | None = None,
        motion_topic: str | None = None,
        poses: _StrPath | None = None,
        labels: bool = False,
    ) -> Self: ...
    @property
    def path(self) -> Path:
        """The file or directory."""

    @property
    def cloud_topic(self) -> str | None:
        """The topic the clouds are read from."""

    @property
    def motion_topic(self) -> str | None:
        """The topic the motion is read from."""

    @property
    def has_motion(self) -> bool:
        """Whether there is a source of motion: a topic or a file of poses."""

    @property
    def sweep_count_hint(self) -> int | None:
        """How many sweeps there are as far as the file tells without reading the clouds."""

    @property
    def topics(self) -> list[Topic]:
        """All topics by name; none for a directory."""

    def sweeps(self) -> Sweeps:
        """Start reading at the first sweep, independently of other readings."""

    def __iter__(self) -> Iterator[Sweep]: ...

@final
class Topic:
    """A topic of a recording."""

    @property
    def name(self) -> str:
        """Its name, such as `/velodyne_points`."""

    @property
    def message_type(self) -> str:
        """Its message type, such as `sensor_msgs/msg/PointCloud2`."""

    @property
    def messages(self) -> int:
        """Number of messages (intact ones where the recording is damaged)."""

@final
class Sweeps:
    """The sweeps of a recording in the order of the file, in constant memory. After an error it ends.

    What was not as it should be is warned of once the end is reached (`RecordingWarning`).
    """

    def __iter__(self) -> Self: ...
    def __next__(self) -> Sweep: ...
    @property
    def warnings(self) -> list[str]:
        """What was not as it should be, in words; complete once the iteration has ended."""

    @property
    def damage(self) -> Damage | None:
        """What is missing of a damaged recording, once the iteration has ended."""

@final
class Damage:
    """A recording from which something is missing. Every intact message was used all the same."""

    @property
    def lost(self) -> int:
        """Missing messages of all topics, at least."""

    @property
    def lost_clouds(self) -> int:
        """Missing clouds, at least."""

    @property
    def is_exact(self) -> bool:
        """Whether not more are missing, as far as the file tells."""

    @property
    def places(self) -> list[str]:
        """Where and what, in the order of the file: the first few places."""

    @property
    def more_places(self) -> int:
        """Number of further places."""

@final
class Sweep:
    """One sweep of a recording."""

    @property
    def number(self) -> int:
        """Its number among the recording's intact clouds, from 1."""

    @property
    def stamp(self) -> float:
        """Time in seconds."""

    @property
    def stamp_ns(self) -> int:
        """The same in nanoseconds, exact."""

    @property
    def points(self) -> _Float32:
        """Points, shape (N, 3), metres, sensor frame."""

    @property
    def pose_odom_sensor(self) -> _Float64 | None:
        """Where the sensor is in the frame its motion is told in, shape (4, 4). Only differences mean anything."""

    @property
    def frame_id(self) -> str:
        """The sensor frame's name, empty in directories."""

    @property
    def dropped(self) -> int:
        """Points left out: NaN, infinite, or exactly (0, 0, 0)."""

    @property
    def objects(self) -> _UInt32 | None:
        """The object each point was hit on, shape (N,), 0 for the ground, where labels were asked for and are there."""

    @property
    def classes(self) -> NDArray[np.uint8] | None:
        """The class of that object (`CLASSES`), shape (N,), 255 where unknown."""

    def __len__(self) -> int: ...

@final
class LiveCloud:
    """A cloud ready to be localized: an accumulator gives them, or you make one of points you have put together."""

    def __new__(
        cls,
        stamp: float,
        points: ArrayLike,
        pose_odom_sensor: ArrayLike | None = None,
        *,
        travel_m: float = 0.0,
        sweeps: int = 1,
    ) -> Self: ...
    @property
    def stamp(self) -> float:
        """Seconds, of the newest sweep."""

    @property
    def points(self) -> _Float32:
        """Points, shape (N, 3), metres, newest sensor frame."""

    @property
    def pose_odom_sensor(self) -> _Float64 | None:
        """Pose of the newest sensor in the odometry frame, shape (4, 4), where the motion is known."""

    @property
    def travel_m(self) -> float:
        """Metres of travel the cloud really holds."""

    @property
    def sweeps(self) -> int:
        """Sweeps in the cloud."""

    @property
    def elapsed_s(self) -> float:
        """Seconds it took to put together."""

    def __len__(self) -> int: ...

@final
class Accumulator:
    """Feeds on sweeps, one after the other, and gives live clouds. Memory is bounded by the distance they hold."""

    def __new__(cls, config: Config | None = None) -> Self: ...
    def push(self, stamp: float, points: ArrayLike, pose_odom_sensor: ArrayLike | None = None) -> LiveCloud | None:
        """Take the next sweep and give the live cloud that ends with it; with swathes only once every `distance_m`.

        `stamp`: seconds. `points`: shape (N, 3), metres, sensor frame, finite. `pose_odom_sensor`: shape (4, 4); a sweep
        without one is a cloud of its own and is not kept.
        """

    def push_sweep(self, sweep: Sweep) -> LiveCloud | None:
        """Take the next sweep of a recording, its pose to the last bit."""

@final
class Segment:
    """One segment: a connected group of points above the ground, in the frame of the cloud it was cut from."""

    def __new__(cls, points: ArrayLike, *, above_ground: float | None = None, rings: ArrayLike | None = None) -> Self: ...
    @property
    def points(self) -> _Float32:
        """Points, shape (N, 3), metres."""

    @property
    def above_ground(self) -> float | None:
        """Height of the lowest point above the ground around it, metres; None where that is not known."""

    @property
    def rings(self) -> _Float32:
        """What stands around it in its cloud, shape (7, 4): of each ring, the same numbers whatever the heading."""

    @property
    def centroid(self) -> _Float32:
        """Mean of the points, shape (3,), metres."""

    @property
    def min(self) -> _Float32:
        """Lower corner of the axis-aligned box, shape (3,), metres."""

    @property
    def max(self) -> _Float32:
        """Upper corner of the axis-aligned box, shape (3,), metres."""

    def __len__(self) -> int: ...

@final
class Segmentation:
    """What `segment` made of a cloud."""

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments, ordered by their first point in the order of voxels (z, then y, then x)."""

    @property
    def ground(self) -> _Float32:
        """The ground points of the voxelled cloud, shape (N, 3), metres."""

    @property
    def structure(self) -> _Float32:
        """All that stands on the ground, in a segment or not, shape (N, 3), metres."""

    @property
    def voxelled(self) -> int:
        """Points of the voxelled cloud, ground and small clusters included."""

    def __len__(self) -> int: ...

def segment(points: ArrayLike, config: Config | None = None, *, threads: int | None = None) -> Segmentation:
    """Cut a cloud into segments: thin it by voxels, remove the ground, cluster the rest.

    `points`: shape (N, 3), metres, finite, a frame with z up to within some ten degrees. The result does not depend on their
    order.
    """

def voxel_filter(points: ArrayLike, config: Config | None = None, *, threads: int | None = None) -> _Float32:
    """Replace the points of each voxel of `segment.voxel` metres by their centroid: shape (N, 3) to (M, 3)."""

def ground_flags(points: ArrayLike, config: Config | None = None, *, threads: int | None = None) -> NDArray[np.bool]:
    """Tell for each point, shape (N, 3), whether it is ground (`segment.ground`): shape (N,)."""

def segments_of(
    points: ArrayLike, clusters: Sequence[ArrayLike], ground: ArrayLike | None = None, *, threads: int | None = None
) -> list[Segment]:
    """Segments of clusters of `points`, each with what stands around it among all of them.

    `points`: shape (N, 3), metres, all that stands on the ground. `clusters`: arrays of their indices. `ground`: the
    ground points of the same cloud.
    """

def euclidean_clusters(points: ArrayLike, config: Config | None = None, *, threads: int | None = None) -> list[_UInt32]:
    """Group points, shape (N, 3), that are linked by steps of up to `segment.tolerance` metres.

    Gives the indices of each group that has `segment.min_points` to `segment.max_points` of them.
    """

@disjoint_base
class Descriptor:
    """Turns segments into rows of numbers, a batch at a time: one of `DESCRIPTORS` by name."""

    def __new__(cls, name: str) -> Self: ...
    @property
    def name(self) -> str:
        """Its name, as in `--descriptor NAME`."""

    @property
    def version(self) -> int:
        """Differs where the numbers do, so that maps of another version are refused."""

    @property
    def dim(self) -> int:
        """Numbers a segment."""

    @property
    def standardized(self) -> bool:
        """Whether a map brings each dimension to zero mean and unit variance over its segments."""

    def describe(self, segments: Segmentation | Sequence[Segment], *, threads: int | None = None) -> Descriptions:
        """Describe a batch. A row depends on its own segment's points only."""

@final
class XConv(Descriptor):
    """The learned descriptor with the weights of a file (`python/train/WEIGHTS.md`), such as weights you have trained."""

    @staticmethod
    def open(path: _StrPath) -> XConv:
        """Open a weights file (`.safetensors`)."""

    @staticmethod
    def from_bytes(data: bytes, name: str = "(memory)") -> XConv:
        """Take the bytes of a weights file; `name` stands for the file in messages."""

    def metadata(self, key: str) -> str | None:
        """Give a line of the weights' header, such as `training_data`."""

    @property
    def multiply_adds(self) -> int:
        """Multiply-adds for one segment."""

    def describe_normalised(
        self, points: ArrayLike, sizes: ArrayLike | None = None, *, threads: int | None = None
    ) -> Descriptions:
        """Describe inputs that are sampled and normalised already, to compare with other programs.

        `points`: shape (N, 256, 3). `sizes`: shape (N, F), the sizes that the header names, NaN where unknown.
        """

@final
class Descriptions:
    """Descriptors of a batch of segments."""

    @property
    def dim(self) -> int:
        """Numbers a segment."""

    @property
    def values(self) -> _Float32:
        """Descriptors, shape (N, dim), in the order of the segments."""

    @property
    def quality(self) -> _Float32:
        """The probability, 0 to 1, that a descriptor is good for matching, shape (N,)."""

    @property
    def preprocessing_s(self) -> float:
        """Seconds spent on preparing the input, where the descriptor has such a step."""

    def __len__(self) -> int: ...

@final
class DescriptorInfo:
    """Which descriptor a map's rows are of."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def version(self) -> int:
        """Its version: rows of different versions must not be compared."""

    @property
    def dim(self) -> int:
        """Numbers a row."""

    def __hash__(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...

@final
class Standardizer:
    """Brings descriptors to a map's scale: a row becomes `(row - mean) * inv_std`."""

    @property
    def mean(self) -> _Float32:
        """Mean of each dimension, shape (dim,)."""

    @property
    def inv_std(self) -> _Float32:
        """One over the standard deviation of each dimension, shape (dim,); 0 where it is constant."""

    def apply(self, descriptions: Descriptions) -> Descriptions:
        """Standardise live descriptions, as the map's stored rows already are."""

@final
class Map:
    """A prior map: checked, immutable, the same to use whether it was just built or lies in a file.

    An opened map keeps its file mapped into memory: replace such files (write beside, rename), never edit them in place.
    """

    @staticmethod
    def open(path: _StrPath) -> Map:
        """Open a map file and verify all of it but the points, which are verified before they are used."""

    def write(self, path: _StrPath) -> None:
        """Write the map file, whole or not at all. The same map gives the same bytes."""

    def verify_points(self) -> None:
        """Verify all points now."""

    def check_descriptor(self, descriptor: Descriptor) -> None:
        """Raise `DescriptorMismatchError` unless live rows of this descriptor may be compared with the map's."""

    @property
    def origin(self) -> _Float64:
        """Where the float32 coordinates are counted from, shape (3,), metres, map frame."""

    @property
    def frame_id(self) -> str:
        """Name of the map frame."""

    @property
    def descriptor_info(self) -> DescriptorInfo:
        """What the descriptors are."""

    @property
    def standardizer(self) -> Standardizer | None:
        """Brings live descriptors to the scale of the stored ones; None where that is not needed."""

    @property
    def centroids(self) -> _Float32:
        """The segments' centroids, shape (S, 3), metres, relative to the origin."""

    @property
    def extents(self) -> _Float32:
        """Sizes of the segments' axis-aligned boxes, shape (S, 3), metres."""

    @property
    def observations(self) -> _UInt32:
        """Windows of the recording that each segment was seen in, shape (S,)."""

    @property
    def descriptors(self) -> _Float32:
        """Descriptors, shape (S, dim), already standardised."""

    @property
    def quality(self) -> _Float32:
        """The probability, 0 to 1, that a descriptor is good for matching, shape (S,)."""

    def segment_points(self, segment: SupportsIndex) -> _Float32:
        """Give one segment's points, shape (N, 3), metres, relative to the origin."""

    @property
    def ground_tiles(self) -> int:
        """Number of ground tiles."""

    def ground_tile_points(self, tile: SupportsIndex) -> _Float32:
        """Give one ground tile's points, shape (N, 3), metres, relative to the origin."""

    @property
    def structure_tiles(self) -> int:
        """Number of structure tiles."""

    def structure_tile_points(self, tile: SupportsIndex) -> _Float32:
        """Give one structure tile's points, shape (N, 3), metres, relative to the origin."""

    @property
    def point_count(self) -> int:
        """Number of points, of segments and tiles."""

    @property
    def path(self) -> _Float64:
        """The path the map was recorded along, shape (P, 3), metres, map frame; empty for a map of a prior cloud."""

    @property
    def coverage(self) -> NDArray[np.int32]:
        """The 5 m cells of the map frame that hold points of a prior cloud, shape (C, 2); empty for a map of a path."""

    @property
    def bounds(self) -> tuple[_Float64, _Float64]:
        """Lower and upper corner of the box around all points, shape (3,) each, metres, map frame."""

    @property
    def settings(self) -> str:
        """The configuration it was built with, TOML."""

    @property
    def source(self) -> str:
        """What it was built from."""

    @property
    def file_size(self) -> int:
        """Bytes of its file, or of the one that `write` would write."""

    def __len__(self) -> int: ...

@final
class MapBuilder:
    """Builds a map window by window, or from one prior cloud. Its length is the number of segments so far.

    `descriptor` takes the place of the configured one, such as an `XConv` with weights of your own.
    """

    def __new__(
        cls, config: Config | None = None, *, descriptor: Descriptor | None = None, threads: int | None = None
    ) -> Self: ...
    def set_source(self, source: str) -> None:
        """Name what the map is built from: a file name without its folder."""

    def push_sweep(self, sweep: Sweep, pose_map_sensor: ArrayLike | None = None) -> None:
        """Take the next sweep of the recording and where it was taken: windows of all lengths are accumulated and pushed.

        `pose_map_sensor`: shape (4, 4); without it the odometry frame is the map frame, and the sweep's own
        `pose_odom_sensor` is taken.
        """

    def interrupt(self) -> None:
        """Tell that the next sweep does not continue the last one: another recording, or a gap."""

    def push(self, live: LiveCloud, pose_map_sensor: ArrayLike | None = None) -> bool:
        """Take the next accumulated cloud of the recording and tell whether it was cut into segments.

        Only one every `map.window_step_m` is, of shorter ones than `accumulate.distance_m` one every `map.short_step_m`;
        all count for the path. `pose_map_sensor`: as for `push_sweep`.
        """

    def push_prior_cloud(self, origin: ArrayLike, points: ArrayLike) -> None:
        """Take one prior cloud: `points`, shape (N, 3), metres, relative to `origin`, shape (3,), metres, map frame."""

    def finish(self) -> Map:
        """Give the map as it stands."""

    def __len__(self) -> int: ...
    def __bool__(self) -> bool: ...

@final
class Index:
    """An index over descriptors, shape (N, dim): by k-d tree, by matrix product, or the faster of the two."""

    def __new__(cls, descriptors: ArrayLike, search: Literal["auto", "tree", "product"] = "auto") -> Self: ...
    def nearest(self, queries: ArrayLike, k: int, *, threads: int | None = None) -> tuple[_UInt32, _Float32]:
        """Find for every query, shape (M, dim), the k nearest rows: their numbers and squared L2 distances.

        Both have shape (M, k), nearest first, k at most the number of rows.
        """

    @property
    def kind(self) -> Literal["tree", "product"]:
        """Which of the two it is."""

    def __len__(self) -> int: ...

@final
class Candidates:
    """Candidate matches of a cloud, best first: a live segment, a map segment it may be, and how good that looks."""

    @property
    def live(self) -> _UInt32:
        """Index of the live segment, shape (C,)."""

    @property
    def map(self) -> _UInt32:
        """Index of the map segment, shape (C,)."""

    @property
    def distance(self) -> _Float32:
        """Squared L2 distance of the descriptors, shape (C,)."""

    @property
    def quality(self) -> _Float32:
        """Probability that both descriptors are good for matching, shape (C,)."""

    @property
    def live_centroids(self) -> _Float32:
        """Centroids of the live segments, shape (C, 3), metres, sensor frame."""

    @property
    def map_centroids(self) -> _Float32:
        """Centroids of the map segments, shape (C, 3), metres, relative to the map's origin."""

    def __len__(self) -> int: ...

def candidates(
    segments: Segmentation | Sequence[Segment],
    descriptions: Descriptions,
    map: Map,
    index: Index,
    config: Config | None = None,
    *,
    threads: int | None = None,
) -> Candidates:
    """Find for every live segment its nearest map segments.

    `descriptions` must be on the map's scale (`map.standardizer`), `index` over `map.descriptors`.
    """

@final
class Hypothesis:
    """A place the cloud may have been taken at."""

    @property
    def pose_origin_sensor(self) -> _Float64:
        """Pose of the live sensor, shape (4, 4), relative to the map's origin."""

    @property
    def inliers(self) -> _UInt32:
        """The candidates that agree with it, by their index, shape (I,)."""

def search(candidates: Candidates, config: Config | None = None, *, threads: int | None = None) -> list[Hypothesis]:
    """Find the distinct places with the most support, best first."""

@final
class Localizer:
    """Finds live clouds in a prior map. Every cloud stands for itself: nothing is kept from one to the next.

    `config.descriptor` must be the map's (`map.descriptor_info`); `descriptor` takes the place of the configured one.
    """

    def __new__(
        cls, map: Map, config: Config | None = None, *, descriptor: Descriptor | None = None, threads: int | None = None
    ) -> Self: ...
    @property
    def map(self) -> Map:
        """The map in use."""

    def localize(self, live: LiveCloud) -> Localization:
        """Find the cloud in the map: segment, describe, match, estimate, verify."""

@final
class Localization:
    """The answer for one cloud."""

    @property
    def stamp(self) -> float:
        """Seconds, of the newest sweep in the cloud."""

    @property
    def verdict(self) -> Literal["located", "ambiguous", "not_found"]:
        """Whether the pose is to be trusted."""

    @property
    def located(self) -> bool:
        """Whether the verdict is `located`."""

    @property
    def reason(self) -> str | None:
        """Why the cloud was not located."""

    @property
    def pose_map_sensor(self) -> _Float64 | None:
        """Pose of the newest sensor frame in the map, shape (4, 4); where the verdict is `ambiguous` it is a guess."""

    @property
    def covariance(self) -> _Float64 | None:
        """Shape (6, 6), order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame."""

    @property
    def travel_m(self) -> float:
        """Metres of travel the cloud holds."""

    @property
    def segments(self) -> int:
        """Segments cut from the cloud."""

    @property
    def described(self) -> int:
        """Segments described for this answer."""

    @property
    def inliers(self) -> int:
        """Matched segments that agree with the pose, at most one a live segment."""

    @property
    def score(self) -> float:
        """How well the best place explains the cloud: inliers weighted by the share of points found in the map."""

    @property
    def overlap(self) -> float:
        """Share of the live points above the ground, where the map has been seen, that lie on what stands there."""

    @property
    def seen(self) -> float:
        """Share of the live points above the ground that lie where the map has been seen."""

    @property
    def free_space_violated(self) -> float:
        """Share of the live rays that pass through what the map holds as solid, well before they reach what they saw."""

    @property
    def runner_up(self) -> float:
        """The score of the best other place, 0 where there is none."""

    @property
    def runner_up_pose_map_sensor(self) -> _Float64 | None:
        """The pose of that other place, shape (4, 4)."""

    @property
    def matches(self) -> list[MatchedSegment]:
        """The matches behind `inliers`."""

    @property
    def timings(self) -> dict[str, float]:
        """Seconds by stage, in the order of the pipeline."""

@final
class MatchedSegment:
    """One live segment and the map segment it was matched with."""

    @property
    def live(self) -> int:
        """Index of the live segment."""

    @property
    def map(self) -> int:
        """Index of the map segment."""

    @property
    def live_centroid_sensor(self) -> _Float32:
        """Centroid of the live segment, shape (3,), metres, sensor frame."""

    @property
    def map_centroid_map(self) -> _Float64:
        """Centroid of the map segment, shape (3,), metres, map frame."""

@final
class SequenceLocalizer:
    """Localizes the clouds of one robot in the order they were taken.

    Every cloud is looked for in the whole map; where a believed place must be by now, by the odometry, is verified too, and
    of places that look alike the one that agrees with the motion stays. This is what `esm-cli localize` does without
    `--single`.
    """

    def __new__(cls, localizer: Localizer, *, threads: int | None = None) -> Self: ...
    def localize(self, live: LiveCloud) -> Localization:
        """Find the cloud in the map in the light of those before it."""

    def forget(self) -> None:
        """Forget where the robot was: after a gap, or when it was carried elsewhere."""

@final
class LoopFinder:
    """Grows a map of the recording's past and looks for every new cloud in it.

    Past is what was seen 30 s and 50 m of travel ago. The motion is used relatively only.
    """

    def __new__(
        cls, config: Config | None = None, *, descriptor: Descriptor | None = None, threads: int | None = None
    ) -> Self: ...
    def push(self, live: LiveCloud) -> LoopAnswer | None:
        """Look for the cloud in the past, then add it to what will be the past.

        None where the cloud has no motion, or there is no past yet.
        """

@final
class LoopAnswer:
    """The answer for one cloud of a recording."""

    @property
    def localization(self) -> Localization:
        """The cloud's localization in the map of the past, whose frame is the odometry's."""

    @property
    def closure(self) -> LoopClosure | None:
        """The constraint, where the cloud was located."""

@final
class LoopClosure:
    """A constraint between two moments of one recording."""

    @property
    def stamp_from(self) -> float:
        """Seconds: the sweep of the past whose place is nearest."""

    @property
    def stamp_to(self) -> float:
        """Seconds: the newest sweep of the cloud that was recognised."""

    @property
    def pose_from_to(self) -> _Float64:
        """Pose of the sensor at `stamp_to` in the sensor frame of `stamp_from`, shape (4, 4)."""

    @property
    def covariance(self) -> _Float64 | None:
        """Shape (6, 6), order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame of `stamp_to`."""

@final
class Preset:
    """A world, a sensor, and two visits, by name (`PRESETS`)."""

    def __new__(cls, name: str) -> Self: ...
    @property
    def name(self) -> str:
        """Its name."""

    @property
    def about(self) -> str:
        """What it mirrors."""

    @property
    def length_m(self) -> float:
        """Length of the route at scale 1, metres."""

    @property
    def sensor(self) -> str:
        """The sensor's name."""

    @property
    def sensor_height_m(self) -> float:
        """Height of the sensor above the ground, metres."""

    @property
    def speed_mps(self) -> float:
        """Mean speed, m/s."""

    @property
    def spacing_m(self) -> float:
        """Metres between recorded sweeps; 0 records every one."""

    @property
    def accumulate_m(self) -> float:
        """Metres of travel in a live cloud of the data it mirrors (`accumulate.distance_m`)."""

@final
class Progress:
    """How far a simulation has come."""

    @property
    def visit(self) -> Literal["map", "live"]:
        """The visit in hand."""

    @property
    def done(self) -> int:
        """Sweeps written."""

    @property
    def total(self) -> int:
        """Sweeps of the visit."""

@final
class Summary:
    """What was simulated."""

    @property
    def sweeps(self) -> int:
        """Sweeps."""

    @property
    def rays(self) -> int:
        """Rays cast."""

    @property
    def points(self) -> int:
        """Points that came back."""

    @property
    def travel_m(self) -> float:
        """Metres travelled."""

    @property
    def kept(self) -> int:
        """Of the sweeps, those that an interrupted run had made."""

    @property
    def discarded(self) -> int:
        """Sweeps of an interrupted run that were made again: this program makes other ones."""

def simulate(
    preset: str | Preset,
    seed: int,
    directory: _StrPath,
    *,
    scale: float = 1.0,
    live_reversed: bool = False,
    live_offset: float = 0.0,
    live_changed: float | None = None,
    force: bool = False,
    progress: Callable[[Progress], object] | None = None,
    threads: int | None = None,
) -> Summary:
    """Simulate both visits of a preset into a directory, or go on where an interrupted run was.

    Makes `map.mcap`, `live.mcap`, `map_truth.tum` and `live_truth.tum`; their bytes depend on preset, seed and scale (which
    multiplies the route's length) and how the live visit is driven alone: `live_reversed` the other way round, `live_offset`
    metres to the left of the mapped way or as far as the ground allows, `live_changed` the share of what can change that
    does. What is complete already is left as it is; what another simulation or somebody else has made is replaced with
    `force` only. `progress` hears of every batch of sweeps and stops the simulation by answering False. After Ctrl-C the
    same call goes on.
    """

@final
class Found:
    """A segment of a live cloud with the object it shows."""

    @property
    def points(self) -> _Float32:
        """Points, shape (N, 3), metres about `centroid_map`, axes of the map frame."""

    @property
    def centroid_map(self) -> _Float64:
        """Mean of the points, shape (3,), metres, map frame."""

    @property
    def object(self) -> int | None:
        """The object that a clear majority of its points lies on, where there is one and points carry labels."""

    @property
    def object_class(self) -> int | None:
        """The class of that object (`CLASSES`)."""

    @property
    def above_ground(self) -> float:
        """Height of the lowest point above the ground, metres, NaN where unknown."""

    @property
    def rings(self) -> _Float32:
        """What stands around it in its cloud, shape (7, 4); see `Segment.rings`."""

    def __len__(self) -> int: ...

@final
class Surveyor:
    """Feeds on the sweeps of one recording; gives the segments of a live cloud every `step_m` metres of travel.

    Clouds that hold less than 95 % of `accumulate.distance_m` are left out.
    """

    def __new__(cls, config: Config | None = None, *, step_m: float = 1.0, threads: int | None = None) -> Self: ...
    def push(
        self,
        stamp: float,
        points: ArrayLike,
        pose_odom_sensor: ArrayLike,
        pose_map_sensor: ArrayLike | None,
        *,
        objects: ArrayLike | None = None,
        classes: ArrayLike | None = None,
    ) -> list[Found] | None:
        """Take the next sweep; give the segments of the live cloud that ends with it, where one is due.

        `stamp`: seconds. `points`: shape (N, 3), metres, sensor frame. `pose_odom_sensor`: the odometry, shape (4, 4).
        `pose_map_sensor`: the truth, shape (4, 4), None where it is not known. `objects`, `classes`: labels, shape (N,).
        """

    def push_sweep(self, sweep: Sweep, pose_map_sensor: ArrayLike | None) -> list[Found] | None:
        """Take the next sweep of a recording, with its labels, and the truth, None where it is not known."""

@final
class Identities:
    """Gives segments of one place their identities, in the order in which they come, over all visits.

    Centroids up to `same_m` metres apart are one object, beyond `different_m` different ones, between neither: the paper's
    rule by default. Its length is the number of identities so far.
    """

    def __new__(cls, same_m: float = 0.5, different_m: float = 4.0) -> Self: ...
    @staticmethod
    def numbered() -> Identities:
        """Make one for objects with numbers, whose parts are told apart by 1 m and 3 m."""

    def of(self, object: int, centroid_map: ArrayLike) -> int:
        """Give the identity of a segment of an object (0 for all where objects have no numbers), -1 for neither.

        `centroid_map`: shape (3,), metres.
        """

    def __len__(self) -> int: ...
    def __bool__(self) -> bool: ...

@final
class SegmentSetWriter:
    """Writes labelled segments to a directory that NumPy maps into memory (`python/train/DATA.md`), whole or not at all.

    As a context manager it finishes at the end, and gives the set up after an exception.
    """

    def __new__(
        cls, target: _StrPath, *, places: list[str], classes: list[str], voxel_m: float, source: str = ""
    ) -> Self: ...
    def push(
        self,
        points: ArrayLike,
        centroid_map: ArrayLike,
        *,
        object: int,
        observation: int,
        visit: int = 0,
        place: int = 0,
        object_class: int = 255,
        above_ground: float | None = None,
        rings: ArrayLike | None = None,
    ) -> None:
        """Append a segment.

        `points`: shape (N, 3), metres about `centroid_map`, shape (3,), metres, map frame. `object`: its identity, unique in
        its place, -1 where unknown. `observation`: the live cloud's number in the set. `above_ground`: metres. `rings`:
        shape (7, 4), as `Segment.rings`; without them it is alone.
        """

    def finish(self) -> int:
        """See everything on the disk, give the set its name, and tell the number of segments."""

    def __enter__(self) -> Self: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
        /,
    ) -> None: ...
