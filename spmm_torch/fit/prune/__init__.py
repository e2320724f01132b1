"""Which BRDF models, and how many lobes, are worth their bytes."""
