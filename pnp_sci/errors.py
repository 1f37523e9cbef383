"""Errors that say which argument is wrong, what came and what was expected."""


class InputError(ValueError):
    """A value that cannot be used: the message names the argument, what came and what was expected."""


class InputIndexError(InputError, IndexError):
    """A number that is beyond the last one."""


class InputTypeError(TypeError):
    """An argument of a kind that cannot be used."""


class UnknownPluginError(InputError):
    """A prior, initialiser or decoder that is not installed: the message lists those that are."""


class FormatError(InputError):
    """A file whose content cannot be understood."""


class DataUnavailableError(FileNotFoundError):
    """A data file that is neither local nor reachable: the message says where to get it."""


class SolverError(RuntimeError):
    """A numerical failure, raised only by ``Result.raise_for_status()``."""


class MissingExtraError(ImportError):
    """A package is missing that an extra of this one installs: the message says which."""
