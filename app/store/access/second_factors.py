"""Keep second factors of experimenters: the secret of their authenticator app, and codes to recover when it is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, delete, insert, or_, select, update

from app.errors import ConflictError
from app.store.database.keys import digest, new_code
from app.store.database.tables import experimenter, recovery_code

N_RECOVERY_CODES = 10
LENGTH = 24  # letters of a recovery code, 118 bits: nobody finds it by its digest


@dataclass(frozen=True)
class SecondFactor:
    """The secret that an experimenter's app shares, and since when its codes are asked for; None: not yet."""

    secret: str
    since: datetime | None


def second_factor_of(connection: Connection, experimenter_id: int) -> SecondFactor | None:
    """Return the second factor of an experimenter; None: there is none, and none is being set up."""
    query = select(experimenter.c.totp_secret, experimenter.c.totp_since).where(experimenter.c.id == experimenter_id)
    secret, since = connection.execute(query).one()
    return SecondFactor(secret, since) if secret is not None else None


def prepare_second_factor(connection: Connection, experimenter_id: int, secret: str) -> None:
    """Store the secret of a second factor that is not asked for before it is confirmed; it replaces an unconfirmed one.

    Raises
    ------
    ConflictError
        If a confirmed one is there.
    """
    this = (experimenter.c.id == experimenter_id, experimenter.c.totp_since.is_(None))
    if not connection.execute(update(experimenter).where(*this).values(totp_secret=secret, totp_step=None)).rowcount:
        raise ConflictError("Your second factor is on already. Turn it off before you set up another one.")


def confirm_second_factor(connection: Connection, experimenter_id: int, now: datetime) -> Sequence[str]:
    """Ask for the second factor from now on; returns the recovery codes, of which only digests are stored."""
    connection.execute(update(experimenter).where(experimenter.c.id == experimenter_id).values(totp_since=now))
    codes = [new_code(LENGTH) for _ in range(N_RECOVERY_CODES)]
    connection.execute(delete(recovery_code).where(recovery_code.c.experimenter_id == experimenter_id))
    rows = [{"experimenter_id": experimenter_id, "code_hash": digest(code)} for code in codes]
    connection.execute(insert(recovery_code), rows)
    return codes


def end_second_factor(connection: Connection, experimenter_id: int) -> None:
    """Forget a second factor and its recovery codes."""
    nothing = dict.fromkeys(("totp_secret", "totp_since", "totp_step"))
    connection.execute(update(experimenter).where(experimenter.c.id == experimenter_id).values(**nothing))
    connection.execute(delete(recovery_code).where(recovery_code.c.experimenter_id == experimenter_id))


def spend_step(connection: Connection, experimenter_id: int, step: int) -> bool:
    """Note the time step of a code; returns whether it is later than that of every code before, as it must be."""
    is_new = or_(experimenter.c.totp_step.is_(None), experimenter.c.totp_step < step)
    this = (experimenter.c.id == experimenter_id, is_new)
    return connection.execute(update(experimenter).where(*this).values(totp_step=step)).rowcount > 0


def spend_recovery_code(connection: Connection, experimenter_id: int, code: str) -> bool:
    """Use a recovery code, which ends with it; returns whether it was one."""
    this = (recovery_code.c.experimenter_id == experimenter_id, recovery_code.c.code_hash == digest(code))
    return connection.execute(delete(recovery_code).where(*this)).rowcount > 0


def n_recovery_codes(connection: Connection, experimenter_id: int) -> int:
    """Count the recovery codes that are left."""
    rows = select(recovery_code.c.id).where(recovery_code.c.experimenter_id == experimenter_id)
    return len(connection.execute(rows).all())
