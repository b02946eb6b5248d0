"""Flights of a campaign among the missions of `gcs fly`: found, and held against what the campaign flew."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from gcs_tools.cli.output import Failure
from gcs_tools.exit_codes import INFRASTRUCTURE, MISSED, OK, USAGE

if TYPE_CHECKING:
    from gcs_tools.campaigns.refly import Numbered
    from gcs_tools.judging.result import Result
    from gcs_tools.missions.mission import Mission

FOLDER = "again"  # in a campaign's folder: missions of its flights


class CampaignFlights:
    """The missions of a command line, those of the form CAMPAIGN#NUMBER as files."""

    def __init__(self, names: Sequence[str]) -> None:
        """Raises Failure for a flight that its campaign does not have."""
        self._numbered: dict[int, Numbered] = {}
        self.missions = [self._mission(place, name) for place, name in enumerate(names)]

    def _mission(self, place: int, name: str) -> str | Mission:
        if "#" not in name:
            return name
        from gcs_tools.campaigns import refly
        from gcs_tools.campaigns.campaign_file import CampaignError

        if not refly.is_numbered(name):
            if refly.is_campaign(name.partition("#")[0]):
                raise Failure(f"{name}: expected 'FOLDER#NUMBER', or 'FOLDER#NUMBER:LAW'", USAGE)
            return name
        try:
            self._numbered[place] = found = refly.numbered(name, FOLDER)
        except CampaignError as error:
            raise Failure(error, USAGE) from error
        except OSError as error:
            raise Failure(f"{error.filename}: {error.strerror}", USAGE) from error
        return found.mission if found.script is None else found.script

    def compared(self, results: Sequence[Result]) -> list[int]:
        """Say of each flight whether it is that of its campaign, to the bit. Return all exit codes.

        A flight of a comparison that is the same ends with 0, whatever became of it.
        """
        codes = [each.exit_code for each in results]
        for place, found in self._numbered.items():
            if place >= len(results):
                continue
            flown = results[place].trajectory_sha256
            named = f"flight {found.number} of {found.folder}"
            if found.script is not None:
                click.echo(f"{named}: flown by a script, so no two flights are the same", err=True)
            elif not found.trajectory_sha256:
                why = (
                    f"it was {found.ended} there" if found.ended else "it has not been flown there"
                )
                click.echo(f"{named}: nothing to compare with ({why})", err=True)
            elif flown == found.trajectory_sha256:
                counted = "a success" if found.success else "a failure"
                more = "; in a comparison nothing is expected" if found.is_compared else ""
                click.echo(
                    f"{named}: the same trajectory to the bit ({flown[:12]}), there counted as {counted}{more}",
                    err=True,
                )
                if found.is_compared and codes[place] == MISSED:
                    codes[place] = OK
            elif flown:
                click.echo(
                    f"Error: {named}: another trajectory ({flown[:12]}, there"
                    f" {found.trajectory_sha256[:12]}): other sources, or another machine",
                    err=True,
                )
                codes[place] = max(codes[place], INFRASTRUCTURE)
        return codes
