#!/usr/bin/env -S uv run --script
# /// script
# requires-python = ">=3.11"
# dependencies = ["numpy>=2", "esm_py"]
# [tool.uv.sources]
# esm_py = { path = "../../crates/esm-py" }
# ///
"""Does it matter which way the sensor looks and how it leans? Live clouds as recorded, and the same ones turned and tilted.

The sensor is mounted anew: turned about its z axis, then tilted about its y axis. Every sweep's points, the odometry
between the sweeps and the truth turn with it, so the cloud as a whole (where each sweep was seen from included) is the
recorded one, rigidly turned; nothing else knows. Each cloud is localized by itself.

    D=../shared/data/kitti00
    esm-cli map build --descriptor esm-swift $D/map.mcap -o kitti00.esm
    python/eval/turned.py kitti00.esm $D/query.mcap $D/query_truth.tum --accumulate 20 6 0

The map says which descriptor is used. Counted as by `esm-cli localize --truth`: localizable are the clouds within 10 m of
the mapped path that hold 95 % of the asked travel, correct are those located within 2 m and 5 degrees, false all others
that are located.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import esm_py
import numpy as np

CORRECT_M, CORRECT_DEG, NEAR_M, TRAVEL_SHARE = 2.0, 5.0, 10.0, 0.95


def mounting(turn_deg: float, tilt_deg: float) -> np.ndarray:
    """pose_sensor_mounted: the new sensor frame in the old one."""
    turn, tilt = np.radians([turn_deg, tilt_deg])
    about_z = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    about_y = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    pose = np.eye(4)
    pose[:3, :3] = about_z @ about_y
    return pose


def off(pose: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    cosine = (np.trace(truth[:3, :3].T @ pose[:3, :3]) - 1) / 2
    return float(np.linalg.norm(pose[:3, 3] - truth[:3, 3])), float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def count(options: argparse.Namespace, travel_m: float, mounted: np.ndarray) -> dict[str, object]:
    """Localizes every cloud of the recording with the sensor mounted so."""
    found_map = esm_py.Map.open(options.map)
    config = esm_py.Config({"descriptor": found_map.descriptor_info.name, "accumulate": {"distance_m": travel_m}})
    localizer, accumulator = esm_py.Localizer(found_map, config), esm_py.Accumulator(config)
    truth = esm_py.read_tum(options.truth)
    stamps, poses = truth.stamps, truth.poses
    inverse, path = np.linalg.inv(mounted), found_map.path
    localizable = hit = false = located = clouds = 0
    metres, degrees = [], []
    for sweep in esm_py.Recording(options.recording):
        points = sweep.points[:, :3].astype(np.float64) @ mounted[:3, :3]
        odometry = None if sweep.pose_odom_sensor is None else sweep.pose_odom_sensor @ mounted
        cloud = accumulator.push(sweep.stamp, points, odometry)
        if cloud is None:
            continue
        clouds += 1
        true = poses[int(np.argmin(np.abs(stamps - cloud.stamp)))]
        near = np.linalg.norm(path - true[:3, 3], axis=1).min() <= NEAR_M
        counts = near and cloud.travel_m >= TRAVEL_SHARE * travel_m
        localizable += counts
        answer = localizer.localize(cloud)
        if not answer.located or answer.pose_map_sensor is None:
            continue
        located += 1
        m, d = off(answer.pose_map_sensor @ inverse, true)
        if m <= CORRECT_M and d <= CORRECT_DEG:
            hit += counts
            metres.append(m)
            degrees.append(d)
        else:
            false += 1
    return {
        "travel_m": travel_m,
        "descriptor": found_map.descriptor_info.name,
        "clouds": clouds,
        "localizable": int(localizable),
        "located": located,
        "found": int(hit),
        "false": false,
        "median_m": float(np.median(metres)) if metres else None,
        "median_deg": float(np.median(degrees)) if degrees else None,
    }


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", type=Path)
    parser.add_argument("recording", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--accumulate", nargs="+", type=float, default=[20.0, 6.0, 0.0], help="metres of travel")
    parser.add_argument("--turn", type=float, default=180.0, help="degrees")
    parser.add_argument("--tilt", type=float, default=3.0, help="degrees")
    parser.add_argument("-o", "--output", type=Path, help="the counts as JSON lines")
    options = parser.parse_args()
    print("| descriptor | travel in a cloud | sensor | localizable | located rightly | false | median error |")
    print("|---|---|---|---|---|---|---|")
    for travel_m in options.accumulate:
        for name, turn, tilt in (("as recorded", 0.0, 0.0), ("turned, tilted", options.turn, options.tilt)):
            c = count(options, travel_m, mounting(turn, tilt))
            share = c["found"] / max(c["localizable"], 1)
            error = "" if c["median_m"] is None else f"{c['median_m']:.2f} m, {c['median_deg']:.2f}°"
            found = f"{c['localizable']} | {c['found']} ({share:.1%}) | {c['false']}"
            print(f"| `{c['descriptor']}` | {travel_m:g} m | {name} | {found} | {error} |", flush=True)
            if options.output:
                with options.output.open("a") as out:
                    out.write(json.dumps({"turn_deg": turn, "tilt_deg": tilt, **c}) + "\n")


if __name__ == "__main__":
    main()
