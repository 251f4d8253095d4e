"""The engineer's bench in the browser: results reviewed, edited and signed off."""
