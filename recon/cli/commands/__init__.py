"""The settings of each command, said once: its flags, the form of its job and its JSON Schema are made from them.

This room imports nothing but pydantic and the ground: it is the one of `recon` that more of `app` than the command line
may read.
"""

from __future__ import annotations

from collections.abc import Mapping

from recon.cli.commands import experiments, measures, reconstruction, recordings
from recon.cli.commands.setting import Command, commands_of

COMMANDS: Mapping[str, type[Command]] = commands_of(reconstruction, recordings, measures, experiments)
