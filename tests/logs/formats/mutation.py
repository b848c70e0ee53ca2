"""Damaged logs: files of all formats with bytes, lines and cells changed as disks, editors and people change them."""

from __future__ import annotations

import gzip
import io
import zipfile
from collections.abc import Collection, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from logs.formats.population import FORMATS

#: Rows of the known log that are left: long logs say no more.
_MOST_BYTES = 6_000
_TEXTS = (".csv", ".txt", ".tsv", ".json", ".jsonl", ".mpt", ".lvm")
_ZIP, _GZIP = b"PK\x03\x04", b"\x1f\x8b"
_PIECES = (
    b'"', b"'", b",", b";", b"\t", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"nan", b"inf", b"-inf", b"1e308", b"1e400",
    b"-", b"\r", b"\n", b"\n\n\n", b"#", b"sep=,\n", b"{", b"[", b"]}", b"[s]", b"A", b"V", b"time", b"99:99:99",
    b"2026-02-30", b"00/00/0000", b"31/12/9999 23:59:60", b"P1D", b"1,234,567.8", b"0x1F", b"1_000", b"\xe2\x88\x92",
    b"\xc2\xa0", b"9" * 400, b"a" * 5_000, b"%", b"mA", b" ", b"true", b"NaT", b"-99999999999999999999",
)  # fmt: skip


def written(folder: Path) -> dict[str, Path]:
    """A file of each format whose package is installed, by its name."""
    paths = {}
    for k, about in enumerate(FORMATS):
        if about.package and find_spec(about.package) is None:
            continue
        place = folder / str(k)
        place.mkdir()
        path = about.write(place)
        if path.is_file():
            paths[about.name] = path
    return paths


def damaged(paths: Collection[Path], rng: np.random.Generator, count: int) -> Iterator[Path]:
    """`count` files, each of them one of these with one to three changes, in its place."""
    originals = [(path, path.read_bytes()) for path in paths]
    for _ in range(count):
        path, content = originals[rng.integers(len(originals))]
        path.write_bytes(damage(content, path.suffix, rng))
        yield path


def damage(content: bytes, suffix: str, rng: np.random.Generator) -> bytes:
    """The content of a file with one to three changes; of packed files every second time in what is packed."""
    if content.startswith(_ZIP) and rng.integers(2):
        return _in_archive(content, rng)
    if content.startswith(_GZIP) and rng.integers(2):
        return gzip.compress(damage(gzip.decompress(content), ".csv", rng), 1)
    changed = bytearray(content[:_MOST_BYTES] if suffix in _TEXTS else content)
    for _ in range(rng.integers(1, 4)):
        changed = _changed(changed, rng)
    return bytes(changed)


def _in_archive(content: bytes, rng: np.random.Generator) -> bytes:
    """An archive with one of its parts damaged, but packed without a fault."""
    target = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as source,
        zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, False, 1) as out,
    ):
        names = source.namelist()
        chosen = names[rng.integers(len(names))]
        for name in names:
            part = source.read(name)
            out.writestr(name, damage(part, "", rng) if name == chosen else part)
    return target.getvalue()


def _changed(content: bytearray, rng: np.random.Generator) -> bytearray:
    """One change: a byte, a piece put in, a stretch taken out, doubled or moved, a cell replaced, the end cut off."""
    size = len(content)
    if not size:
        return bytearray(b"x")
    at = int(rng.integers(size))
    length = int(rng.integers(1, 200))
    piece = bytes(content[at : at + length])
    kind = int(rng.integers(15))
    if kind in (0, 8, 9):
        content[at] = int(rng.integers(256))
    elif kind == 10:
        content[at] = b'0123456789,.;-\t "'[rng.integers(17)]
    elif kind in (1, 2):
        content[at:at] = _PIECES[rng.integers(len(_PIECES))]
    elif kind == 3:
        del content[at : at + length]
    elif kind == 4:
        content[at:at] = piece
    elif kind == 5:
        del content[at : at + length]
        other = int(rng.integers(len(content) + 1))
        content[other:other] = piece
    elif kind in (6, 11, 12, 13):
        cells = bytes(content).split(b",")
        cells[rng.integers(len(cells))] = _PIECES[rng.integers(len(_PIECES))]
        content = bytearray(b",".join(cells))
    else:
        del content[at:]
    return content
