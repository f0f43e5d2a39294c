"""The layer table: what each X-conv layer looks like, its parameters and its work.

Everything that has a shape in this package takes it from here; WEIGHTS.md states the same table in words.
"""

from __future__ import annotations

from dataclasses import dataclass

INPUT_POINTS = 256
"""Points sampled from a segment."""

BN_EPS = 1e-3
BN_MOMENTUM = 0.01
"""PyTorch's convention; TensorFlow calls the same 0.99."""

STD_FLOOR_M = 1e-3
"""Floor in metres of the scalar that a segment is divided by."""

SIZE_FEATURES = ("sigma1", "sigma2", "sigma3", "height", "extent1", "extent2")
"""The metric sizes that every segment has, in the order of their columns."""

ABOVE_GROUND = "above_ground"
"""A seventh size, where the height above ground is known."""

CONTEXT = 28
"""Numbers that tell what stands around a segment: four for each of seven rings (DATA.md)."""

SIZE_MODES = ("none", "beside", "fc", "both")


@dataclass(frozen=True)
class XConvSpec:
    """One X-conv layer: neighbours K, dilation D, lifted channels, channels before and after, multiplier."""

    neighbours: int
    dilation: int
    lifted: int
    before: int
    channels: int
    multiplier: int

    @property
    def joined(self) -> int:
        """Channels of lifted and previous features together."""
        return self.lifted + self.before

    @property
    def nearest(self) -> int:
        """How many nearest points the neighbour list is thinned from."""
        return self.neighbours * self.dilation

    def parameters(self) -> int:
        """Trainable parameters, batch norms included."""
        k, kk = self.neighbours, self.neighbours**2
        lift = 3 * self.lifted + self.lifted**2 + 4 * self.lifted
        transform = 3 * k * kk + 2 * k * kk + 6 * kk
        separable = k * self.joined * self.multiplier + self.joined * self.multiplier * self.channels
        return lift + transform + separable + 2 * self.channels

    def multiply_adds(self) -> int:
        """Multiply-adds for one query point; batch norm and activations are not counted."""
        k, kk = self.neighbours, self.neighbours**2
        lift = k * (3 * self.lifted + self.lifted**2)
        transform = 3 * k * kk + 2 * k * kk
        apply = kk * self.joined
        separable = k * self.joined * self.multiplier + self.joined * self.multiplier * self.channels
        return lift + transform + apply + separable


@dataclass(frozen=True)
class Plan:
    """A network: X-conv layers, points each keeps, fully connected widths, descriptor and size mode."""

    variant: str
    points: tuple[int, ...]
    layers: tuple[XConvSpec, ...]
    global_channels: int
    hidden: tuple[int, int]
    learned_dim: int
    size_mode: str
    size_features: tuple[str, ...]
    input_points: int = INPUT_POINTS
    turned: bool = False
    """Whether segments are turned about the up axis into a pose of their own first."""
    context: bool = False
    """Whether what stands around a segment is known to the network."""

    def __post_init__(self) -> None:
        """Refuses plans that no neighbour list can serve."""
        if len(self.points) != len(self.layers):
            raise ValueError(f"the plan has {len(self.points)} point counts for {len(self.layers)} layers")
        before = self.input_points
        for number, (kept, layer) in enumerate(zip(self.points, self.layers, strict=True), 1):
            if not 1 <= kept <= before:
                raise ValueError(f"layer {number} keeps {kept} points of {before}")
            if layer.nearest > before:
                raise ValueError(f"layer {number} needs {layer.nearest} neighbours of {before} points")
            before = kept
        if self.size_mode not in SIZE_MODES:
            raise ValueError(f"size mode {self.size_mode!r} is none of {', '.join(SIZE_MODES)}")
        unknown = [f for f in self.size_features if f not in (*SIZE_FEATURES, ABOVE_GROUND)]
        if unknown:
            raise ValueError(f"unknown size features: {', '.join(unknown)}")
        if (self.size_mode == "none") != (not self.size_features):
            raise ValueError("size features go with a size mode, and a size mode with size features")
        if self.context and not self.size_features:
            raise ValueError("context goes with a size mode")

    @property
    def sources(self) -> tuple[int, ...]:
        """Points among which each layer looks for neighbours: those of the layer before."""
        return (self.input_points, *self.points[:-1])

    @property
    def sizes(self) -> int:
        """Columns of the metric sizes."""
        return len(self.size_features)

    @property
    def measures(self) -> int:
        """Columns of all that enters beside the points: the metric sizes, then the context."""
        return self.sizes + (CONTEXT if self.context else 0)

    @property
    def join_input(self) -> int:
        """Numbers into the layer that joins shape, sizes and context."""
        return self.hidden[1] + self.measures

    @property
    def fc_input(self) -> int:
        """Channels into the fully connected layers: global branch and last X-conv."""
        return self.global_channels + self.layers[-1].channels

    @property
    def descriptor_dim(self) -> int:
        """Numbers a descriptor."""
        return self.learned_dim + (self.sizes if self.size_mode in ("beside", "both") else 0)

    def layer_parameters(self) -> list[int]:
        """Trainable parameters: each X-conv (the last with the global branch), fc1, fc2, the joining layer, fc3."""
        g = self.global_channels
        counts = [layer.parameters() for layer in self.layers]
        counts[-1] += 3 * g + g * g + 4 * g
        first, second = self.hidden
        counts += [self.fc_input * first + 2 * first, first * second + 2 * second]
        if self.context:
            counts.append(self.join_input * second + 2 * second)
        return [*counts, second * self.learned_dim + self.learned_dim]

    def parameters(self) -> int:
        """Trainable parameters without the size weights and the quality head."""
        return sum(self.layer_parameters())

    def multiply_adds(self) -> int:
        """Multiply-adds of one segment."""
        total = sum(kept * layer.multiply_adds() for kept, layer in zip(self.points, self.layers, strict=True))
        g, (first, second) = self.global_channels, self.hidden
        per_point = 3 * g + g * g + self.fc_input * first + first * second
        total += self.points[-1] * per_point + second * self.learned_dim
        if self.size_mode in ("fc", "both"):
            total += self.sizes * first
        if self.context:
            total += self.join_input * second
        return total


def xconv_layers(
    channels: tuple[int, ...],
    neighbourhoods: tuple[tuple[int, int], ...],
) -> tuple[XConvSpec, ...]:
    """Layers by the rules of the reference: lifted width C/2 then C_prev/4, multiplier 4 then ceil(C / C_prev)."""
    layers: list[XConvSpec] = []
    before = 0
    for (neighbours, dilation), c in zip(neighbourhoods, channels, strict=True):
        lifted = before // 4 if before else c // 2
        multiplier = -(-c // before) if before else 4
        layers.append(XConvSpec(neighbours, dilation, lifted, before, c, multiplier))
        before = c
    return tuple(layers)


PAPER_LAYERS = xconv_layers((32, 64, 128, 256), ((8, 1), (12, 3), (16, 3), (16, 4)))
FULL_POINTS = (256, 256, 256, 256)
SWIFT_POINTS = (256, 96, 64, 48)

VARIANTS: dict[str, tuple[tuple[int, ...], str, bool, bool]] = {
    "esm-paper": (FULL_POINTS, "none", False, False),
    "esm": (FULL_POINTS, "beside", True, True),
    "esm-swift": (SWIFT_POINTS, "beside", True, True),
}
"""Points a layer keeps, size mode, whether segments are turned, whether they have context, by name of the variant."""


def plan_for(
    variant: str,
    *,
    points: tuple[int, ...] | None = None,
    size_mode: str | None = None,
    size_features: tuple[str, ...] | None = None,
    learned_dim: int = 16,
    turned: bool | None = None,
    context: bool | None = None,
) -> Plan:
    """The plan of a variant, with what differs from its defaults."""
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r} is none of {', '.join(VARIANTS)}")
    default_points, default_mode, default_turned, default_context = VARIANTS[variant]
    mode = default_mode if size_mode is None else size_mode
    features = SIZE_FEATURES if size_features is None else size_features
    return Plan(
        variant=variant,
        points=default_points if points is None else points,
        layers=PAPER_LAYERS,
        global_channels=64,
        hidden=(256, 128),
        learned_dim=learned_dim,
        size_mode=mode,
        size_features=() if mode == "none" else features,
        turned=default_turned if turned is None else turned,
        context=default_context and mode != "none" if context is None else context,
    )


def tiny_plan(size_mode: str = "beside", context: bool = False) -> Plan:
    """A few thousand parameters over 32 points, for tests in which the architecture does not matter."""
    return Plan(
        variant="esm-swift",
        points=(32, 24, 16, 12),
        layers=xconv_layers((8, 8, 16, 16), ((4, 1), (4, 2), (6, 2), (6, 2))),
        global_channels=4,
        hidden=(24, 16),
        learned_dim=8,
        size_mode=size_mode,
        size_features=() if size_mode == "none" else SIZE_FEATURES,
        input_points=32,
        context=context,
    )
