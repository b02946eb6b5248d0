"""The live vehicle that a command means: found on the bus or at its ports, or waited for."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_tools.cli.output import Failure

if TYPE_CHECKING:
    from zenoh import Session

    from gcs_tools.flight.ground_script import Vehicle
    from gcs_tools.live.subscriber import Subscriber

ALONE_S = 3.0  # wall: after that who waits with a file of their own is told what for
UNSEEN = "connected, but no vehicle answers, or not to us"

LOOK_S = 0.05  # wall: between two looks for a publisher, or for a flight controller
GREET_S = 1.0  # wall: between two greetings of a vehicle that is not ready


MEET_S = 2.0  # wall: how long at least it may take to meet a vehicle that publishes already


@contextlib.contextmanager
def watched(
    instance: int | None, zenoh: Path | None, timeout_s: float | None = None
) -> Iterator[Subscriber]:
    """A Subscriber to the vehicle that is meant, found and named. Raises Failure when there can be none.

    Of an instance that was asked for it takes no other's data. `timeout_s`: how long it waits for a
    vehicle (wall); one that publishes already has MEET_S at least. None: until there is one.
    """
    from fcu.interface.ports import ports
    from gcs_tools.live import bus
    from gcs_tools.live.subscriber import Subscriber

    due = math.inf if timeout_s is None else time.monotonic() + timeout_s
    who = "a vehicle" if instance is None else f"instance {instance}"
    missing = f"{who} did not publish within {timeout_s or 0.0:g} s (start one: gcs up; longer: --timeout S)"
    try:
        number, there = instance, list[int]()
        if zenoh is None:
            there = bus.published()
            if number not in there if number is not None else not there:
                click.echo(f"waiting for {who} to publish (start one: gcs up) ...", err=True)
            while number is None and not there:
                if time.monotonic() > due:
                    raise Failure(missing)
                time.sleep(LOOK_S)
                there = bus.published()
            number = there[0] if number is None else number
        with bus.session(bus.for_tool(number or 0, zenoh)) as session:
            vehicle = Subscriber(session, "*" if number is None else str(ports(number).system_id))
            try:
                told = _told_when_alone(session, zenoh, number)
                if zenoh is not None or number in there:
                    due = max(due, time.monotonic() + MEET_S)

                def check() -> None:
                    told()
                    if time.monotonic() > due:
                        raise Failure(missing)

                vehicle.find(check)
                _name(vehicle, instance)
                yield vehicle
            finally:
                vehicle.close()
    except bus.BusError as error:
        raise Failure(error, error.exit_code) from error


def up_by(instance: int | None, timeout_s: float) -> tuple[int, float]:
    """The instance that is meant, once it is up, and until when (time.monotonic) it may take to be ready.

    None: the first that runs. `timeout_s`: wall, for both; one that is up has MEET_S at least to be
    ready. Raises Failure when none is up in time.
    """
    from fcu.interface.ports import running_instances

    due, told = time.monotonic() + timeout_s, False
    which = "" if instance is None else f" as instance {instance}"
    while not (there := [n for n in running_instances() if instance in (None, n)]):
        if time.monotonic() >= due:
            raise Failure(
                f"no vehicle is up on this machine{which}"
                f" after {timeout_s:g} s (start one: gcs up; longer: --timeout S)"
            )
        if not told:
            told = True
            click.echo(f"waiting for a vehicle to be up{which} (start one: gcs up) ...", err=True)
        time.sleep(LOOK_S)
    return there[0], max(due, time.monotonic() + MEET_S)


def wait_ready(vehicle: Vehicle, due: float) -> None:
    """Greet a vehicle that is up until it is ready. Raises VehicleError if not before `due`."""
    from gcs_tools.flight.ground_script import VehicleError

    while True:
        try:
            return vehicle.wait_ready(min(GREET_S, max(due - time.monotonic(), 0.0)))
        except VehicleError:
            if time.monotonic() >= due:
                raise VehicleError(
                    "a flight controller is up, but no vehicle is ready (longer: --timeout S)"
                ) from None


def _name(vehicle: Subscriber, asked: int | None) -> None:
    """Say which vehicle was met, and who else is there that it could have been."""
    from fcu.interface.ports import ports
    from gcs_tools.live import bus
    from gcs_tools.live.subscriber import printable

    assert vehicle.key is not None
    run, system = vehicle.key[:2]
    click.echo(f"met vehicle {printable(system)}, run {printable(run)}", err=True)
    others = [
        f"vehicle {printable(of)}, run {printable(its)}" for its, of in sorted(vehicle.others)
    ]
    if asked is None:
        numbers = (n for n in bus.published() if str(ports(n).system_id) != system)
        others += [f"vehicle {ports(n).system_id} (--instance {n})" for n in numbers]
    if others:
        click.echo(f"not met, but there: {'; '.join(others)}", err=True)


def _told_when_alone(
    session: Session, zenoh: Path | None, number: int | None
) -> Callable[[], None]:
    """What says once, to who waits though there is somebody, how far it leads."""
    from gcs_tools.live import bus

    there = zenoh is not None or number in bus.published()
    due = time.monotonic() + ALONE_S if there else math.inf
    where = f"as {zenoh} says" if zenoh is not None else f"instance {number}"
    who = "" if number is None or zenoh is None else f" (as instance {number})"

    def check() -> None:
        nonlocal due
        if time.monotonic() > due:
            due = math.inf
            why = UNSEEN if bus.connected(session) else bus.UNCONNECTED
            click.echo(f"waiting, {where}: {why}{who} ...", err=True)

    return check
