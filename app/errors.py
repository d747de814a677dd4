"""What can go wrong in a study, told apart where a caller must; `web/problems.py` says it over HTTP."""

from __future__ import annotations

from typing import ClassVar, Literal


class StimuliError(ValueError):
    """A stimulus set cannot be used as it is: names the file and the value."""


class StudyError(Exception):
    """A request that a study refuses, in one calm sentence that says what to do."""

    status: ClassVar[int] = 400

    def __init__(self, detail: str) -> None:
        super().__init__(detail)
        self.detail = detail


class UnauthorisedError(StudyError):
    status = 401


class NoSessionError(UnauthorisedError):
    """A token that opens no session, or none at all."""

    def __init__(self) -> None:
        super().__init__("There is no session here. Please open your invitation again.")


class ForbiddenError(StudyError):
    status = 403


class ClosedError(ForbiddenError):
    """A study that takes nobody in, now or any more; `standing` says which of the two."""

    def __init__(self, detail: str, standing: Literal["paused", "closed"]) -> None:
        super().__init__(detail)
        self.standing = standing


class NotFoundError(StudyError):
    status = 404


class ConflictError(StudyError):
    status = 409


class GoneError(StudyError):
    status = 410


class TooLargeError(StudyError):
    status = 413


class InvalidError(StudyError):
    status = 422


class UnavailableError(StudyError):
    """What cannot be done now and may be tried again: the queue is full, or the database does not answer."""

    status = 503
    retry_after_s: ClassVar[int] = 1


class TooManyError(StudyError):
    """Somebody asks too often; `retry_after_s` says when they may again."""

    status = 429

    def __init__(self, detail: str, retry_after_s: int) -> None:
        super().__init__(detail)
        self.retry_after_s = retry_after_s
