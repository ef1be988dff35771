"""Keep the speed of each commit, draw its history, and mark what became slower.

    python .ci/speed_history.py HISTORY.json BENCHMARKS.json COMMIT CHART.png

Every benchmark is a ratio to a yardstick of the same run, so that machines and their load matter
little. A benchmark is marked, and the command ends with 1, if the median of the last
three commits is more than 15 % above that of the eight before: one slow run alone is no change.
"""

import json
import statistics
import sys
from pathlib import Path

import matplotlib.pyplot as plt

LEAST_CHANGE, LATEST, BEFORE = 1.15, 3, 8


def ratios(benchmarks: Path) -> dict[str, float]:
    """Return the time of each benchmark, in times of the yardstick that it was measured beside."""
    rows = json.loads(benchmarks.read_text(encoding="utf-8"))["benchmarks"]
    measured = [row["extra_info"] for row in rows]
    return {info["name"]: info["ratio"] for info in measured if "ratio" in info}


def marked(history: dict[str, dict[str, float]]) -> dict[str, float]:
    """Return the benchmarks that are slower in the last commits, and by how much."""
    names = {name for row in history.values() for name in row}
    slower = {}
    for name in sorted(names):
        series = [row[name] for row in history.values() if name in row]
        before, now = series[-LATEST - BEFORE : -LATEST], series[-LATEST:]
        if before and statistics.median(now) > LEAST_CHANGE * statistics.median(before):
            slower[name] = statistics.median(now) / statistics.median(before)
    return slower


def main(kept: Path, benchmarks: Path, commit: str, chart: Path) -> int:
    """Add a commit to the history, draw it, and say what became slower."""
    history = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    history[commit] = ratios(benchmarks)
    kept.write_text(json.dumps(history, indent=1), encoding="utf-8")
    figure, panel = plt.subplots(figsize=(9, 5), layout="constrained")
    slower = marked(history)
    for name in sorted(history[commit]):
        series = [row.get(name) for row in history.values()]
        panel.plot(series, "r.-" if name in slower else ".-", lw=1, label=name)
    panel.set(xticks=range(len(history)), ylabel="time in times of the yardstick", yscale="log")
    panel.set_xticklabels([name[:7] for name in history], rotation=90)
    figure.legend(loc="outside right upper", fontsize=6)
    figure.savefig(chart, dpi=150)
    for name, factor in slower.items():
        print(f"{name} takes {factor:.2f} times as long as before")
    return bool(slower)


if __name__ == "__main__":
    *paths, commit, chart = sys.argv[1:]
    sys.exit(main(*map(Path, paths), commit, Path(chart)))
