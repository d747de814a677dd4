"""Answer only under names that are this server's, and build links with its public address.

A page of another site can let its own host name point to this server (DNS rebinding), and a client can name any host:
the links that experimenters copy would then lead there. Pure ASGI.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable
from urllib.parse import urlsplit

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

LOOPBACK = ("localhost", "127.0.0.1", "::1")
ANY = "*"


class KnownHosts:
    """Refuse requests for other hosts; show routes the public address, whatever name was asked for.

    Parameters
    ----------
    allowed : host names separated by commas, `*.example.org` for all below one, `*` for any. None: any IP address,
        which nobody can let point elsewhere, and this machine's own name
    public_url : address that people use, for example "https://study.example.org"; its host is allowed, too
    """

    def __init__(self, app: ASGIApp, allowed: str | None = None, public_url: str | None = None) -> None:
        self.app = app
        self.is_known = known_hosts(allowed, public_url)
        self.public = urlsplit(public_url) if public_url else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        asked = dict(scope["headers"]).get(b"host", b"").decode("latin-1")
        if not self.is_known(asked):
            sentence = (
                f"This server does not answer as {asked[:100]!r}. If that is its name, set "
                "RECONSTUDY_PUBLIC_URL or RECONSTUDY_ALLOWED_HOSTS."
            )
            await PlainTextResponse(sentence, 421)(scope, receive, send)
            return
        if self.public is not None:
            others = [header for header in scope["headers"] if header[0] != b"host"]
            host = (b"host", self.public.netloc.encode())
            # Changed in place, as what stands around this one, the log and the metrics, reads the route from it.
            scope.update(scheme=self.public.scheme, headers=[host, *others])
        await self.app(scope, receive, send)


def known_hosts(allowed: str | None, public_url: str | None) -> Callable[[str], bool]:
    """Return a test whether a Host header names this server; parameters as of `KnownHosts`."""
    names = {*LOOPBACK, urlsplit(public_url or "").hostname or LOOPBACK[0]}
    if allowed is None:
        machine = socket.gethostname().lower()
        names |= {machine, f"{machine}.local"}
    else:
        names |= {name.strip().lower() for name in allowed.split(",") if name.strip()}
    below = tuple(name.removeprefix(ANY) for name in names if name.startswith("*."))

    def is_known(header: str) -> bool:
        try:
            name = urlsplit(f"//{header}").hostname or ""
        except ValueError:
            return False
        if ANY in names or name in names or (below and name.endswith(below)):
            return True
        return allowed is None and _is_address(name)

    return is_known


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
