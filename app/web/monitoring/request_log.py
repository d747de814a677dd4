"""Give every request an id, count it, and log it. Pure ASGI.

The id is the proxy's where it sends one. It stands in the answer and in every line logged during the request. Lines
name routes, never addresses, clients or tokens.
"""

from __future__ import annotations

import json
import logging
import random
import re
import time
from contextvars import ContextVar
from datetime import UTC, datetime

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.web.gates import route_of
from app.web.monitoring.metrics import Metrics

ID_HEADER = b"x-request-id"
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # what ends a line or moves a terminal's cursor
VALID_ID = re.compile(r"[A-Za-z0-9_-]{8,64}")
QUIET = ("/healthz", "/readyz", "/metrics")  # machines ask every few seconds: logged at debug level
PLAIN_FORMAT = "%(asctime)s %(levelname)s %(name)s [%(request_id)s] %(message)s"

request_id: ContextVar[str] = ContextVar("request_id", default="-")
log = logging.getLogger(__name__)


class Requests:
    """Name, count and log every request."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app, self.metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = dict(scope["headers"]).get(ID_HEADER, b"").decode("latin-1")
        name = given if VALID_ID.fullmatch(given) else f"{random.getrandbits(64):016x}"
        token = request_id.set(name)
        started = time.perf_counter()

        async def watch(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (ID_HEADER, name.encode())]
                self._note(scope, message["status"], time.perf_counter() - started)
            await send(message)

        try:
            await self.app(scope, receive, watch)
        finally:
            request_id.reset(token)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = route_of(scope)
        self.metrics.answered(scope["method"], route, status, seconds)
        level = logging.DEBUG if route in QUIET else logging.INFO
        if not log.isEnabledFor(level):
            return
        facts = {"method": scope["method"], "route": route, "status": status, "ms": round(1000 * seconds, 2)}
        log.log(level, "%s %s: %d in %.1f ms", *facts.values(), extra={"facts": facts})


class PlainFormatter(logging.Formatter):
    """Write a log record as one line, and a traceback below it: no text from outside can begin a line of its own."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 (the library's name)
        return CONTROLS.sub(lambda control: f"\\x{ord(control[0]):02x}", super().formatMessage(record))


class JsonFormatter(logging.Formatter):
    """Write a log record as a line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "request_id": getattr(record, "request_id", "-"),
            "message": record.getMessage(),
            **getattr(record, "facts", {}),
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)


def start_logging(log_format: str) -> None:
    """Log to standard error with request ids, as plain lines or as JSON."""
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter() if log_format == "json" else PlainFormatter(PLAIN_FORMAT))
    handler.addFilter(_with_request_id)
    logging.basicConfig(level=logging.INFO if log_format == "json" else logging.WARNING, handlers=[handler], force=True)
    logging.getLogger("alembic").setLevel(logging.WARNING)  # announces itself at every start


def _with_request_id(record: logging.LogRecord) -> bool:
    record.request_id = request_id.get()
    return True
