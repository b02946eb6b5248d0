"""Ports and identities of instances, from one table."""

from __future__ import annotations

import pytest

from fcu.interface import ports as module
from fcu.interface.link import PortBusy
from fcu.interface.ports import (
    NoFreeInstance,
    Ports,
    busy,
    first_free_instance,
    owner,
    ports,
    running_instances,
    table,
)


def test_instances_zero_and_nine():
    assert ports(0) == Ports(4560, 4660, 14580, 14540, 18570, 14550, system_id=1, fcu_tcp=5760)
    assert ports(9) == Ports(4569, 4669, 14589, 14549, 18579, 14550, system_id=10, fcu_tcp=5850)


def test_no_two_instances_meet_and_none_takes_the_ground_stations_port():
    own = [p for n in range(10) for name, p in ports(n)._asdict().items() if name != "station"]
    assert len(set(own)) == len(own)
    assert ports(0).station not in own


@pytest.mark.parametrize("instance", [-1, 10])
def test_an_instance_out_of_range_is_refused(instance):
    with pytest.raises(ValueError, match="expected 0 to 9"):
        ports(instance)


def test_the_table_names_every_port_and_its_owner():
    text = table()
    for name, number in ports(0)._asdict().items():
        if name != "system_id":
            assert f"{number}" in text
            assert owner(name) in text
    assert text.count("+N") == 5
    assert "5760+10N" in text
    assert "14550 " in text


class Machine:
    """Ports as another process would see them: the ones in `busy` are taken."""

    def __init__(self, busy):
        self.busy = busy
        self.bound = []

    def exclusive_socket(self, port, link):
        if port in self.busy:
            raise PortBusy(port, link)
        self.bound.append(port)
        return self

    def close(self):
        pass


@pytest.mark.parametrize(
    ("taken", "names", "free"),
    [
        (set(), (), 0),
        ({4560}, (), 1),
        ({4660, 14581, 18572}, (), 3),
        ({14540}, (), 0),
        ({14540}, ("plant", "script"), 1),
        ({14550}, ("plant", "fcu_plant", "script"), 0),
        ({4660}, ("plant",), 0),
        ({5760, 5770}, (), 2),
    ],
)
def test_the_first_instance_with_all_its_ports_is_found(monkeypatch, taken, names, free):
    machine = Machine(taken)
    monkeypatch.setattr(module, "exclusive_socket", machine.exclusive_socket)
    monkeypatch.setattr(module, "listening_socket", machine.exclusive_socket)
    assert first_free_instance(*names) == free
    wanted = names or ("plant", "fcu_plant", "fcu_script", "fcu_station")
    assert {ports(free)._asdict()[name] for name in wanted} <= set(machine.bound)


def test_a_busy_port_is_named(monkeypatch):
    machine = Machine({4661})
    monkeypatch.setattr(module, "exclusive_socket", machine.exclusive_socket)
    monkeypatch.setattr(module, "listening_socket", machine.exclusive_socket)
    assert [error.port for error in busy(1)] == [4661]
    assert busy(0) == []


@pytest.mark.parametrize("has_table", [True, False])
def test_the_instances_that_run_are_those_with_a_flight_controller(monkeypatch, has_table):
    """By the kernel's table of ports, without which they are tried."""
    machine = Machine({14582, 14584})
    monkeypatch.setattr(module, "exclusive_socket", machine.exclusive_socket)
    monkeypatch.setattr(module, "listening_socket", machine.exclusive_socket)
    monkeypatch.setattr(module, "bound_ports", lambda: machine.busy if has_table else None)
    assert running_instances() == [2, 4]
    assert bool(machine.bound) is not has_table


def test_no_free_instance_is_an_error(monkeypatch):
    machine = Machine({4660 + n for n in range(10)})
    monkeypatch.setattr(module, "exclusive_socket", machine.exclusive_socket)
    monkeypatch.setattr(module, "listening_socket", machine.exclusive_socket)
    with pytest.raises(NoFreeInstance, match="0 to 9"):
        first_free_instance()
