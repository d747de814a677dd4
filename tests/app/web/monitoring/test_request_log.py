"""A line of the log is one line, whatever a client sends, and a client that leaves is no error."""

from __future__ import annotations

import logging

from app.web.monitoring.request_log import PLAIN_FORMAT, PlainFormatter


def test_no_text_begins_a_line_of_its_own() -> None:
    record = logging.LogRecord("app", logging.WARNING, __file__, 1, "%s refused", ("a\nERROR b\x1b[2J\u2028",), None)
    record.request_id = "-"
    line = PlainFormatter(PLAIN_FORMAT).format(record)
    assert line.endswith(r"a\x0aERROR b\x1b[2J\x2028 refused")
    assert len(line.splitlines()) == 1
