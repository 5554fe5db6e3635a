"""`tactile feel THING`: a policy feels out anything, and shows what it found after each ray."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactile_core.errors import TactileError

if TYPE_CHECKING:
    from upath import UPath

    from tactile_core.evaluation.replay import Rollout
    from tactile_core.exploration.world.state import Cast

BAR = 30  # characters of a Jaccard index of 100


@click.command()
@click.argument("thing")
@click.option("--policy", "name", default="recall", show_default=True, metavar="NAME",
              help="Who chooses the rays: a rule (random, even, coverage, uncertainty, oracle) or "
              "a trained policy.")  # fmt: skip
@click.option("--rays", default=10, show_default=True, type=click.IntRange(1, 100),
              help="How many rays it casts.")  # fmt: skip
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0, 2**32 - 1),
              help="Of a generated shape, and of what the policy draws.")  # fmt: skip
@click.option("--out", default="run.gif", show_default=True, type=click.Path(path_type=Path),
              help="Where the animation goes.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, for programs.")
def feel(thing: str, name: str, rays: int, seed: int, out: Path, as_json: bool) -> None:
    """Feel out THING: a mesh, a picture of a shape, or a class (mug, bottle).

    It is hidden from the policy, which casts rays and gets the first point that each one touches.
    The Jaccard index says how well the U-Net's reconstruction from these touches covers the shape,
    0 to 100. U-Net and policy are those of the last finished run in the home or, without one, those
    that the package ships.
    """
    if sys.stderr.isatty():  # PyTorch takes seconds to load
        click.echo("Loading the U-Net and the policy …", err=True)
    from tactile_core.dataset.things import find_thing
    from tactile_core.evaluation.replay import feel_out
    from tactile_core.exploration.acting import find_policy
    from tactile_core.exploration.at_hand import POLICIES, UNET, at_hand
    from tactile_core.figures.animation import rollout_gif
    from tactile_core.files import written_whole
    from tactile_core.reconstruction.inference import Reconstructor
    from tactile_core.reconstruction.trained import load_unet

    if out.suffix.lower() != ".gif":
        raise TactileError(f"--out {out}: an animation is a GIF, call it *.gif")
    try:
        in_the_way = out.is_dir() or (out.parent.exists() and not out.parent.is_dir())
    except OSError as error:
        raise TactileError(f"--out {out} cannot be written ({error.strerror})") from error
    if in_the_way:
        raise TactileError(f"--out {out}: a folder has that name, or a file that of its folder")
    artifacts = at_hand(UNET, POLICIES)
    unet = load_unet(artifacts / "unet")
    found = find_thing(thing, unet.resolution, seed)
    reconstructor = Reconstructor(unet)
    policy = find_policy(name, reconstructor)
    known = found.geometry in set(unet.trained_on["geometry"])
    say = quiet if as_json else click.echo
    say(f"{thing}: {found.said}.")
    if known:
        say("The U-Net was trained on this very object: it has it easier than with others.")
    say(f"{name} feels it out with {weights_said(artifacts)}.\n")
    say("ray  touch            Jaccard")
    rollout = feel_out(
        policy, found.mask, reconstructor, rays, seed, lambda ray, cast: say(row(ray, cast))
    )
    try:
        with written_whole(out) as file:
            file.write(rollout_gif(replace(rollout, category=found.category)))
    except OSError as error:
        raise TactileError(f"--out {out} cannot be written ({error.strerror})") from error
    if as_json:
        click.echo(json.dumps(told(rollout, thing, found.said, known, artifacts, out), indent=2))
    else:
        touches = len({tuple(touch) for touch in rollout.touches if touch[0] >= 0})
        held = "1 touch" if touches == 1 else f"{touches} touches"
        say(f"\n{held}, Jaccard {rollout.jaccard[-1]:.1f}. {out} shows it.")


def row(ray: int, cast: "Cast") -> str:
    """What one ray did, as a line of the table."""
    touch, jaccard = cast.touches[0].tolist(), float(cast.jaccard[0])
    met = "missed" if cast.missed[0] else f"{tuple(touch)}{' again' if cast.repeated[0] else ''}"
    return f"{ray:3}  {met:15}  {jaccard:7.1f}  {'█' * round(BAR * jaccard / 100)}".rstrip()


def quiet(line: str) -> None:
    """Says nothing."""


def weights_said(artifacts: "UPath") -> str:
    """Whose weights these are, in words."""
    from tactile_core.exploration.pretrained import FOLDER, provenance

    if Path(artifacts.path) != FOLDER:
        return f"the weights of the last run in {artifacts}"
    made = provenance().made
    return f"the weights that the package ships (profile {made['profile']}, {made['started']})"


def told(
    rollout: "Rollout", thing: str, said: str, known: bool, artifacts: "UPath", out: Path
) -> dict[str, Any]:
    """The whole for programs; pixels are [row, column]."""
    rays = [
        {
            "ray": number,
            "from": ends[:2].tolist(),
            "to": ends[2:].tolist(),
            "touch": touch.tolist() if touch[0] >= 0 else None,
            "jaccard": round(jaccard, 4),
        }
        for number, (ends, touch, jaccard) in enumerate(
            zip(rollout.rays, rollout.touches, rollout.jaccard, strict=True), start=1
        )
    ]
    return {
        "thing": thing,
        "said": said,
        "trained_on": known,
        "policy": rollout.policy,
        "weights": str(artifacts),
        "resolution": len(rollout.mask),
        "rays": rays,
        "picture": str(out),
    }
