"""Name the roles of experimenters and the scopes of tokens: what each allows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

Role = Literal["viewer", "experimenter", "owner"]
ROLES: tuple[Role, ...] = get_args(Role)  # each may do what those before it may

Scope = Literal["read", "personal", "audit", "studies:write", "participants:write", "participants:erase", "jobs"]
READ: Scope = "read"
PERSONAL: Scope = "personal"
AUDIT: Scope = "audit"
STUDIES: Scope = "studies:write"
PEOPLE: Scope = "participants:write"
ERASING: Scope = "participants:erase"
JOBS: Scope = "jobs"
SCOPES: Mapping[Scope, str] = {
    READ: "studies, votes, trials, scores and all that is computed from them",
    PERSONAL: "participants, screening results, questionnaires, the archive",
    AUDIT: "the audit log",
    STUDIES: "create, edit, open, close, archive, duplicate and delete studies and stimulus sets, and give out codes",
    PEOPLE: "exclude participants from the analysis, include them again, enter results of tests beside the screen",
    ERASING: "withdraw participants, and erase their data for good",
    JOBS: "jobs on recordings and films: see, start, cancel and retry them",
}
READING = (READ, PERSONAL, AUDIT)  # scopes that change nothing
SCOPES_OF_ROLE: Mapping[Role, tuple[Scope, ...]] = {
    "viewer": (READ,),
    "experimenter": (READ, PERSONAL, AUDIT, JOBS, STUDIES, PEOPLE, ERASING),
    "owner": (READ, PERSONAL, AUDIT, JOBS, STUDIES, PEOPLE, ERASING),
}
LONGEST_TOKEN_DAYS = 3650
