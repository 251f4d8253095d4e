"""Many campaigns: each by itself, none twice, and tables over all of them."""
