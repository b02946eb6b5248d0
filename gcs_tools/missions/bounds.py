"""What a mission may demand of a metric: a limit or a floor, over all of a flight or a part of it."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from gcs_tools.judging.metrics import FLOOR, FLOORS, METRICS, PARTS
from gcs_tools.missions.fields import NotNegative, Table, one_of, optional, wrong


class Bound(Table):
    """A limit of a metric, over the flight or from a time to a time.

    A number is its `limit`, and of a metric that is a minimum its `at_least`.
    """

    limit: float | None = optional("at most")
    at_least: float | None = optional("at least")
    t_from: NotNegative | None = Field(None, alias="from", description="s")
    t_to: NotNegative | None = Field(None, alias="to", description="s")
    laws_with: Annotated[Literal["guard", "reference"], one_of(*PARTS)] | None = optional(
        "what a law has that this is expected of; it does not apply to the others"
    )

    @model_validator(mode="after")
    def _one_limit(self) -> Self:
        if (self.limit is None) == (self.at_least is None):
            raise wrong((), "either limit or at_least")
        if (self.t_to or math.inf) <= (self.t_from or 0.0):
            raise wrong(("to",), f"a time after from, {self.t_from or 0.0:g}", self.t_to)
        return self


def _bound(value: Any) -> Any:
    """A number as the table that it is short for."""
    if isinstance(value, dict):
        return value
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise wrong((), "a number, or a table { limit or at_least, from, to, laws_with }", value)
    return {"limit": value}


def _floor(value: Any) -> Any:
    """A number as the table that it is short for, of a metric that is a minimum."""
    if isinstance(value, dict) and "limit" in value:
        raise wrong(("limit",), f"at_least ({FLOOR})", value["limit"])
    table = _bound(value)
    return table if table is value else {"at_least": value}


AT_MOST = Annotated[Bound, BeforeValidator(_bound, json_schema_input_type=float | Bound)]
_Floor = Annotated[Bound, BeforeValidator(_floor, json_schema_input_type=float | Bound)]
LIMITS: dict[str, Any] = {
    name: (
        (_Floor | None, optional("a number: at least"))
        if name in FLOORS
        else (AT_MOST | None, optional("a number: at most"))
    )
    for name in METRICS
}
