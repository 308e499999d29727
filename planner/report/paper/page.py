"""The pages of the paper's experiment, on its own model and on the virtual robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from planner.report.figure import Figure
from planner.report.page import (
    Card,
    Listing,
    Page,
    Section,
    environment,
    figures_section,
    file_links,
    parameters_of,
)
from planner.report.paper.figures import FEATURED
from planner.report.paper.results import (
    Results,
    bounds_table,
    dropped_words,
    executed_table,
    foot_table,
    signed_percent,
    table_1,
    table_2,
)
from planner.report.paper.virtual_figures import VIRTUAL_FEATURED
from planner.report.table import Column, Row, Table, percent, signed

EYEBROW = Markup(
    "request-planner · Stronger &amp; Stone, <cite>A Model-Based Approach to Robot Joint "
    "Control</cite>"
)


def paper_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the paper's model."""
    foot, bound = results["foot"], results["foot_bound"]
    gaps = [each["gap"] for each in results["bounds"].values()]
    cards = [
        _foot_card(foot),
        Card(percent(results["baseline_deviation"], 1), "",
             "mean deviation of the ten baseline figures from the paper’s"),
        Card(percent(bound["gap"]), "",
             f"gap of the foot-optimised requests over the lower bound within the limits, "
             f"{bound['L2']:.3f} cm"),
        Card(f"{percent(min(gaps))} – {percent(max(gaps))}", "",
             "gap of every joint’s optimised requests over its lower bound"),
    ]  # fmt: skip
    context: dict[str, Any] = {"results": results, "foot": foot}
    featured = [figure for figure in figures if figure.name in FEATURED]
    parameters = results["parameters"]
    parameter_rows = [
        *((words, f"{parameters['model'][name]:.6g}")
          for name, words in parameters_of([parameters["model"]]).items()),
        ("samples in a step of the walk", parameters["samples"]),
        ("of these clamped into the leg’s reach", parameters["clamped_samples"]),
        ("lines of each approximation", parameters["segments"]),
        ("rule that inverts a line", parameters["rule"]),
    ]  # fmt: skip
    return Page(
        heading="The paper’s experiment, again",
        eyebrow=EYEBROW,
        verdict=_rendered(VERDICT, context),
        note=_rendered(NOTE, context),
        cards=cards,
        sections=[
            Section("Moment by moment", MOMENTS, {"featured": featured}),
            Section("Table 2: joint angles", TABLE_2, context | {"table": table_2(results)}),
            Section("The foot", FOOT, context | {"table": foot_table(results)}),
            Section("How good could any requests be?", BOUNDS, {"table": bounds_table(results)}),
            figures_section("Figures", [each for each in figures if each not in featured]),
        ],
        listings=[file_links(files), Listing("Parameters", parameter_rows), *_ends(results)],
        footer=f"{results['made_by']}. Published figures: {results['source']}.",
        downloads=True,
    ).html()


VERDICT = """
Computing the requests from a model of the joint brings the foot from
<strong>{{ foot.direct.L2 | fixed }} cm</strong> to
<strong>{{ foot.closed_form_plain.L2 | fixed }} cm</strong> of its desired path, by the paper’s own
method; the paper, on its robot, went from {{ foot.direct.paper.L2 | fixed }} to
{{ foot.closed_form_plain.paper.L2 | fixed }}. Planning all joints at once for the foot brings it to
<strong>{{ foot.foot_optimal.L2 | fixed }} cm</strong>. The best that sending the desired angles
early can do is {{ foot.shift.L2 | fixed }} cm here and {{ foot.shift.paper.L2 | fixed }} there.
"""

NOTE = """
{{ results.note }} So the figures need not be equal: with nothing tuned, the ten that no hand-drawn
approximation enters differ by {{ results.baseline_deviation | percent(1) }} on average.
"""

MOMENTS = """
<p class="note hints">One step of the walk: move the slider, or point into the plots, and the leg
  follows. Drag the leg to turn it.</p>
{{ hints }}
<div class="moment">
{% for figure in featured %}
{{ show(figure) }}
{% endfor %}
</div>
"""

TABLE_2 = """
<p>Distances between angle trajectories in degrees: ours, then the paper’s, then the difference.
  L₂ is a root mean square over the {{ results.parameters.samples }} samples of a step, L∞ the
  largest of them. Direct: the desired angles are requested. Closed form, as in the paper: its
  inversion of {{ results.parameters.segments }} lines, which are chosen automatically here and were
  drawn by hand there. Closed form, knots refined: the same, but with knots that simulating the
  joint has moved; that is ours, not the paper’s, whose figures stand beside both.</p>
<p>The largest misses are L∞ of the knee. They fall where the swing ends: for some twenty samples
  before, the desired knee turns faster than the model’s top speed, so that the model must miss it
  under any requests. The robot’s knee missed it by less; why, the paper does not say.</p>
{{ table }}
"""

FOOT = """
<p>Distance of the foot from its desired path in centimetres. The best time shift sends the desired
  angles {{ results.best_shift_samples }} samples early, the best of all whole-sample leads. Closed
  form and optimised requests are planned joint by joint, and the foot is only measured: a plan that
  is better in every joint need not be better in the foot.
  {% if foot.closed_form_plain.L2 < [foot.closed_form.L2, foot.optimal.L2] | min %}
  Here it is not: the paper’s method as it is comes to {{ foot.closed_form_plain.L2 | fixed }} cm,
  with knots refined to {{ foot.closed_form.L2 | fixed }}, and the optimum of every joint to
  {{ foot.optimal.L2 | fixed }}.
  {% endif %}
  The foot-optimised requests are planned for the foot, all joints at once: its joints have larger
    errors,
  which compensate for one another. The lower bound on the error of the model’s foot within the
    limits is
  {{ results.foot_bound.L2 | fixed(3) }} cm (root mean square, proved by a search of all poses of
  the leg); these are {{ results.foot_bound.gap | percent }} above that.</p>
{{ table }}
"""

BOUNDS = """
<p>For a joint of this model no requests track the desired angles better than the lower bound (root
  mean square, proved by convex optimisation). The gap is how far a plan lies above it. The closed
  form does not know of the joints’ limits, which the optimised requests keep: the last rows say how
  far the farthest request of a plan is beyond them. A robot that clips its requests would not track
  as well as such a plan predicts.</p>
{{ table }}
"""


def virtual_page(results: Results, figures: Sequence[Figure], files: Sequence[str]) -> str:
    """The page of the experiment on the virtual robot."""
    foot, joints = results["foot"], results["identified"]
    fidelity = [each["Pwl,Plain"]["L2"] for each in results["table2"].values()]
    rms = [each["rms_deg"] for each in joints.values()]
    cards = [
        Card(f"{min(rms):.2f} – {max(rms):.2f}°", "",
             "rms between the step tests and the identified models, by joint"),
        Card(f"{min(fidelity):.1f} – {max(fidelity):.1f}°", "",
             "L₂(Pwl, MB), the paper’s measure of its model’s fidelity; there 2.6 – 2.7°"),
        Card(signed_percent(foot["foot_optimal"]["loss"]), "",
             "foot error of the foot-optimised plan, executed against planned"),
        _foot_card(foot),
    ]  # fmt: skip
    context = {"results": results, "foot": foot, "dropped": dropped_words(results)}
    featured = [figure for figure in figures if figure.name in VIRTUAL_FEATURED]
    learning = [figure for figure in figures if figure.name == "learning"]
    rest = [figure for figure in figures if figure not in (*featured, *learning)]
    warnings = {name: joint["warnings"] for name, joint in joints.items() if joint["warnings"]}
    return Page(
        heading="The paper’s experiment on a virtual robot",
        eyebrow=EYEBROW,
        verdict=_rendered(VIRTUAL_VERDICT, context),
        note=results["note"],
        cards=cards,
        sections=[
            Section("Moment by moment", MOMENTS, {"featured": featured}),
            Section("Table 1: the joints, identified", VIRTUAL_TABLE_1,
                    context | {"table": table_1(results), "warnings": warnings}),
            Section("Table 2: joint angles", VIRTUAL_TABLE_2,
                    context | {"table": table_2(results)}),
            Section("The foot", VIRTUAL_FOOT, context | {"table": foot_table(results)}),
            Section("What the plans predicted and the robot did", EXECUTED,
                    {"table": executed_table(results)}),
            Section("Learning from executed cycles", LEARNING, {**context, "learning": learning}),
            figures_section("Figures", rest),
            Section("What the robot is made of", ROBOT,
                    {**context, "table": constants_table(results["robot"]["constants"])}),
        ],
        listings=[file_links(files), *_ends(results)],
        footer=f"{results['made_by']}. Published figures: {results['source']}.",
        downloads=True,
    ).html()  # fmt: skip


VIRTUAL_VERDICT = """
Models identified from step tests, requests planned on them, and {{ results.robot.cycles }} cycles
walked by servos that are not the model: the foot comes from
<strong>{{ foot.direct.L2 | fixed }} cm</strong> to
<strong>{{ foot.closed_form_plain.L2 | fixed }} cm</strong> of its desired path by the paper’s
method ({{ foot.direct.paper.L2 | fixed }} to {{ foot.closed_form_plain.paper.L2 | fixed }} on its
robot), and to <strong>{{ foot.foot_optimal.L2 | fixed }} cm</strong> when all joints are planned at
once for the foot, where the plan had predicted {{ foot.foot_optimal.predicted.L2 | fixed }}.
"""

VIRTUAL_TABLE_1 = """
<p>Estimate and 95 % interval from step tests of
  {{ results.parameters.step_amplitudes_deg | map("int") | join(", ") }} degrees,
  {{ results.parameters.step_cycles }} cycles each, as the
  {{ results.robot.constants.sensor_bits.value }}-bit sensors recorded them. Nothing of this is set
  in the robot but the delay on the way to the servo: its top speed is where the motor’s torque is
  used up by back-EMF and friction. A tick is 8 ms. The intervals suppose a joint of the model’s
  kind, which this one is not.</p>
{{ table }}
{% for name, lines in warnings.items() %}
<p><b>{{ name }}</b>: {{ lines | join(" ") }}</p>
{% endfor %}
"""

VIRTUAL_TABLE_2 = """
<p>Distances between angle trajectories in degrees, mean ± standard deviation over
  {{ results.robot.cycles }} cycles by the joints’ true angles: ours, then the paper’s, then the
  difference. The first {{ dropped }} cycles of each run, until it was steady, are left out.
  <code>results.json</code> has the same by the sensors. As with the paper’s model, L∞ of the knee
  misses most: where the swing ends, the desired knee turns faster than the joint can.</p>
{{ table }}
"""

VIRTUAL_FOOT = """
<p>Distance of the foot from its desired path in centimetres. The best time shift, found on the
  robot, sends the desired angles {{ results.best_shift_samples }} samples early. On the identified
  models the lower bound on the foot’s error within the limits is
  {{ results.foot_bound.L2 | fixed(3) }} cm (root mean square); the foot-optimised plan is
  {{ results.foot_bound.gap | percent }} above it.</p>
{{ table }}
"""

EXECUTED = """
<p>L₂ as each plan predicted it on the identified models, as executed, and the loss: joints in
  degrees, the foot in centimetres. Foot-optimised requests do not aim at the joints’ desired
  angles. Where requests exceed a joint’s limits, which the closed form does not know, the robot
  cuts them.</p>
{{ table }}
"""

LEARNING = """
<p>The requests of the foot-optimised plan, executed and refined by what the sensors measured, as
  <code>request-planner refine</code> does it, {{ results.learning.trials | length }} times. The
  foot goes from {{ results.learning.trials[0].L2 | fixed(3) }} cm to
  {{ results.learning.trials[-1].L2 | fixed(3) }} cm (L₂, mean of
  {{ results.learning.cycles_of_each }} cycles by the true angles). On the identified models no
  requests within the limits bring it below {{ results.foot_bound.L2 | fixed(3) }} cm; the noise of
  one cycle is {{ results.learning.noise | fixed(3) }} cm.</p>
{{ figures(learning) }}
"""

ROBOT = """
<p>The front leg of <code>urdf/ers210a.urdf</code> in the air, simulated by MuJoCo; its masses are
  those of the URDF. One servo per joint, all on one battery. Stall torque
  {{ results.robot.stall_torque_newton_metre | fixed(1) }} N m; the top speed without the leg that
  follows from these constants is {{ results.robot.top_speed_deg_per_tick | fixed }} degrees per
  tick.</p>
{{ table }}
"""


def constants_table(constants: Results) -> Table:
    """The constants of the robot, with their sources."""
    rows = []
    for name, constant in constants.items():
        unit = constant["unit"].replace("^2", "²") if constant["unit"] != "1" else ""
        value = signed(f"{constant['value']:.4g} {unit}".strip())
        rows.append(Row(name.replace("_", " "), (value, constant["source"])))
    columns = (Column("value"), Column("source", words=True))
    return Table("constant", columns, tuple(rows), label="Constants")


def _foot_card(foot: Results) -> Card:
    return Card(
        f"{foot['direct']['L2']:.2f} → {foot['foot_optimal']['L2']:.2f}",
        "cm",
        "foot error, direct to foot-optimised (L₂); closed form, as in the paper: "
        f"{foot['closed_form_plain']['L2']:.2f} cm",
    )


def _ends(results: Results) -> list[Listing]:
    seconds = [(part.replace("_", " "), f"{each:.2f}") for part, each in results["seconds"].items()]
    return [Listing("Seconds", seconds), Listing("Versions", list(results["versions"].items()))]


def _rendered(template: str, context: Mapping[str, Any]) -> Markup:
    # Escaped where it was rendered.
    return Markup(environment().from_string(template).render(context))
