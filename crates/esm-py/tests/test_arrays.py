"""Arrays in: whatever their layout, the same numbers; what is no cloud is told so by its name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import esm_py
from esm_py.errors import NonFinitePointError

Points = np.ndarray[Any, np.dtype[Any]]

CLOUDS = hnp.arrays(
    np.float32,
    st.tuples(st.integers(0, 40), st.just(3)),
    elements=st.floats(-1e6, 1e6, width=32) | st.just(float("nan")),
)


def layouts(points: Points) -> dict[str, Points]:
    """The same numbers, laid out in every way there is."""
    n = len(points)
    wide = np.zeros((n, 7), points.dtype)
    wide[:, 1:7:2] = points
    backwards = points[::-1, ::-1].copy()
    packed = np.zeros(n, dtype=[("flag", "u1"), ("xyz", points.dtype, 3)])
    packed["xyz"] = points
    frozen = points.copy()
    frozen.flags.writeable = False
    twice = np.repeat(points, 2, axis=0)
    return {
        "c": np.ascontiguousarray(points),
        "fortran": np.asfortranarray(points),
        "strided columns": wide[:, 1:7:2],
        "strided rows": twice[::2],
        "negative strides": backwards[::-1, ::-1],
        "transposed": np.ascontiguousarray(points.T).T,
        "unaligned": packed["xyz"],
        "read-only": frozen,
        "other byte order": points.astype(points.dtype.newbyteorder()),
        "subclass": points.view(np.ma.MaskedArray),
    }


@given(CLOUDS)
def test_layout_does_not_matter(points: Points) -> None:
    keep = np.isfinite(points).all(axis=1)
    for name, laid in layouts(points).items():
        kept, dropped = esm_py.finite(laid)
        np.testing.assert_array_equal(kept, points[keep], err_msg=name)
        assert kept.dtype == np.float32 and dropped == (~keep).sum(), name


@given(hnp.arrays(np.float64, st.tuples(st.integers(0, 20), st.just(3)), elements=st.floats(-1e30, 1e30)))
def test_float64_is_rounded_once(points: Points) -> None:
    for name, laid in layouts(points).items():
        np.testing.assert_array_equal(esm_py.finite(laid)[0], points.astype(np.float32), err_msg=name)


@given(
    hnp.arrays(
        st.sampled_from(["i1", "u1", "<i2", ">i4", "i8", "u8", "f2", "longdouble"]),
        st.tuples(st.integers(0, 20), st.just(3)),
        elements=st.integers(0, 100),
    )
)
def test_any_real_dtype_is_taken(points: Points) -> None:
    for name, laid in layouts(points).items():
        np.testing.assert_array_equal(esm_py.finite(laid)[0], points.astype(np.float32), err_msg=name)


def test_lists_are_arrays_too() -> None:
    kept, _ = esm_py.finite([[1, 2, 3.5], (4, 5, 6)])
    np.testing.assert_array_equal(kept, np.array([[1, 2, 3.5], [4, 5, 6]], np.float32))


def test_results_do_not_share_memory() -> None:
    points = np.ones((4, 3), np.float32)
    kept, _ = esm_py.finite(points)
    kept[0] = 7
    assert points.max() == 1
    segment = esm_py.Segment(points)
    points[:] = 9
    assert segment.points.max() == 1


TAKERS = {
    "finite": esm_py.finite,
    "segment": esm_py.segment,
    "voxel_filter": esm_py.voxel_filter,
    "ground_flags": esm_py.ground_flags,
    "euclidean_clusters": esm_py.euclidean_clusters,
    "Segment": esm_py.Segment,
    "LiveCloud": lambda points: esm_py.LiveCloud(0.0, points),
    "Accumulator.push": lambda points: esm_py.Accumulator().push(0.0, points),
    "MapBuilder.push_prior_cloud": lambda points: esm_py.MapBuilder().push_prior_cloud([0, 0, 0], points),
    "Surveyor.push": lambda points: esm_py.Surveyor().push(0.0, points, np.eye(4), None),
}


@pytest.mark.parametrize("take", TAKERS.values(), ids=TAKERS.keys())
def test_what_is_no_cloud_is_refused(take: Any) -> None:
    for wrong, shape in [
        (np.zeros((5, 4)), r"\(5, 4\)\nhint: pass points\[:, :3\]"),
        (np.zeros(3), r"\(3,\)"),
        (np.zeros((2, 2, 3)), r"\(2, 2, 3\)"),
        (np.zeros((3, 2)), r"\(3, 2\)"),
        (np.float32(1.0), r"\(\)"),
        ([], r"\(0,\)"),
    ]:
        with pytest.raises(ValueError, match=rf"^points must have shape \(N, 3\), got {shape}"):
            take(wrong)
    for no_numbers, dtype in [
        (np.zeros((2, 3), bool), "bool"),
        (np.zeros((2, 3), complex), "complex128"),
        (np.full((2, 3), "a"), "<U1"),
        (np.zeros((2, 3), object), "object"),
        (np.zeros((2, 3), "datetime64[s]"), "datetime64"),
        (None, "object"),
        ("points", "<U6"),
        (b"points", r"\|S6"),
    ]:
        with pytest.raises(TypeError, match=rf"^points must hold real numbers, got dtype {dtype}"):
            take(no_numbers)
    with pytest.raises(TypeError, match="^points must be an array of numbers: "):
        take([[1, 2, 3], [4]])
    # A view of one number that pretends to be ten billion points.
    huge = np.broadcast_to(np.float32(1.0), (10_000_000_000, 3))
    with pytest.raises(ValueError, match="^points has 10000000000 rows, at most 2147483648"):
        take(huge)


@pytest.mark.parametrize("take", [t for n, t in TAKERS.items() if n != "finite"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_numbers_that_are_not_finite_are_refused_by_their_index(take: Any, bad: float) -> None:
    points = np.ones((50, 3))
    points[41, 1] = bad
    with pytest.raises(NonFinitePointError, match="^points: point 41 is not finite\nhint: drop") as caught:
        take(points)
    assert caught.value.index == 41 and isinstance(caught.value, ValueError)


def test_empty_clouds_are_clouds() -> None:
    none = np.empty((0, 3))
    assert len(esm_py.segment(none)) == 0
    assert esm_py.voxel_filter(none).shape == (0, 3)
    assert esm_py.ground_flags(none).shape == (0,)
    assert esm_py.euclidean_clusters(none) == []
    live = esm_py.Accumulator().push(1.0, none)
    assert live is not None and live.points.shape == (0, 3)
    with pytest.raises(ValueError, match="^points must hold at least one point"):
        esm_py.Segment(none)


POSES = st.builds(
    lambda q, t: (np.array(q) / np.linalg.norm(q), np.array(t)),
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)


def matrix(q: Points, t: Points) -> Points:
    w, x, y, z = q
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = t
    return pose


@given(POSES)
def test_poses_come_back(pose: tuple[Points, Points]) -> None:
    given_pose = matrix(*pose)
    for laid in (given_pose, np.asfortranarray(given_pose), given_pose.tolist()):
        live = esm_py.LiveCloud(0.0, np.ones((1, 3)), laid)
        assert live.pose_odom_sensor is not None
        np.testing.assert_allclose(live.pose_odom_sensor, given_pose, atol=1e-14)


def test_what_is_no_pose_is_refused() -> None:
    def take(pose: Any) -> None:
        esm_py.LiveCloud(0.0, np.ones((1, 3)), pose)

    mirrored, scaled, sheared, last, nan = (np.eye(4) for _ in range(5))
    mirrored[2, 2] = -1
    scaled[:3, :3] *= 1.01
    sheared[0, 1] = 0.1
    last[3, 0] = 1
    nan[1, 3] = np.nan
    for wrong, words in [
        (mirrored, "must be a rigid motion"),
        (scaled, "must be a rigid motion"),
        (sheared, "must be a rigid motion"),
        (np.zeros((4, 4)), "must end with the row 0 0 0 1, not 0 0 0 0"),
        (last, "must end with the row 0 0 0 1, not 1 0 0 1"),
        (nan, "must be finite, row 1 column 3 is not"),
        (np.eye(3), r"must have shape \(4, 4\), got \(3, 3\)"),
        (np.zeros(7), r"must have shape \(4, 4\), got \(7,\)"),
    ]:
        with pytest.raises(ValueError, match=f"^pose_odom_sensor {words}"):
            take(wrong)
    with pytest.raises(TypeError, match="^pose_odom_sensor must hold real numbers"):
        take(np.eye(4, dtype=complex))
    take(np.eye(4, dtype=np.float32))
