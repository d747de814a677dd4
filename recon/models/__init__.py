"""Models that other programs made: their files, read and checked, so that they are filmed beside ours.

A models folder holds `scene.json` (`scene_file`) and an approach's models as files of any common format (`folder`).
`read` turns a file into what is drawn, in the world; `inspection` finds what is wrong before anything is filmed.
"""

from recon.models.splats.read import read_splats

__all__ = ["read_splats"]
