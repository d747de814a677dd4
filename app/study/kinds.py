"""Name the kinds of study that one starts from; `options.presets` holds what each sets."""

from __future__ import annotations

from typing import Literal, get_args

PresetName = Literal["paper", "quick", "online"]
PAPER: PresetName = "paper"
QUICK: PresetName = "quick"
ONLINE: PresetName = "online"
PRESETS: tuple[PresetName, ...] = get_args(PresetName)
