"""How an experiment runs: over cores or a cluster, into a folder, resumable."""
