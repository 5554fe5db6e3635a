"""What a file is that should be a zip archive and is none: told by its first and last bytes."""

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
LONGEST_END = 22 + (1 << 16)  # bytes: that record with its comment
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
    _, found, end = tail.rpartition(DIRECTORY)
    if found:
        disk = int.from_bytes(end[:2], "little")
        several = disk not in (0, 0xFFFF)  # the latter where the archive is longer than 4 GiB
        return f"is the last of {disk + 1} parts of a zip archive: join them" if several else None
    return _kind(head, size)


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
