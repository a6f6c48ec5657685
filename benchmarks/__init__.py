"""Speed and quality, measured: ``make bench``. Ratios are of times in the same run on the same machine."""
