"""The exceptions of ohmward: one family, so that a caller can catch everything that the package refuses."""


class OhmwardError(Exception):
    """Base of every error that ohmward raises on purpose."""


class InputError(OhmwardError):
    """What the caller or a file gave cannot be used; the message names the thing, the rule, the value and the fix.

    The command line prints the message and ends with status 2.
    """
