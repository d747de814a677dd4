"""Define the options of privacy: who answers for participants' data, and how long they are kept."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from app.study.option_fields import ANY_TIME, Note, Options, Setting


class PrivacyOptions(Options):
    """Who answers for participants' data, and when their personal data are deleted."""

    responsible: Annotated[
        Note, Setting("Responsible", "for participants’ data: a person or an institution", ANY_TIME, is_basic=True)
    ] = ""
    contact: Annotated[Note, Setting("Contact", "such as an address of mail", ANY_TIME, is_basic=True)] = ""
    keep_days: Annotated[
        int,
        Setting(
            "Days for which personal data are kept",
            "after the study is closed; then answers, screening, outside ids and names on invitations are deleted, and "
            "votes stay; 0: no limit",
            ANY_TIME,
        ),
    ] = Field(default=0, ge=0, le=36_500)  # a hundred years
