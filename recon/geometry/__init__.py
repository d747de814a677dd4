"""Clouds and meshes, and the files that hold them."""

from recon.geometry.mesh import Cloud, Discs, Mesh, Model, Texture, merge_meshes
from recon.geometry.mesh_files import read_cloud, read_mesh, read_points, read_surface, write_cloud, write_mesh
from recon.geometry.splats import Splats

__all__ = [
    "Cloud",
    "Discs",
    "Mesh",
    "Model",
    "Splats",
    "Texture",
    "merge_meshes",
    "read_cloud",
    "read_mesh",
    "read_points",
    "read_surface",
    "write_cloud",
    "write_mesh",
]
