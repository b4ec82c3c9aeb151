"""Experiments: each file is one, run as `python -m experiments.NAME --preset smoke|cpu|full --field
value`.
"""
