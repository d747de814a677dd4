"""The synthetic studio, where recordings with known depth come from: `synthesise` writes a capture of one of SCENES."""

from recon.studio.scenes import SCENES
from recon.studio.synthesis import SynthParameters, synthesise

__all__ = ["SCENES", "SynthParameters", "synthesise"]
