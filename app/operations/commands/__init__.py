"""The settings of commands, said once for the command line, for the forms of jobs and in JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping

from app.operations.commands import analysis, server, studies
from recon.cli.commands import COMMANDS as COMMANDS_OF_RECON
from recon.cli.commands.setting import Command, commands_of

COMMANDS: Mapping[str, type[Command]] = {**COMMANDS_OF_RECON, **commands_of(analysis, studies, server)}
