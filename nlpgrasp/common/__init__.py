"""Shared utilities: validation, files, frames, numerical methods, display."""
