"""Faults given by hand to a vehicle that is up, by MAV_CMD_INJECT_FAILURE."""

from __future__ import annotations

from typing import NamedTuple

from fcu.interface.faults import NAMES, SPECS
from fcu.mavlink.definitions import CommandId
from fcu.mavlink.failures import ROWS, Type, Unit
from gcs_tools.flight.ground_script import Refused, Vehicle

ENABLES = "SYS_FAILURE_EN"


class Choice(NamedTuple):
    """A fault that a vehicle can be told to have."""

    name: str  # as in [[plant.faults]]
    unit: int  # FAILURE_UNIT
    type: int  # FAILURE_TYPE
    much: float  # by default
    least: float  # of it
    most: float
    what: str  # the number is; empty: there is none
    says: str

    @property
    def range(self) -> str:
        """Least and most of it, with the unit."""
        return f"{self.least:g} to {self.most:g} {self.what}"


def choices() -> list[Choice]:
    """Every fault, under the name that missions have for it."""
    found = {
        NAMES[row.kind]: Choice(
            NAMES[row.kind],
            unit,
            type_,
            row.much,
            row.least,
            row.most,
            row.unit,
            SPECS[NAMES[row.kind]].says,
        )
        for (unit, type_), row in ROWS.items()
    }
    return [found[name] for name in SPECS if name in found]


def give(
    vehicle: Vehicle, name: str, rotor: int, much: float, for_s: float, enable: bool
) -> None:  # fmt: skip
    """Have a vehicle's simulator break something. Raises VehicleError, Refused with the reason.

    name : of a Choice.  rotor : 0: all.  much : 0: as the Choice has it.  for_s : simulation time, 0: until
    it is cleared.  enable : set SYS_FAILURE_EN before.
    """
    chosen = next(each for each in choices() if each.name == name)
    if enable:
        vehicle.set_parameter(ENABLES, 1.0)
    _command(vehicle, chosen.unit, chosen.type, rotor, much, for_s)


def clear(vehicle: Vehicle, rotor: int) -> None:
    """End the faults of a rotor, 0: every fault that a vehicle has. Raises VehicleError, Refused."""
    for unit in (Unit.MOTOR,) if rotor else Unit:
        _command(vehicle, unit, Type.OK, rotor, 0.0, 0.0)


def _command(
    vehicle: Vehicle, unit: int, type_: int, rotor: int, much: float, for_s: float
) -> None:  # fmt: skip
    try:
        vehicle.command(CommandId.INJECT_FAILURE, unit, type_, rotor, much, for_s)
    except Refused as refused:
        hint = " (--enable sets it)" if ENABLES in str(refused) else ""
        raise Refused(f"{refused}{hint}") from refused
