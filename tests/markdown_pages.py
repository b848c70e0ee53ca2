"""The pages of the documentation as tests see them: programs, command lines, links, headings."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SKIP = "<!-- skip -->"


def pages() -> list[Path]:
    """Every page that people read, built ones left out."""
    docs = [page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts]
    return sorted([*ROOT.glob("*.md"), *docs])


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def programs(page: Path, language: str = "python") -> list[str]:
    """The fenced blocks in a language, but those below a line that says skip."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(rf"({SKIP}\s*\n)?^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [program for skipped, program in found if not skipped]


def command_lines(page: Path, command: str) -> Iterator[list[str]]:
    """Lines in fenced blocks that start with a command, split into words; a prompt and a comment are no words."""
    for block in re.findall(r"^```[\w{}-]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            words = line.strip().removeprefix("$ ")
            if words.startswith(f"{command} "):
                yield shlex.split(words, comments=True)[1:]


def redirected(words: list[str]) -> tuple[list[str], str]:
    """The words of a command line before `>`, and the file behind it, or ""."""
    return (words[:-2], words[-1]) if ">" in words else (words, "")


def links(page: Path) -> list[str]:
    """Targets of links and pictures, without those on other servers; code is no link."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"`[^`\n]*`|\$\$.*?\$\$", "", text, flags=re.DOTALL)
    targets = re.findall(r"\]\(<?([^)>\s]+)>?\)", text) + re.findall(r"^\[[^\]]+\]: (\S+)$", text, re.MULTILINE)
    return [t for t in targets if not re.match(r"[a-z]+:", t)]


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
