"""Map a wood at a first visit, find the robot in it at a second one, and draw what was found."""

import matplotlib.pyplot as plt
import numpy as np

import esm_py

# A recording of yesterday and one of today; here both are simulated. Yours: any ROS 2 MCAP or directory of scans.
esm_py.simulate("train-forest", 101, "wood", scale=0.06)
config = esm_py.Config({"accumulate": {"distance_m": 8.0}, "match": {"k": 10}})

# Yesterday: a posed drive becomes a map.
builder = esm_py.MapBuilder(config)
for sweep in esm_py.Recording("wood/map.mcap", poses="wood/map_truth.tum"):
    builder.push_sweep(sweep)
builder.finish().write("wood.esm")

# Today: every fourth cloud is looked for in all of the map.
map = esm_py.Map.open("wood.esm")
localizer, accumulator = esm_py.Localizer(map, config), esm_py.Accumulator(config)
clouds = [accumulator.push_sweep(sweep) for sweep in esm_py.Recording("wood/live.mcap")]
answers = [localizer.localize(cloud) for cloud in clouds[::4] if cloud is not None]
poses = [a.pose_map_sensor for a in answers if a.located and a.pose_map_sensor is not None]
print(f"{len(poses)} of {len(answers)} clouds located")

segments, found = map.centroids + map.origin, np.array([pose[:2, 3] for pose in poses])
plt.scatter(segments[:, 0], segments[:, 1], s=2, c="silver", label="map segments")
plt.plot(map.path[:, 0], map.path[:, 1], lw=6, alpha=0.4, label="mapped path")
plt.plot(found[:, 0], found[:, 1], "g.", label="located")
plt.gca().set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
plt.legend()
plt.savefig("wood.png", dpi=150)
