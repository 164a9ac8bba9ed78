"""Joins what criterion measured with what peers.py printed, as a Markdown table on stdout.

Usage: table.py --round CRITERION_FOLDER >>ROUND.jsonl
       table.py ROUND.jsonl... [--title TEXT]
The first takes what criterion measured last into a round's file. Several files are several rounds; a row's figure is the
median over them. Standard library only.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
# PyTorch3D and Embree are not installed by run.sh; their figures were measured once, on a 2-core Zen 5 with
# AVX-512, and stand in the table as quotations: (peer, ms).
QUOTED = {
    "raster/forward-backward/icosphere-4-256-batch-1": [
        ("PyTorch3D 0.7.9, a silhouette alone, of 1,280 faces instead of 5,120 (quoted)", 17359),
        ("the same with its backward patched (quoted)", 455),
    ],
    "raster/forward/icosphere-5-512-batch-1": [("Embree, visibility alone, 1 thread (quoted)", 63.7)],
    "chamfer/2466x9000/forward-backward/2t": [("PyTorch3D 0.7.9, 1 thread (quoted)", 190)],
}


# The arithmetic of the direct algorithm for ids that have one, in flops.
def flops(name):
    parts = name.split("/")
    if parts[0] == "gemm":
        m, k, n = map(int, parts[1].split("x"))
        return 2 * m * k * n
    if parts[0] == "conv2d":
        batch, height, width, channels = parts[1].split("x")
        cin, cout = map(int, channels.split("-"))
        passes = {"forward": 1, "backward": 2, "forward-backward": 3}[parts[2]]
        return passes * 2 * 9 * int(batch) * int(height) * int(width) * cin * cout
    return None


# Whose figures criterion measured.
HERE = "here"


def note(folder):
    """Prints the median milliseconds of each bench, as peers.py does."""
    for path in sorted(pathlib.Path(folder).glob("**/new/benchmark.json")):
        name = json.loads(path.read_text())["full_id"]
        estimates = json.loads((path.parent / "estimates.json").read_text())
        median = estimates["median"]["point_estimate"] / 1e6
        print(json.dumps({"id": name, "peer": HERE, "median_ms": median}))


def medians(files):
    """Median milliseconds by id and peer over the rounds, and the peers' versions."""
    rounds, versions = {}, {}
    for file in files:
        for line in pathlib.Path(file).read_text().splitlines():
            row = json.loads(line)
            if "versions" in row:
                versions = row["versions"]
            else:
                rounds.setdefault((row["id"], row["peer"]), []).append(row["median_ms"])
    return {key: statistics.median(values) for key, values in rounds.items()}, versions


def cell(milliseconds, work):
    if milliseconds is None:
        return "-"
    text = f"{milliseconds / 1e3:.3g} s" if milliseconds >= 1e3 else f"{milliseconds:.3g} ms"
    return f"{text} ({work / milliseconds / 1e6:.0f} GFLOP/s)" if work else text


def command(*words):
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rounds", nargs="*")
    parser.add_argument("--round", metavar="CRITERION_FOLDER")
    parser.add_argument("--title", default="Speed beside the peers")
    options = parser.parse_args()
    if options.round:
        return note(options.round)
    measured, versions = medians(options.rounds)
    mine = {name: value for (name, peer), value in measured.items() if peer == HERE}
    peers = {key: value for key, value in measured.items() if key[1] != HERE}

    cpu = next(
        (l.split(":", 1)[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")),
        "unknown",
    )
    print(f"# {options.title}\n")
    print(f"- date: {command('date', '-u', '+%Y-%m-%d %H:%M')} UTC")
    print(f"- machine: {cpu}, {command('nproc')} cores")
    print(f"- commit: {command('git', 'describe', '--always', '--dirty')}")
    print(f"- {command('rustc', '--version')}")
    print("- peers: " + ", ".join(f"{k} {v}" for k, v in versions.items()) + "\n")
    print(f"Medians over {len(options.rounds)} rounds of the medians in each. `1t`, `2t`: threads. A ratio above 1 means that this workspace is faster.\n")
    print("| work | here | peer | | ratio |\n|---|---|---|---|---|")
    by_id = {name: list(rows) for name, rows in QUOTED.items() if name in mine}
    for (name, peer), value in peers.items():
        by_id.setdefault(name, []).append((peer, value))
    for name in sorted(set(mine) | set(by_id)):
        work, here = flops(name), mine.get(name)
        for peer, value in by_id.get(name, [("", None)]):
            ratio = "-"
            # What was measured on another machine has none.
            if here and value and "(quoted)" not in peer:
                ratio = f"{value / here:.{2 if value < 10 * here else 0}f}"
            print(f"| {name} | {cell(here, work)} | {peer} | {cell(value, work)} | {ratio} |")


if __name__ == "__main__":
    main()
