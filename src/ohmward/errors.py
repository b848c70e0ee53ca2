"""Exceptions of ohmward, one family, so that a caller can catch them all."""


class OhmwardError(Exception):
    """Base of every error that ohmward raises on purpose."""


class InputError(OhmwardError):
    """Bad input of the caller or a file; the message names the thing, the rule, the value and the fix.

    The command line prints the message and ends with status 2.
    """
