"""The look of a run report: one style sheet, light and dark as the reader's system is."""

CSS = """
:root {
  color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --ink: #1b2230; --muted: #5d6778; --grid: #d9dee6; --table: #f3efe6;
  --goal: #12995a; --start: #8a93a3; --final: #1f5fd6; --step: #7fa6ec; --truth: #c2680c;
  --good: #0d7a45; --good-soft: #e2f5ea; --bad: #a8430f; --bad-soft: #fdeee4;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #11151c; --card: #1a202b; --ink: #e7ebf2; --muted: #9aa5b6; --grid: #333d4d; --table: #222a36;
    --goal: #35c27f; --start: #8b95a7; --final: #6aa0ff; --step: #6d93d2; --truth: #f0a04b;
    --good: #58d69a; --good-soft: #15362a; --bad: #f4a36f; --bad-soft: #3d2518;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 28px 20px 60px; }
header { display: flex; flex-wrap: wrap; gap: 8px 16px; align-items: baseline; margin-bottom: 4px; }
h1 { font-size: 26px; margin: 0; letter-spacing: -0.01em; }
h2 { font-size: 16px; margin: 0 0 10px; }
.badge { border-radius: 999px; padding: 3px 12px; font-weight: 600; font-size: 14px; }
.badge.good { color: var(--good); background: var(--good-soft); }
.badge.bad { color: var(--bad); background: var(--bad-soft); }
.words { color: var(--muted); margin: 0 0 18px; max-width: 80ch; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin-bottom: 16px; }
.card, section { background: var(--card); border: 1px solid var(--grid); border-radius: 10px; }
.card { padding: 12px 14px; }
.card b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; }
.card span { color: var(--muted); font-size: 13px; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(480px, 100%), 1fr)); gap: 16px; }
section { padding: 16px 18px; margin-bottom: 16px; min-width: 0; }
svg { width: 100%; height: auto; display: block;
  font-family: system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
figure { margin: 0; } figure img { width: 100%; border-radius: 6px; display: block; }
figcaption { color: var(--muted); font-size: 13px; margin-top: 6px; }
.columns > * { min-width: 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: 5px 10px; border-bottom: 1px solid var(--grid); white-space: nowrap; }
th:first-child, td:first-child, td.text { text-align: left; }
th { color: var(--muted); font-weight: 600; font-size: 13px; }
tr.met td:not(.no) { color: var(--good); font-weight: 600; }
td.no { color: var(--bad); }
pre { margin: 0; padding: 12px; overflow-x: auto; font-size: 12.5px; background: var(--page); border-radius: 6px; }
details { margin-top: 12px; }
details summary { cursor: pointer; font-weight: 600; }
details[open] summary { margin-bottom: 10px; }
.empty { color: var(--muted); }
@media print { body { background: none; } section, .card { break-inside: avoid; } }
"""
