"""What a server says with an archive: whether it may be had, later or not, and which one it is.

Errors of `requests` name the whole address, password and signature included. They never go on from
here: not as the cause of another (`from None`), and not as a line in a log.
"""

import logging
from urllib.parse import urlsplit

import requests
from requests.auth import AuthBase

from tactile_core.addresses import redacted, shown
from tactile_core.errors import TactileError

HUGGING_FACE = "huggingface.co"
LONGEST_WAIT = 60  # seconds, whatever the server asks for
VALIDATORS = {"etag": "ETag", "modified": "Last-Modified", "length": "Content-Length"}


def _redact(record: logging.LogRecord) -> bool:
    record.msg, record.args = redacted(record.getMessage()), ()
    return True


logging.getLogger("urllib3.connectionpool").addFilter(_redact)  # it names paths with their query


class HuggingFaceToken(AuthBase):
    """Sends a bearer token to https://huggingface.co and to no other host.

    The rule is put to the address as `requests` really uses it; and `requests` takes the
    header off again when it follows a redirect to another host.
    """

    def __init__(self, token: str):
        self.token = token

    def __call__(self, request: requests.PreparedRequest) -> requests.PreparedRequest:
        if takes_token(request.url or ""):
            request.headers["Authorization"] = f"Bearer {self.token}"
        return request


class MissingFileError(TactileError):
    """There is no file at an address."""


class TransientError(Exception):
    """A failure that may pass; `wait` is for how many seconds the server asks."""

    def __init__(self, reason: str, wait: float = 0.0):
        super().__init__(reason)
        self.wait = wait


def takes_token(url: str) -> bool:
    """Whether the Hugging Face token may be sent to `url`."""
    parts = urlsplit(url)
    return parts.scheme == "https" and parts.netloc == HUGGING_FACE


def refuse(response: requests.Response, url: str) -> None:
    """Raise what a status other than 200 and 206 means."""
    status = response.status_code
    if status in (401, 403):
        raise TactileError(f"{shown(url)} refuses access ({status}): {how_to_enter(url)}")
    if status in (404, 410):
        raise MissingFileError(f"{shown(url)} does not exist ({status}): look at the address")
    if status in (408, 429) or status >= 500:
        asked = response.headers.get("Retry-After", "")
        wait = min(int(asked), LONGEST_WAIT) if asked.isdecimal() else 0
        raise TransientError(f"status {status}", wait)
    if status not in (200, 206):
        raise TactileError(f"{shown(url)} answers with status {status}: look at the address")


def how_to_enter(url: str) -> str:
    host = urlsplit(url).hostname
    if host == HUGGING_FACE:
        return (
            "for ShapeNet at Hugging Face accept the licence on the data set's page and set "
            "HF_TOKEN to a token of that account"
        )
    return (
        f"{host} wants a user and a password, which ~/.netrc or the address in the environment may "
        "give, or an address whose signature has not expired"
    )


def auth_for(url: str, token: str | None) -> AuthBase | None:
    # No handler for other hosts, which leaves a user's .netrc in force there.
    return HuggingFaceToken(token) if token and takes_token(url) else None


def validators_of(response: requests.Response) -> dict[str, str]:
    """What tells the file from others, see `VALIDATORS`; no length that is none."""
    if response.headers.get("Content-Encoding", "identity") != "identity":
        return {}  # they speak of the packed bytes
    found = {
        key: response.headers[name] for key, name in VALIDATORS.items() if name in response.headers
    }
    lengths = set(found.pop("length", "").replace(" ", "").split(","))  # some send it twice
    if len(lengths) == 1 and (length := lengths.pop()).isdecimal():
        found["length"] = length
    return found


def is_unchanged(cached: dict[str, str], response: requests.Response) -> bool:
    """Whether a server that ignores conditions would send the cached file once more."""
    dated = "etag" in cached or "modified" in cached
    return response.status_code == 200 and dated and cached == validators_of(response)


def if_range(begun: dict[str, str]) -> str | None:
    """The validator of a begun download; a weak ETag does not vouch for bytes."""
    etag = begun.get("etag")
    return etag if etag and not etag.startswith("W/") else begun.get("modified")


def is_other_range(response: requests.Response, offset: int, begun: dict[str, str]) -> bool:
    """Whether a part was sent that is not the rest of what was `begun` under these validators: of
    another place, or of another file by a server that does not know If-Range."""
    if response.status_code != 206:
        return False
    place, _, total = response.headers.get("Content-Range", "").rpartition("/")
    sent = validators_of(response) | {"length": total}  # of the whole, not of the part
    if not total.isdecimal():
        del sent["length"]
    other = any(begun.get(key, value) != value for key, value in sent.items())
    return other or not place.startswith(f"bytes {offset}-")


def reason_of(error: Exception) -> str:
    """Why a request failed, without the address, which may hold a secret."""
    if isinstance(error, TransientError):
        return str(error)
    if isinstance(error, requests.Timeout):
        return "no answer in time"
    if isinstance(error, requests.exceptions.SSLError):
        return "its certificate is not trusted"
    if isinstance(error, requests.ConnectionError):
        return "no connection"
    if not isinstance(error, requests.RequestException):
        return "it leads to what is no address"
    return type(error).__name__
