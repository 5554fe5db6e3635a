"""Archives over http(s): streamed to disk, resumed, verified, and not fetched twice.

The server's validators (ETag, Last-Modified, length) are recorded in the cache. With them a
later request asks "has it changed since?" (If-None-Match, If-Modified-Since), and a broken
download asks for "the rest, if it has not" (Range with If-Range).
"""

import logging
import time
from collections.abc import Callable
from pathlib import Path

import requests
from filelock import FileLock

from tactile_core.addresses import shown
from tactile_core.dataset.sources.answers import (
    TransientError,
    auth_for,
    if_range,
    is_other_range,
    is_unchanged,
    reason_of,
    refuse,
    validators_of,
)
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

ATTEMPTS = 5  # in a row that bring no new byte
FIRST_WAIT = 0.5  # seconds; doubled after every further failure
TIMEOUT = (10, 60)  # seconds to connect, and between two pieces
# The bytes as they are: lengths and ranges then count what lies on disk.
PLAIN = {"Accept-Encoding": "identity"}
NO_HEAD = (400, 403, 405, 501)  # of servers that know GET only, and addresses signed for it
CONDITIONS = {"etag": "If-None-Match", "modified": "If-Modified-Since"}


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
        refuse(response, url)
    except TactileError:
        raise
    except (TransientError, requests.RequestException, ValueError) as error:
        raise TactileError(
            f"{shown(url)} cannot be asked whether it has changed ({reason_of(error)}): look at "
            "the address and the network"
        ) from None
    validators = validators_of(response)
    etag = validators.get("etag", "W/")
    if not etag.startswith("W/"):  # a strong one vouches for the bytes
        return etag
    # A length alone would miss a file that was replaced by one as long.
    return repr(sorted(validators.items())) if validators.keys() - {"length"} else ""


def _headers(method: str, url: str, token: str | None) -> requests.Response:
    """The answer to a request, of whose body nothing is read."""
    auth = auth_for(url, token)
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
        except TransientError as error:
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
    cached, begun = read_record(target), read_record(part)
    validator = if_range(begun)
    offset = part.stat().st_size if validator else 0
    headers = dict(PLAIN)
    if validator and offset:
        headers |= {"Range": f"bytes={offset}-", "If-Range": validator}
    else:
        headers |= {CONDITIONS[key]: cached[key] for key in CONDITIONS if key in cached}
    try:
        with requests.get(
            url, headers=headers, auth=auth_for(url, token), stream=True, timeout=TIMEOUT
        ) as response:
            if (cached and response.status_code == 304) or is_unchanged(cached, response):
                return target
            if response.status_code == 416 or is_other_range(response, offset, begun):
                part.unlink(missing_ok=True)
                raise TransientError("the server has no such rest of the file")
            refuse(response, url)
            if response.status_code == 200:  # from the start, whatever was asked
                offset = 0
                part.unlink(missing_ok=True)  # never old bytes beside a new record
                write_record(part, validators_of(response))
            _stream(response, part, offset, progress)
    except (requests.ConnectionError, requests.Timeout) as error:
        raise TransientError(reason_of(error)) from None
    except requests.exceptions.ChunkedEncodingError:
        raise TransientError("the connection broke") from None
    except TactileError:
        raise
    except (requests.RequestException, ValueError) as error:  # the latter of odd addresses
        raise TactileError(f"{shown(url)} cannot be fetched ({reason_of(error)})") from None
    except OSError as error:
        raise TactileError(f"{part} cannot be written ({error.strerror}): make room") from error
    return part


def _stream(
    response: requests.Response, part: Path, offset: int, progress: Callable[[str], None]
) -> None:
    """Append the body to the first `offset` bytes of `part`, and check the length."""
    length = validators_of(response).get("length")
    total = offset + int(length) if length else None
    reporter = Reporter(part.name.removesuffix(".part"), total, progress)
    with part.open("ab" if offset else "wb") as file:
        for piece in response.iter_content(PIECE):
            file.write(piece)
            reporter.at(file.tell())
        size = file.tell()
    if total is not None and size != total:
        raise TransientError(f"{size} of {total} bytes came")
