"""Limit how often a client may ask: guessing must be slow, fetching must leave room for others.

Counts live in the process's memory, so each of several workers counts for itself.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from limits import RateLimitItem, RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from app.errors import TooManyError

SIGN_INS = RateLimitItemPerMinute(10)  # per address
SIGN_INS_AS = RateLimitItemPerMinute(5)  # per name
WRONG_CODES = RateLimitItemPerMinute(30)  # per address: unknown invitations and resume codes
WRONG_TOKENS = RateLimitItemPerMinute(30)  # per address: unknown analysts' tokens; each adds to the audit log


@dataclass(frozen=True)
class Throttle:
    """Counts of recent requests by kind and client."""

    limiter: MovingWindowRateLimiter

    def count(self, limit: RateLimitItem, *key: str) -> None:
        """Count one request.

        Raises
        ------
        TooManyError
            If that is more than the limit allows.
        """
        if not self.limiter.hit(limit, *key):
            self._refuse(limit, *key)

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
