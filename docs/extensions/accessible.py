"""What the theme leaves out for a keyboard or a screen reader: levels of captions, names of side bars, focus."""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

#: Text of a page -> with what stands in its place; a page that was not written again has none of the former.
REPLACED = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    '<aside class="toc-drawer">': '<aside class="toc-drawer" aria-label="On this page">',
    "<pre>": '<pre tabindex="0">',
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Finish the pages once all are written."""
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def finish(app: Sphinx, error: Exception | None) -> None:
    """Put in what is missing."""
    for page in Path(app.outdir).rglob("*.html") if error is None else ():
        text = page.read_text(encoding="utf-8")
        for old, new in REPLACED.items():
            text = text.replace(old, new)
        page.write_text(text, encoding="utf-8")
