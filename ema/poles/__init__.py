"""Poles: estimators, the stability diagram, and the choice among them."""
