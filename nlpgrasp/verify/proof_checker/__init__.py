"""Checkers of proofs: interval arithmetic in C, rational arithmetic in Python. They share no code with certificates."""

from nlpgrasp.verify.proof_checker.check import CheckedProof, check_proof

__all__ = ["CheckedProof", "check_proof"]
