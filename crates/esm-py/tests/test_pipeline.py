"""From clouds to answers, step by step and in one, as the command line does it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import esm_py
from conftest import CONFIG, Cli, World, build
from esm_py.errors import DescriptorMismatchError, EmptyMapError, MapDataError, WeightsFileError
from weights import weights


def pose_of(line: dict[str, Any], key: str = "pose") -> np.ndarray[Any, np.dtype[np.float64]]:
    x, y, z, w = line[key]["q"]
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = line[key]["t"]
    return pose


def flags(config: esm_py.Config, folder: Path) -> list[str]:
    path = folder / "config.toml"
    path.write_text(config.to_toml())
    return ["--config", str(path)]


def test_a_map_is_the_command_lines_to_the_byte(world: World, cli: Cli, tmp_path: Path) -> None:
    theirs = tmp_path / "cli.esm"
    truth = ["--poses", str(world.folder / "map_truth.tum")]
    cli.run("map", "build", world.folder / "map.mcap", *truth, "-o", theirs, *flags(CONFIG, tmp_path))
    assert theirs.read_bytes() == world.map_file.read_bytes()
    [info] = cli.lines("map", "info", world.map_file, "--check")
    assert (info["segments"], info["points"], info["source"]) == (len(world.map), world.map.point_count, "map.mcap")
    assert info["bytes"] == world.map.file_size == world.map_file.stat().st_size
    assert info["settings"] == world.map.settings


@pytest.mark.parametrize("single", [True, False])
def test_answers_are_the_command_lines_to_the_bit(single: bool, world: World, cli: Cli, tmp_path: Path) -> None:
    chosen = ["--frames", "1-60", *(["--single"] if single else []), *flags(CONFIG, tmp_path)]
    lines = cli.lines("localize", "--map", world.map_file, world.folder / "live.mcap", *chosen)
    answers = [line for line in lines if "verdict" in line]
    localizer = esm_py.Localizer(esm_py.Map.open(world.map_file), CONFIG)
    localize = localizer.localize if single else esm_py.SequenceLocalizer(localizer).localize
    accumulator = esm_py.Accumulator(CONFIG)
    located = 0
    for sweep, line in zip(world.recording("live"), answers, strict=False):
        live = accumulator.push_sweep(sweep)
        assert live is not None
        ours = localize(live)
        keys = ("stamp", "verdict", "reason", "travel_m", "segments", "described", "inliers", "score", "runner_up")
        assert {k: getattr(ours, k) for k in keys} == {k: line[k] for k in keys}
        if ours.pose_map_sensor is None:
            assert line["pose"] is None
        else:
            np.testing.assert_allclose(ours.pose_map_sensor, pose_of(line), atol=1e-13)
        if ours.covariance is not None:
            assert ours.covariance.flatten().tolist() == line["covariance"]
        assert set(ours.timings) == set(line["timings_ms"]) - {"total"}
        located += ours.located
    assert len(answers) == 60 and located > 30


def test_answers_are_true(world: World, live: list[esm_py.LiveCloud]) -> None:
    truth = esm_py.read_tum(world.folder / "live_truth.tum")
    assert truth.stamps is not None
    localizer = esm_py.Localizer(world.map, CONFIG)
    answers = [localizer.localize(cloud) for cloud in live]
    located = [a for a in answers if a.located]
    assert len(located) >= 3
    for answer in located:
        want = truth.poses[np.argmin(abs(truth.stamps - answer.stamp))]
        assert answer.pose_map_sensor is not None and answer.covariance is not None
        assert np.linalg.norm((answer.pose_map_sensor - want)[:3, 3]) < 0.5
        assert len(answer.matches) == answer.inliers and answer.reason is None
        match = answer.matches[0]
        there = answer.pose_map_sensor[:3, :3] @ match.live_centroid_sensor + answer.pose_map_sensor[:3, 3]
        assert np.linalg.norm(there - match.map_centroid_map) < 1.5
        np.testing.assert_allclose(world.map.centroids[match.map] + world.map.origin, match.map_centroid_map, atol=1e-4)
        assert np.linalg.eigvalsh(answer.covariance).min() > 0


def test_the_steps_one_by_one(world: World, live: list[esm_py.LiveCloud]) -> None:
    map, cloud = world.map, live[2]
    cut = esm_py.segment(cloud.points, CONFIG)
    assert len(cut) == len(cut.segments) > 10
    assert len(cut.ground) + len(cut.structure) == cut.voxelled
    thin = esm_py.voxel_filter(cloud.points, CONFIG)
    assert len(thin) == cut.voxelled
    on_ground = esm_py.ground_flags(thin, CONFIG)
    np.testing.assert_array_equal(thin[on_ground], cut.ground)
    np.testing.assert_array_equal(thin[~on_ground], cut.structure)
    clusters = esm_py.euclidean_clusters(cut.structure, CONFIG)
    assert len(clusters) == len(cut)
    np.testing.assert_array_equal(cut.structure[clusters[0]], cut.segments[0].points)
    one = cut.segments[0]
    np.testing.assert_allclose(one.centroid, one.points.mean(axis=0), atol=1e-4)
    np.testing.assert_array_equal((one.min, one.max), (one.points.min(axis=0), one.points.max(axis=0)))

    descriptor = esm_py.Descriptor(map.descriptor_info.name)
    map.check_descriptor(descriptor)
    described = descriptor.describe(cut)
    assert described.values.shape == (len(cut), descriptor.dim) and described.quality.shape == (len(cut),)
    listed = descriptor.describe(list(cut.segments))
    np.testing.assert_array_equal(listed.values, described.values)
    assert map.standardizer is not None
    scaled = map.standardizer.apply(described)
    by_hand = (described.values - map.standardizer.mean) * map.standardizer.inv_std
    np.testing.assert_array_equal(scaled.values, by_hand)

    index = esm_py.Index(map.descriptors)
    rows, distances = index.nearest(scaled.values, 5)
    assert rows.shape == distances.shape == (len(cut), 5)
    all_distances = ((scaled.values[:, None] - map.descriptors[None]) ** 2).sum(axis=2)
    np.testing.assert_allclose(distances, np.sort(all_distances, axis=1)[:, :5], rtol=1e-4, atol=1e-5)
    for kind in ("tree", "product"):
        other = esm_py.Index(map.descriptors, kind)
        np.testing.assert_array_equal(other.nearest(scaled.values, 5)[0], rows)

    found = esm_py.candidates(cut, scaled, map, index, CONFIG)
    assert len(found) == 10 * len(cut) == len(found.live) == len(found.distance)
    assert (np.diff(found.quality) <= 0).all()
    np.testing.assert_array_equal(found.map_centroids, map.centroids[found.map])
    np.testing.assert_array_equal(found.live_centroids[0], cut.segments[int(found.live[0])].centroid)
    places = esm_py.search(found, CONFIG)
    answer = esm_py.Localizer(map, CONFIG).localize(cloud)
    assert places and answer.pose_map_sensor is not None
    best = places[0]
    assert best.inliers.size >= 4 and best.inliers.max() < len(found)
    # Verification moves it a little.
    pose = best.pose_origin_sensor + np.pad(map.origin[:, None], ((0, 1), (3, 0)))
    assert np.linalg.norm((pose - answer.pose_map_sensor)[:3, 3]) < 1.0


def test_arrays_and_recordings_make_the_same_clouds(world: World) -> None:
    by_sweep, by_array = esm_py.Accumulator(CONFIG), esm_py.Accumulator(CONFIG)
    for sweep, _ in zip(world.recording("live"), range(12), strict=False):
        one, two = by_sweep.push_sweep(sweep), by_array.push(sweep.stamp, sweep.points, sweep.pose_odom_sensor)
        assert one is not None and two is not None
        # A pose goes through a matrix and back: the last bits may differ.
        np.testing.assert_allclose(one.points, two.points, atol=1e-5)
        assert (one.stamp, one.sweeps) == (two.stamp, two.sweeps)
        assert one.travel_m == pytest.approx(two.travel_m) and one.elapsed_s > 0
    swathes = esm_py.Accumulator(CONFIG.replace({"accumulate": {"swathes": True}}))
    given = [swathes.push_sweep(s) for s in world.recording("live")]
    assert 3 < sum(s is not None for s in given) < 12


def test_threads_do_not_change_a_bit(world: World, live: list[esm_py.LiveCloud], tmp_path: Path) -> None:
    def everything(threads: int | None) -> list[Any]:
        cut = esm_py.segment(live[1].points, CONFIG, threads=threads)
        localizer = esm_py.Localizer(world.map, CONFIG, threads=threads)
        answers = [localizer.localize(cloud) for cloud in live[:3]]
        build(world.recording("map", truth=True), CONFIG, threads).write(tmp_path / "map.esm")
        xconv = esm_py.XConv.from_bytes(weights())
        described = [d.describe(cut, threads=threads) for d in (esm_py.Descriptor("shape"), xconv)]
        return [
            (tmp_path / "map.esm").read_bytes(),
            *[s.points.tobytes() for s in cut.segments],
            *[(d.values.tobytes(), d.quality.tobytes()) for d in described],
            *[(a.score, None if (p := a.pose_map_sensor) is None else p.tobytes()) for a in answers],
        ]

    one = everything(1)
    assert one == everything(2) == everything(None)
    for bad in (0, 2000, -1):
        with pytest.raises((ValueError, OverflowError), match="threads|negative"):
            esm_py.segment(live[1].points, threads=bad)


def test_maps_survive_their_file(world: World, tmp_path: Path) -> None:
    built = build(world.recording("map", truth=True), CONFIG)
    built.write(tmp_path / "a.esm")
    opened = esm_py.Map.open(tmp_path / "a.esm")
    opened.verify_points()
    for name in ("centroids", "extents", "observations", "descriptors", "quality", "path", "coverage", "origin"):
        np.testing.assert_array_equal(getattr(opened, name), getattr(built, name), err_msg=name)
    assert opened.descriptors.shape == (len(opened), opened.descriptor_info.dim)
    assert opened.path.shape[1] == 3 and opened.path.dtype == np.float64 and opened.coverage.shape == (0, 2)
    for index in (0, len(opened) - 1):
        points = opened.segment_points(index)
        np.testing.assert_array_equal(points, built.segment_points(index))
        np.testing.assert_allclose(points.mean(axis=0), opened.centroids[index], atol=0.05)
    assert opened.ground_tile_points(0).shape[1] == opened.structure_tile_points(0).shape[1] == 3
    assert opened.ground_tiles > 0 and opened.structure_tiles > 0 and opened.frame_id == "map"
    low, high = opened.bounds
    assert (low < high).all() and opened.descriptor_info == built.descriptor_info
    assert esm_py.Config.from_toml(opened.settings) == CONFIG
    for outside in (len(opened), 2**62):
        with pytest.raises(MapDataError, match="was asked for, there are"):
            opened.segment_points(outside)
    with pytest.raises(OverflowError):
        opened.segment_points(-1)
    opened.write(tmp_path / "b.esm")
    assert (tmp_path / "a.esm").read_bytes() == (tmp_path / "b.esm").read_bytes()


def test_a_map_of_a_prior_cloud(world: World, cli: Cli, tmp_path: Path) -> None:
    tiles = [world.map.ground_tile_points(n) for n in range(world.map.ground_tiles)]
    tiles += [world.map.structure_tile_points(n) for n in range(world.map.structure_tiles)]
    survey = np.concatenate(tiles)
    rows = b"".join(survey.astype("<f4"))
    head = f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(survey)}\nHEIGHT 1\nPOINTS {len(survey)}\nDATA binary\n"
    (tmp_path / "survey.pcd").write_bytes(head.encode() + rows)
    cli.run("map", "build", tmp_path / "survey.pcd", "-o", tmp_path / "cli.esm", *flags(CONFIG, tmp_path))
    prior = esm_py.read_prior_cloud(tmp_path / "survey.pcd")
    builder = esm_py.MapBuilder(CONFIG)
    builder.set_source("survey.pcd")
    builder.push_prior_cloud(prior.origin, prior.points)
    map = builder.finish()
    assert len(map.path) == 0 and map.coverage.shape[1] == 2 and map.coverage.dtype == np.int32
    map.write(tmp_path / "ours.esm")
    assert (tmp_path / "ours.esm").read_bytes() == (tmp_path / "cli.esm").read_bytes()


def test_builders_refuse(hall: np.ndarray[Any, np.dtype[np.float32]]) -> None:
    builder = esm_py.MapBuilder()
    assert len(builder) == 0 and builder
    with pytest.raises(EmptyMapError, match="hint: "):
        builder.finish()
    with pytest.raises(ValueError, match="^pose_map_sensor is missing"):
        builder.push(esm_py.LiveCloud(0.0, hall))
    with pytest.raises(ValueError, match="^origin must be finite"):
        builder.push_prior_cloud([0, np.inf, 0], hall)
    with pytest.raises(ValueError, match=r"^origin must have shape \(3,\), got \(2,\)"):
        builder.push_prior_cloud([0, 0], hall)
    assert builder.push(esm_py.LiveCloud(0.0, hall), np.eye(4)) and len(builder) == 1
    assert not builder.push(esm_py.LiveCloud(0.1, hall), np.eye(4)), "no new window yet"
    far = np.eye(4)
    far[0, 3] = 1e7
    builder.push(esm_py.LiveCloud(0.2, hall), far)
    with pytest.raises(MapDataError):
        builder.finish()
    with pytest.raises(ValueError, match="^stamp must be finite"):
        esm_py.LiveCloud(float("nan"), hall)
    with pytest.raises(ValueError, match="^travel_m must be 0 m or more"):
        esm_py.LiveCloud(0.0, hall, travel_m=-1.0)


def test_another_descriptor_is_refused(world: World) -> None:
    with pytest.raises(DescriptorMismatchError, match="hint: use --descriptor shape"):
        esm_py.Localizer(world.map, CONFIG.replace({"descriptor": "eigen"}))
    with pytest.raises(DescriptorMismatchError):
        world.map.check_descriptor(esm_py.Descriptor("eigen"))


def test_weights_of_your_own(world: World, live: list[esm_py.LiveCloud], tmp_path: Path) -> None:
    path = tmp_path / "mine.safetensors"
    path.write_bytes(weights())
    mine = esm_py.XConv.open(path)
    assert isinstance(mine, esm_py.Descriptor) and mine.name == "esm-swift"
    assert mine.dim == 22 and not mine.standardized and mine.multiply_adds > 1e6
    assert mine.metadata("training_data") == "random numbers" and mine.metadata("nothing") is None
    assert mine.version == esm_py.XConv.from_bytes(path.read_bytes()).version

    accumulator, builder = esm_py.Accumulator(CONFIG), esm_py.MapBuilder(CONFIG, descriptor=mine)
    for sweep in world.recording("map", truth=True):
        cloud = accumulator.push_sweep(sweep)
        assert cloud is not None
        builder.push(cloud)
    map = builder.finish()
    assert (map.descriptor_info.name, map.descriptor_info.dim) == ("esm-swift", 22) and map.standardizer is None
    map.write(tmp_path / "mine.esm")
    map = esm_py.Map.open(tmp_path / "mine.esm")
    # Random weights describe badly, sizes well: nobody is promised a pose, and the descriptor must be the same.
    answer = esm_py.Localizer(map, CONFIG, descriptor=mine).localize(live[2])
    assert answer.segments > 0 and answer.verdict in ("located", "not_found", "ambiguous")
    with pytest.raises(DescriptorMismatchError):
        esm_py.Localizer(map, CONFIG)
    with pytest.raises(DescriptorMismatchError):
        esm_py.Localizer(map, CONFIG, descriptor=esm_py.XConv.from_bytes(weights(training_data="others")))


def test_normalised_inputs() -> None:
    mine = esm_py.XConv.from_bytes(weights())
    points = np.random.default_rng(1).normal(size=(5, 256, 3))
    sizes = np.random.default_rng(2).normal(size=(5, 6))
    described = mine.describe_normalised(points, sizes)
    assert described.values.shape == (5, 22) and described.quality.shape == (5,)
    np.testing.assert_allclose(described.values[2], mine.describe_normalised(points[2:3], sizes[2:3]).values[0], atol=1e-6)
    unknown = mine.describe_normalised(points).values
    np.testing.assert_array_equal(unknown[:, 16:], 0)
    assert mine.describe_normalised(points[:0], sizes[:0]).values.shape == (0, 22)
    for bad_points, bad_sizes, words in [
        (points[:, :255], sizes, r"points must have shape \(N, 256, 3\)"),
        (points[0], sizes, r"points must have shape \(N, 256, 3\)"),
        (points, sizes[:, :5], r"sizes must have shape \(5, 6\)"),
        (points, sizes[:4], r"sizes must have shape \(5, 6\)"),
        (np.full((1, 256, 3), np.nan), sizes[:1], "points must be finite"),
    ]:
        with pytest.raises(ValueError, match=words):
            mine.describe_normalised(bad_points, bad_sizes)


def test_weights_that_are_none(tmp_path: Path) -> None:
    for bad, words in [
        (b"", "not a safetensors file"),
        (weights()[:-8], "not a safetensors file"),
        (weights(architecture="resnet"), "architecture is `resnet`"),
        (weights(variant="mine"), "variant is `mine`"),
        ((2**60).to_bytes(8, "little") + b"{}", "not a safetensors file"),
    ]:
        (tmp_path / "bad").write_bytes(bad)
        loads: list[Callable[[], esm_py.XConv]] = [
            lambda: esm_py.XConv.open(tmp_path / "bad"),
            functools.partial(esm_py.XConv.from_bytes, bad, "bad"),
        ]
        for load in loads:
            with pytest.raises(WeightsFileError, match=f"bad: {words}") as caught:
                load()
            assert caught.value.hint
    with pytest.raises(FileNotFoundError):
        esm_py.XConv.open(tmp_path / "none")


def test_matching_refuses_what_does_not_fit(world: World, live: list[esm_py.LiveCloud]) -> None:
    cut = esm_py.segment(live[1].points, CONFIG)
    shape, eigen = esm_py.Descriptor("shape"), esm_py.Descriptor("eigen")
    index, described = esm_py.Index(world.map.descriptors), shape.describe(cut)
    cases: list[tuple[Any, str]] = [
        ((cut.segments[:3], described, world.map, index), "descriptions must describe the 3 segments"),
        ((cut, eigen.describe(cut), world.map, index), "descriptions must have 13 numbers a row"),
        ((cut, described, world.map, esm_py.Index(world.map.descriptors[:5])), "index must be over the map's"),
    ]
    for arguments, words in cases:
        with pytest.raises(ValueError, match=f"^{words}"):
            esm_py.candidates(*arguments)
    assert world.map.standardizer is not None
    with pytest.raises(ValueError, match="^descriptions must have 13 numbers a row, got 7"):
        world.map.standardizer.apply(eigen.describe(cut))
    for bad in ([1, 2], None, 5, "segments"):
        with pytest.raises(TypeError, match="^segments must be a Segmentation or a sequence of Segment"):
            shape.describe(bad)  # type: ignore[arg-type]
    for queries, k, words in [
        (world.map.descriptors[:, :3], 2, r"queries must have shape \(N, 13\)"),
        (np.full((1, 13), np.nan), 2, "queries must be finite, row 0 column 0 is not"),
        (world.map.descriptors[:2], 0, "k must be at least 1"),
    ]:
        with pytest.raises(ValueError, match=words):
            index.nearest(queries, k)
    rows, _ = index.nearest(world.map.descriptors[:2], 2**40)
    assert rows.shape == (2, len(world.map)), "no more than there are"
    with pytest.raises(ValueError, match="search must be auto, tree or product"):
        esm_py.Index(world.map.descriptors, "fast")  # type: ignore[arg-type]
    for empty in (np.empty((0, 3)), np.empty((3, 0))):
        with pytest.raises(ValueError, match="^descriptors must"):
            esm_py.Index(empty)
    with pytest.raises(esm_py.errors.ConfigError):
        esm_py.Descriptor("magic")


def test_loops_are_the_command_lines(world: World, cli: Cli, tmp_path: Path) -> None:
    """Both visits as one drive: a directory of scans, a second apart, with its poses."""
    scans = tmp_path / "scans"
    scans.mkdir()
    poses: list[np.ndarray[Any, np.dtype[np.float64]]] = []
    for visit in ("map", "live"):
        for sweep in world.recording(visit, truth=True):
            if sweep.number % 3 == 0 and sweep.pose_odom_sensor is not None:
                points = np.c_[sweep.points, np.zeros(len(sweep))].astype("<f4")
                (scans / f"{len(poses):06}.bin").write_bytes(points.tobytes())
                poses.append(sweep.pose_odom_sensor)
    truth = tmp_path / "poses.txt"
    np.savetxt(truth, np.stack(poses)[:, :3].reshape(-1, 12), fmt="%.17g")

    finder, accumulator = esm_py.LoopFinder(CONFIG), esm_py.Accumulator(CONFIG)
    closures = []
    for sweep in esm_py.Recording(scans, poses=truth):
        cloud = accumulator.push_sweep(sweep)
        assert cloud is not None
        answer = finder.push(cloud)
        if answer is not None and answer.closure is not None:
            assert answer.localization.located
            assert repr(answer).startswith("LoopAnswer(localization=Localization(") and "closure=LoopClosure(" in repr(answer)
            closures.append(answer.closure)
    assert len(closures) > 5
    for closure in closures:
        old, new = poses[int(closure.stamp_from)], poses[int(closure.stamp_to)]
        want = np.linalg.inv(old) @ new
        assert closure.stamp_to - closure.stamp_from > 30
        assert np.linalg.norm((closure.pose_from_to - want)[:3, 3]) < 0.5

    lines = cli.lines("loops", scans, "--poses", truth, *flags(CONFIG, tmp_path))
    theirs = [line for line in lines if "summary" not in line]
    assert len(theirs) == len(closures)
    for closure, line in zip(closures, theirs, strict=True):
        assert (closure.stamp_from, closure.stamp_to) == (line["stamp_from"], line["stamp_to"])
        np.testing.assert_allclose(closure.pose_from_to, pose_of(line, "pose_from_to"), atol=1e-13)
        assert closure.covariance is not None and closure.covariance.flatten().tolist() == line["covariance"]
