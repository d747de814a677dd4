"""Limit how often a client may ask: guessing must be slow, fetching must leave room for others.

Counts live in the process's memory, so each of several workers counts for itself.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

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
WRONG_TOKENS = RateLimitItemPerMinute(30)  # per address: unknown analysts' tokens; each adds to the audit log


@dataclass(frozen=True)
class Throttle:
    """Counts of recent requests by kind and client."""

    limiter: MovingWindowRateLimiter

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
        if not self.limiter.hit(limit, *key, cost=cost):
            self._refuse(limit, *key)

    def forget(self, limit: RateLimitItem, *key: str) -> None:
        """Forget what was counted, as it turned out to be harmless."""
        self.limiter.clear(limit, *key)

    def check(self, limit: RateLimitItem, *key: str) -> None:
        """Refuse a client that is over the limit, without counting.

        Raises
        ------
        TooManyError
        """
        if not self.limiter.test(limit, *key):
            self._refuse(limit, *key)

    def _refuse(self, limit: RateLimitItem, *key: str) -> None:
        resets_at = self.limiter.get_window_stats(limit, *key).reset_time
        wait_s = max(1, math.ceil(resets_at - time.time()))
        raise TooManyError(f"That was asked too often. Please wait {wait_s} s and try again.", wait_s)


def new_throttle() -> Throttle:
    return Throttle(MovingWindowRateLimiter(MemoryStorage()))
