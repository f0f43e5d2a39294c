"""Give the robot its pose in a prior map, from LiDAR alone, on a CPU, and say honestly when it cannot.

The crates of esm one to one, with NumPy arrays in the place of clouds, poses and descriptors:

| step | in | out |
|---|---|---|
| `Recording` | an MCAP file or a directory of scans | `Sweep` by `Sweep`, with the motion between them |
| `Accumulator` | sweeps | `LiveCloud`: the last metres of travel in the newest sensor frame |
| `segment` | a cloud | `Segmentation`: ground, and what stands on it in `Segment` pieces |
| `Descriptor` | segments | `Descriptions`: a row of numbers and a quality each |
| `Index`, `candidates`, `search` | descriptions, a `Map` | candidate matches, and the places they agree on |
| `MapBuilder`, `Map` | live clouds with poses | the prior map |
| `Localizer` | a live cloud | `Localization`: pose, covariance, evidence and a verdict |
| `SequenceLocalizer` | live clouds with odometry | the same, in the light of the clouds before |
| `LoopFinder` | live clouds | the places of one recording that were passed before |
| `simulate` | a preset and a seed | recordings of a world with truth |
| `Surveyor`, `SegmentSetWriter` | sweeps with truth | labelled segments for learning |

Points are arrays of shape (N, 3), metres; any layout and any real dtype is taken, and rounded once to float32. Poses are
float64 arrays of shape (4, 4), named by their frames: `pose_map_sensor` takes sensor coordinates to map coordinates. Frames
have z up. Results are frozen and their arrays read-only: `.copy()` gives one of your own.

Heavy work runs off the interpreter on all processors (`threads` limits them; the results are the same to the bit), and
Ctrl-C is honoured.
"""

from esm_py import errors
from esm_py._native import (
    CLASSES,
    DESCRIPTORS,
    PRESETS,
    UNKNOWN_CLASS,
    Accumulator,
    Candidates,
    Config,
    Damage,
    Descriptions,
    Descriptor,
    DescriptorInfo,
    Found,
    Hypothesis,
    Identities,
    Index,
    LiveCloud,
    Localization,
    Localizer,
    LoopAnswer,
    LoopClosure,
    LoopFinder,
    Map,
    MapBuilder,
    MatchedSegment,
    PoseWriter,
    Preset,
    PriorCloud,
    Progress,
    Recording,
    Scan,
    Segment,
    Segmentation,
    SegmentSetWriter,
    SequenceLocalizer,
    Standardizer,
    Summary,
    Surveyor,
    Sweep,
    Sweeps,
    Topic,
    Trajectory,
    XConv,
    __version__,
    candidates,
    classify,
    euclidean_clusters,
    finite,
    ground_flags,
    read_kitti_poses,
    read_poses,
    read_prior_cloud,
    read_scan,
    read_tum,
    search,
    segment,
    segments_of,
    simulate,
    voxel_filter,
    write_tum,
)
from esm_py.errors import EsmError, RecordingWarning

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
    "EsmError",
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
    "RecordingWarning",
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
    "errors",
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
