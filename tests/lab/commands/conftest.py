"""The fixtures of the other commands serve those of the laboratory too."""

from cli.conftest import as_json, files, here, refused

__all__ = ["as_json", "files", "here", "refused"]
