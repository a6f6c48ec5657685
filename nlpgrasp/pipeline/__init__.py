"""``ng.solve``: compile, propose, refine, certify, bound, analyse."""
