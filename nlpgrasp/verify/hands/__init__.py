"""Numeric hands from JSON data and their own file: constraints and link poses."""
