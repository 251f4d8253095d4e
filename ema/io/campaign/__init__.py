"""A campaign: the manifest, the roles of its channels, and whether its files agree."""
