"""What can go wrong, as exceptions."""


class Error(Exception):
    """Whatever ``tamis`` could not do; its text says why and what to do about it."""


class InvalidValueError(Error, ValueError):
    """An argument has a value that makes no sense."""


class InvalidTypeError(Error, TypeError):
    """An argument is of a type that cannot be used."""


class MissingFileError(Error, FileNotFoundError):
    """A file is not there."""


class ImageWarning(UserWarning):
    """Something is wrong with an image, such as pixels that are no numbers."""
