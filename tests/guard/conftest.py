"""The fixtures of the law: the guard is tested on the same airframe and parameters."""

from tests.laws.conftest import *  # noqa: F403
