"""Studies that can be run again by anyone with a checkout; they are no part of the package."""
