"""Stages of ``ng.solve``: compile, root bound, propose, refine, close gap, choose, bound, certify, analyse."""
