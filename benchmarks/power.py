"""Cost of a power grasp over the number of contacts, with a plot (docs/pictures/power_grasp_cost.png)."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

import nlpgrasp as ng
from benchmarks.starts import run_starts
from problems.power_grasp import FINGERS, HAND, LENGTHS, OTHER_LENGTHS, TIP_RADIUS, problem, side

mpl.use("Agg")
from matplotlib import pyplot as plt

STARTS = 6
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "power_grasp_cost.png"


def run():
    counts = range(4, 13)
    seconds = []
    for count in counts:
        results, times = run_starts(power_grasp_problem(count), STARTS)
        solved = [r for r in results if r.solved]
        seconds.append(times)
        best = max((r.record.mu.lower for r in solved), default=0.0)
        text = f"{len(solved)} of {STARTS} starts"
        print(
            f"{count:2d} contacts: {text}, median {np.median(times):5.2f} s, most {times.max():5.2f} s; mu {best:.3f}"
        )
    medians = np.array([np.median(times) for times in seconds])
    slope, offset = np.polyfit(counts, medians, 1)
    fitted = slope * np.array(counts) + offset
    explained = 1.0 - np.sum((medians - fitted) ** 2) / np.sum((medians - medians.mean()) ** 2)
    print(f"line through the medians: {slope:.2f} s a contact, {explained:.0%} of their variance")
    power = np.polyfit(np.log(counts), np.log(medians), 1)[0]
    print(f"exponent of the contacts in a power law: {power:.2f}")
    _plot(np.array(counts), seconds, fitted, slope)


def power_grasp_problem(count):
    """Return the power grasp problem with a number of contacts, on fingertips first, then on inner links."""
    links = [f"{finger}_{part}" for part in ("tip", "middle", "proximal") for finger in FINGERS][:count]
    tips = {link: _tip(link) for link in links}
    hand = ng.URDFHand.load(HAND, tips, approach=[1.0, 0.0, 0.0])
    complete = problem(3)
    return ng.GraspProblem(complete.body, complete.contacts[:count], complete.task, hand=hand)


def _tip(link):
    """Return the tip radius, or the patch on the side, of a link."""
    finger, part = link.split("_")
    lengths = LENGTHS.get(finger, OTHER_LENGTHS)
    return TIP_RADIUS if part == "tip" else side(lengths[part == "middle"])


def _plot(counts, seconds, fitted, slope):
    """Write the plot of seconds over the number of contacts."""
    figure, axes = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
    axes.scatter(np.repeat(counts, STARTS), np.concatenate(seconds), s=14, color="0.6", label="starts")
    axes.plot(counts, [np.median(each) for each in seconds], "o-", color="C0", label="median")
    axes.plot(counts, fitted, "--", color="C1", label=f"line, {slope:.1f} s a contact")
    axes.set(xlabel="contacts", ylabel="seconds a start, one core", ylim=(0.0, None), xticks=counts)
    axes.legend(frameon=False)
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=150)
    print(f"plot: {PICTURE.relative_to(PICTURE.parents[2])}")
