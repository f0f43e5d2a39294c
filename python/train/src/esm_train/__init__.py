"""Training of the segment descriptor of esm: data, network, losses, trainer, evaluation, export."""

__version__ = "0.1.0"
