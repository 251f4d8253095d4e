"""Types and small tools that everything in `ema` rests on."""
