"""The whole way from a capture to a stimulus set, in two calls: `reconstruct` and `render`."""

from recon.pipeline.film import RenderOptions
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.methods import Methods, read_methods
from recon.pipeline.reconstruct import match_files, reconstruct
from recon.pipeline.render import render
from recon.pipeline.run import Run, read_run

__all__ = [
    "Methods",
    "ReconstructOptions",
    "RenderOptions",
    "Run",
    "match_files",
    "read_methods",
    "read_run",
    "reconstruct",
    "render",
]
