"""Say which films a study's participants practise with, as the study's options name them."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import StringConstraints, model_validator

from app.study.option_fields import Options, Setting, SettingError

MOST_PRACTICE = 10  # pairs; more are a study of their own

Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]  # as in a stimulus set


class PracticeFilms(Options):
    """Two films of the same dataset that are shown for practice."""

    called: ClassVar[str] = "practice_pairs"

    dataset: Annotated[Name, Setting("Dataset", "of both", expected="a dataset's name")]
    a: Annotated[Name, Setting("A", "its condition", expected="a condition's name")]
    b: Annotated[Name, Setting("B", "its condition", expected="a condition's name")]

    @model_validator(mode="after")
    def _are_two(self) -> Self:
        if self.a == self.b:
            raise SettingError(
                "practice_pairs", f"names {self.a!r} twice, expected two different conditions of {self.dataset}"
            )
        return self
