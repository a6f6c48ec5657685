"""Packages that not every installation has: imported where they are needed, refused in one sentence."""
