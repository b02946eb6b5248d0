"""The file of a recording that is being written: locked, in chunks, its failures in words."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from gcs_tools.recording.container import Block, Container
from gcs_tools.recording.reader import METADATA, SCHEMA_VERSION, VERSION_KEY, RecordingError
from gcs_tools.recording.schema import PACKAGE

CHUNK_BYTES = 256 * 1024
CHUNK_SECONDS = 0.5  # of wall time: with what is on its way, a killed recorder loses less than 1 s


class RecordingFile:
    """Every method raises RecordingError, naming file and reason, when it cannot be written.

    What was written before (a full disk) stays readable.
    """

    def __init__(self, path: Path, metadata: dict[str, str]) -> None:
        """Create the file at `path`, which must not exist, and write `metadata` to it."""
        self._path = path
        self.failed: str | None = None
        self._closed = False
        self._last_chunk = time.monotonic()
        with self._reporting():
            self._file = FileIO(path, "xb")
            with suppress(OSError):  # whoever would mend it sees that it is written
                fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            with self._reporting():
                self._container = Container(self._file, PACKAGE, f"m-mrac {SCHEMA_VERSION}")
                self._container.add_metadata(
                    METADATA, {VERSION_KEY: str(SCHEMA_VERSION), **metadata}
                )
        except RecordingError:
            self._file.close()
            raise

    @contextmanager
    def _reporting(self) -> Iterator[None]:
        """Name the file and the reason when writing fails, now and at every later call."""
        if self.failed is not None:
            raise RecordingError(self.failed)
        try:
            yield
        except OSError as error:
            self.failed = f"{self._path}: {error.strerror}"
            raise RecordingError(self.failed) from error

    def add_channel(self, topic: str, message: str, schema: bytes) -> int:
        """Announce a topic; returns its channel number."""
        with self._reporting():
            return self._container.add_channel(topic, message, schema)

    def is_due(self, pending_bytes: int) -> bool:
        """Whether it is time for a chunk of what is pending."""
        late = time.monotonic() - self._last_chunk >= CHUNK_SECONDS
        return late or pending_bytes >= CHUNK_BYTES

    def write(self, blocks: list[Block]) -> None:
        """One chunk, of what there is."""
        with self._reporting():
            if blocks:
                self._container.add_chunk(blocks)
        self._last_chunk = time.monotonic()

    def finish(self) -> None:
        """Write the index."""
        with self._reporting():
            self._container.finish()

    def close(self) -> None:
        """Close the file, as it is."""
        self._file.close()
