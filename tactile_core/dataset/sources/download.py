"""Archives over http(s): streamed to disk, resumed, verified, and not fetched twice.

The server's validators (ETag, Last-Modified, length) are recorded in the cache. With them a
later request asks "has it changed since?" (If-None-Match, If-Modified-Since), and a broken
download asks for "the rest, if it has not" (Range with If-Range).

Errors of `requests` name the whole address, password and signature included. They never go on from
here: not as the cause of another (`from None`), and not as a line in a log.
"""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import requests
from filelock import FileLock
from requests.auth import AuthBase

from tactile_core.addresses import redacted, shown
from tactile_core.dataset.sources.cache import (
    PIECE,
    Reporter,
    accept_part,
    cache_path,
    file_sha256,
    part_of,
    read_record,
    write_record,
)
from tactile_core.errors import OutOfReachError, TactileError

logger = logging.getLogger(__name__)

HUGGING_FACE = "huggingface.co"
ATTEMPTS = 5  # in a row that bring no new byte
FIRST_WAIT = 0.5  # seconds; doubled after every further failure
LONGEST_WAIT = 60  # seconds, whatever the server asks for
TIMEOUT = (10, 60)  # seconds to connect, and between two pieces
# The bytes as they are: lengths and ranges then count what lies on disk.
PLAIN = {"Accept-Encoding": "identity"}
VALIDATORS = {"etag": "ETag", "modified": "Last-Modified", "length": "Content-Length"}
NO_HEAD = (400, 403, 405, 501)  # of servers that know GET only, and addresses signed for it
CONDITIONS = {"etag": "If-None-Match", "modified": "If-Modified-Since"}


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


class _TransientError(Exception):
    """A failure that may pass; `wait` is for how many seconds the server asks."""

    def __init__(self, reason: str, wait: float = 0.0):
        super().__init__(reason)
        self.wait = wait


def takes_token(url: str) -> bool:
    """Whether the Hugging Face token may be sent to `url`."""
    parts = urlsplit(url)
    return parts.scheme == "https" and parts.netloc == HUGGING_FACE


def download(
    url: str,
    folder: Path,
    *,
    sha256: str | None = None,
    token: str | None = None,
    first_wait: float = FIRST_WAIT,
    progress: Callable[[str], None] = lambda message: None,
) -> Path:
    """The file at an http(s) address, in `folder`; fetched only when it is new or has changed.

    sha256 : expected SHA-256 of the file (hex); a cached file that has it is taken unasked
    token : bearer token, sent to https://huggingface.co only
    first_wait : seconds before the first retry of a failure that may pass

    Raises `MissingFileError` where there is none, and `TactileError` where access is refused, the
    server stays unreachable, or the file has another checksum.
    """
    target = cache_path(url, folder)
    with FileLock(f"{target}.lock"):
        if sha256 and target.exists() and file_sha256(target) == sha256.lower():
            return target
        fetched = _with_retries(url, target, token, first_wait, progress)
        try:
            verify_sha256(fetched, sha256, shown(url))
        except TactileError:
            fetched.unlink()
            raise
        if fetched != target:
            accept_part(target)
        return target


def remote_version(url: str, token: str | None = None) -> str | None:
    """What tells two versions of the file at `url` apart, asked for by HEAD.

    None where there is no file; empty where the server sends neither ETag nor Last-Modified.
    """
    try:
        response = _headers("HEAD", url, token)
        if response.status_code in NO_HEAD:
            response = _headers("GET", url, token)
        if response.status_code in (404, 410):
            return None
        _refuse(response, url)
    except (_TransientError, requests.RequestException) as error:
        raise TactileError(
            f"{shown(url)} cannot be asked whether it has changed ({_reason(error)}): look at "
            "the address and the network"
        ) from None
    validators = _validators(response)
    etag = validators.get("etag", "W/")
    if not etag.startswith(
        "W/"
    ):  # a strong one vouches for the bytes, whenever they were put there
        return etag
    # A length alone would miss a file that was replaced by one as long.
    return repr(sorted(validators.items())) if validators.keys() - {"length"} else ""


def _headers(method: str, url: str, token: str | None) -> requests.Response:
    """The answer to a request, of whose body nothing is read."""
    auth = _auth(url, token)
    with requests.request(
        method, url, headers=PLAIN, auth=auth, timeout=TIMEOUT, allow_redirects=True, stream=True
    ) as response:
        return response


def verify_sha256(path: Path, expected: str | None, address: str) -> None:
    """Raises `TactileError` where a checksum is expected and `path` has another."""
    if expected and (found := file_sha256(path)) != expected.lower():
        raise TactileError(
            f"{address} has SHA-256 {found}, not the expected {expected}: correct sha256 in the "
            "settings, or find out who changed the archive"
        )


def _with_retries(
    url: str,
    target: Path,
    token: str | None,
    first_wait: float,
    progress: Callable[[str], None],
) -> Path:
    part = part_of(target)
    failures, most = 0, 0
    while True:
        try:
            return _attempt(url, target, token, progress)
        except _TransientError as error:
            size = part.stat().st_size if part.exists() else 0
            failures = 1 if size > most else failures + 1
            most = max(most, size)
            if failures == ATTEMPTS:
                raise OutOfReachError(
                    f"{shown(url)} cannot be fetched ({error}, {ATTEMPTS} times in a row): look "
                    "at the address and the network, then run again"
                ) from None
            pause = max(error.wait, first_wait * 2 ** (failures - 1))
            logger.info("%s: %s, next attempt in %.1f s", shown(url), error, pause)
            time.sleep(pause)


def _attempt(url: str, target: Path, token: str | None, progress: Callable[[str], None]) -> Path:
    """One request. Returns `target` where it is unchanged, else its part, complete."""
    part = part_of(target)
    cached, validator = read_record(target), _if_range(read_record(part))
    offset = part.stat().st_size if validator else 0
    headers = dict(PLAIN)
    if validator and offset:
        headers |= {"Range": f"bytes={offset}-", "If-Range": validator}
    else:
        headers |= {CONDITIONS[key]: cached[key] for key in CONDITIONS if key in cached}
    try:
        with requests.get(
            url, headers=headers, auth=_auth(url, token), stream=True, timeout=TIMEOUT
        ) as response:
            if (cached and response.status_code == 304) or _unchanged(cached, response):
                return target
            if response.status_code == 416 or _other_range(response, offset):
                part.unlink(missing_ok=True)
                raise _TransientError("the server has no such rest of the file")
            _refuse(response, url)
            if response.status_code == 200:  # from the start, whatever was asked
                offset = 0
                part.unlink(missing_ok=True)  # never old bytes beside a new record
                write_record(part, _validators(response))
            _stream(response, part, offset, progress)
    except (requests.ConnectionError, requests.Timeout) as error:
        raise _TransientError(_reason(error)) from None
    except requests.exceptions.ChunkedEncodingError:
        raise _TransientError("the connection broke") from None
    except requests.RequestException as error:
        raise TactileError(f"{shown(url)} cannot be fetched ({_reason(error)})") from None
    except OSError as error:
        raise TactileError(f"{part} cannot be written ({error.strerror}): make room") from error
    return part


def _stream(
    response: requests.Response, part: Path, offset: int, progress: Callable[[str], None]
) -> None:
    """Append the body to the first `offset` bytes of `part`, and check the length."""
    length = _validators(response).get("length")
    total = offset + int(length) if length else None
    reporter = Reporter(part.name.removesuffix(".part"), total, progress)
    with part.open("ab" if offset else "wb") as file:
        for piece in response.iter_content(PIECE):
            file.write(piece)
            reporter.at(file.tell())
        size = file.tell()
    if total is not None and size != total:
        raise _TransientError(f"{size} of {total} bytes came")


def _refuse(response: requests.Response, url: str) -> None:
    """Raise what a status other than 200 and 206 means."""
    status = response.status_code
    if status in (401, 403):
        raise TactileError(f"{shown(url)} refuses access ({status}): {_how_to_enter(url)}")
    if status in (404, 410):
        raise MissingFileError(f"{shown(url)} does not exist ({status}): look at the address")
    if status in (408, 429) or status >= 500:
        asked = response.headers.get("Retry-After", "")
        wait = min(int(asked), LONGEST_WAIT) if asked.isdecimal() else 0
        raise _TransientError(f"status {status}", wait)
    if status not in (200, 206):
        raise TactileError(f"{shown(url)} answers with status {status}: look at the address")


def _how_to_enter(url: str) -> str:
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


def _auth(url: str, token: str | None) -> AuthBase | None:
    # No handler for other hosts, which leaves a user's .netrc in force there.
    return HuggingFaceToken(token) if token and takes_token(url) else None


def _validators(response: requests.Response) -> dict[str, str]:
    if response.headers.get("Content-Encoding", "identity") != "identity":
        return {}  # they speak of the packed bytes
    return {
        key: response.headers[name] for key, name in VALIDATORS.items() if name in response.headers
    }


def _unchanged(cached: dict[str, str], response: requests.Response) -> bool:
    """Whether a server that ignores conditions would send the cached file once more."""
    dated = "etag" in cached or "modified" in cached
    return response.status_code == 200 and dated and cached == _validators(response)


def _if_range(begun: dict[str, str]) -> str | None:
    """The validator of a begun download; a weak ETag does not vouch for bytes."""
    etag = begun.get("etag")
    return etag if etag and not etag.startswith("W/") else begun.get("modified")


def _other_range(response: requests.Response, offset: int) -> bool:
    begins = f"bytes {offset}-"
    sent = response.headers.get("Content-Range", "")
    return response.status_code == 206 and not sent.startswith(begins)


def _reason(error: Exception) -> str:
    """Why a request failed, without the address, which may hold a secret."""
    if isinstance(error, _TransientError):
        return str(error)
    if isinstance(error, requests.Timeout):
        return "no answer in time"
    if isinstance(error, requests.exceptions.SSLError):
        return "its certificate is not trusted"
    if isinstance(error, requests.ConnectionError):
        return "no connection"
    return type(error).__name__
