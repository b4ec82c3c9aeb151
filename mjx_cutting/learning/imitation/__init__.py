"""Imitation of the expert: who acts (schedule), what is kept (buffer), how the learner is fitted
(aggregation).
"""
