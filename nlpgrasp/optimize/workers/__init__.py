"""Worker processes: parallel starts, cancellation and interrupts."""
