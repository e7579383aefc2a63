"""The motion of a shot: a preset, a table over one, or an act of several, one upon the other.

A stage has a clock, which may have other time codes per second than the shot has frames. Then the
key `time` says which of two readings holds:

    "codes"     frame N is time code N
    "seconds"   frame N is time code N T / F, as USD scales the time of layers of other rates

T: time codes per second of the stage. F: frames per second of the shot. Both are one where T and F
differ by less than the rounding of rates such as 24000/1001.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.errors import all_of, warn_input
from featherfx.groom.keys.preset import MOTION_KEYS, SOURCE_KEYS, Clock
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import Either, Number, ValueType
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.read.space import SceneReaders
from featherfx.groom.types import Groom
from featherfx.packages import load_name
from featherfx.shot.frames import MAX_RATE, MIN_RATE, StageClock
from featherfx.shot.motion.joints import BODY_JOINTS
from featherfx.shot.types import Motion

if TYPE_CHECKING:
    from featherfx.shot.sources import MovingSurface, OfScene


DEFAULT_RATE = 24.0  # 1/s, where neither shot nor stage gives one
# of a rate: a quarter of what is between 24 and 24000/1001, above the rounding of 23.98
_RATE_TOLERANCE = 2.5e-4


def _differ(source: OfScene, rate: float) -> bool:
    own = source.time_codes_per_second
    return abs(own - rate) > _RATE_TOLERANCE * rate and source.sampled is not None


def check_rate(source: OfScene, rate: float, at: Place) -> None:
    """Problems where the rates of shot and stage differ."""
    if _differ(source, rate) and source.has_rate:
        at.fail(
            f"{source.path} has {source.time_codes_per_second:g} time codes a second, the shot "
            f'{rate:g} frames_per_second. Give it as many, or time = "codes", frame N is time '
            'code N, or time = "seconds", as USD composes layers of other rates'
        )


@dataclass
class ClockReader:
    """Clocks of the stages of a shot, made in the order in which it reads them.

    first_frame: of the shot. frames_per_second: as given; None: those of the first stage.
    written_rate: time codes per second of what is written, so that it stands on its skin where both
    are composed in one stage.
    """

    first_frame: int
    frames_per_second: float | None
    written_rate: float | None = None

    def clock(self, source: OfScene, entry: dict[str, Any], at: Place) -> StageClock:
        """Make the clock of a stage by keys `time` and `start` of an entry; problems where the
        rates of shot and stage differ and nothing says what a frame is."""
        own = source.time_codes_per_second
        rate = self._rate(own, at)
        differ = _differ(source, rate)
        if entry["time"] is None:
            check_rate(source, rate, at)
        step = own / rate if differ and entry["time"] == "seconds" else 1.0
        if self.written_rate is None:
            self.written_rate = own / step if source.sampled is not None else rate
        start = self.first_frame * step if entry["start"] is None else entry["start"]
        return StageClock(float(start), step, rate)

    def _rate(self, own: float, at: Place) -> float:
        """Return frames per second, given or of a stage with its own time codes per second."""
        if self.frames_per_second is None:
            if not MIN_RATE <= own <= MAX_RATE:
                at.refuse(
                    f"has {own:g} time codes a second, which are no frames. Give frames_per_second "
                    'to the shot and time = "codes" or "seconds" here'
                )
            self.frames_per_second = own
        return self.frames_per_second


# acts within acts
_DEEPEST = 4


def read_motion(
    raw: Any,
    given: Any,
    place: Place,
    library: Library,
    groom: Groom | None,
    readers: SceneReaders | None = None,
    depth: int = 0,
) -> Motion:
    """The motion that a checked key or part describes. Raises InputError.

    raw: as the file has it, so that messages name the key where a base was written. readers: of
    USD scenes.
    """
    table = {"base": given} if isinstance(given, str) else given
    named = not isinstance(raw, dict)
    tree = library.merged("motion", sourced(table, place.source), place, "" if named else "base")
    values, problems = plain(tree), Problems()
    place = replace(place, problems=problems)
    kind = values.pop("kind")
    clock = Clock(**{each.name: values.pop(each.name) for each in fields(Clock)})
    for source in SOURCE_KEYS:
        values.pop(source)
    _check_pairs(place.child("amount"), clock.amount, Number(0.0, 2.0))
    if kind == "act":
        if isinstance(values["planted_feet"], tuple):
            _check_pairs(place.child("planted_feet"), values["planted_feet"], Number(0.0, 1.0))
        at = Place(tree["motions"].source, place.child("motions").key, problems)
        with problems.collecting():
            values["motions"] = _parts(values["motions"], at, library, groom, readers, depth)
    elif kind == "fold":
        _check_later(place.child("folds"), [key["time"] for key in values["folds"]], "time")
    elif kind == "flap":
        _check_flap(values, place)
    elif kind == "keys":
        at = place.child("keyframes")
        given = list(enumerate(values["keyframes"]))
        firsts = {frame["joint"]: index for index, frame in reversed(given)}
        meant = {each: _joints_meant(each, groom, at.item(k)) for each, k in firsts.items()}
        keyframes = [
            (at.item(index), frame | {"joint": joint})
            for index, frame in given
            for joint in meant[frame["joint"]]
        ]
        _check_keyframes(keyframes)
        values["keyframes"] = tuple(frame for _, frame in keyframes)
    elif kind == "curve":
        _joints_meant(values["joint"], groom, place)
        if readers is None:
            place.refuse("is a USD scene. Use featherfx.read_shot, or a command")
        values["source"] = readers.attribute(
            readers.file(Path(place.source).parent, values["usd"]), values, place
        )
    problems.hand_on()
    if groom is not None and clock.fit != "none":
        clock = load_name("motion.flap:fitted")(clock, groom)
    return Motion(kind, values, clock)


def check_rates(motion: Motion, rate: float, place: Place) -> None:
    """Problems where a curve's stage has other time codes a second than the shot has frames, and
    nothing says what a frame is. rate: 1/s, frames."""
    for part in motion.values.get("motions", ()):
        check_rates(part, rate, place)
    if motion.kind == "curve" and motion.values["time"] is None:
        check_rate(motion.values["source"], rate, place)


def warn_of_aliases(motion: Motion, rate: float, source: str, tempo: float = 1.0) -> None:
    """Warn of beats, swings and shakes that are too fast for the frames. rate: 1/s, frames."""
    tempo *= motion.clock.tempo
    if motion.kind == "act":
        for part in motion.values["motions"]:
            warn_of_aliases(part, rate, source, tempo)
    key = {"flap": "wingbeat_frequency", "swing": "frequency", "shake": "frequency"}
    if motion.kind not in key:
        return
    given = motion.values[key[motion.kind]]
    fastest = tempo * (max(each for _, each in given) if isinstance(given, tuple) else given)
    if 2.0 * fastest > rate:
        told = f"{fastest:.3g} {motion.kind}s a second look slower or backwards in {rate:g} frames"
        remedy = f"Give more than {2.0 * fastest:.3g} frames_per_second"
        message = f"{source}: motion.{key[motion.kind]}: {told}. {remedy}"
        warn_input(message)


def warn_of_length(motion: Motion, frames: tuple[int, int], rate: float, source: str) -> None:
    """Warn of a motion that goes on after the last of frames, is over before the first, or has
    keyframes at one time alone. rate: 1/s, frames."""
    (first, last), ends = frames, list(_ends(motion))
    end = first + rate * max((each for each in ends if each < math.inf), default=0.0)
    if end > last + 1.0:
        told = f"goes on until frame {math.ceil(end)}, and the shot ends with frame {last}. Give"
        told += f" frames = [{first}, {math.ceil(end)}], or a higher tempo"
    elif motion.kind == "keys" and not ends:
        told = "has keyframes at one time alone, so that nothing moves. Give others at another time"
    elif ends and max(ends) <= 0.0:
        told = f"is over at frame {end:.4g}, before the first, {first}. Give later times or start"
    else:
        return
    warn_input(f"{source}: motion: {told}")


def _ends(motion: Motion) -> Iterator[float]:
    """Yield when parts of a motion come to their ends, in s; inf: never."""
    values, clock, own = motion.values, motion.clock, list[float]()
    if motion.kind == "act":
        own = [end for each in values["motions"] for end in _ends(each)]
    elif motion.kind in ("keys", "fold"):
        times = [each["time"] for each in values["folds" if motion.kind == "fold" else "keyframes"]]
        own = [max(times)] if max(times) > min(times) else []
    elif (
        motion.kind == "flap"
        and values["beats"]
        and isinstance(values["wingbeat_frequency"], float | int)
    ):
        beats_in_time = load_name("motion.beat:beats_in_time")
        own = [beats_in_time(values["beats"])[1] / values["wingbeat_frequency"]]
    elif motion.kind not in ("hold", "level"):
        own = [math.inf]
    yield from (clock.start + each / clock.tempo for each in own)


def check_driven(
    motion: Motion, groom: Groom, surfaces: Sequence[MovingSurface] | None, place: Place
) -> None:
    """Problems where the map of an act names no joints of the groom, or none of the skin."""
    driven = motion.values["joints"]
    joints = {joint.name for joint in groom.joints} | BODY_JOINTS.keys()
    trees = [tree for each in surfaces or () if (tree := each.joint_tree) is not None]
    if driven and not trees:
        told = "drives the skeleton of a [skin], and the shot has none that a skeleton moves"
        place.fail(f"{told}. Name a skinned mesh or a skeleton there, or leave the map out")
        return
    taken: dict[str, str] = {}
    for own, name in driven.items():
        at, found = place.child(own), {tree.names[k] for tree in trees for k in tree.find(name)}
        if own not in joints:
            at.unknown(f"no joint '{own}' in the groom", own, joints)
        if not found:
            known = {each for tree in trees for each in tree.names}
            known |= {each.rpartition("/")[2] for each in known}
            at.unknown(f"no joint '{name}' in {trees[0].skeleton}", name, known)
        elif len(found) > 1:
            at.fail(f"'{name}' is the end of {', '.join(sorted(found))}. Give one of these paths")
        elif (other := taken.setdefault(next(iter(found)), own)) != own:
            at.fail(f"'{name}' is driven by '{other}' already. Leave one of them out")


def _parts(
    parts: tuple[dict[str, Any], ...],
    place: Place,
    library: Library,
    groom: Groom | None,
    readers: SceneReaders | None,
    depth: int,
) -> tuple[Motion, ...]:
    if depth == _DEEPEST:
        place.refuse(f"acts stand in acts more than {_DEEPEST} deep. Is one a part of itself?")
    read = (
        partial(read_motion, part, part, place.item(index), library, groom, readers, depth + 1)
        for index, part in enumerate(parts)
    )
    return tuple(all_of(*read))


def _check_pairs(place: Place, pairs: Sequence[Sequence[float]], allowed: ValueType) -> None:
    """Times ascend, and values are allowed."""
    _check_later(place, [time for time, _ in pairs])
    for index, (_, value) in enumerate(pairs):
        allowed.check(value, place.item(index).item(1), False)


def _check_flap(values: dict[str, Any], place: Place) -> None:
    """Numbers over time are in their ranges, keys of curves within one beat; series are whole."""
    for name, key in MOTION_KEYS["flap"].items():
        given, at = values[name], place.child(name)
        if isinstance(given, dict):
            usual = ((1.0, 0.0),) if name == "elevation" else ()
            values[name] = {"mean": 0.0, "harmonics": usual} | given
        if not isinstance(key.type, Either) or not isinstance(given, tuple):
            continue
        if dict not in key.type.options:
            _check_pairs(at, given, key.type.options[float])
            continue
        _check_later(at, [phase for phase, _ in given], unit="")
        for index, (phase, _) in enumerate(given):
            if not 0.0 <= phase < 1.0:
                wrong = f"{phase:g} is no phase of a beat. Give 0 to less than 1"
                at.item(index).item(0).fail(wrong)


def _check_later(place: Place, times: list[float], name: str = "", unit: str = " s") -> None:
    """Each time is after the one before it."""
    for index, (before, after) in enumerate(pairwise(times), 1):
        if not after > before:
            at = place.item(index)
            at = at.child(name) if name else at.item(0)
            at.fail(f"{after:g}{unit} is not after {before:g}{unit}, the one before")


def _joints_meant(pattern: str, groom: Groom | None, place: Place) -> list[str]:
    """Names of the joints that a pattern means; a problem where there are none."""
    if groom is None or not pattern:
        return [pattern]
    known = [each.name for each in groom.joints if each.name not in BODY_JOINTS] + [*BODY_JOINTS]
    found = [each for each in known if fnmatchcase(each, pattern)]
    if not found:
        place.child("joint").unknown(f"no joint '{pattern}' in the groom", pattern, known)
    return found


def _check_keyframes(keyframes: list[tuple[Place, dict[str, Any]]]) -> None:
    """Times of one joint ascend, rates and orders are clear. keyframes: with their places."""
    latest: dict[tuple[str, str], float] = {}
    orders: dict[str, str] = {}
    by_quaternion = {each["joint"] for _, each in keyframes if len(each["rotation"] or ()) == 4}
    for at, frame in keyframes:
        joint, time = frame["joint"], frame["time"]
        for what in ("position", "rotation"):
            if frame[what] is None:
                continue
            before = latest.setdefault((joint, what), -math.inf)
            if time == before:
                told = f"{time:g} s has a {what} of this joint already"
                at.child("time").fail(f"{told}. Give another time, or leave one of them out")
            elif time < before:
                told = f"{time:g} s comes after {before:g} s of this joint's {what}"
                at.child("time").fail(f"{told}. Give keyframes in the order of their times")
            latest[joint, what] = time
        rotation = frame["rotation"]
        if rotation is None and frame["position"] is None:
            at.fail("holds neither position nor rotation. Give one of them")
        both = rotation is not None and frame["position"] is not None
        if both and not isinstance(frame["tangents"], str):
            message = "are rates of one curve, but the keyframe holds position and rotation"
            at.child("tangents").fail(f"{message}. Make two keyframes of it")
        turns = rotation is not None and len(rotation) == 3
        if turns and joint in by_quaternion and max(map(abs, rotation)) > 180.0:
            message = "counts turns beside angles only, but another keyframe has a quaternion"
            at.child("rotation").fail(f"{message}. Give angles, or at most 180 degrees")
        if turns and orders.setdefault(joint, frame["order"]) != frame["order"]:
            message = f"is '{frame['order']}' after '{orders[joint]}' of the same joint"
            at.child("order").fail(f"{message}. Give one order for all its keyframes")
        if rotation is not None and len(rotation) == 4 and np.linalg.norm(rotation) < 1e-9:
            at.child("rotation").fail("the quaternion is zero. Give one with a length")
