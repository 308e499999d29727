"""The figures of the paper's experiment, on its model and on the virtual robot, and their files."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.arrays import Array
from planner.evaluation.reproduction import STEP_AMPLITUDES
from planner.report import figure
from planner.report.figure import (
    INK,
    MARGIN,
    Axis,
    Curve,
    Figure,
    Panel,
    Role,
    Span,
    Timeline,
    Words,
    around,
    joined,
    line,
)
from planner.report.learning_page import errors_figure
from planner.report.wording import words_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

    from planner.evaluation.reproduction import PlannedWalk
    from planner.evaluation.virtual_experiment import VirtualOutcome

ROLES = {
    "direct": figure.DIRECT,
    "shift": figure.SHIFT,
    "closed_form_plain": figure.PLAIN,
    "optimal": figure.OPTIMAL,
    "foot_optimal": figure.FOOT_OPTIMAL,
}
"""The methods that are drawn, in order; the closed form with knots refined is not the paper's."""

HIDDEN = ("shift", "optimal")
"""Methods that are hidden at first: in space they are the direct method's path, and nearly the
closed form's."""

REQUESTED_TOO = "requested = desired"

ACROSS, UPWARD = Axis("forward of the hip, x", "cm"), Axis("above the hip, z", "cm")

PREDICTED = Role("predicted", figure.INK.light, figure.INK.dark, width=1.1, dashes=(0, (1, 1.6)))


WIDTH = 4.8
"""Width of a picture [inch]: legible on a phone, and between one and two columns of a paper."""

V_MAX = r"$v_\mathrm{max}$"


def paper_figures(planned: PlannedWalk) -> tuple[Figure, ...]:
    """Every figure, in the order of the paper's."""
    step, plans, plain = timeline_of(planned).step, planned.plans, "closed_form_plain"
    angles = {method: plan.predicted for method, plan in plans.items()}
    feet = {method: plan.foot for method, plan in plans.items()}
    requests, lines = (plans[plain].requests, figure.REQUESTED), planned.approximations[plain]
    direct, actual = (
        (angles[method], ROLES[method]._replace(label="actual")) for method in ("direct", plain)
    )
    for_foot = figure.REQUESTED._replace(label="requests, foot-optimised")
    hidden = (plans["foot_optimal"].requests, for_foot)

    def knots(j: int) -> list[Curve]:
        fit, role = plans[plain].approximations[j], figure.APPROXIMATION
        fine = np.linspace(0.0, fit.samples, 20 * fit.samples + 1)  # knots lie between samples
        at, values = np.mod(fit.knots, fit.samples), np.degrees(fit.values)
        curve = Curve(role, step * fine, np.degrees(fit(fine)))
        return [curve, Curve(role, step * at, values, "knots", marks="rings")]

    return (
        direct_foot_figure(planned),
        joints_figure(planned, "figure2_joints_direct", direct, desired=REQUESTED_TOO),
        *(_step_test(planned, k, each) for k, each in enumerate(STEP_AMPLITUDES, 3)),
        _speed(planned),
        joints_figure(planned, "figure6_approximation", more=knots),
        joints_figure(
            planned, "figure7_trajectories", requests, (lines, figure.APPROXIMATION), actual
        ),
        foot_paths_figure("figure8_foot_paths", planned, feet, planned.legs),
        by_method_figure(planned, angles, feet, hidden),
    )


def virtual_figures(outcome: VirtualOutcome) -> tuple[Figure, ...]:
    """Every figure of the virtual robot with every cycle, in the order of the paper's."""
    planned, walks, plain = outcome.planned, outcome.walks, "closed_form_plain"
    plans, lines = planned.plans, (planned.approximations[plain], figure.APPROXIMATION)
    requests = (plans[plain].requests, figure.REQUESTED)
    actual = (walks[plain], ROLES[plain]._replace(label="actual"))
    cycles = figure.DIRECT._replace(label=f"actual, {len(walks['direct'])} cycles")
    direct = (walks["direct"], cycles), (plans["direct"].predicted, PREDICTED)
    first = {method: outcome.legs[method][0] for method in ROLES}
    return (
        foot_paths_figure("foot_paths", planned, outcome.foot_paths, first),
        _step_tests(outcome),
        joints_figure(planned, "joints_direct", *direct, desired=REQUESTED_TOO),
        joints_figure(planned, "trajectories", requests, lines, actual),
        by_method_figure(planned, walks, outcome.foot_paths, words="virtual_"),
        _learning(outcome),
    )


def timeline_of(planned: PlannedWalk) -> Timeline:
    """The samples of a step of the walk."""
    return Timeline(planned.models[0].period, len(planned.walk.desired))


def with_cycles(
    draw: Callable[[Array], Curve], values: Array, *, axes: int = 1
) -> tuple[Curve, ...]:
    """A curve; of cycles, along a further axis, their mean and each of them as a thin line."""
    if values.ndim == axes:
        return (draw(values),)
    mean, *each = map(draw, (values.mean(axis=0), *values))
    x, y = joined(curve.x for curve in each), joined(curve.y for curve in each)
    return mean, replace(mean, role=mean.role._replace(width=0.7, dashes="-"), x=x, y=y, notes=())


# The foot.


def direct_foot_figure(planned: PlannedWalk) -> Figure:
    """Figure 1: the foot's paths from the side, joined at the same instants by thin lines."""
    desired, actual = planned.walk.desired_foot, planned.plans["direct"].foot
    pairs = 100.0 * np.stack([desired[::8], actual[::8]], axis=1)
    ties = figure.GRID._replace(label="the same instants", width=1.2)
    draw, name = timeline_of(planned).path, "figure1_foot_direct"
    curves = (
        Curve(ties, joined(pairs[:, :, 0]), joined(pairs[:, :, 2])),
        draw(desired, figure.DESIRED),
        draw(actual, figure.DIRECT),
    )
    upward = replace(UPWARD, range=around([curve.y for curve in curves]))
    return Figure(name, *words_of(name), ACROSS, (Panel(upward, curves, height=1.8),), equal=True)


def foot_paths_figure(
    name: str, planned: PlannedWalk, feet: Mapping[str, Array], legs: Mapping[str, Array]
) -> Figure:
    """Paths of the foot, (n, 3) or (cycles, n, 3), and legs, (n, joints + 1, 3) [m], by method."""
    # The leg is drawn in files in the middle of the time on the ground, at sample 22.
    foot, joints = planned.walk.desired_foot, 100.0 * planned.legs["desired"][22]
    timeline, ground = timeline_of(planned), float(foot[:, 2].min())
    ends = around([100.0 * foot[:, 0]])
    curves = [
        line(ends, (100.0 * ground,) * 2),
        Curve(figure.GRID._replace(width=9.0), joints[:, 0], joints[:, 2], "leg", legend=False),
        timeline.path(foot, figure.DESIRED),
    ]
    for method, role in ROLES.items():
        if method not in HIDDEN:
            curves += with_cycles(partial(timeline.path, role=role), feet[method], axes=2)
    words = (
        Words("hip", joints[0, 0], joints[0, 2], across="left", upward="bottom"),
        Words("knee", joints[2, 0], joints[2, 2], across="right", upward="bottom"),
        Words("ground", ends[1], 100.0 * ground, across="right", upward="top"),
    )
    moving = timeline.leg(
        name,
        words_of(name),
        planned.legs["desired"],
        [(role, legs[method]) for method, role in ROLES.items()],
        ground=ground,
        hidden=[ROLES[method].label for method in HIDDEN],
    )
    panel = Panel(UPWARD, curves, words=words, height=2.5)
    return replace(moving, x=ACROSS, panels=(panel,), equal=True)


# The joints.


def by_method_figure(
    planned: PlannedWalk,
    angles: Mapping[str, Array],
    paths: Mapping[str, Array],
    *more: tuple[Array, Role],
    words: str = "",
) -> Figure:
    """Angles [rad] and paths of the foot [m], of a cycle or several, by method; more are hidden."""
    timeline, curves = timeline_of(planned), list[Curve]()
    for method, role in ROLES.items():
        distances = 100.0 * np.linalg.norm(paths[method] - planned.walk.desired_foot, axis=-1)
        draw = partial(timeline.curve, role=role, hidden=method in HIDDEN)
        curves += with_cycles(draw, distances)
    axis = Axis("distance", "cm", from_zero=True)
    below = Panel(axis, curves, "foot, from its desired path")
    drawn = [(angles[method], role) for method, role in ROLES.items() if method != "shift"]
    hidden = [role.label for role in (figure.OPTIMAL, *(role for _, role in more))]
    name = "joints_by_method"
    return joints_figure(planned, name, *drawn, *more, words=words, below=[below], hidden=hidden)


def joints_figure(
    planned: PlannedWalk,
    name: str,
    *drawn: tuple[Array, Role],
    desired: str = "desired",
    words: str = "",
    below: Sequence[Panel] = (),
    more: Callable[[int], Sequence[Curve]] = lambda _: (),
    hidden: Collection[str] = (),
) -> Figure:
    """A panel per joint: values [rad], (n, k) or (cycles, n, k), and ``more`` by its index."""
    timeline, panels = timeline_of(planned), list[Panel]()
    wanted = (planned.walk.desired, figure.DESIRED._replace(label=desired))
    for j, joint in enumerate(planned.walk.joint_names):
        curves: list[Curve] = []
        for values, role in (wanted, *drawn):
            held = role.light == figure.REQUESTED.light
            draw = partial(timeline.curve, role=role, held=held, hidden=role.label in hidden)
            curves += with_cycles(draw, np.degrees(values[..., j]))
        panels.append(Panel(Axis("angle", "deg"), (*curves, *more(j)), joint))
    return timeline.figure(name, [*panels, *below], words_of(words + name), clock=bool(below))


# The model.


def _step_test(planned: PlannedWalk, number: int, amplitude: float) -> Figure:
    """Figures 3 and 4: the answer to a step test, its lag and its acceleration time shaded."""
    response = planned.steps[amplitude]
    timeline = Timeline(planned.models[0].period, len(response.angles))
    begun = response.step + response.lag
    full = begun + response.acceleration
    start, middle, end = (timeline.step * sample for sample in (response.step, begun, full))
    speed = math.degrees(response.v_max) * planned.models[0].period
    low, top = -0.12 * amplitude, 1.24 * amplitude
    curves = (
        timeline.curve(np.degrees(response.requests), figure.REQUESTED, held=True),
        timeline.curve(np.degrees(response.angles), figure.CLOSED_FORM, "actual"),
    )
    spans = (Span(start, middle, figure.MUTED, 0.16), Span(middle, end, figure.CLOSED_FORM, 0.16))
    words = (
        Words(f"lag {response.lag} ticks", start, top, "right", "top"),
        Words(f"acceleration {response.acceleration} ticks", end, top, "left", "top"),
    )
    title, axis = f"top speed {speed:.3g} deg per tick", Axis("angle", "deg", (low, top))
    panel = Panel(axis, curves, title, spans, words, height=1.6)
    about = words_of("step_test", number=number, amplitude=amplitude)
    return timeline.figure(f"figure{number}_step_{amplitude:g}", [panel], about)


def _speed(planned: PlannedWalk) -> Figure:
    """Figure 5."""
    model = planned.models[0]
    theta_0, v_max = math.degrees(model.theta_0), math.degrees(model.v_max_per_tick)
    errors = np.linspace(-2.2, 2.2, 89) * theta_0
    speeds = model.tick * np.degrees(model.speed(np.radians(errors)))
    far, high = float(errors[-1]), 1.35 * v_max
    dotted = figure.MUTED._replace(dashes=(0, (1.0, 1.5)))
    curves = (
        line((-far, far), (0.0, 0.0)),
        line((0.0, 0.0), (-high, high)),
        line((theta_0, theta_0), (0.0, v_max), dotted),
        line((-theta_0, -theta_0), (0.0, -v_max), dotted),
        Curve(figure.CLOSED_FORM, errors, speeds, "f"),
    )
    words = (
        Words("θ₀", theta_0, 0.0, upward="top"),
        Words("−θ₀", -theta_0, 0.0, upward="bottom"),
        Words("v_max", 1.6 * theta_0, v_max, upward="bottom"),
        Words("−v_max", -1.6 * theta_0, -v_max, upward="top"),
    )
    axis = Axis("f(x)", "deg per tick", (-high, high))
    panel = Panel(axis, curves, words=words, height=1.7)
    across = Axis("request minus angle, x", "deg", (-far, far))
    return Figure("figure5_speed", *words_of("figure5_speed"), across, [panel])


# The virtual robot.


def _step_tests(outcome: VirtualOutcome) -> Figure:
    """Figures 3 and 4: the sensors' records of each step test's last cycle, and the model's."""
    timeline, last = timeline_of(outcome.planned), slice(-len(outcome.planned.walk.desired), None)
    once = Timeline(timeline.period, timeline.samples, cyclic=False)
    panels = []
    names = outcome.planned.walk.joint_names
    for identification, joint in zip(outcome.identifications, names, strict=True):
        measured, predicted = [], []
        for fit in identification.fits:
            middle = float(np.mean(fit.log.requests[last]))
            measured.append(once.curve(np.degrees(fit.log.angles[last] - middle), figure.INK))
            predicted.append(
                once.curve(np.degrees(fit.predicted[last] - middle), figure.CLOSED_FORM)
            )
        times = joined(curve.x for curve in measured)
        angles, model = (joined(curve.y for curve in each) for each in (measured, predicted))
        curves = (
            Curve(figure.CLOSED_FORM._replace(width=1.4), times, model, "identified model"),
            Curve(figure.INK, times, angles, "measured by the sensor", marks="dots", opacity=0.55),
        )
        panels.append(Panel(Axis("angle", "deg"), curves, joint))
        rest = Curve(figure.MUTED._replace(width=0.9), times, angles - model, "residual")
        title = f"{joint}, residual, {np.degrees(identification.rms):.2f} deg rms"
        panels.append(Panel(Axis("residual", "deg"), (rest,), title, height=0.6))
    return once.figure("step_tests", panels, words_of("step_tests"))


def _learning(outcome: VirtualOutcome) -> Figure:
    """The foot's error in each trial of learning, and the lower bound of the models."""
    errors = [each.mean.rms for each in outcome.learnt_foot]
    bound = 100.0 * float(outcome.planned.plans["foot_optimal"].lower_bounds[0])
    numbers = {"errors": errors, "trials": len(errors), "lower_bound": bound, "unit": "cm"}
    drawn = errors_figure("foot", numbers | {"predicted": math.nan, "noise": 0.0, "stopped": ""})
    title, caption = words_of("virtual_learning")
    return replace(drawn, title=title, caption=caption)


# Files, drawn by Matplotlib as the same bytes every time.


def pictures_of(figure: Figure) -> tuple[str, bytes]:
    """The figure as an SVG file, text as text, and as a PNG file, laid out once and not dated."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    svg, png = io.StringIO(), io.BytesIO()
    with mpl.rc_context(fname=Path(__file__).with_name("paper.mplstyle")):
        picture = draw(figure)  # printed by canvases: `savefig` draws it once before
        canvas: Any = FigureCanvasSVG(picture)
        canvas.print_svg(svg, metadata={"Date": None, "Creator": None})
        picture.set_layout_engine("none")
        picture.dpi = 200  # dots per inch
        canvas = FigureCanvasAgg(picture)
        canvas.print_png(png, metadata={"Software": None})
    rows = (row.rstrip() for row in svg.getvalue().splitlines())
    return "\n".join(rows) + "\n", png.getvalue()


def draw(figure: Figure) -> Picture:
    """The figure as Matplotlib draws it: the panels, and the legend above them."""
    from matplotlib.figure import Figure as Picture

    drawn = [curve for panel in figure.panels for curve in panel.curves if not curve.hidden]
    names = list(dict.fromkeys(curve.name for curve in drawn if curve.legend))
    # of the words, with the line before each and the blank behind it [inch]
    widths = [0.062 * len(name) + 0.56 for name in names]
    columns = len(names) or 1
    while columns > 1 and sum(map(max, np.array_split(widths, columns))) > WIDTH:
        columns -= 1
    heights = [panel.height for panel in figure.panels]
    # for the panels, the axis, their headings and the rows of the legend [inch]
    height = 1.5 * sum(heights) + 0.45 + 0.2 * sum(bool(panel.title) for panel in figure.panels)
    height += 0.22 * -(-len(names) // columns)
    picture = Picture(figsize=(WIDTH, height), layout="constrained")
    rows = picture.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    handles: dict[str, Any] = {}
    for axes, panel in zip(rows[:, 0], figure.panels, strict=True):
        _draw_panel(axes, panel, figure)
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    _set_axis(rows[-1, 0].xaxis, figure.x)
    picture.align_ylabels(list(rows[:, 0]))
    if names:
        entries = [handles[name] for name in names]
        picture.legend(entries, names, loc="outside upper left", ncols=columns)
    return picture


def _draw_panel(axes: Axes, panel: Panel, figure: Figure) -> None:
    for span in panel.spans:
        shade = axes.axvspan if span.along == "x" else axes.axhspan
        look = (span.role.light, span.opacity)
        shade(span.start, span.end, zorder=0.5, facecolor=look, linewidth=0.0)
    for order, curve in enumerate(curve for curve in panel.curves if not curve.hidden):
        role, looks = curve.role, dict[str, Any](linestyle="", marker="o")
        if not curve.marks:
            drawstyle = "steps-post" if curve.held else "default"
            looks = {"linewidth": role.width, "linestyle": role.dashes, "drawstyle": drawstyle}
            looks |= {"solid_capstyle": "butt"} if role.width > 5.0 else {}
        elif curve.marks == "rings":
            looks |= {"ms": 5.0, "mfc": "none", "mew": 1.3, "clip_on": False}
        else:
            looks |= {"ms": 2.3 if curve.opacity < 1.0 else 5.0, "mew": 0.0, "alpha": curve.opacity}
        looks |= {"color": role.light, "label": curve.name, "zorder": 3.0 + 0.01 * order}
        axes.plot(curve.x, curve.y, **looks)
    away = {"left": 4, "right": -4, "bottom": 4, "top": -4}  # from their place [pt]
    for words in panel.words:
        axes.annotate(
            words.text.replace("v_max", V_MAX),
            (words.x, words.y),
            xytext=(away.get(words.across, 0), away.get(words.upward, 0)),
            textcoords="offset points",
            ha=words.across,
            va={"middle": "center"}.get(words.upward, words.upward),
            fontsize=8.5,
            color=INK.light,
            zorder=6.0,
        )
    axes.set_title(panel.title, loc="left")
    _set_axis(axes.yaxis, panel.y)
    if figure.equal:
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(MARGIN)
        return
    axes.margins(y=0.09)
    axes.set_xlim(*figure.x_range)
    if panel.y.range is not None or panel.y.from_zero:
        axes.set_ylim(*(panel.y.range or (0.0, None)))


def _set_axis(axis: Any, description: Axis) -> None:
    """The words of an axis: its title, and names where it has them."""
    axis.set_label_text(description.words)
    if description.names is not None:
        words = [name.replace("v_max", V_MAX) for name in description.names.values()]
        axis.set_ticks(list(description.names), labels=words)
        axis.set_tick_params(length=0)
        axis.grid(visible=False)
