"""Files in and out: one file for each format, behind `ema.io.campaign.read.read_campaign`."""
