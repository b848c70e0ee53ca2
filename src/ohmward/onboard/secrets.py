"""Secrets, and checks of addresses that need one.

A secret comes from an environment variable or a file that nobody else may read, never from a setup or a command line.
"""

from __future__ import annotations

import ipaddress
import os
import stat
from pathlib import Path

from ohmward.errors import InputError

#: Whether the mode of a file says who may read it; on Windows it does not.
HAS_MODES = os.name == "posix"

#: Prefix of a file's path in the key of a setup that names a secret.
_FILE = "file:"


def check_secret_name(key: str, where: str | None) -> None:
    """Raise InputError unless `where` is None or a place of a secret: the name of a variable, or file:PATH.

    Names of variables are in capitals by convention; anything else is more likely the secret itself, which no message
    may show.
    """
    if where is not None and not where.startswith(_FILE) and not (where.isidentifier() and where == where.upper()):
        raise InputError(
            f'{key} says where the secret is, not the secret: {key} = "MY_VARIABLE" for an environment variable, '
            f'or {key} = "file:/etc/ohmward/secret" for a file of mode 600'
        )


def secret(key: str, where: str | None) -> str:
    """The secret that the key `key` of a setup points at; "" if it points at none.

    where: name of an environment variable, or "file:PATH"; the file's last line break is left out.  None for none.

    Raises:
        InputError: there is none, or users other than the owner may read the file. The message never has the secret.
    """
    if where is None:
        return ""
    check_secret_name(key, where)
    if not where.startswith(_FILE):
        if not (found := os.environ.get(where)):
            raise InputError(f"{key}: the environment variable {where} is not set; set it where ohmward starts")
        return found
    path = Path(where.removeprefix(_FILE))
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        if HAS_MODES and mode & 0o077:
            raise InputError(f"{key}: others may read {path} (mode {mode:o}); chmod 600 {path}")
        found = path.read_text(encoding="utf-8").rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{key}: {path} cannot be read ({getattr(error, 'strerror', '') or 'no text'})") from error
    if not found:
        raise InputError(f"{key}: {path} is empty; write the secret into it")
    return found


def host_and_port(key: str, address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises:
        InputError: the address has another form.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"{key} must be HOST:PORT, as 127.0.0.1:4710, got {address!r}")
    return host.strip("[]"), int(port)


def is_loopback(host: str) -> bool:
    """True if only this machine can reach the host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
