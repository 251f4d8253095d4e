"""Parameter sets of tyres in numbered versions."""
