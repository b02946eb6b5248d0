"""What stations, scripts and the simulator say to the vehicle, and its answers: one row a message.

A row of `TAKEN` has the message's name, the value that it is read as, and the service that takes it. The
station hands messages over by these rows, and the tables in docs/mavlink.md follow from them. What the
vehicle tells of itself, at a rate or on request, is in `messages.py`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from fcu.mavlink import requests, setpoints, telemetry
from fcu.mavlink.plan_messages import MissionMessage


class Service(StrEnum):
    """The part of the station that takes a message, as docs/mavlink.md calls it."""

    COMMANDS = "commands"
    SETPOINTS = "setpoints"
    STICKS = "sticks"
    PLANS = "plans"
    PARAMETERS = "parameters"
    INFORMATION = "information"
    TARGETS = "Follow Me"
    ORIGIN = "origin"
    STATIONS = "links"
    REFUSALS = "refused"


class Taken(NamedTuple):
    """A message that the vehicle takes from stations and scripts."""

    name: str
    kind: type  # that it is read as
    service: Service
    answers: tuple[str, ...]  # to its sender, beside STATUSTEXT. Empty: it is not answered
    meaning: str  # what docs/mavlink.md says of it


class Reply(NamedTuple):
    """A message that the vehicle sends because of another, or when something happens."""

    name: str
    meaning: str  # what docs/mavlink.md says of it


class OfPlant(NamedTuple):
    """A message between the vehicle and its simulator, both ways packed by `fcu/mavlink/plant_link.py`."""

    name: str
    to_vehicle: bool  # else to the simulator
    meaning: str  # what docs/mavlink.md says of it


_ACK, _DONE = ("COMMAND_ACK",), ("MISSION_ACK",)
_VALUE = ("PARAM_VALUE", "PARAM_ERROR")
TAKEN = (
    Taken("HEARTBEAT", telemetry.Heartbeat, Service.STATIONS, (), "a client is there; of type GCS: a ground station is"),
    Taken("COMMAND_LONG", requests.Command, Service.COMMANDS, _ACK, "a command"),
    Taken("COMMAND_INT", requests.Command, Service.COMMANDS, _ACK, "a command with a place in whole numbers"),
    Taken("SET_MODE", requests.SetMode, Service.COMMANDS, (), "a mode; replaced by DO_SET_MODE"),
    Taken("SET_POSITION_TARGET_LOCAL_NED", setpoints.SetpointMessage, Service.SETPOINTS, ("POSITION_TARGET_LOCAL_NED",), "position, velocity, acceleration, yaw"),
    Taken("SET_POSITION_TARGET_GLOBAL_INT", setpoints.SetpointMessage, Service.SETPOINTS, ("POSITION_TARGET_GLOBAL_INT",), "the same with a place on Earth"),
    Taken("SET_ATTITUDE_TARGET", setpoints.AttitudeSetpointMessage, Service.SETPOINTS, ("ATTITUDE_TARGET",), "attitude or body rates, thrust"),
    Taken("SET_ACTUATOR_CONTROL_TARGET", requests.NotTaken, Service.REFUSALS, (), "not flown: its sender is told once"),
    Taken("MANUAL_CONTROL", requests.ManualControl, Service.STICKS, (), "four sticks"),
    Taken("RC_CHANNELS_OVERRIDE", requests.ChannelsOverride, Service.STICKS, (), "four channels of a radio"),
    Taken("FOLLOW_TARGET", requests.FollowTarget, Service.TARGETS, (), "place and velocity of a target"),
    Taken("SET_GPS_GLOBAL_ORIGIN", requests.GlobalOrigin, Service.ORIGIN, ("GPS_GLOBAL_ORIGIN",), "position of local (0, 0, 0) on Earth"),
    Taken("MISSION_REQUEST_LIST", MissionMessage, Service.PLANS, ("MISSION_COUNT",), "download a plan, a fence or rally points"),
    Taken("MISSION_REQUEST", MissionMessage, Service.PLANS, ("MISSION_ITEM",), "one item of a download, with floats"),
    Taken("MISSION_REQUEST_INT", MissionMessage, Service.PLANS, ("MISSION_ITEM_INT",), "one item of a download"),
    Taken("MISSION_REQUEST_PARTIAL_LIST", MissionMessage, Service.PLANS, ("MISSION_COUNT",), "a part of a download: all items are counted"),
    Taken("MISSION_COUNT", MissionMessage, Service.PLANS, ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"), "upload so many items"),
    Taken("MISSION_ITEM", MissionMessage, Service.PLANS, ("MISSION_REQUEST", "MISSION_ACK"), "one item of an upload, with floats"),
    Taken("MISSION_ITEM_INT", MissionMessage, Service.PLANS, ("MISSION_REQUEST_INT", "MISSION_ACK"), "one item of an upload"),
    Taken("MISSION_WRITE_PARTIAL_LIST", MissionMessage, Service.PLANS, ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"), "upload a part"),
    Taken("MISSION_CLEAR_ALL", MissionMessage, Service.PLANS, _DONE, "clear a plan, a fence or rally points"),
    Taken("MISSION_SET_CURRENT", MissionMessage, Service.PLANS, ("MISSION_CURRENT", "MISSION_ACK"), "go on with an item"),
    Taken("MISSION_ACK", MissionMessage, Service.PLANS, (), "the end of a download"),
    Taken("PARAM_REQUEST_LIST", requests.ParamRequestList, Service.PARAMETERS, _VALUE[:1], "all parameters"),
    Taken("PARAM_REQUEST_READ", requests.ParamRequestRead, Service.PARAMETERS, _VALUE, "one parameter"),
    Taken("PARAM_SET", requests.ParamSet, Service.PARAMETERS, _VALUE, "set a parameter; all links hear its value"),
    Taken("REQUEST_DATA_STREAM", requests.StreamRequest, Service.INFORMATION, (), "a rate of a group of messages"),
    Taken("TIMESYNC", requests.TimeSync, Service.INFORMATION, ("TIMESYNC",), "clocks, by simulation time since boot"),
    Taken("PING", requests.Ping, Service.INFORMATION, ("PING",), "is it there?"),
    Taken("FILE_TRANSFER_PROTOCOL", requests.FileTransfer, Service.INFORMATION, ("FILE_TRANSFER_PROTOCOL",), "files: there are none"),
    Taken("LOG_REQUEST_LIST", requests.LogRequestList, Service.INFORMATION, ("LOG_ENTRY",), "logs: there are none"),
    Taken("LOG_REQUEST_DATA", requests.LogRequestData, Service.INFORMATION, ("LOG_DATA",), "a part of a log: empty"),
    Taken("SERIAL_CONTROL", requests.SerialControl, Service.INFORMATION, ("SERIAL_CONTROL",), "a console: there is none"),
    Taken("PARAM_EXT_REQUEST_LIST", requests.ExtendedParameter, Service.INFORMATION, ("PARAM_EXT_VALUE",), "extended parameters: there are none"),
    Taken("PARAM_EXT_REQUEST_READ", requests.ExtendedParameter, Service.INFORMATION, ("PARAM_EXT_VALUE", "PARAM_ERROR"), "one of them"),
    Taken("PARAM_EXT_SET", requests.ExtendedParameter, Service.INFORMATION, ("PARAM_EXT_ACK",), "set one of them: refused"),
)  # fmt: skip
SERVICE_OF = {row.kind: row.service for row in TAKEN}

REPLIES = (
    Reply("COMMAND_ACK", "the result of a command; again when it is done, if it takes time"),
    Reply("STATUSTEXT", "what happens, in a sentence"),
    Reply("PARAM_VALUE", "a parameter"),
    Reply("PARAM_ERROR", "why a parameter was not read or set"),
    Reply("MESSAGE_INTERVAL", "the rate of a message, to GET_MESSAGE_INTERVAL"),
    Reply("TIMESYNC", "simulation time since boot, ns"),
    Reply("PING", "the same numbers"),
    Reply("MISSION_COUNT", "items of a download"),
    Reply("MISSION_REQUEST_INT", "the next item of an upload"),
    Reply("MISSION_REQUEST", "the same, to a sender of items with floats"),
    Reply("MISSION_ITEM_INT", "an item of a download"),
    Reply("MISSION_ITEM", "the same with floats"),
    Reply("MISSION_ACK", "the result of an upload, or a refusal"),
    Reply("MISSION_ITEM_REACHED", "an item was flown, to all"),
    Reply("FILE_TRANSFER_PROTOCOL", "a refusal"),
    Reply("LOG_ENTRY", "no log"),
    Reply("LOG_DATA", "no bytes"),
    Reply("SERIAL_CONTROL", "a sentence that there is no console"),
    Reply("PARAM_EXT_VALUE", "a count of 0: there are no extended parameters"),
    Reply("PARAM_EXT_ACK", "a refusal"),
)

OF_PLANT = (
    OfPlant("ODOMETRY", True, "the state of a tick"),
    OfPlant("ACTUATOR_OUTPUT_STATUS", True, "speeds of the rotors at that tick"),
    OfPlant("BATTERY_STATUS", True, "the battery, now and then"),
    OfPlant("HEARTBEAT", True, "simulation time stands; how the flight has ended"),
    OfPlant("HIL_ACTUATOR_CONTROLS", False, "commands of the rotors, for the tick of their time"),
    OfPlant("COMMAND_LONG", False, "reset, or break something"),
    OfPlant("COMMAND_ACK", True, "that is done, or refused"),
)
