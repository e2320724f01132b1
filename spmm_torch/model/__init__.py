"""The sparse parametric mixture model: an `nn.Module`, its file, its lookups, its sampling."""
