"""Pictures are on file whole, or not at all."""

import os
import resource
import signal
from contextlib import contextmanager

import pytest

from fcu.interface.files import whole_file


@contextmanager
def small_disk():
    """A limit for the body alone: pytest itself may write its output into a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    heard = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, heard)


def test_of_a_full_disk_there_is_no_part_of_a_picture(tmp_path):
    with small_disk(), pytest.raises(OSError, match=r"x\.png"):
        whole_file.write(tmp_path / "x.png", b"x" * 2000)
    assert list(tmp_path.iterdir()) == []


def test_of_a_full_disk_the_picture_before_stays(tmp_path):
    (tmp_path / "x.png").write_bytes(b"before")
    with small_disk(), pytest.raises(OSError, match=r"x\.png"):
        whole_file.write(tmp_path / "x.png", b"x" * 2000)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("x.png", b"before")]


def test_a_picture_is_written_through_a_link(tmp_path):
    (tmp_path / "link.png").symlink_to("x.png")
    whole_file.write(tmp_path / "link.png", b"picture")
    assert os.readlink(tmp_path / "link.png") == "x.png"
    assert (tmp_path / "x.png").read_bytes() == b"picture"


@pytest.mark.parametrize("direct", [False, True])
@pytest.mark.parametrize("kind", ["pipe", "device", "file"])
def test_in_a_folder_of_somebody_elses_nothing_else_is_written_to(tmp_path, direct, kind):
    led = tmp_path / "led"
    if kind == "pipe":
        os.mkfifo(led)
        reader = os.open(led, os.O_RDONLY | os.O_NONBLOCK)
    elif kind == "device":
        led.symlink_to(os.devnull)
    else:
        led.write_bytes(b"")
    path = led if direct else tmp_path / "report.html"
    if not direct:
        path.symlink_to(led)
    whole_file.write(path, b"report", follow=False)
    assert path.read_bytes() == b"report"
    assert not path.is_symlink()
    assert path.stat().st_mode & 0o111 == 0
    if kind == "pipe":
        assert os.read(reader, 10) == b""
        os.close(reader)


def test_a_device_is_written_to(tmp_path):
    (tmp_path / "link").symlink_to(os.devnull)
    whole_file.write(tmp_path / "link", b"report")
    assert os.readlink(tmp_path / "link") == os.devnull


def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"before")
    (tmp_path / "x.toml").chmod(0o640)
    whole_file.write(tmp_path / "x.toml", b"after")
    assert (tmp_path / "x.toml").stat().st_mode & 0o777 == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["x.toml"]


def test_a_part_that_is_not_put_in_place_leaves_nothing(tmp_path):
    with whole_file.part(tmp_path / "x") as new:
        new.file.write(b"half")
    assert list(tmp_path.iterdir()) == []
