"""Looks of the page, light and dark."""

from __future__ import annotations

STYLE = """
:root {
  color-scheme: light dark;
  --page: #f6f6f4; --card: #ffffff; --text: #1d2126; --quiet: #626a73; --line: #dcdedc;
  --accent: #2f6f8f;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #14171a; --card: #1d2226; --text: #e7e9ea; --quiet: #98a1a9; --line: #333a40;
    --accent: #63abc9;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 40px 24px 64px; max-width: 1128px; background: var(--page);
  color: var(--text); font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
  font-variant-numeric: tabular-nums;
}
h1 { margin: 0; font-size: 34px; line-height: 1.2; overflow-wrap: anywhere; }
h2 { margin: 48px 0 4px; font-size: 21px; }
h3 { margin: 0 0 8px; font-size: 15px; }
h3 span { font-weight: 400; }
p { margin: 6px 0 12px; max-width: 92ch; }
.quiet, figcaption, dt { color: var(--quiet); }
.cards { display: grid; gap: 12px; margin-top: 24px;
  grid-template-columns: repeat(auto-fit, minmax(168px, 1fr)); }
.card, .panel { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
  padding: 14px 16px; }
.card .name { font-size: 13px; color: var(--quiet); }
.card .value { font-size: 26px; font-weight: 600; line-height: 1.3; white-space: nowrap; }
.card .note { font-size: 13px; color: var(--quiet); }
.card.main { border-color: var(--accent); box-shadow: inset 0 3px 0 var(--accent); }
.panel { margin-top: 14px; min-width: 0; }
.slices { display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(190px, 1fr)); }
.panels { display: grid; gap: 14px; align-items: stretch;
  grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr)); }
figure { margin: 0; }
figcaption { margin-top: 6px; font-size: 13px; }
img { display: block; width: 100%; border-radius: 4px; }
img.pixelated { image-rendering: pixelated; }
.map { max-width: 340px; margin: 0 auto; }
svg { display: block; width: 100%; max-width: 560px; margin: 8px auto 0;
  font: 13px system-ui, sans-serif; }
svg text { fill: var(--text); }
svg text.quiet { fill: var(--quiet); }
svg text.small { font-size: 11px; }
svg .bar:not([fill]) { fill: var(--accent); }
svg .axis { stroke: var(--line); }
.scroll { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; white-space: nowrap; }
th, td { padding: 7px 12px; text-align: right; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; }
th { font-size: 13px; font-weight: 500; color: var(--quiet); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 4px 24px; margin: 0; }
dd { margin: 0; overflow-wrap: anywhere; }
@media print { body { padding: 0; } .panel, .card { break-inside: avoid; } }
"""
