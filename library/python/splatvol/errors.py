"""Exceptions. Each message is one line, which names the file and the broken rule."""


class Error(Exception):
    """What the package raises when something goes wrong. Its subclasses say why."""


class FileError(Error, OSError):
    """The system, or a server, refused: open, read, write, rename."""


class MissingFileError(FileError, FileNotFoundError):
    """There is no file of this name."""


class InvalidDataError(Error, ValueError):
    """The bytes of a file, or a mesh, break a rule."""


class UnsupportedError(Error):
    """Well-formed, but this version does not handle it."""


class InvalidArgumentError(Error, ValueError):
    """The caller asked for something that is not possible."""


class OutOfBudgetError(Error, MemoryError):
    """It would not fit into the granted memory."""


class DeviceError(Error):
    """The device that draws failed."""


class CancelledError(Error):
    """The call was ended early. Ctrl-C raises KeyboardInterrupt instead."""
