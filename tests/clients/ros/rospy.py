"""A stand-in for rospy in one process: its nodes, topics, services, rates and times, with MAVROS beside them.

A node that flies a PX4 by MAVROS runs unmodified, without ROS: put this folder on its PYTHONPATH. What it
publishes below mavros/ is sent as MAVROS sends it, what it subscribes to there is what MAVROS would tell
(mavros_link). Other topics stay within the process. Parameters are those of the environment variable
ROS_PARAMETERS, as JSON. MAVROS_URL is its own port, the vehicle's, and the vehicle's system.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import message_types as _types
from mavros_link import MavrosLink


class ROSException(Exception):
    """An error of ROS."""


class ROSInterruptException(ROSException, KeyboardInterrupt):
    """ROS is shut down."""


class ServiceException(Exception):
    """A service failed."""


class ROSInitException(ROSException):
    """ROS is not there."""


class Duration(_types.Time):
    """A span of time."""

    def __init__(self, secs: float = 0, nsecs: int = 0) -> None:
        whole, part = divmod(round(secs * 1e9) + nsecs, 1_000_000_000)
        super().__init__(int(whole), int(part))

    def _compared(self, other: Any) -> int:
        return self.to_nsec() - (other.to_nsec() if isinstance(other, _types.Time) else int(other))

    def __lt__(self, other: Any) -> bool:
        return self._compared(other) < 0

    def __gt__(self, other: Any) -> bool:
        return self._compared(other) > 0

    def __le__(self, other: Any) -> bool:
        return self._compared(other) <= 0

    def __ge__(self, other: Any) -> bool:
        return self._compared(other) >= 0


class Time(Duration):
    """A point in time."""

    @classmethod
    def now(cls) -> Time:
        """This moment."""
        return cls(0, time.time_ns())

    def __sub__(self, other: Any) -> Any:
        less = self.to_nsec() - other.to_nsec()
        return Duration(0, less) if isinstance(other, Time) else Time(0, less)

    def __add__(self, other: Any) -> Time:
        return Time(0, self.to_nsec() + other.to_nsec())


get_rostime = Time.now


def get_time() -> float:
    """This moment in seconds."""
    return time.time()


class _Ros:
    """ROS, as far as a process has it."""

    def __init__(self) -> None:
        self.down = threading.Event()
        self.link: MavrosLink | None = None
        self.inside: dict[str, list[Callable[[Any], None]]] = {}
        self.on_shutdown: list[Callable[[], None]] = []
        self.lock = threading.Lock()

    def mavros(self) -> MavrosLink:
        """The link to the vehicle, begun once."""
        with self.lock:
            if self.link is None:
                numbers = map(int, os.environ.get("MAVROS_URL", "14540:14580:1").split(":"))
                self.link = MavrosLink(*numbers)
            return self.link


_ros = _Ros()


def _of_mavros(name: str) -> str:
    """The name of a topic or service below mavros/. Empty: it is not MAVROS'."""
    parts = name.strip("/~").split("/")
    return "/".join(parts[parts.index("mavros") + 1 :]) if "mavros" in parts else ""


def init_node(name: str, argv: Any = None, anonymous: bool = False, **_other: Any) -> None:
    """Begin the node."""
    _ros.mavros()
    if threading.current_thread() is threading.main_thread() and not _other.get("disable_signals"):
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: _end())


def _end() -> None:
    signal_shutdown("ended")
    raise KeyboardInterrupt


def signal_shutdown(_reason: str = "") -> None:
    """End the node."""
    _ros.down.set()


def on_shutdown(call: Callable[[], None]) -> None:
    """Call at the end."""
    atexit.register(call)


def is_shutdown() -> bool:
    """True once the node is ended."""
    return _ros.down.is_set()


def spin() -> None:
    """Wait for the end of the node."""
    while not _ros.down.wait(0.5):
        pass


def sleep(seconds: Any) -> None:
    """Wait so many seconds."""
    span = seconds.to_sec() if isinstance(seconds, _types.Time) else float(seconds)
    if _ros.down.wait(max(span, 0.0)):
        raise ROSInterruptException("shut down")


class Rate:
    """Ends of equal periods."""

    def __init__(self, hz: float, reset: bool = False) -> None:
        self._period_s, self._next_s = 1.0 / hz, time.monotonic() + 1.0 / hz
        self.sleep_dur = Duration(self._period_s)

    def sleep(self) -> None:
        """Wait for the end of the period."""
        now = time.monotonic()
        wait = self._next_s - now
        self._next_s = (
            self._next_s + self._period_s if wait > -self._period_s else now + self._period_s
        )
        if _ros.down.wait(max(wait, 0.0)):
            raise ROSInterruptException("shut down")


class Timer(threading.Thread):
    """Calls again and again."""

    def __init__(self, period: Any, callback: Callable[[Any], None], oneshot: bool = False) -> None:
        super().__init__(daemon=True)
        self._period_s, self._callback, self._oneshot = period.to_sec(), callback, oneshot
        self._off = threading.Event()
        self.start()

    def run(self) -> None:
        """Call until it is shut down."""
        rate = Rate(1.0 / self._period_s)
        while not is_shutdown() and not self._off.is_set():
            rate.sleep()
            self._callback(None)
            if self._oneshot:
                return

    def shutdown(self) -> None:
        """End it."""
        self._off.set()


class Publisher:
    """A topic that a node publishes."""

    def __init__(self, name: str, data_class: Any, *_places: Any, **_options: Any) -> None:
        self._class, self._topic, self.name = data_class, _of_mavros(name), name
        self._inside = name.strip("/")

    def publish(self, *values: Any, **named: Any) -> None:
        """Say it."""
        one = len(values) == 1 and not named and isinstance(values[0], _types.Message)
        said = values[0] if one else self._class(*values, **named)
        if self._topic:
            _ros.mavros().published(self._topic, said)
        for call in _ros.inside.get(self._inside, []):
            call(said)

    def get_num_connections(self) -> int:
        """Number of listeners."""
        return 1

    def unregister(self) -> None:
        """End it."""


class Subscriber:
    """A topic that a node hears."""

    def __init__(
        self,
        name: str,
        data_class: Any,
        callback: Any = None,
        callback_args: Any = None,
        *_o: Any,
        **_n: Any,
    ) -> None:
        self._call = (
            callback if callback_args is None else (lambda said: callback(said, callback_args))
        )
        self._topic = _of_mavros(name)
        if self._call is None:
            return
        if self._topic:
            _ros.mavros().subscribe(self._topic, self._call)
        else:
            _ros.inside.setdefault(name.strip("/"), []).append(self._call)

    def unregister(self) -> None:
        """End it."""
        if self._topic and self._call is not None:
            _ros.mavros().unsubscribe(self._topic, self._call)


def wait_for_message(name: str, data_class: Any, timeout: float | None = None) -> Any:
    """The next message of a topic. Raises ROSException."""
    heard: list[Any] = []
    came = threading.Event()

    def take(said: Any) -> None:
        heard.append(said)
        came.set()

    subscriber = Subscriber(name, data_class, take)
    came.wait(timeout)
    subscriber.unregister()
    if not heard:
        raise ROSException(f"timeout exceeded while waiting for message on topic {name}")
    return heard[0]


class ServiceProxy:
    """A service of MAVROS."""

    def __init__(self, name: str, service_class: Any, *_places: Any, **_options: Any) -> None:
        self._name, self._class = _of_mavros(name), service_class

    def __call__(self, *values: Any, **named: Any) -> Any:
        one = len(values) == 1 and not named and isinstance(values[0], _types.Message)
        asked = values[0] if one else self._class.Request(*values, **named)
        try:
            return self._class.Response(**_ros.mavros().call(self._name, asked))
        except LookupError as error:
            raise ServiceException(f"service [/mavros/{self._name}] unavailable") from error

    call = __call__

    def wait_for_service(self, timeout: float | None = None) -> None:
        """Wait until it is there."""
        wait_for_service(f"mavros/{self._name}", timeout)

    def close(self) -> None:
        """End it."""


def wait_for_service(name: str, timeout: Any = None) -> None:
    """Wait until a service is there. Raises ROSException."""
    if not _ros.mavros().has(_of_mavros(name)):
        raise ROSException(f"timeout exceeded while waiting for service {name}")


def _parameters() -> dict[str, Any]:
    return dict(json.loads(os.environ.get("ROS_PARAMETERS", "{}")))


def get_param(name: str, default: Any = KeyError) -> Any:
    """A parameter of ROS. Raises KeyError."""
    told = _parameters()
    key = name.strip("/~").rpartition("/")[2]
    if key in told:
        return told[key]
    if default is KeyError:
        raise KeyError(name)
    return default


def has_param(name: str) -> bool:
    """True if the parameter is there."""
    return name.strip("/~").rpartition("/")[2] in _parameters()


def myargv(argv: list[str] | None = None) -> list[str]:
    """The arguments that are not ROS'."""
    return [word for word in (argv or sys.argv) if ":=" not in word]


def get_name() -> str:
    """The node's name."""
    return "/node"


def get_namespace() -> str:
    """The node's namespace."""
    return "/"


def _say(text: Any, *values: Any, **_named: Any) -> None:
    print(str(text) % values if values else text, flush=True)


loginfo = logwarn = logerr = logdebug = logfatal = loginfo_once = logwarn_once = _say
_last_said: dict[Any, float] = {}


def _say_seldom(period_s: float, text: Any, *values: Any) -> None:
    if time.monotonic() - _last_said.get(text, -1e9) >= period_s:
        _last_said[text] = time.monotonic()
        _say(text, *values)


loginfo_throttle = logwarn_throttle = logerr_throttle = logdebug_throttle = _say_seldom
