"""The residual function of every cluster, and the errors that it leaves [WDR11 §4.1]."""
