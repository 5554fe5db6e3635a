"""Addresses that may hold a secret: how they are shown, and where the secret is kept.

A password or signature lies in the environment only. A setting that needs one says `$NAME`, the
variable that holds the whole address, and Dagster's database keeps these few letters.
"""

import os
import re
from collections.abc import Mapping
from urllib.parse import parse_qsl, urlsplit

from tactile_core.errors import ODD, TactileError, spelt

HTTP = ("http://", "https://")
# The second form is of a password with a slash or the like, which should have been encoded.
USER = re.compile(r"(?<=://)(?:[^/\s?#'\"]*@|[^/\s:@'\"]*:(?!\d+[/?#])[^\s@'\"]*@)")
# After an address, or after a path alone, as in the messages of urllib3.
QUERY = re.compile(r"(://[^\s?'\"<>]*)\?[^\s'\"<>]*|\?[^\s'\"<>]*=[^\s'\"<>]*")
# Names of query fields that hold what is not for others, as S3, Azure, Google and others call them.
SECRET_FIELD = re.compile(
    r"sig|token|key|pass|pwd|secret|cred|auth|policy|session|jwt|access", re.IGNORECASE
)
LONG = 20  # letters: what stands in a query and is as long may be a secret under any name


def checked(address: str) -> str:
    """The address itself; raises `TactileError` where it can be none, whatever lies there."""
    if letter := ODD.search(address):
        raise TactileError(
            f"{shown(spelt(address))} has {letter[0]!r} in it, which no address holds: correct it"
        )
    try:
        if "://" in address:
            urlsplit(address)
    except ValueError:  # it may name user and password
        raise TactileError(f"{shown(address)} is no address: correct it") from None
    return address


def shown(address: str) -> str:
    """An address without password and query, to be said and stored; a local path as it is."""
    return redacted(address) if "://" in address else address


def redacted(text: str) -> str:
    """A text without the passwords and queries of the addresses in it."""
    return QUERY.sub(r"\1", USER.sub(_user, text))


def one_line(error: BaseException) -> str:
    """What an exception says, on one line of at most 200 characters, without passwords."""
    return redacted(" ".join(str(error).split()))[:200] or type(error).__name__


def holds_secret(address: str) -> bool:
    """Whether an address has a password in it, or what looks like a signature."""
    if "://" not in address:
        return False
    if any(_user(match) != match[0] for match in USER.finditer(address)):
        return True
    fields = parse_qsl(urlsplit(address).query, keep_blank_values=True)
    return any(SECRET_FIELD.search(name) or len(value) >= LONG for name, value in fields)


def setting_of(variable: str, environ: Mapping[str, str] = os.environ) -> str | None:
    """The address in a variable as a setting: `$NAME` where it holds more than may be shown."""
    try:
        address = checked(environ.get(variable) or "") or None
    except TactileError as error:
        raise TactileError(f"{variable}: {error}") from None
    return f"${variable}" if address and shown(address) != address else address


def full(setting: str) -> str:
    """The address that a setting stands for.

    Raises `TactileError` where the setting itself holds a secret, names a variable that is not
    set, or is no address.
    """
    if holds_secret(checked(setting)):
        raise TactileError(
            f"the settings hold {shown(setting)} with its password or signature, which would be "
            "stored with the run: put the whole address into an environment variable, such as "
            "TACTILE_SHAPENET, and give the variable's name with a dollar ($TACTILE_SHAPENET)"
        )
    if not setting.startswith("$"):
        return setting
    address = os.environ.get(setting[1:])
    if not address:
        raise TactileError(f"the settings name {setting}, and this variable is not set: set it")
    return checked(address)


def _user(match: re.Match[str]) -> str:
    """What may be shown of the user before a host: a name alone, which some stores need.

    Over http a name alone may be a token.
    """
    web = match.string[: match.start()].lower().endswith(HTTP)
    return "" if web or ":" in match[0] else match[0]
