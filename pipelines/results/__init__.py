"""Everything one campaign gave, in memory and in its folder."""
