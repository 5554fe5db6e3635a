"""What a file is that should be a zip archive and is none: told by its first and last bytes."""

from collections.abc import Iterator
from pathlib import Path

BEGINNINGS = {
    b"\x1f\x8b": "a gzip file, as .tar.gz",
    b"BZh": "a bzip2 file, as .tar.bz2",
    b"\xfd7zXZ": "an xz file, as .tar.xz",
    b"(\xb5/\xfd": "a zstd file, as .tar.zst",
    b"7z\xbc\xaf'\x1c": "a 7z archive",
    b"Rar!": "a RAR archive",
}
PAGE = (b"<!doctype html", b"<html", b"<head", b"<!--", b"<script")
DIRECTORY = b"PK\x05\x06"  # begins the record at the end of every zip archive
END = 22  # bytes of that record, without the comment that may follow
LONGEST_END = END + (1 << 16)
FETCH = "get the archive itself, whole"


def what_it_is(path: Path) -> str | None:
    """What the file at `path` is and what helps; None where it ends as a zip archive does.

    Raises `FileNotFoundError` where there is none.
    """
    try:
        with path.open("rb") as file:
            head = file.read(1024)
            size = file.seek(0, 2)
            file.seek(max(0, size - LONGEST_END))
            tail = file.read()
    except FileNotFoundError:
        raise
    except OSError as error:
        return f"cannot be read ({error.strerror}): look at its permissions"
    last = tail.rfind(DIRECTORY)
    if last < 0:
        return _kind(head, size)
    if any(_ends_at(tail, place) for place in _places(tail) if place < last):
        return (
            "is a zip archive whose comment holds the mark by which an archive's end is found: "
            "take the comment out, as zip -z does"
        )
    disk = int.from_bytes(tail[last + 4 : last + 6], "little")
    several = disk not in (0, 0xFFFF)  # the latter where the archive is longer than 4 GiB
    return f"is the last of {disk + 1} parts of a zip archive: join them" if several else None


def _places(tail: bytes) -> Iterator[int]:
    """Where the mark of an archive's end stands."""
    place = tail.find(DIRECTORY)
    while place >= 0:
        yield place
        place = tail.find(DIRECTORY, place + 1)


def _ends_at(tail: bytes, place: int) -> bool:
    """Whether the record at `place` and its comment end where the file does."""
    record = tail[place : place + END]
    return len(tail) == place + END + int.from_bytes(record[END - 2 :], "little")


def _kind(head: bytes, size: int) -> str:
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not size:
        return f"is empty: {FETCH}"
    if not head.strip(b"\0"):
        return f"begins with nothing but zeros, as a copy that was broken off: {FETCH}"
    if text.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not the archive that it stands for: run git lfs pull there"
    if text.startswith(PAGE):
        return (
            "is a web page, not an archive, as servers show it to those who are not signed in or "
            "have not accepted a licence: sign in there, and get the archive itself"
        )
    if text.startswith(b"<?xml"):
        return f"is an XML text, not an archive, as stores answer when they refuse: {FETCH}"
    for beginning, kind in BEGINNINGS.items():
        if head.startswith(beginning):
            return f"is {kind}, not a zip archive: unpack it and give its folder"
    if head[257:262] == b"ustar":
        return "is a tar archive, not a zip archive: unpack it and give its folder"
    if head.startswith(b"PK\x07\x08"):
        return "is one of several parts of a zip archive: join them"
    if head.startswith(b"PK"):
        return f"is a zip archive that is cut off, its end is missing: {FETCH}"
    binary = any(byte < 9 or 13 < byte < 32 for byte in head)
    return f"is {'no zip archive' if binary else 'a text, not a zip archive'}: {FETCH}"
