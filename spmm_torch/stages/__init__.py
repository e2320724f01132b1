"""The stages of the fit [WDR11 §3.2, §4.1], in the order in which `fit` runs them."""
