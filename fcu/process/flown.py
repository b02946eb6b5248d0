"""Once a law: the law and the guard that settings.py and tick.py are compiled around. Here M-MRAC's.

`fcu.laws.seam` makes such a module for each other law.
"""

from __future__ import annotations

from fcu.guard import guard as guard
from fcu.laws.mmrac import law as law
