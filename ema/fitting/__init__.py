"""The curve fit: poles and residues with error bars, pair by pair."""
