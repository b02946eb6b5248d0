"""Who tries everything on a bus that is not theirs. Arguments: a configuration, run and vehicle.

One session listens and asks, another puts, answers and claims to be a vehicle: neither can take
its own for somebody else's. Says a line when all is declared, and at the end of standard input
what came of it, as JSON.
"""

from __future__ import annotations

import json
import os
import select
import sys

import zenoh

from gcs_tools.live import bus

FORGED = ("fcu/timing", "fcu/law", "plant/truth")  # puts, one each a round
AT_LEAST = 300  # puts


def count(channel) -> int:
    n = 0
    while channel.try_recv() is not None:
        n += 1
    return n


def configured(file: str, mode: str) -> zenoh.Config:
    config = zenoh.Config.from_file(file)
    config.insert_json5("mode", json.dumps(mode))
    return config


def refused(file: str) -> bool:
    """Whether it is turned away at the door: a client gives up, a peer tries again for ever."""
    try:
        with bus.session(configured(file, "client")):
            return False
    except bus.BusError:
        return True


def main(file: str, run: str, vehicle: str) -> None:
    mine = f"{run}/{vehicle}"
    came = dict.fromkeys(("ticks", "tokens", "answers", "asked", "puts"), 0)
    turned_away = refused(file)
    # a peer would put to those alone of whom it has heard that they subscribe
    speaks = configured(file, "peer" if turned_away else "client")
    with bus.session(configured(file, "peer")) as ears, bus.session(speaks) as mouth:
        keys = "m_mrac/**", f"m_mrac/{mine}/**", f"m_mrac/{mine}/fcu/timing", "**"
        data = [ears.declare_subscriber(key, bus.channel()) for key in keys]
        live = [
            ears.liveliness().declare_subscriber(key, bus.channel(), history=True) for key in keys
        ]
        asked = mouth.declare_queryable("m_mrac/**", bus.channel(), complete=True)
        claims = [
            mouth.liveliness().declare_token(f"m_mrac/{key}/alive/fcu") for key in ("0/0", mine)
        ]
        print("trying", flush=True)
        while not select.select([0], [], [], 0.005)[0] or came["puts"] < AT_LEAST:
            for topic in FORGED:
                mouth.put(f"m_mrac/{mine}/{topic}", b"forged")
                came["puts"] += 1
            mouth.delete(f"m_mrac/{mine}/fcu/law")
            while (query := asked.try_recv()) is not None:
                came["asked"] += 1
                with query:
                    query.reply(f"m_mrac/{mine}/about", b'{"schema_version": -1}')
            came["ticks"] += sum(map(count, data))
            came["tokens"] += sum(map(count, live))
        for key in keys:
            came["answers"] += sum(r.ok is not None for r in ears.get(key, timeout=1.0))
            tokens = ears.liveliness().get(key, timeout=1.0)
            came["tokens"] += sum(r.ok is not None for r in tokens)
        came["links"] = bus.connected(ears) and bus.connected(mouth)
        for each in [*data, *live, asked, *claims]:
            each.undeclare()
    print(json.dumps({"refused": turned_away, **came}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)
