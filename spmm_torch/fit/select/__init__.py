"""The sparse fit of every texel with the dictionary [WDR11 §4.1]."""
