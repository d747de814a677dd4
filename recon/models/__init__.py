"""Models that other programs made: their files, read and checked, so that they are filmed beside ours.

A models folder holds `scene.json` (`scene_file`) and an approach's models as files of any common format (`folder`).
`read` turns a file into a mesh or splats in the world; `inspection` finds what is wrong before anything is filmed.
"""
