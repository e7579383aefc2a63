"""`featherfx lab motion`: how the joints of a shot move, and its wings beat."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

import click

from featherfx.cli.lab.show import plain
from featherfx.cli.options import presets_option
from featherfx.cli.program import Command, print_json


@click.command(
    cls=Command,
    epilog="""
    featherfx lab motion samples/swan_wing/shot.toml
    featherfx lab motion samples/swan_wing/shot.toml --json
    """,
)
@click.argument("shot", type=click.Path(path_type=Path))
@presets_option
@click.option("--json", "as_json", is_flag=True, help="All joints by frame, SI units, radians.")
def motion(shot: Path, preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """Print how the joints of a shot move.

    A line a frame and wing: elevation, sweep, twist, elbow and wrist in degrees, the fan of the
    hand (1 open, 0 folded), and the span over the largest one of the shot. --json has joints, too:
    position (m) and rotation (quaternion w, x, y, z), and the share of a beat in which a wing
    falls.
    """
    from featherfx.api import read_shot
    from featherfx.shot.motion.joint_tracks import find_tracks, frame_rows, rate_lines

    read = read_shot(shot, preset_folders)
    tracks = find_tracks(read)
    rows = list(frame_rows(read, tracks))
    if as_json:
        print_json(plain({"frames": rows, "rates": tracks.largest_rates()}))
        return
    for row in rows:
        for side, wing in row["wings"].items():
            click.echo(f"frame {row['frame']:4}  {side:5}  {_angles(wing)}")
    for side, wing in tracks.wings.items():
        share = wing.downstroke
        told = "makes no whole beat" if share is None else f"falls for {share:.0%} of a beat"
        click.echo(f"{side} wing {told}")
    for line in rate_lines(tracks.largest_rates()):
        click.echo(line)


def _angles(wing: dict[str, Any]) -> str:
    bends = ("elevation", "sweep", "twist", "elbow", "wrist")
    angles = "  ".join(f"{name} {degrees(wing[name]):6.1f}" for name in bends)
    return f"{angles}  fan {wing['fan']:.2f}  span {wing['span_ratio']:.3f}"
