"""What can go wrong: one class for each cause that the core tells apart, all of them an `EsmError`.

`str(error)` names the file, the place in it and the reason, and on a line of its own what to do (`error.hint`).
Wrong arguments (a dtype, a shape) are plain `TypeError` and `ValueError` that name the argument.
"""

from __future__ import annotations

__all__ = [
    "BusyError",
    "ConfigError",
    "DescriptorMismatchError",
    "EmptyError",
    "EmptyMapError",
    "EsmError",
    "ExistsError",
    "FileError",
    "ForbiddenFileError",
    "InterruptedSimulationError",
    "MalformedError",
    "MapDataError",
    "MapFileError",
    "MissingFileError",
    "MissingMapError",
    "NonFinitePointError",
    "RecordingWarning",
    "ScaleError",
    "SettingError",
    "TopicError",
    "UnknownPresetError",
    "UnsupportedError",
    "WeightsFileError",
]


class EsmError(Exception):
    """Anything that esm refuses to do."""

    path: str | None = None
    """The file or directory it is about, where there is one."""

    def __str__(self) -> str:
        """Tell what is wrong, where, and what to do."""
        return str(self.args[0]) if self.args else type(self).__name__

    @property
    def hint(self) -> str | None:
        """What to do about it."""
        _, found, hint = str(self).partition("\nhint: ")
        return hint if found else None


class NonFinitePointError(EsmError, ValueError):
    """A point holds a NaN or an infinity; `finite` drops such points."""

    index: int
    """The first such point."""


class ConfigError(EsmError, ValueError):
    """A configuration has a key that does not exist, or a value outside its range."""

    field: str | None = None
    """The key with its tables, such as `accumulate.distance_m`, where a value is to blame."""
    value: str | None = None
    """The value, as given."""
    allowed: str | None = None
    """What would be allowed."""


class DescriptorMismatchError(EsmError, ValueError):
    """The map was built with another descriptor."""


class EmptyMapError(EsmError, ValueError):
    """A map would hold no segment."""


class MapDataError(EsmError, ValueError):
    """What was gathered for a map does not fit together, or a map was asked for what it does not hold."""


class MapFileError(EsmError, ValueError):
    """A map file is damaged, cut short, newer than this version, or not a map at all."""


class MissingMapError(MapFileError, FileNotFoundError):
    """There is no such map file."""


class WeightsFileError(EsmError, ValueError):
    """A file of network weights is damaged or belongs to another network."""


class FileError(EsmError, OSError):
    """The operating system refused a file operation."""


class MissingFileError(FileError, FileNotFoundError):
    """There is no such file or directory."""


class ForbiddenFileError(FileError, PermissionError):
    """The permissions do not allow it."""


class MalformedError(EsmError, ValueError):
    """A file is damaged, cut short, or breaks its format's rules."""

    place: str
    """Where in the file, such as `line 7` or `byte 4096`."""


class UnsupportedError(EsmError, ValueError):
    """A file is something else than what can be read."""


class TopicError(EsmError, ValueError):
    """A topic has to be chosen, or the chosen one is not there."""

    candidates: list[str]
    """The topics that could be meant."""


class EmptyError(EsmError, ValueError):
    """There is nothing usable in the input."""


class UnknownPresetError(EsmError, ValueError):
    """There is no preset of this name."""


class ScaleError(EsmError, ValueError):
    """The scale of a simulation is no usable factor."""


class BusyError(EsmError):
    """Another simulation is at work in the directory."""


class InterruptedSimulationError(EsmError):
    """The `progress` callback stopped the simulation; the same call goes on where it was."""


class ExistsError(EsmError, FileExistsError):
    """Something stands at the target that would be replaced."""


class SettingError(EsmError, ValueError):
    """A setting is outside its range."""


class RecordingWarning(UserWarning):
    """A recording was not as it should be, though reading went on."""
