"""Signal processing: FRF estimation and checks of the raw signals."""
