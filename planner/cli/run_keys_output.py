"""Keys of a run file about what is written."""

from __future__ import annotations

from planner.cli.export_options import ROS
from planner.files.kinds import by_name, choice, flag, number, several, text, whole, written_name
from planner.files.schema import Key, Table

OUTPUT = Table(
    name=("output",),
    about='What is written beside results.json, inside the folder; "" leaves a file out.',
    keys=(
        Key(
            name="requests",
            kind=written_name(or_none=True),
            about="What to send.",
            default="requests.csv",
        ),
        Key(
            name="angles",
            kind=written_name(or_none=True),
            about="What it leads to.",
            default="angles.csv",
        ),
        Key(
            name="desired",
            kind=written_name(or_none=True),
            about="What was wanted.",
            default="desired.csv",
        ),
        Key(
            name="foot",
            kind=written_name(or_none=True),
            about="Where the foot then is, where there is one.",
            default="foot.csv",
        ),
        Key(
            name="report",
            kind=written_name(or_none=True),
            about="A page about the plan, with pictures, such as report.html.",
            default="",
            set_to="report.html",
        ),
        Key(
            name="comparison",
            kind=flag(),
            about="Whether to hold both inversions against each other, as compare does: "
            "comparison.json, .svg and .png.",
            default=False,
        ),
        Key(
            name="level",
            kind=choice("slope", "envelope", "exact"),
            about="With comparison: the sharpest bound to compute; exact takes its time.",
            otherwise='"envelope"',
            example="envelope",
        ),
        Key(
            name="scene",
            kind=written_name(or_none=True),
            about="A page with the robot moving, such as scene.html (extra 'meshcat').",
            default="",
        ),
    ),
)

EXPORT = Table(
    name=("export",),
    about="Requests for robots, as request-planner export writes them; a table for each file.",
    keys=(
        Key(
            name="format",
            kind=choice("csv", *ROS, "lerobot"),
            about="What to write; yaml, bag, mcap and lerobot need their extras.",
            example="csv",
            set_to="csv",
            required=True,
        ),
        Key(
            name="file",
            kind=written_name(),
            about="Where, inside the folder; bag, mcap and lerobot are folders themselves.",
            example="controller.csv",
            set_to="controller.csv",
            required=True,
        ),
        Key(
            name="cycles",
            kind=whole(least=1, most=10**6),
            about="How often to go through the requests.",
            default=1,
        ),
        Key(
            name="rate_hz",
            kind=number(above=0.0),
            about="Rows per second.",
            otherwise="one row per request",
            example=125.0,
        ),
        Key(
            name="between",
            kind=choice("hold", "linear"),
            about="With rate_hz: hold each request, or go to the next in a straight line.",
            otherwise='"hold"',
            example="hold",
        ),
        Key(
            name="joint_names",
            kind=several(text(), "names of joints"),
            about="The joints' names on the robot, in the order of the columns.",
            otherwise="those of the path",
            example=["lf_1", "lf_2", "lf_3"],
        ),
        Key(
            name="unit",
            kind=choice("rad", "deg", "ticks"),
            about="csv: unit of the columns.",
            otherwise='"rad"',
            example="rad",
        ),
        Key(
            name="ticks_per_turn",
            kind=whole(least=2, most=10**9 - 1),
            about="csv in ticks: ticks of a turn.",
            otherwise="4096",
            example=4096,
        ),
        Key(
            name="zero_tick",
            kind=whole(least=1 - 10**9, most=10**9 - 1),
            about="csv in ticks: the tick at angle 0.",
            otherwise="2048",
            example=2048,
        ),
        Key(
            name="zero_ticks",
            kind=by_name(whole(least=1 - 10**9, most=10**9 - 1), "ticks by joint"),
            about="csv in ticks: the same for single joints.",
            example={"knee": 2048},
        ),
        Key(
            name="lead_s",
            kind=number(least=0.0),
            about="yaml, bag, mcap: time in which the controller leads the joints to the first.",
            otherwise="0.0",
            example=2.0,
        ),
        Key(
            name="velocities",
            kind=flag(),
            about="yaml, bag, mcap: whether points carry velocities, and become splines.",
            otherwise="false",
            example=False,
        ),
        Key(
            name="topic",
            kind=text("the name of a topic"),
            about="bag, mcap: the topic.",
            otherwise='"/joint_trajectory_controller/joint_trajectory"',
            example="/joint_trajectory_controller/joint_trajectory",
        ),
        Key(
            name="task",
            kind=text(),
            about="lerobot: what the episode shows, in words.",
            otherwise='"follow the planned requests"',
            example="follow the planned requests",
        ),
    ),
    repeated=True,
)
