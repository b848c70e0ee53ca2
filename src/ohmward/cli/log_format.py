"""Log of a process on standard error: lines for people, or a JSON object a line for what collects logs."""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime

TEXT, JSON = "text", "json"
FORMATS = (TEXT, JSON)


class JsonFormatter(logging.Formatter):
    """Records as JSON objects: time (ISO 8601, UTC), level, logger, message and, of an unexpected error, traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """One line."""
        found = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            found["traceback"] = self.formatException(record.exc_info)
        return json.dumps(found, ensure_ascii=False)


def begin_log(log_format: str) -> None:
    """Send the log, and warnings with it, to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter() if log_format == JSON else logging.Formatter("ohmward: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    if log_format == JSON:
        logging.captureWarnings(True)
