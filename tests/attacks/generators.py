"""Files and texts that are nearly right: one change, or several, of something valid.

Each function takes a random generator and returns the same for the same seed.
"""

from __future__ import annotations

import math
import random
import re
import struct
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import click
import pymavlink.dialects.v20.common as mavlink
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

# --- texts

NUMBERS = (
    "0", "-0.0", "1", "-1", "0.5", "3", "1e-9", "1e9", "1e300", "-1e308", "1e-320", "1e400", "inf",
    "-inf", "nan", "9" * 20, "9" * 400, "0x7fffffff", "2147483648", "4294967296", "1_000", "007",
    "9223372036854775808", "499.9", "500.1", "1e-3", "100.0", "1000.0", "10001.0", "3600.0", "1e5",
)  # fmt: skip
VALUES = (
    *NUMBERS, '""', '"x"', '"nan"', "true", "false", "[]", "[[]]", "{}", "[0.0]", "[0.0, 0.0]",
    "[0.0, 0.0, 0.0]", "[0.0, 0.0, 0.0, 0.0]", "[[0.0, 0.0, 0.0, 0.0]]", "[nan, 0.0, 0.0]",
    "[1e300, 0.0, 0.0]", '["a", 1]', "{ limit = 1.0 }", "{ limit = nan, from = 1e9 }",
    "{ at_s = 0.0, position_m = [0.0, 0.0, 1.0] }", "1979-05-27T07:32:00Z", "07:32:00",
    '"../../etc/passwd"', '"\\u0000"', "'''\n'''", '"\U0001f681"', '"govern"', '"refuse"', '"mmrac"',
)  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
_KEY = re.compile(r"^\s*([\w.]+)\s*=", re.M)
_VALUE = re.compile(r"=[ \t]*([^\n#{\[]+|\[[^\n]*\]|\{[^\n]*\})")


def _replaced(text: str, found: re.Match[str] | None, new: str, group: int = 0) -> str:
    return text if found is None else text[: found.start(group)] + new + text[found.end(group) :]


def _one(rng: random.Random, pattern: re.Pattern[str], text: str) -> re.Match[str] | None:
    found = list(pattern.finditer(text))
    return rng.choice(found) if found else None


def _a_number(rng: random.Random, text: str, _others: Sequence[str]) -> str:
    return _replaced(text, _one(rng, _NUMBER, text), rng.choice(NUMBERS))


def _a_nearby_number(rng: random.Random, text: str, _others: Sequence[str]) -> str:
    found = _one(rng, _NUMBER, text)
    if found is None:
        return text
    factor = rng.choice((0.0, -1.0, 0.1, 0.5, 0.99, 1.01, 2.0, 10.0, 100.0))
    return _replaced(text, found, repr(float(found[0]) * factor))


def _a_value(rng: random.Random, text: str, _others: Sequence[str]) -> str:
    return _replaced(text, _one(rng, _VALUE, text), rng.choice(VALUES), 1)


def _a_key(rng: random.Random, text: str, others: Sequence[str]) -> str:
    names = _KEY.findall(rng.choice(others)) or ["x"]
    new = rng.choice([rng.choice(names), "x", "a.b.c", '""', "flight", "at_s", "law.f_m"])
    return _replaced(text, _one(rng, _KEY, text), new, 1)


def _a_line(rng: random.Random, text: str, others: Sequence[str]) -> str:
    lines = text.splitlines()
    at = rng.randrange(len(lines) + 1)
    match rng.randrange(5):
        case 0:
            del lines[at : at + 1]
        case 1:
            lines[at:at] = lines[at - 1 : at]
        case 2:
            other = rng.randrange(len(lines) + 1)
            lines.insert(other, lines.pop(min(at, len(lines) - 1)))
        case 3:
            lines.insert(at, rng.choice(rng.choice(others).splitlines()))
        case _:
            tables = ("flight", "law", "wind", "plant", "expect", "x", "flight.start", "[faults]")
            lines.insert(at, f"[{rng.choice(tables)}]")
    return "\n".join(lines) + "\n"


def _characters(rng: random.Random, text: str, _others: Sequence[str]) -> str:
    at = rng.randrange(len(text) + 1)
    until = at + rng.choice((0, 0, 1, 1, 2, 10, 100))
    new = "".join(rng.choice('[]{}=.,"\'#\n\\ eE+-_0\t\0\x7f\ufeffé\U0001f681') for _ in range(rng.randrange(4)))  # fmt: skip
    return text[:at] + new + text[until:]


def _a_table_of_another(rng: random.Random, text: str, others: Sequence[str]) -> str:
    tables = re.split(r"(?m)^(?=\[)", rng.choice(others))
    own = re.split(r"(?m)^(?=\[)", text)
    own.insert(rng.randrange(len(own) + 1), rng.choice(tables))
    return "".join(own)


TEXT_MUTATIONS: tuple[Callable[[random.Random, str, Sequence[str]], str], ...] = (
    _a_number, _a_number, _a_nearby_number, _a_nearby_number, _a_value, _a_value, _a_key, _a_line,
    _characters, _a_table_of_another,
)  # fmt: skip


def mission(rng: random.Random, originals: Sequence[str]) -> bytes:
    """A mission file with one to four changes; now and then its bytes are changed as well."""
    text = rng.choice(originals)
    for _ in range(rng.choice((1, 1, 2, 4))):
        text = rng.choice(TEXT_MUTATIONS)(rng, text, originals)
    data = text.encode("utf-8", "surrogatepass")
    return flipped(rng, data) if rng.random() < 0.05 else data


# --- bytes


def flipped(rng: random.Random, data: bytes) -> bytes:
    """One to four places changed: bits, runs of zeros, lengths, pieces cut out, moved or repeated."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not out:
            return bytes(out)
        at = rng.randrange(len(out))
        size = rng.choice((1, 2, 8, 9, 64, 1000, 100_000))
        match rng.randrange(7):
            case 0:
                out[at] ^= 1 << rng.randrange(8)
            case 1:
                out[at : at + size] = rng.randbytes(len(out[at : at + size]))
            case 2:
                out[at : at + size] = bytes(len(out[at : at + size]))
            case 3:
                del out[at : at + size]
            case 4:
                del out[at:]
            case 5:
                other = rng.randrange(len(out))
                out[other:other] = out[at : at + size]
            case _:
                number = rng.choice(
                    (0, 1, 255, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1, len(out))
                )
                out[at : at + 8] = struct.pack("<Q", number)
    return bytes(out)


def recording(rng: random.Random, originals: Sequence[bytes]) -> bytes:
    """A recording with changed bytes, changed records or changed contents of its messages."""
    data = rng.choice(originals)
    match rng.randrange(4):
        case 0:
            return flipped(rng, data)
        case 1:
            return _other_records(rng, data)
        case _:
            return _written_again(rng, data)


_MAGIC = b"\x89MCAP0\r\n"


def _other_records(rng: random.Random, data: bytes) -> bytes:
    """Whole records left out, repeated, moved, of another kind or length."""
    records, at = [], len(_MAGIC)
    while at + 9 <= len(data) - len(_MAGIC):
        kind, size = struct.unpack_from("<BQ", data, at)
        records.append((kind, data[at + 9 : at + 9 + size]))
        at += 9 + size
    for _ in range(rng.choice((1, 2, 4))):
        if not records:
            break
        n = rng.randrange(len(records))
        kind, content = records[n]
        match rng.randrange(5):
            case 0:
                del records[n]
            case 1:
                records.insert(rng.randrange(len(records)), (kind, content))
            case 2:
                records[n] = (rng.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 128, 255)), content)
            case _:
                records[n] = (kind, flipped(rng, content))
    body = b"".join(
        struct.pack("<BQ", kind, len(content) if rng.random() > 0.01 else rng.choice((0, 2**63)))
        + content
        for kind, content in records
    )
    return _MAGIC + body + _MAGIC


def _written_again(rng: random.Random, data: bytes) -> bytes:
    """A whole file with good checksums, of other schemas, channels, metadata or messages.

    Of a truncated original: what can be read of it.
    """
    out = BytesIO()
    writer = Writer(out, compression=rng.choice(list(CompressionType)), chunk_size=1 << 18)
    writer.start(rng.choice(("", "m-mrac", "x")), rng.choice(("", "m-mrac 1", "\0")))
    chance = rng.choice((0.0, 0.001, 0.02, 0.2))
    target = rng.randrange(6)

    def changed(n: int, value: Any) -> Any:
        if target != n or rng.random() < 0.5:
            return value
        if isinstance(value, bytes):
            return flipped(rng, value)
        if isinstance(value, str):
            if value[:1] in "{[0123456789" and rng.random() < 0.8:
                return _replaced(value, _one(rng, _NUMBER, value), rng.choice(VALUES))
            return rng.choice((value[: len(value) // 2], value * 2, "", "\0", "/x", "[" * 3000))
        return rng.choice((0, 1, 2**63, value // 2, 2 * value)) % 2**64

    schemas, channels = {0: 0}, {}
    reader = make_reader(BytesIO(data))
    try:
        for found in reader.iter_metadata():
            fields = {key: changed(0, value) for key, value in found.metadata.items()}
            if target == 0 and fields and rng.random() < 0.3:
                del fields[rng.choice(list(fields))]
            writer.add_metadata(
                changed(0, found.name) if rng.random() < 0.2 else found.name, fields
            )
        for file in reader.iter_attachments():
            writer.add_attachment(
                file.create_time, file.log_time, changed(1, file.name), file.media_type,
                changed(1, file.data),
            )  # fmt: skip
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    changed(2, schema.name), schema.encoding, changed(2, schema.data)
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    changed(3, channel.topic), changed(3, channel.message_encoding),
                    schemas.get(channel.schema_id, 0), channel.metadata,
                )  # fmt: skip
            content, log_time = message.data, message.log_time
            if target == 4 and rng.random() < chance:
                content = flipped(rng, content)
            if target == 5 and rng.random() < chance:
                if rng.random() < 0.3:
                    continue
                log_time = changed(5, log_time)
            writer.add_message(channels[channel.id], log_time, content, message.publish_time)
    except Exception:  # of a truncated original, or a changed one that cannot be written
        pass
    writer.finish()
    return out.getvalue()


def result(rng: random.Random, text: str) -> bytes:
    """A result.json with other values, or other bytes."""
    for _ in range(rng.choice((1, 1, 3))):
        match rng.randrange(3):
            case 0:
                new = rng.choice(
                    ("null", "NaN", '"x"', "[]", "{}", "true", "1e999", "-1", "9" * 500)
                )
                text = _replaced(text, _one(rng, re.compile(r'(?<=": )[^,\n]+'), text), new)
            case 1:
                text = _replaced(text, _one(rng, re.compile(r'"\w+"(?=:)'), text), '"x"')
            case _:
                text = _characters(rng, text, ())
    return text.encode("utf-8", "surrogatepass")


# --- command lines

WORDS = (
    "", " ", "-", "--", "---", "-1", "0", "1", "9", "10", "1e9", "nan", "inf", "-inf", "max", "1..3",
    "3..1", "0..99999", "x", "x.toml", "x.mcap", ".", "..", "no/such/x",
    "hover.toml", "run", "run/flight.mcap", "run/result.json", "out", "out/", "bad.toml", "é\u2028",
    "\U0001f681", "a" * 5000, "{}", "[", "%s", "$(x)", "*", "flight.duration_s=0.1", "flight.x=1",
    "flight.duration_s=nan", "law.f_m=-1", "law.f_m=1e400", "=", "a=b", ".=", "law.guard=\"govern\"",
    "noise.seed=1", "wind.steady_m_s=[1,2,3]", "47.4,8.5,488", "91,0,0", "a,b,c", "overview", "all",
    "full", "light", "none", "always", "never", "failed", "px4", "generic", "both", "sim", "mmrac",
    "tests", "law.py", "\udcff",
)  # fmt: skip

MISSIONS = ("hover.toml", "gust_step", "paper_fast", "bad.toml", "no_such_mission", "law.py", "run")
RUNS = ("run", "run/flight.mcap", "run/result.json", "cut.mcap", "bad.mcap", "hover.toml", "out")
NUMBER = re.compile(r"[\d.]+")


def command_line(rng: random.Random, group: click.Group, instance: int) -> list[str]:
    """A subcommand of `group` with arguments and options, each fitting, or not.

    instance : the only one that is named where a vehicle could be met.
    """
    name = rng.choice(group.list_commands(click.Context(group)))
    command = group.get_command(click.Context(group), name)
    if command is None or rng.random() < 0.02:
        return [rng.choice(WORDS), *rng.choices(WORDS, k=rng.randrange(3))]
    if isinstance(command, click.Group):
        return [name, *command_line(rng, command, instance)]
    words = []
    options = [p for p in command.params if isinstance(p, click.Option) and not p.hidden]
    for each in rng.choices(options, k=rng.randrange(4)):
        if each.name != "instance":
            words.append(rng.choice([*each.opts, *each.secondary_opts]))
            if not each.is_flag:
                words.append(_value(rng, each))
    if any(each.name == "instance" for each in options):
        wrong = [word for word in WORDS if not NUMBER.fullmatch(word)]
        at = str(instance) if rng.random() < 0.9 else rng.choice(wrong)
        words += ["--instance", at]
    for each in command.params:
        if isinstance(each, click.Argument):
            few = rng.choice((1, 1, 1, 2, 3)) if each.nargs == -1 else 1
            fit = MISSIONS if "mission" in str(each.name) else RUNS
            for _ in range(few):
                fitting = repr(rng.uniform(-9, 9)) if each.type is click.FLOAT else rng.choice(fit)
                words.append(fitting if rng.random() < 0.8 else rng.choice(WORDS))
    if rng.random() < 0.1:
        words.append(rng.choice(WORDS))
    if rng.random() < 0.1 and words:
        del words[rng.randrange(len(words))]
    fast = {"fly": ["--set", "flight.duration_s=0.2"], "view": ["--no-open"]}
    return [name, *fast.get(name, []), *words]


def _value(rng: random.Random, option: click.Parameter) -> str:
    """For an option: of its choices, of its kind, or of no kind at all."""
    if rng.random() < 0.4:
        return rng.choice(WORDS)
    if isinstance(option.type, click.Choice):
        return str(rng.choice(option.type.choices))
    if "INT" in str(option.type).upper() or "FLOAT" in str(option.type).upper():
        return rng.choice(
            ("0", "1", "2", "3.5", "90", "500", "-1", "1e300", "1e-300", "nan", "inf")
        )
    return rng.choice((*MISSIONS, *RUNS, *WORDS))


# --- messages

EXTREMES = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 1e9, 0.5)
PARAMETERS = (
    b"MR_GAMMA",
    b"MR_GUARD",
    b"MR_F_M",
    b"MAV_TYPE",
    b"MAV_SYS_ID",
    b"COM_OF_LOSS_T",
    b"",
)


def message(
    rng: random.Random, kind: type, system: int, names: Sequence[bytes], commands: Sequence[int]
) -> mavlink.MAVLink_message:
    """One of pymavlink's messages with random fields, as a rule for this system.

    names : parameters that it has.  commands : those that it knows.
    """
    fields = []
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    for name, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        count = lengths[name]
        if type_ == "char":
            known = rng.choice((*names, *PARAMETERS)) if rng.random() < 0.8 else b""
            fields.append((known or rng.randbytes(count))[:count])
        elif name in ("target_system", "target") and rng.random() < 0.9:
            fields.append(system)
        elif name == "target_component" and rng.random() < 0.9:
            fields.append(rng.choice((0, 1)))
        elif name == "command" and not count and rng.random() < 0.9:
            fields.append(rng.choice(commands))
        elif count:
            fields.append([_number(rng, type_) for _ in range(count)])
        else:
            fields.append(_number(rng, type_))
    return kind(*fields)


_BITS = re.compile(r"(u?)int(\d+)_t")


def _number(rng: random.Random, type_: str) -> float:
    found = _BITS.match(type_)
    if found is None:
        if rng.random() < 0.5:
            return rng.choice(EXTREMES)
        return rng.uniform(-1, 1) * 10.0 ** rng.randrange(-3, 8)
    bits, signed = int(found[2]), not found[1]
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return rng.choice(
        (low, high, 0, 1, 4, 6, rng.randint(low, high), rng.randint(0, min(high, 300)))
    )
