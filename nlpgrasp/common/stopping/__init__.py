"""When to stop: deadlines and Ctrl-C."""
