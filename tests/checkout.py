"""Where the checkout is: `make test` runs a copy of it that lacks legoworld/."""

from __future__ import annotations

import os
from pathlib import Path

CHECKOUT = Path(os.environ.get("LEGOWORLD_CHECKOUT", Path(__file__).parents[1]))
