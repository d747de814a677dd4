"""Enrol participants, many at once: python enrol.py URL INVITATION N_PARTICIPANTS N_THREADS; prints how many got in."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

from app.errors import GoneError
from app.store.database.engine import open_database
from app.store.participants.invitations import invitation_by_code
from tests.seeded_studies import NOW, begin_session


def main(url: str, code: str, n_participants: int, n_threads: int) -> None:
    database = open_database(url)
    with database.reading() as connection:
        invitation = invitation_by_code(connection, code)
    assert invitation is not None

    def enrol(_number: int) -> bool:
        try:
            begin_session(database, invitation, NOW)
        except GoneError:
            return False
        return True

    print("ready", flush=True)
    sys.stdin.readline()
    with ThreadPoolExecutor(n_threads) as pool:
        print(sum(pool.map(enrol, range(n_participants))))
    database.dispose()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
