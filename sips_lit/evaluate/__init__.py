"""Evaluation: features of a pair, verified matches for every budget, summaries of many pairs."""
