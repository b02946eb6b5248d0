"""Plans over the wire: taken whole or not at all, given back as they came, whatever is lost."""

from __future__ import annotations

import math
import random

import pymavlink.dialects.v20.common as mavlink
import pytest

from fcu.interface.status_texts import Code
from fcu.mavlink.definitions import MissionType
from fcu.services import plan_items, plan_protocol, station
from fcu.vehicle.mission import Do
from fcu.vehicle.modes import Mode
from tests.services.test_station import AT, Met

LAT, LON, ALT = 47.4, 8.5, 488.0  # the origin of `Met`
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
ACCEPTED, DENIED = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_DENIED
TAKEOFF, WAYPOINT, LAND = 22, 16, 21
JUMP, SPEED = 177, 178


def item(sequence, command=WAYPOINT, *params, north=0.0, east=0.0, z=10.0, frame=RELATIVE, kind=0):
    """An item of the plan that leads so far (m) north and east of the origin."""
    lat = LAT + math.degrees(north / 6_371_000.0)
    lon = LON + math.degrees(east / (6_371_000.0 * math.cos(math.radians(LAT))))
    four = (*params, 0.0, 0.0, 0.0, math.nan)[:4] if len(params) < 4 else params
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, sequence, frame, command, 0, 1, *four, round(lat * 1e7), round(lon * 1e7), z, kind
    )


def without(sequence, axis):
    """A place without its latitude (x) or longitude (y)."""
    left_out = item(sequence)
    setattr(left_out, axis, 0x7FFFFFFF)
    return left_out


def plan(count=4):
    return [
        item(0, TAKEOFF),
        *(item(n, north=10.0 * n, east=3.0 * n) for n in range(1, count - 1)),
        item(count - 1, LAND, z=0.0),
    ]


class Client(Met):
    """A client that uploads and downloads, on a link of its own."""

    def __init__(self):
        super().__init__()
        self.observe()
        self.now = 1.0

    def upload(self, items, kind=MISSION, lose=lambda: False):
        """The result of an upload. None: the vehicle has given it up."""
        answers = self.say(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind), self.now)
        for _ in range(2000):
            for answer in answers:
                if answer.get_type() == "MISSION_ACK":
                    return answer.type
            asked = [m for m in answers if m.get_type().startswith("MISSION_REQUEST")]
            answers = []
            for each in asked:
                if not lose():
                    answers += self.say(items[each.seq], self.now)
            if not answers:
                self.now += 0.3
                self.station.idle(0, self.now, self.now)
                answers = [m for m in self.heard() if not lose()]
        return None

    def download(self, kind=MISSION):
        (count,) = self.say(mavlink.MAVLink_mission_request_list_message(1, 1, kind), self.now)
        found = []
        for n in range(count.count):
            (answer,) = self.say(mavlink.MAVLink_mission_request_int_message(1, 1, n, kind))
            found.append(answer)
        self.say(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
        return found

    def another(self, system=246):
        """Another client, at the port of ground stations."""
        return Other(self, system)


class Other:
    def __init__(self, met, system):
        self.met = met
        self.link = met.network.link(AT.station, AT.fcu_station, "another")
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)

    def say(self, message):
        self.link.send(message.pack(self.mav))
        self.met.station.serve(self.met.station.station, 0, self.met.now)
        messages = []
        while (datagram := self.link.receive()) is not None:
            messages += mavlink.MAVLink(None).parse_buffer(bytearray(datagram))
        return [each for each in messages if each.get_type() != "STATUSTEXT"]


@pytest.fixture
def client():
    return Client()


def fields(message):
    return {k: v for k, v in message.to_dict().items() if k not in ("current", "target_system", "target_component", "mavpackettype")}  # fmt: skip


def test_a_download_gives_back_what_was_uploaded(client):
    items = plan(7)
    assert client.upload(items) == ACCEPTED
    assert len(client.vehicle.mission.steps) == 7
    for sent, given in zip(items, client.download(), strict=True):
        sent, given = fields(sent), fields(given)
        for name, value in sent.items():
            same = given[name] == value or (math.isnan(value) and math.isnan(given[name]))
            assert same, name


def test_an_old_client_is_asked_for_floats(client):
    """It knows MISSION_REQUEST and MISSION_ITEM alone."""
    answers = client.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0), client.now)
    assert answers[0].get_type() == "MISSION_REQUEST_INT"  # which it does not answer
    client.now += 0.3
    client.station.idle(0, client.now, client.now)
    heard = [m.get_type() for m in client.heard()]
    assert "MISSION_REQUEST" in heard
    for n in range(2):
        old = mavlink.MAVLink_mission_item_message(1, 1, n, 3, 16, 0, 1, 0, 0, 0, math.nan, LAT, LON, 9.0)  # fmt: skip
        answers = client.say(old, client.now)
        kind = "MISSION_REQUEST" if n == 0 else "MISSION_ACK"
        assert [m.get_type() for m in answers] == [kind]
    assert answers[0].type == ACCEPTED
    request = mavlink.MAVLink_mission_request_message(1, 1, 1, 0)
    (given,) = client.say(request, client.now)
    assert given.get_type() == "MISSION_ITEM"
    assert (given.x, given.z) == (pytest.approx(LAT, abs=1e-5), 9.0)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.computes
def test_loss_of_a_fifth_ends_whole(client, seed):
    rng = random.Random(seed)
    assert client.upload(plan(12), lose=lambda: rng.random() < 0.2) == ACCEPTED
    assert len(client.vehicle.mission.steps) == 12


def test_items_twice_or_out_of_order_are_not_taken(client):
    items = plan(4)
    assert client.upload(items) == ACCEPTED
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 4, 0), client.now)
    for n in (2, 0, 0, 3, 1, 1, 2):
        answers = client.say(items[n], client.now)
        assert not any(m.get_type() == "MISSION_ACK" for m in answers)
    (answer,) = client.say(items[3], client.now)
    assert (answer.get_type(), answer.type) == ("MISSION_ACK", ACCEPTED)
    (again,) = client.say(items[3], client.now)  # the answer was lost
    assert (again.get_type(), again.type) == ("MISSION_ACK", ACCEPTED)


def test_a_plan_that_is_not_taken_leaves_the_one_there_was(client):
    assert client.upload(plan(5)) == ACCEPTED
    before = client.vehicle.mission.steps
    assert client.upload([item(0, 84), *plan(5)[1:]]) == mavlink.MAV_MISSION_UNSUPPORTED
    assert client.vehicle.mission.steps == before
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 9, 0), client.now)
    client.say(item(0), client.now)  # and then its power is lost
    for _ in range(30):
        client.now += 0.25
        client.station.idle(0, client.now, client.now)
    assert [m.type for m in client.heard() if m.get_type() == "MISSION_ACK"] == [
        mavlink.MAV_MISSION_OPERATION_CANCELLED
    ]
    assert client.vehicle.mission.steps == before
    assert len(client.download()) == 5


def test_of_two_uploads_at_once_the_second_is_refused(client):
    other = client.another()
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 2, 0), client.now)
    (answer,) = other.say(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    assert (answer.get_type(), answer.type) == ("MISSION_ACK", mavlink.MAV_MISSION_ERROR)
    client.say(item(0), client.now)
    (answer,) = client.say(item(1), client.now)
    assert answer.type == ACCEPTED
    (answer,) = other.say(mavlink.MAVLink_mission_count_message(1, 1, 1, 0))
    assert answer.get_type() == "MISSION_REQUEST_INT"


def test_a_download_is_of_one_plan_while_another_comes(client):
    other = client.another()
    assert client.upload(plan(6)) == ACCEPTED
    (count,) = other.say(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert client.upload([item(0, north=99.0), item(1, north=98.0)]) == ACCEPTED
    given = [
        other.say(mavlink.MAVLink_mission_request_int_message(1, 1, n, 0))[0]
        for n in range(count.count)
    ]
    assert [m.command for m in given] == [TAKEOFF, *[WAYPOINT] * 4, LAND]


def test_a_part_is_written_and_the_rest_stays(client):
    assert client.upload(plan(5)) == ACCEPTED
    client.say(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 3), client.now)
    client.say(item(2, north=77.0), client.now)
    (answer,) = client.say(item(3, north=78.0), client.now)
    assert answer.type == ACCEPTED
    places = [step.place for step in client.vehicle.mission.steps]
    assert [round(places[n].y) for n in (1, 2, 3)] == [10, 77, 78]
    (answer,) = client.say(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 4, 9))
    assert answer.type == mavlink.MAV_MISSION_INVALID_SEQUENCE


def test_clearing_all_leaves_nothing(client):
    assert client.upload(plan(5)) == ACCEPTED
    (answer,) = client.say(mavlink.MAVLink_mission_clear_all_message(1, 1, ALL))
    assert (answer.type, answer.mission_type) == (ACCEPTED, ALL)
    assert client.vehicle.mission.steps == ()
    assert client.download() == []


@pytest.mark.parametrize(
    ("wrong", "result"),
    [
        (item(1, 84), mavlink.MAV_MISSION_UNSUPPORTED),  # a VTOL take-off
        (item(1, frame=10), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),  # terrain
        (item(1, frame=1), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (item(1, WAYPOINT, -1.0), mavlink.MAV_MISSION_INVALID_PARAM1),
        (item(1, WAYPOINT, 0.0, math.inf), mavlink.MAV_MISSION_INVALID_PARAM2),
        (item(1, north=30_000.0), mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (without(1, "x"), mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (without(1, "y"), mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        (item(1, z=1e6), mavlink.MAV_MISSION_INVALID_PARAM7),
        (item(1, z=math.nan), mavlink.MAV_MISSION_INVALID_PARAM7),
        (item(1, JUMP, 9.0, 1.0), mavlink.MAV_MISSION_INVALID_PARAM1),
        (item(1, JUMP, 1.0, 1.0), mavlink.MAV_MISSION_INVALID_PARAM1),  # to itself
        (item(1, JUMP, math.nan, 1.0), mavlink.MAV_MISSION_INVALID_PARAM1),
        (item(1, SPEED, 2.0, 3.0), mavlink.MAV_MISSION_INVALID_PARAM1),  # a climb's
        (item(1, 18, 2.0, 0.0, 0.1), mavlink.MAV_MISSION_INVALID_PARAM3),  # a circle of 10 cm
    ],
)
@pytest.mark.computes
def test_an_item_that_cannot_be_flown_is_refused_with_its_reason(client, wrong, result):
    said = []
    client.station.tell = lambda told, severity=None: said.append(told)
    items = plan(4)
    items[1] = wrong
    assert client.upload(items) == result
    assert client.vehicle.mission.steps == ()


def test_more_items_than_there_is_room_for_are_refused_at_once(client):
    (answer,) = client.say(mavlink.MAVLink_mission_count_message(1, 1, 65535, 0))
    assert (answer.get_type(), answer.type) == ("MISSION_ACK", mavlink.MAV_MISSION_NO_SPACE)


def test_progress_is_told(client):
    assert client.upload(plan(4)) == ACCEPTED
    client.say(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    client.now += 1.0
    client.station.idle(0, client.now, client.now)
    told = [m for m in client.heard() if m.get_type() == "MISSION_CURRENT"][-1]
    assert (told.seq, told.total, told.mission_state) == (2, 4, mavlink.MISSION_STATE_NOT_STARTED)
    (answer,) = client.say(mavlink.MAVLink_mission_set_current_message(1, 1, 4))
    assert answer.type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    assert client.vehicle.mission.current == 2


def test_the_identity_of_a_plan_follows_it_and_is_found_once(client, monkeypatch):
    found, identity_of = [], plan_protocol._identity_of

    def once_more(items):
        found.append(items)
        return identity_of(items)

    monkeypatch.setattr(plan_protocol, "_identity_of", once_more)

    def identity():
        client.station._plans.current()
        client.download()
        return client.station._plans.stored.identity(MissionType.MISSION)

    assert identity() == 0
    assert client.upload(plan(4)) == ACCEPTED
    first = identity()
    assert client.upload([item(0, 84)]) == mavlink.MAV_MISSION_UNSUPPORTED
    assert identity() == first != 0
    assert client.upload(plan(5)) == ACCEPTED
    assert identity() not in (0, first)
    assert client.upload(plan(4)) == ACCEPTED
    assert identity() == first
    assert [len(items) for items in found] == [4, 5, 4]
    origin = mavlink.MAVLink_set_gps_global_origin_message(1, -353_632_600, 1_491_652_300, 584_000)
    client.say(origin, client.now)  # too far away: it is cleared
    assert client.download() == []
    assert identity() == 0


def test_a_plan_is_started_paused_and_continued_by_command(client):
    start, pause = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_PAUSE_CONTINUE
    assert client.ask(start, 0.0) == mavlink.MAV_RESULT_DENIED  # there is none
    assert client.upload(plan(4)) == ACCEPTED
    assert client.ask(start, 0.0) == mavlink.MAV_RESULT_ACCEPTED
    assert (client.vehicle.armed, client.vehicle.mode) == (True, Mode.MISSION)
    assert client.ask(pause, 0.0) == mavlink.MAV_RESULT_ACCEPTED
    assert client.vehicle.mode is Mode.HOLD
    assert client.ask(pause, 1.0) == mavlink.MAV_RESULT_ACCEPTED
    assert client.vehicle.mode is Mode.MISSION


# --- fences and rally points

IN, OUT, DISC_IN, DISC_OUT = 5001, 5002, 5003, 5004


def polygon(*corners, first=0, command=IN, say=None):
    total = len(corners) if say is None else say
    return [
        item(first + n, command, float(total), north=north, east=east, kind=FENCE, frame=0)
        for n, (east, north) in enumerate(corners)
    ]


SQUARE = (-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)


def test_a_fence_and_rally_points_are_taken_and_given_back(client):
    fence = [*polygon(*SQUARE), item(4, DISC_OUT, 8.0, north=20.0, kind=FENCE, frame=0)]
    assert client.upload(fence, FENCE) == ACCEPTED
    square, disc = client.vehicle.fence.areas
    assert (square.inclusion, disc.inclusion, disc.radius) == (True, False, 8.0)
    assert square.corners[2] == pytest.approx((50.0, 50.0), abs=0.02)
    assert [m.command for m in client.download(FENCE)] == [IN] * 4 + [DISC_OUT]
    rally = [item(0, 5100, north=7.0, kind=RALLY), item(1, 5100, east=9.0, kind=RALLY)]
    assert client.upload(rally, RALLY) == ACCEPTED
    assert len(client.vehicle.rally) == len(client.download(RALLY)) == 2
    assert client.upload([], FENCE) == ACCEPTED
    assert client.vehicle.fence.areas == ()
    assert len(client.vehicle.rally) == 2


def test_a_circle_of_radius_0_is_no_area(client):
    """MAVSDK's geofence example sends it, at latitude and longitude 0, beside its polygon."""
    nothing = item(4, DISC_IN, 0.0, kind=FENCE, frame=0)
    nothing.x = nothing.y = 0
    assert client.upload([*polygon(*SQUARE), nothing], FENCE) == ACCEPTED
    (square,) = client.vehicle.fence.areas
    assert len(square.corners) == 4
    assert [m.command for m in client.download(FENCE)] == [IN] * 4 + [DISC_IN]


@pytest.mark.parametrize(
    ("fence", "result"),
    [
        (polygon(*SQUARE[:2]), mavlink.MAV_MISSION_INVALID_PARAM1),
        (polygon(*SQUARE, say=5), mavlink.MAV_MISSION_INVALID),
        ([*polygon(*SQUARE)[:3], *polygon(*SQUARE, first=3, command=OUT)], mavlink.MAV_MISSION_INVALID),
        ([item(0, DISC_IN, -1.0, kind=FENCE)], mavlink.MAV_MISSION_INVALID_PARAM1),
        ([item(0, DISC_IN, math.nan, kind=FENCE)], mavlink.MAV_MISSION_INVALID_PARAM1),
        ([item(0, WAYPOINT, kind=FENCE)], mavlink.MAV_MISSION_UNSUPPORTED),
    ],
)  # fmt: skip
def test_a_broken_fence_leaves_the_one_there_was(client, fence, result):
    assert client.upload([item(0, DISC_IN, 99.0, kind=FENCE, frame=0)], FENCE) == ACCEPTED
    assert client.upload(fence, FENCE) == result
    assert [area.radius for area in client.vehicle.fence.areas] == [99.0]


def test_a_plan_through_a_fence_is_refused_with_its_item(client):
    fence = [item(0, DISC_OUT, 8.0, north=20.0, kind=FENCE, frame=0)]
    assert client.upload(fence, FENCE) == ACCEPTED
    through = [item(0, TAKEOFF), item(1, north=40.0), item(2, LAND, z=0.0)]
    assert client.upload(through) == DENIED
    around = [item(0, TAKEOFF), item(1, north=20.0, east=20.0), item(2, north=40.0)]
    assert client.upload(around) == ACCEPTED


# --- looked at before it is taken


@pytest.mark.parametrize(("policy", "result"), [(0.0, ACCEPTED), (1.0, ACCEPTED), (2.0, DENIED)])
def test_a_plan_that_may_saturate_is_refused_if_the_guard_refuses(client, policy, result):
    client.station._params.set("MR_GUARD", policy, False)
    client.station._params.set("MPC_XY_CRUISE", 12.0, False)
    far = [item(0, TAKEOFF), item(1, north=50.0), item(2, north=50.0, east=50.0)]
    assert client.upload(far) == result
    assert len(client.vehicle.mission.steps) == (3 if result == ACCEPTED else 0)
    told = [told for _, told, _ in client.logged if told.code in (Code.PLAN_SHORT, Code.DENIED)]
    assert len(told) == (policy != 1.0)
    assert len(client.download()) == len(client.vehicle.mission.steps)


def test_a_guard_that_begins_to_refuse_denies_the_plan_there_is(client):
    client.station._params.set("MPC_XY_CRUISE", 12.0, False)
    far = [item(0, TAKEOFF), item(1, north=50.0), item(2, north=50.0, east=50.0)]
    assert client.upload(far) == ACCEPTED
    client.station._params.set("MR_GUARD", 2.0, False)
    for _ in range(50):
        client.now += 0.02
        client.station.idle(0, client.now, client.now)
    told = [told for _, told, _ in client.logged if told.code is Code.DENIED]
    assert len(told) == 1
    assert told[0].values[1].code is Code.ITEM
    assert not client.vehicle.start_plan(-1, 0, client.now).granted
    assert client.upload(far[:1]) == ACCEPTED
    assert client.vehicle.start_plan(-1, 0, client.now).granted


def test_a_distance_to_the_next_place_is_a_step(client):
    near = item(1, 114, 20.0)
    assert client.upload([item(0, TAKEOFF), near, item(2, north=50.0)]) == ACCEPTED
    step = client.vehicle.mission.steps[1]
    assert (step.do, step.value) == (Do.NEAR, 20.0)
    assert client.upload([item(0, TAKEOFF), item(1, 114, -1.0), item(2, north=50.0)]) == mavlink.MAV_MISSION_INVALID_PARAM1  # fmt: skip


def test_a_long_look_is_spread_and_the_plan_before_stands_meanwhile(client):
    assert client.upload(plan(4)) == ACCEPTED
    client.station._params.set("MR_GUARD", 0.0, False)
    items = [item(n, north=3.0 * (n % 40), east=n) for n in range(300)]
    answers = client.say(mavlink.MAVLink_mission_count_message(1, 1, 300, 0), client.now)
    for each in items[:-1]:
        answers = client.say(each, client.now)
    assert client.say(items[-1], client.now) == []
    for again in range(3):  # the client thinks that its last item is lost
        assert client.say(items[-1], client.now + again) == []
    assert len(client.vehicle.mission.steps) == 4
    turns = 0
    while not (answers := [m for m in client.heard() if m.get_type() == "MISSION_ACK"]):
        assert not [m for m in client.heard() if m.get_type().startswith("MISSION_REQUEST")]
        client.now += 0.01
        client.station.idle(0, client.now, client.now)
        turns += 1
    assert turns > 50
    assert answers[0].type == ACCEPTED
    assert len(client.vehicle.mission.steps) == 300


def test_a_look_that_is_broken_off_leaves_the_plan_there_was(client):
    assert client.upload(plan(4)) == ACCEPTED
    client.station._params.set("MR_GUARD", 0.0, False)
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 300, 0), client.now)
    for n in range(300):
        client.say(item(n, north=3.0 * (n % 40), east=n), client.now)
    client.say(
        mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0)
    )
    for _ in range(500):
        client.now += 0.01
        client.station.idle(0, client.now, client.now)
    assert len(client.vehicle.mission.steps) == 4


def test_a_fence_that_comes_in_mid_look_cancels_the_plan_and_tells_so(client):
    client.station._params.set("MR_GUARD", 0.0, False)
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 300, 0), client.now)
    for n in range(300):
        client.say(item(n, north=3.0 * (n % 40), east=n), client.now)
    answers = client.say(mavlink.MAVLink_mission_count_message(1, 1, 4, FENCE), client.now)
    (cancelled,) = [m for m in answers if m.get_type() == "MISSION_ACK"]
    assert cancelled.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert cancelled.mission_type == 0
    assert client.upload(polygon(*SQUARE), FENCE) == ACCEPTED
    assert client.vehicle.mission.steps == ()


def test_the_steps_of_a_long_plan_are_found_a_part_at_a_time(client, monkeypatch):
    """The answer comes some turns later. A plan of few items is answered at once."""
    monkeypatch.setattr(station, "AT_A_TIME", 10)
    found, before = [], plan_items.step_of
    monkeypatch.setattr(plan_items, "step_of", lambda *of: found.append(1) or before(*of))
    client.say(mavlink.MAVLink_mission_count_message(1, 1, 35, 0), client.now)
    for n in range(35):
        answers = client.say(item(n, north=n), client.now)
    assert answers == []
    turns = []
    while not answers:
        turns.append(len(found))
        client.now += 0.01
        client.station.idle(0, client.now, client.now)
        answers = [m for m in client.heard() if m.get_type() == "MISSION_ACK"]
    assert turns == [10, 20, 30]
    assert answers[0].type == ACCEPTED
