"""Draws what README shows."""

import json
import re
from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from judge import Judged
from results import TITLES
from roads import draw
from setting import SAMPLE_TIME, TEST, VARIATIONS

matplotlib.use("svg")
from matplotlib import pyplot as plt

Array = npt.NDArray[np.float64]

SPEEDS = np.linspace(8.0, 24.0, 8)  # m/s, centres of the sets of both specs
ACCELERATIONS = np.linspace(-2.0, 2.0, 5)  # m/s²
STYLE = {
    "svg.hashsalt": "vehicle_steering",
    "svg.fonttype": "none",
    "font.size": 9,
    "lines.linewidth": 0.9,
}
SPARSE = 8  # samples from point to point of a curve
COLOURS = {  # of Okabe and Ito, which colour-blind readers tell apart too
    "kinematic": "0.7",
    "filters": "#E69F00",
    "mlp": "#56B4E9",
    "stanley": "k",
    "mpc": "#009E73",
    "controller": "#D55E00",
}


def write(judged: Judged, folder: Path) -> None:
    """The three figures, as SVG in the folder `figures`."""
    (folder / "figures").mkdir(exist_ok=True)
    with plt.rc_context(STYLE):
        _curvature(judged, folder / "figures" / "curvature_error.svg")
        _paths(judged, folder / "figures" / "paths.svg")
        _learned(folder, folder / "figures" / "learned.svg")


def _curvature(judged: Judged, path: Path) -> None:
    """The curvature of the test drive, and what models make of it."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.5), sharex=True)
    wheels, vehicle = judged.traces["wheels"], judged.traces["vehicle"]
    above.plot(vehicle.time[::SPARSE], vehicle.true[::SPARSE], "k")
    above.set_ylabel("curvature, 1/m")
    curves = (
        (wheels, COLOURS["kinematic"], TITLES["wheels"]),
        (vehicle, "#0072B2", TITLES["vehicle"]),
        (judged.traces["controller"], COLOURS["controller"], "controller and learned vehicle"),
    )
    for trace, colour, label in curves:
        error = 1e3 * (trace.predicted - trace.true)
        below.plot(trace.time[::SPARSE], error[::SPARSE], colour, label=label)
    below.set(xlabel="time, s", ylabel="error, 0.001/m", ylim=(-4, 4))
    _legend_above(below)
    _save(figure, path)


def _paths(judged: Judged, path: Path) -> None:
    """The test road from above, and how far beside it each controller drives."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 5), height_ratios=(3, 2))
    road, nominal = draw(TEST), VARIATIONS[0].name
    above.plot(-road.y[::40], road.x[::40], "k", linewidth=0.6)  # turned: it leads down
    above.set(aspect="equal", xlabel="m", ylabel="m", title="the test road")
    for name, colour in COLOURS.items():
        run = judged.runs[name, nominal]
        width = 1.4 if name == "controller" else 0.8
        way, offset = run.way[::SPARSE], run.offset[::SPARSE]
        below.plot(way, offset, color=colour, linewidth=width, label=TITLES[name])
    below.set(xlabel="along the road, m", ylabel="offset to the left, m")
    _legend_above(below)
    _save(figure, path)


def _learned(folder: Path, path: Path) -> None:
    """Channels, filters and understeer of vehicle and controller."""
    vehicle, controller = (_parameters(folder, name) for name in ("vehicle", "controller"))
    figure, axes = plt.subplots(2, 2, figsize=(8, 5.5))
    back, ahead = SAMPLE_TIME * np.arange(-29, 1), SAMPLE_TIME * np.arange(30)
    fading = np.exp(-((np.arange(-29, 1) / 15) ** 2))
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.9, SPEEDS.size))
    for index, (speed, colour) in enumerate(zip(SPEEDS, colours, strict=True)):
        label = f"{speed:.0f} m/s"
        axes[0, 0].plot(back, fading * vehicle["W"][index], color=colour, label=label)
        axes[0, 1].plot(ahead, controller["W"][index], color=colour)
    axes[0, 0].set(title="vehicle: angle to curvature", xlabel="s", ylabel="1/m/rad")
    axes[0, 0].legend(ncols=2, fontsize=7)
    axes[0, 1].set(title="controller: road ahead to angle", xlabel="s", ylabel="rad m")
    axes[1, 0].plot(ACCELERATIONS, 1e3 * vehicle["A"], "o-")
    axes[1, 0].set(title="understeer A(a)", xlabel="acceleration, m/s²", ylabel="0.001 s²/m²")
    axes[1, 1].plot(back[:-1], controller["w0"], ".-")
    axes[1, 1].set(title="controller: its past angles", xlabel="s")
    _save(figure, path)


def _legend_above(axes: plt.Axes) -> None:
    """In a line over the axes, where it covers no curve."""
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, fontsize=7, frameon=False)


def _parameters(folder: Path, spec: str) -> dict[str, Array]:
    """The learned numbers of the latest run of a spec."""
    file = folder / "runs" / spec / "latest" / "parameters.json"
    entries = json.loads(file.read_text(encoding="utf-8"))["parameters"]
    return {e["name"]: np.array(e["values"]).reshape(e["shape"]) for e in entries}


def _save(figure: plt.Figure, path: Path) -> None:
    """As SVG with coordinates of two decimals, and a path on one line."""
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    text = re.sub(r"<[^>]*>", _short, path.read_text(encoding="utf-8"))
    path.write_text(re.sub(r" *\n(?=[LMQCz])", " ", text), encoding="utf-8")


def _short(tag: re.Match[str]) -> str:
    """A tag with numbers of two decimals; what stands between tags is text to read."""
    return re.sub(r"(\d\.\d\d)\d+", r"\1", tag.group())
