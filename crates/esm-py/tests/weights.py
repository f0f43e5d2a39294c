"""Weights of random numbers, as `python/train/WEIGHTS.md` describes the file."""

from __future__ import annotations

import json

import numpy as np

LAYERS = [(8, 16, 0, 4, 32), (12, 8, 32, 2, 64), (16, 16, 64, 2, 128), (16, 32, 128, 2, 256)]
"""K, Cd, Cp, m, C of the four X-conv layers."""


def shapes(sizes: int, learned: int) -> dict[str, tuple[int, ...]]:
    """The tensors of a network that puts the sizes beside what it has learned."""
    norms: dict[str, int] = {}
    out: dict[str, tuple[int, ...]] = {}
    for n, (k, cd, cp, m, c) in enumerate(LAYERS, 1):
        cin, at = cd + cp, f"xconv{n}."
        out |= {at + "lift1.weight": (3, cd), at + "lift2.weight": (cd, cd), at + "x0.weight": (3 * k, k * k)}
        out |= {at + "x1.weight": (k, k, k), at + "x2.weight": (k, k, k), at + "depthwise.weight": (k, cin, m)}
        out |= {at + "pointwise.weight": (cin * m, c)}
        norms |= {at + "lift1": cd, at + "lift2": cd, at + "x0": k * k, at + "x1": k * k, at + "x2": k * k}
        norms |= {at + "pointwise": c}
    out |= {"global1.weight": (3, 64), "global2.weight": (64, 64), "fc1.weight": (320, 256), "fc2.weight": (256, 128)}
    out |= {"fc3.weight": (128, learned), "fc3.bias": (learned,)}
    norms |= {"global1": 64, "global2": 64, "fc1": 256, "fc2": 128}
    for name, channels in norms.items():
        out |= {f"{name}.bn.scale": (channels,), f"{name}.bn.shift": (channels,)}
    if sizes:
        out |= {"measures.mean": (sizes,), "measures.std": (sizes,), "size.weight": (sizes,)}
    dim = learned + sizes
    return out | {"quality.weight": (dim, 2), "quality.bias": (2,)}


def weights(variant: str = "esm-swift", sizes: int = 6, learned: int = 16, **changes: str) -> bytes:
    """A whole file; `changes` replace lines of its header."""
    names = ["sigma1", "sigma2", "sigma3", "height", "extent1", "extent2"][:sizes]
    metadata = {
        "format": "esm-weights",
        "format_version": "2",
        "architecture": "xconv-4",
        "variant": variant,
        "input_points": "256",
        "point_plan": "256,96,64,48",
        "neighbours": "8x1,12x3,16x3,16x4",
        "channels": "32,64,128,256",
        "lift": "16,8,16,32",
        "multipliers": "4,2,2,2",
        "learned_dim": str(learned),
        "size_mode": "beside" if sizes else "none",
        "size_features": ",".join(names),
        "context": "none",
        "descriptor_dim": str(learned + sizes),
        "normalisation": "mean,rms,floor=0.001",
        "quality_temperature": "1",
        "training_data": "random numbers",
    } | changes
    rng = np.random.default_rng(7)
    header: dict[str, object] = {"__metadata__": metadata}
    body = bytearray()
    for name, shape in shapes(sizes, learned).items():
        spread = 1 / np.sqrt(shape[0]) if len(shape) > 1 else 0.1
        values = rng.normal(size=shape) * spread + (1.0 if name.endswith(("scale", "std", "size.weight")) else 0.0)
        data = values.astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(shape), "data_offsets": [len(body), len(body) + len(data)]}
        body += data
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + bytes(body)
