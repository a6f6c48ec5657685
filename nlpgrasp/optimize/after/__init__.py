"""Post-processing of a solve's starts: choice of the answer, robustness, prices, forces, diagnosis."""
