"""The settings of each command, said once: its flags, the form of its job and its JSON Schema are made from them.

This room imports nothing but pydantic and the ground: it is the one of `recon` that more of `app` than the command line
may read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from recon.cli.commands import experiments, measures, reconstruction, recordings
from recon.cli.commands.setting import Command

# by what is typed: `CaptureSynth` has the settings of `capture synth`
COMMANDS: Mapping[str, type[Command]] = {
    re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower(): command
    for module in (reconstruction, recordings, measures, experiments)
    for name, command in vars(module).items()
    if isinstance(command, type) and issubclass(command, Command) and command is not Command
}
