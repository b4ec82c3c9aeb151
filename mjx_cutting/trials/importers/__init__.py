"""Readers for data that was not recorded in the dataset format."""
