"""Check codes of an authenticator app (TOTP, RFC 6238): a new one every 30 s, each taken once."""

from __future__ import annotations

from datetime import datetime
from secrets import compare_digest

import pyotp
import segno

from app.store.access.second_factors import second_factor_of, spend_recovery_code, spend_step
from app.store.database.engine import Transaction

ISSUER = "reconstudy"
CLOCK_STEPS = (-1, 0, 1)  # of 30 s by which the clocks of server and telephone may differ, RFC 6238 section 5.2


def new_totp_secret() -> str:
    """Return a secret of 160 random bits, as authenticator apps take it."""
    return pyotp.random_base32()


def totp_address(secret: str, name: str) -> str:
    """Return the address that a QR code hands to an authenticator app."""
    return pyotp.TOTP(secret).provisioning_uri(name=name, issuer_name=ISSUER)


def totp_picture(secret: str, name: str) -> str:
    """Return the QR code of `totp_address` as SVG for a page."""
    return segno.make(totp_address(secret, name), error="m").svg_inline(scale=4, border=2)


def is_code(connection: Transaction, experimenter_id: int, secret: str, code: str, now: datetime) -> bool:
    """Is this the app's code of now that was not taken before? It is taken by this."""
    given = "".join(code.split())
    totp = pyotp.TOTP(secret)
    for offset in CLOCK_STEPS:
        step = totp.timecode(now) + offset
        if compare_digest(totp.generate_otp(step).encode(), given.encode()):
            return spend_step(connection, experimenter_id, step)
    return False


def is_let_in(connection: Transaction, experimenter_id: int, code: str, now: datetime) -> bool:
    """May somebody with the right password sign in by this code? Without a second factor none is needed."""
    factor = second_factor_of(connection, experimenter_id)
    if factor is None or factor.since is None:
        return True
    return is_code(connection, experimenter_id, factor.secret, code, now) or spend_recovery_code(
        connection, experimenter_id, "".join(code.split()).lower()
    )
