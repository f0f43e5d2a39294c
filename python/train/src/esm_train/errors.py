"""The one exception that the command line turns into a message and exit code 2."""

from __future__ import annotations


class TrainError(Exception):
    """Bad input: says which file, where in it, and how to mend it."""

    def __init__(self, message: str, hint: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint

    def __str__(self) -> str:
        message = super().__str__()
        return message if self.hint is None else f"{message}\nhint: {self.hint}"
