"""How often somebody may ask: what is guessed at must be slow, what is fetched must leave room for others.

Counted in this process's memory: with several workers each counts for itself.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from limits import RateLimitItem, RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from app.errors import TooManyError

SIGN_INS = RateLimitItemPerMinute(10)  # of one address
SIGN_INS_AS = RateLimitItemPerMinute(5)  # under one name
WRONG_CODES = RateLimitItemPerMinute(30)  # of one address: invitations and resume codes that nobody gave out

WRONG_TOKENS = RateLimitItemPerMinute(30)  # of one address: of analysts; each leaves an entry in the audit log


@dataclass(frozen=True)
class Throttle:
    """Counts of who asked for what, lately."""

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
        """Refuse who is over the limit already, without counting.

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
