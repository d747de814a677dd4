"""Errors of studies, by class where callers treat them differently; `web/problems.py` answers them over HTTP."""

from __future__ import annotations

from typing import ClassVar, Literal


class StimuliError(ValueError):
    """A stimulus set that cannot be used; the message names the file and the value.

    Parameters
    ----------
    detail : what was found and what was expected
    by_command : what a command does about it, where one does
    on_page : what somebody at the dashboard does about it instead
    """

    def __init__(self, detail: str, *, by_command: str = "", on_page: str = "") -> None:
        super().__init__("; ".join(filter(None, [detail, by_command])))
        self.on_page = "; ".join(filter(None, [detail, on_page]))


def said_on_page(error: Exception) -> str:
    """Return what a page says of an error: no page speaks of commands."""
    return error.on_page if isinstance(error, StimuliError) else str(error)


class StudyError(Exception):
    """A refused request; `detail` is one calm sentence that says what to do."""

    status: ClassVar[int] = 400

    def __init__(self, detail: str) -> None:
        super().__init__(detail)
        self.detail = detail

    @property
    def field(self) -> str:
        """Name of the field of a form that is wrong, as its cause tells; empty: none alone."""
        return str(getattr(self.__cause__, "field", ""))


class UnauthorisedError(StudyError):
    status = 401


class NoSessionError(UnauthorisedError):
    """A missing token, or one that opens no session."""

    def __init__(self) -> None:
        super().__init__("There is no session here. Please open your invitation again.")


class ForbiddenError(StudyError):
    status = 403


class ClosedError(ForbiddenError):
    """A study that takes in nobody now; `standing` says whether it pauses or is closed."""

    def __init__(self, detail: str, standing: Literal["paused", "closed", "full"]) -> None:
        super().__init__(detail)
        self.standing = standing


class NotFoundError(StudyError):
    status = 404


class ConflictError(StudyError):
    status = 409


class ChangedError(StudyError):
    """What the request is about has changed since the client read it."""

    status = 412


class GoneError(StudyError):
    status = 410


class TooLargeError(StudyError):
    status = 413


class InvalidError(StudyError):
    status = 422


class UnavailableError(StudyError):
    """A request to send again later: the queue is full, or the database does not answer."""

    status = 503
    retry_after_s: ClassVar[int] = 1


class TooManyError(StudyError):
    """A client that asks too often; it may ask again after `retry_after_s`."""

    status = 429

    def __init__(self, detail: str, retry_after_s: int) -> None:
        super().__init__(detail)
        self.retry_after_s = retry_after_s
