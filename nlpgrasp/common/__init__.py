"""Shared utilities: validation, files, frames, directions, scalar constraints, meshes, display."""
