"""The paper's table of its real robot: mean of five trials by strategy and sheet.

Time s, path deviation mm, load N, removed volume mm^3. Hathaway, Stolkin, Rastegarpanah, IROS 2024.
"""

from __future__ import annotations

MEASURES = ("time_s", "path_deviation_mm", "load_n", "mrv_mm3")
SHEETS = ("foam", "plastic", "cardboard", "mica", "aluminium")

_ROWS = {
    "baseline": "19.4/2.29/9.03/331 20.1/2.29/5.57/72.4 20.1/2.38/12.1/207 "
    "19.8/3.67/14.1/10.0 20.1/3.21/14.0/17.7",
    "expert": "10.6/11.6/6.54/174 11.0/10.3/6.57/52.0 10.7/10.3/8.30/66.0 "
    "11.3/10.1/9.05/7.82 10.9/9.26/6.90/6.57",
    "fine_tune": "10.9/5.70/8.95/202 10.5/4.41/7.49/54.0 11.0/4.35/8.32/74.0 "
    "10.5/4.46/9.84/15.8 10.3/3.96/7.59/16.0",
    "re_train": "44.7/8.55/10.3/259 47.6/7.44/8.61/55.3 45.4/6.83/16.0/80.2 "
    "43.8/8.47/14.4/14.2 43.7/8.12/10.4/12.3",
    "bc": "10.6/8.26/6.23/108 10.3/7.64/6.40/45.9 10.4/8.49/7.44/64.6 "
    "10.5/9.44/8.42/9.99 10.3/7.75/6.58/9.18",
    "dagger": "10.1/8.95/6.20/131 12.9/8.04/6.29/56.4 12.3/8.68/8.08/88.7 "
    "10.3/9.50/8.99/10.8 10.2/7.85/6.64/11.3",
}  # fmt: skip


def _row(text: str) -> dict[str, dict[str, float]]:
    cells = [dict(zip(MEASURES, map(float, cell.split("/")), strict=True)) for cell in text.split()]
    return dict(zip(SHEETS, cells, strict=True))


TABLE = {strategy: _row(text) for strategy, text in _ROWS.items()}
"""Strategy -> sheet -> measure."""
