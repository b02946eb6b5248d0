"""Plans, fences and rally points with wrong items, uploaded over a link that loses and repeats.

    python -m tests.attacks.plans --plans 10000

Whatever is sent, the vehicle has afterwards either the whole of it or what it had before. It goes on
answering, and its memory stays level.
"""

from __future__ import annotations

import argparse
import math
import random
import resource
from collections import Counter

import pymavlink.dialects.v20.common as mavlink

from tests.services.test_plan_protocol import FENCE, MISSION, RALLY, Client, item

COMMANDS = {
    MISSION: [16, 17, 18, 19, 20, 21, 22, 31, 93, 112, 114, 115, 177, 178, 179, 189, 195, 197, 201, 206, 211, 84, 0, 65535],
    FENCE: [5000, 5001, 5002, 5003, 5004, 16],
    RALLY: [5100, 16],
}  # fmt: skip
NUMBERS = [0.0, 1.0, 2.0, 3.0, 4.0, -1.0, 1e9, -1e9, 1e38, math.nan, math.inf, -math.inf, 0.5]
HEIGHTS = [0.0, 5.0, 10.0, -50.0, -200.0, 1e5, math.nan, math.inf]
FRAMES = [0, 3, 5, 6, 2, 1, 10, 255]


def drawn(rng, kind):
    """The items of an upload: good ones, of which some are wrong."""
    wrong = rng.choice([0.0, 0.05, 0.3])
    items = []
    for n in range(rng.randint(0, 12)):
        command = {MISSION: 16, FENCE: 5003, RALLY: 5100}[kind]
        params, frame, z = [5.0, 0.0, 0.0, math.nan], 6, 10.0
        if rng.random() < 0.5:
            command = rng.choice(COMMANDS[kind])
        if rng.random() < wrong:
            params = [rng.choice(NUMBERS) for _ in range(4)]
        if rng.random() < wrong:
            frame = rng.choice(FRAMES)
        if rng.random() < wrong:
            z = rng.choice(HEIGHTS)
        far = rng.choice([10.0, 100.0, 1000.0, 1e5, 1e7]) if rng.random() < wrong else 50.0
        made = item(n, command, *params, z=z, frame=frame, kind=kind)
        scatter = round(far * 90.0)
        made.x = max(-(2**31), min(2**31 - 1, made.x + rng.randint(-scatter, scatter)))
        made.y = max(-(2**31), min(2**31 - 1, made.y + rng.randint(-scatter, scatter)))
        items.append(made)
    return items


def held(client, kind):
    vehicle = client.vehicle
    found = {MISSION: vehicle.mission.steps, FENCE: vehicle.fence.areas, RALLY: vehicle.rally}
    return found[kind], client.station._plans.stored.items[kind]


def attack(seed, plans, memory=None):
    """The results of so many uploads, counted. Raises AssertionError for half a plan."""
    rng, client, results = random.Random(seed), Client(), Counter()
    for number in range(plans):
        kind = rng.choice([MISSION, MISSION, FENCE, RALLY])
        items, before = drawn(rng, kind), held(client, kind)
        part = rng.choice([0.0, 0.0, 0.2])
        result = client.upload(items, kind, lose=lambda part=part: rng.random() < part)
        results["given up" if result is None else mavlink.enums["MAV_MISSION_RESULT"][result].name] += 1  # fmt: skip
        after = held(client, kind)
        if result == mavlink.MAV_MISSION_ACCEPTED:
            assert len(after[1]) == len(items)
            assert kind != MISSION or len(after[0]) == len(items)
        elif result is not None:
            assert after == before, f"plan {number} of seed {seed}: half a plan"
        if rng.random() < 0.2:  # and it flies what it has
            client.vehicle.select(client.vehicle.mode.MISSION, 0, client.now)
        if memory is not None and number % (plans // 4 or 1) == 0:
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
        client.logged.clear()  # the test's own: the vehicle's memory is measured
        client.now += rng.choice([0.01, 0.1, 7.0])
    (count,) = (
        m for m in client.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0), client.now)
        if m.get_type() == "MISSION_COUNT"
    )  # fmt: skip
    assert count.count == len(client.vehicle.mission.steps)
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    memory = []
    results = attack(options.seed, options.plans, memory)
    for name, count in results.most_common():
        print(f"{count:7d}  {name}")
    print("memory, MB:", *memory)


if __name__ == "__main__":
    main()
