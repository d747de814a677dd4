"""Imported films are never called three-dimensional models, in any language, protocol or preset."""

from __future__ import annotations

import json
import re

import pytest

from app.study.languages.language_pack import model_texts
from app.study.options.neutral_words import neutral_words
from app.study.options.options import parse_options
from app.study.options.presets import PRESETS, read_preset

SPEAKS_OF_MODELS = re.compile("three-dim|3D|dreidim|tridim|trois dim|三维|model|modelo|modèle|模型", re.IGNORECASE)


@pytest.mark.parametrize("protocol", ["PC", "ACR", "DCR", "CCR"])
@pytest.mark.parametrize("preset", PRESETS)
def test_neutral_words_speak_of_films_alone(preset: str, protocol: str) -> None:
    given = {"protocol": protocol, **({"reference": "original"} if protocol == "DCR" else {})}
    options = neutral_words(parse_options(read_preset(preset).overridden_by(given)))
    parse_options(options.as_json())  # every key is known, and every text has its placeholders
    assert not SPEAKS_OF_MODELS.search(json.dumps(options.as_json(), ensure_ascii=False))
    assert set(options.texts) >= ({"en", "de", "es", "fr", "zh"} if preset == "quick" else {"en", "de"})


def test_every_standard_text_that_speaks_of_models_has_a_neutral_one() -> None:
    told = {key for key, text in model_texts().items() if re.search("three-dim|3D|models? ", str(text))}
    general = {key for key in told if not key.startswith(("questions.", "protocols.", "entrance."))}
    assert general <= set(neutral_words(parse_options({})).texts["en"])


def test_own_words_stay() -> None:
    texts = {"en": {"welcome.body": "Mine."}}
    options = neutral_words(parse_options({"consent": "My three-dimensional models.", "texts": texts}))
    assert options.texts["en"]["welcome.body"] == "Mine."
    assert options.consent == "My three-dimensional models."
