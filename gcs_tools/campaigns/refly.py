"""One flight of a campaign flown again: `gcs fly CAMPAIGN#1234`, with the very values of that flight."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path

from fcu.interface.files import whole_file
from gcs_tools.campaigns import store
from gcs_tools.campaigns.campaign_file import CampaignError
from gcs_tools.missions.mission import Mission, MissionError, as_toml, with_values

_NAMED = re.compile(r"(?P<folder>.+)#(?P<number>[0-9]{1,9})(?::(?P<law>.+))?")


@dataclass(frozen=True)
class Numbered:
    """A flight of a campaign's folder."""

    folder: Path
    number: int
    law: str
    mission: str  # a file, that holds the mission with all that was set and drawn
    trajectory_sha256: str  # as the campaign flew it; empty: it has not, or not to its end
    ended: str
    success: bool | None  # as the campaign counted it; None: it has not been flown there
    is_compared: bool = False  # it is of a comparison, which expects nothing of a flight
    script: Mission | None = None  # the mission itself, if it runs a script: beside its own file

    def command(self) -> str:
        """What to type to fly it again."""
        return command(self.folder, self.number, self.law)


def command(folder: Path | str, number: int, law: str = "") -> str:
    """What to type to fly a flight of a campaign again; `law`: where there are several."""
    return f"gcs fly '{folder}#{number}{f':{law}' if law else ''}'"


def is_numbered(name: str) -> bool:
    """Whether a name stands for a flight of a campaign."""
    found = _NAMED.fullmatch(name)
    return found is not None and is_campaign(found["folder"])


def is_campaign(folder: str) -> bool:
    """Whether a campaign was flown in a folder."""
    return bool(folder) and isfile(Path(folder) / store.JSON)


def numbered(name: str, into: str) -> Numbered:
    """The flight of CAMPAIGN#NUMBER or CAMPAIGN#NUMBER:LAW; its mission is written there, in a folder `into`.

    Raises CampaignError, OSError.
    """
    found = _NAMED.fullmatch(name)
    assert found is not None
    folder, number = Path(found["folder"]), int(found["number"])
    campaign = store.reopened(folder, unchanged=True, allow_commands=True)  # `gcs fly` asks
    label = found["law"] or campaign.labels[0]
    if label not in campaign.labels:
        raise CampaignError(f"{name}: no such law; there are {', '.join(campaign.labels)}")
    if number >= campaign.n:
        raise CampaignError(f"{name}: the campaign has flights 0 to {campaign.n - 1}")
    variant = campaign.variants[campaign.labels.index(label)]
    quantities = campaign.draws.quantities(number)
    values = campaign.draws.values(number, quantities, variant.base)
    is_compared = campaign.document.seeds is not None
    if is_compared:  # what the mission expects is of its own law
        values = {**values, "expect": {"reached": False}}
    try:
        drawn = with_values(variant.mission, values, "draw")
    except MissionError as error:
        raise CampaignError(f"{name}: {error}") from error
    if (folder / into).is_symlink():
        raise CampaignError(f"{folder / into}: expected a folder, not a link: remove it")
    (folder / into).mkdir(exist_ok=True)
    of = f"-{label}" if len(campaign.labels) > 1 else ""
    path = folder / into / f"{campaign.name}-{number}{of}.toml"
    text = as_toml(drawn.given, f"flight {number} of {folder}, law {label}")
    whole_file.write(path, text.encode(), follow=False)
    row = store.row(campaign, folder, number, label)
    return Numbered(
        folder,
        number,
        label,
        str(path),
        row.get("trajectory_sha256") or "",
        row.get("ended") or "",
        row.get("success"),
        is_compared,
        None if variant.folder is None else replace(drawn, folder=variant.folder),
    )
