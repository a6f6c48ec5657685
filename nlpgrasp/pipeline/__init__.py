"""``ng.solve``: compile, propose, refine and certify starts, choose, bound, certify the answer, analyse."""
