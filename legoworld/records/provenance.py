"""provenance.json: whatever the maker of a scene says of how it was made."""

from __future__ import annotations

from typing import Any

#: A JSON object that is copied into run.json as it is; no key of it means anything here.
ProvenanceFile = dict[str, Any]
