"""Execution of experiments on local cores or a cluster, with resume from an output folder."""
