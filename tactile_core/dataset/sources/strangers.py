"""What often lies under the name of a mesh and is none: told by its first bytes."""

import codecs
import re

BEGINNINGS = {
    b"\x1f\x8b": "is packed with gzip: unpack it",
    b"BZh": "is packed with bzip2: unpack it",
    b"\xfd7zXZ": "is packed with xz: unpack it",
    b"(\xb5/\xfd": "is packed with zstd: unpack it",
    b"PK\x03\x04": "is a zip archive: unpack it",
    b"7z\xbc\xaf'\x1c": "is a 7z archive: unpack it",
    b"Rar!": "is a RAR archive: unpack it",
    b"Kaydara FBX": "is an FBX file under another name",
    b"DRACO": "is packed with Draco, which is not read: export it without compression",
}
OTHERS = {b"glTF": ".glb", b"ply\n": ".ply", b"ply\r": ".ply"}
ANNEX = re.compile(rb"(\.\./)*(\.git)?/annex/objects/")
OBJ = re.compile(rb"(?m)^v[ \t]+-?[\d.]+(e[-+]?\d+)?[ \t]+-?[\d.]")  # a vertex of text
PAGE = (b"<!doctype html", b"<html", b"<head", b"<body", b"<script")


def stranger(data: bytes, suffix: str) -> str | None:
    """What is wrong with a file that is no mesh of the kind that its name says, if that shows."""
    if not data:
        return "is empty: get it again"
    for beginning, kind in BEGINNINGS.items():
        if data.startswith(beginning):
            return kind
    for beginning, other in OTHERS.items():
        if data.startswith(beginning) and suffix != other:
            return f"is a {other[1:].upper()} file under another name: call it *{other}"
    if not data[: 1 << 20].strip(b"\0"):
        return "begins with nothing but zeros, as a copy that was broken off: get it again"
    text = data[:1024].removeprefix(codecs.BOM_UTF8).lstrip().lower()
    if ANNEX.match(text):
        return "is a git-annex pointer, not the mesh that it stands for: run git annex get there"
    if suffix == ".obj" and text.startswith((b"off\n", b"off\r", b"off ")):
        return "is an OFF file under another name: call it *.off"
    if suffix == ".obj" and text.startswith(b"solid") and b"facet" in text:
        return "is an STL file under another name: call it *.stl"
    if suffix == ".stl" and OBJ.search(data[:1024]) and b"facet" not in text:
        return "is an OBJ file under another name: call it *.obj"
    if text.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not the mesh that it stands for: run git lfs pull there"
    if text.startswith(PAGE):
        return "is a web page, not a mesh: get the file itself"
    if text.startswith((b"<?xml", b"<!--")):
        return "is an XML text or a web page, not a mesh: get the file itself"
    return None
