"""Limit how often a client may ask: guessing must be slow, fetching must leave room for others.

Counts live in the process's memory, so each of several workers counts for itself.
"""

from __future__ import annotations

import math
import time

from limits import RateLimitItem, RateLimitItemPerHour, RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from app.errors import TooManyError

SIGN_INS = RateLimitItemPerMinute(10)  # per address
SECOND_FACTORS = RateLimitItemPerHour(10)  # per account: whoever comes to them knows its password
SIGN_INS_AS = RateLimitItemPerMinute(5)  # per address and name
WRONG_CODES = RateLimitItemPerMinute(30)  # per address: unknown invitations and resume codes
SENT_PIECES = RateLimitItemPerHour(512)  # per session: 16 MiB of large bodies; a whole study sends less than 2
PIECE = 32 * 1024  # bytes; a vote is a tenth of it
REMARKS = RateLimitItemPerMinute(60)  # per address: what pages tell the log
LARGEST_JUMP_S = 2.0
WRONG_TOKENS = RateLimitItemPerMinute(30)  # per address: unknown analysts' tokens; each adds to the audit log


class Throttle:
    """Counts of recent requests by kind and client. When somebody sets the clock, they begin anew."""

    def __init__(self) -> None:
        self._storage = MemoryStorage()
        self._limiter = MovingWindowRateLimiter(self._storage)
        self._offset_s = _clocks_offset_s()

    def hit(self, limit: RateLimitItem, *key: str, cost: int = 1) -> bool:
        """Count one request; returns whether the limit allows it."""
        self._mind_the_clock()
        return self._limiter.hit(limit, *key, cost=cost)

    def count(self, limit: RateLimitItem, *key: str, cost: int = 1) -> None:
        """Count one request.

        Parameters
        ----------
        limit : how much may be asked in which time
        key : kind and client
        cost : of this request, in the limit's unit

        Raises
        ------
        TooManyError
            If that is more than the limit allows.
        """
        if not self.hit(limit, *key, cost=cost):
            self._refuse(limit, *key)

    def forget(self, limit: RateLimitItem, *key: str) -> None:
        """Forget what was counted, as it turned out to be harmless."""
        self._limiter.clear(limit, *key)

    def check(self, limit: RateLimitItem, *key: str) -> None:
        """Refuse a client that is over the limit, without counting.

        Raises
        ------
        TooManyError
        """
        self._mind_the_clock()
        if not self._limiter.test(limit, *key):
            self._refuse(limit, *key)

    def _mind_the_clock(self) -> None:
        """Forget all counts if the clock was set: the library's windows would be as long as it jumped."""
        offset_s = _clocks_offset_s()
        if abs(offset_s - self._offset_s) > LARGEST_JUMP_S:
            self._storage.reset()
        self._offset_s = offset_s

    def _refuse(self, limit: RateLimitItem, *key: str) -> None:
        resets_at = self._limiter.get_window_stats(limit, *key).reset_time
        wait_s = max(1, math.ceil(resets_at - time.time()))
        raise TooManyError(f"That was asked too often. Please wait {wait_s} s and try again.", wait_s)


def _clocks_offset_s() -> float:
    return time.time() - time.monotonic()
