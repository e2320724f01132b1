"""The search for lobes on the samples [WDR11 §3.2, Eq. 5]."""
