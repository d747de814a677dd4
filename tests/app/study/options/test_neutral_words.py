"""Imported films are never called three-dimensional models, in any language, protocol or preset."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from app.study.kinds import PRESETS
from app.study.languages.language_pack import model_texts, read_language_pack
from app.study.options.neutral_words import neutral_words
from app.study.options.options import parse_options
from app.study.options.presets import read_preset
from app.study.options.wording import protocol_texts

ROOT = Path(__file__).parents[4]
SPEAKS_OF_MODELS = re.compile(
    "three-dim|3D|dreidim|tridim|trois dim|三维|model|modelo|modèle|模型|نموذج|نماذج|الأبعاد", re.IGNORECASE
)


@pytest.mark.parametrize("protocol", ["PC", "ACR", "DCR", "CCR"])
@pytest.mark.parametrize("preset", PRESETS)
def test_neutral_words_speak_of_films_alone(preset: str, protocol: str) -> None:
    given = {"protocol": protocol, **({"reference": "original"} if protocol == "DCR" else {})}
    options = neutral_words(parse_options(read_preset(preset).overridden_by(given)))
    parse_options(options.as_json())  # every key is known, and every text has its placeholders
    assert not SPEAKS_OF_MODELS.search(json.dumps(options.as_json(), ensure_ascii=False))
    assert set(options.texts) == {"en", "de"}, "no draft is offered unasked"


@pytest.mark.parametrize("protocol", ["PC", "ACR", "DCR", "CCR"])
def test_every_language_has_neutral_words_for_all_that_its_pack_says_of_models(protocol: str) -> None:
    packs = {path.stem: read_language_pack(path) for path in (ROOT / "languages").glob("*.json")}
    given = {"protocol": protocol, "languages": list(packs), **({"reference": "original"} if protocol == "DCR" else {})}
    options = neutral_words(parse_options(given))
    for tag, pack in packs.items():
        said = {**protocol_texts(pack, protocol), **options.texts[tag]}
        told = {key for key, text in said.items() if SPEAKS_OF_MODELS.search(json.dumps(text, ensure_ascii=False))}
        assert {key for key in told if not key.startswith(("questions.", "entrance."))} == set(), tag


def test_every_standard_text_that_speaks_of_models_has_a_neutral_one() -> None:
    told = {key for key, text in model_texts().items() if re.search("three-dim|3D|models? ", str(text))}
    general = {key for key in told if not key.startswith(("questions.", "protocols.", "entrance."))}
    assert general <= set(neutral_words(parse_options({})).texts["en"])


def test_own_words_stay() -> None:
    texts = {"en": {"welcome.body": "Mine."}}
    options = neutral_words(parse_options({"consent": "My three-dimensional models.", "texts": texts}))
    assert options.texts["en"]["welcome.body"] == "Mine."
    assert options.consent == "My three-dimensional models."
