"""Shared utilities: validation, files, frames, numerics, display."""
