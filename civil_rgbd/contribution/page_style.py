"""How the report looks, on a screen and on paper."""

from __future__ import annotations

from typing import Final

STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; color: #222; background: #fff; margin: 0 auto;
  max-width: 1100px; padding: 1.5rem; overflow-wrap: anywhere; }
h1 { font-size: 1.8rem; margin: 0 0 .8rem; }
h1 small { font-size: 1.1rem; font-weight: normal; color: #555; margin-left: .8rem; }
h2 { font-size: 1.2rem; margin: 2rem 0 .7rem; padding-top: .6rem; border-top: 1px solid #ccc; }
dl { display: grid; grid-template-columns: repeat(4, 1fr); gap: .6rem; margin: 0; }
dl div { border: 1px solid #ccc; border-radius: 4px; padding: .4rem .7rem; }
dt { color: #555; font-size: .85em; }
dd { margin: 0; font-weight: 600; }
table { border-collapse: collapse; width: 100%; }
th { text-align: left; font-weight: normal; color: #555; width: 14rem; padding-right: 1rem; }
th, td { vertical-align: top; padding-top: .2rem; padding-bottom: .2rem;
  border-bottom: 1px solid #eee; }
td { white-space: pre-line; }
figure { margin: .5rem 0 1.3rem; break-inside: avoid; }
.charts { display: grid; grid-template-columns: 1fr 1fr; gap: 0 1.5rem; align-items: start; }
.tall { grid-row: span 2; }
figure > svg { width: 100%; max-width: 760px; height: auto; display: block; }
figcaption { color: #444; font-size: .92em; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: 6px; }
.pair img { width: 100%; display: block; }
.map { width: 100%; image-rendering: pixelated; display: block;
  margin-bottom: .3rem; }
.scale { width: 140px; height: .8em; vertical-align: -.05em; }
.legend { white-space: nowrap; }
p.legend { white-space: normal; }
pre { background: #f5f5f5; padding: .7rem; white-space: pre-wrap; }
@media (max-width: 700px) {
  .charts { grid-template-columns: 1fr; }
  dl { grid-template-columns: 1fr 1fr; }
  th { width: 9rem; }
}
@media print {
  body { font-size: 11px; max-width: none; padding: 0; }
  h2 { break-after: avoid; }
  .pair { break-inside: avoid; }
}
"""
