"""Services of mavros_msgs, each with the classes of its request and response."""

import message_types as _types

_SERVICES = [
    "CommandBool",
    "CommandTOL",
    "CommandHome",
    "CommandLong",
    "CommandInt",
    "SetMode",
    "ParamGet",
    "ParamSet",
    "StreamRate",
    "WaypointPush",
    "WaypointClear",
    "WaypointPull",
    "WaypointSetCurrent",
]
for _name in _SERVICES:
    _service = getattr(_types, _name)
    globals().update(
        {
            _name: _service,
            f"{_name}Request": _service.Request,
            f"{_name}Response": _service.Response,
        }
    )
