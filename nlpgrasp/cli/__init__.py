"""Command line interface, one command per file."""
