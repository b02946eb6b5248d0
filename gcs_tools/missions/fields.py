"""What the values of a mission file may be: numbers, ranges, vectors."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

from fcu.interface.parameter import not_one_of

# Hz: those from 100 to 1000 whose period is a whole number of microseconds
RATES = tuple(rate for rate in range(100, 1001) if 1_000_000 % rate == 0)


class Table(BaseModel):
    """One table: nothing but the keys below, numbers that are numbers and finite."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_by_name=False
    )


def wrong(key: tuple[str | int, ...], expected: str, got: Any = None) -> PydanticCustomError:
    """What a check across keys raises: the key at fault below the table checked."""
    return PydanticCustomError(
        "mission", "{expected}", {"key": key, "expected": expected, "got": got}
    )


def because(key: tuple[str | int, ...], why: str) -> PydanticCustomError:
    """What a check raises that is told in its own words: the key at fault below the table checked."""
    return PydanticCustomError("because", "{why}", {"key": key, "why": why})


def one_line(text: str) -> str:
    """Check a text that terminals show: one line, without control characters. Raises a PydanticCustomError."""
    if not text.isprintable():
        raise wrong((), "one line of text without control characters", text)
    return text


def _whole(value: Any) -> Any:
    """500.0 as 500: a rate on a command line is a float."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _rate(value: int) -> int:
    if value not in RATES:
        raise wrong((), f"one of {', '.join(map(str, RATES))} Hz", value)
    return value


def three(value: Any) -> Any:
    """One number for all three axes."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return [value] * 3 if number else value


def one_of(*words: str) -> BeforeValidator:
    """Says which words there are, before a Literal of them does in its own way."""

    def check(value: Any) -> Any:
        if value not in words:
            raise wrong((), not_one_of(words, value).removeprefix("expected "))
        return value

    return BeforeValidator(check)


# of any number, in its unit: more is no quantity of a vehicle, and its square, or a step of the
# simulation from it, may be infinite
MOST = 1e9
Number = Annotated[float, Field(ge=-MOST, le=MOST)]
Positive = Annotated[float, Field(gt=0.0, le=MOST)]
NotNegative = Annotated[float, Field(ge=0.0, le=MOST)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
# TOML has arrays only: lax about that (and that alone), so that values cannot be changed
Numbers = Annotated[tuple[Number, Number, Number], Field(strict=False)]
NotNegatives = Annotated[tuple[NotNegative, NotNegative, NotNegative], Field(strict=False)]
Positives = Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
Position = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Rate = Annotated[
    int,
    BeforeValidator(_whole),
    AfterValidator(_rate),
    WithJsonSchema({"type": "integer", "enum": list(RATES)}),
]
ZERO = (0.0, 0.0, 0.0)


def optional(description: str) -> Any:
    """A key that may be left out, without a default of its own."""
    return Field(None, description=description)
