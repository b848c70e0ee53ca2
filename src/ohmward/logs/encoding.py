"""Encoding of a text table, told by its mark, its zeros, or the words of its header."""

from __future__ import annotations

import codecs
import re

from ohmward.logs.channels import BATTERY, letters

#: Marks at the beginning of a text, the longest first: that of UTF-32 LE begins with that of UTF-16 LE.
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
#: Encodings of the world beside UTF-8. Western Europe first: it wins where no word tells.
CODE_PAGES = (
    "cp1252",
    "cp1251",
    "cp932",
    "gb18030",
    "big5",
    "cp949",
    "cp1250",
    "mac_roman",
    "koi8_r",
    "cp866",
    "cp850",
)

_WORDS = frozenset(word for channel in BATTERY for words in channel.words for word in words if not word.isascii())


def find_encoding(head: bytes) -> str:
    """The encoding of a text that begins with these bytes."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if wide := _without_mark(head):
        return wide
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return _code_page(head)
    return "utf-8-sig"


def is_wide(encoding: str) -> bool:
    """True where a plain letter takes several bytes, zeros among them."""
    return encoding.lower().replace("_", "-").startswith(("utf-16", "utf-32"))


def _without_mark(head: bytes) -> str:
    """UTF-16 or UTF-32 by the places of the zeros, which letters and digits of ASCII have there; "" for neither."""
    sample = head[: len(head) & ~3][:4096]
    if len(sample) < 8:
        return ""
    zeros = [sample[k::4].count(0) / (len(sample) // 4) for k in range(4)]
    usual = [share > 0.8 for share in zeros]
    names = {
        (False, True, True, True): "utf-32-le",
        (True, True, True, False): "utf-32-be",
        (False, True, False, True): "utf-16-le",
        (True, False, True, False): "utf-16-be",
    }
    return names.get((usual[0], usual[1], usual[2], usual[3]), "")


def _code_page(head: bytes) -> str:
    """The encoding in which most words name a quantity."""

    def known(encoding: str) -> int:
        text = head.decode(encoding, errors="ignore")
        units = len(re.findall(r"[°℃µ]", text[:2000]))
        return 2 * len(_WORDS & set(letters(text[:20_000]))) + (units > 0)

    return max(CODE_PAGES, key=known)
