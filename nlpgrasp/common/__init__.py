"""What every room uses: checks, files, frames, directions, rows, drawings."""
