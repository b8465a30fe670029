"""Settings of `legoworld bench serve --http`, without the packages that it needs."""

from __future__ import annotations

import os
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld import extras
from legoworld.errors import UsageError, cause

TOKEN_VARIABLE: Final = "LEGOWORLD_SERVE_TOKEN"
_SHORTEST_TOKEN: Final = 16


@dataclass(frozen=True, kw_only=True)
class HttpOptions:
    """Where it listens, who may ask, and how much is taken.

    queue: orders that are received, wait or are scored at once; step: of every score, 0 for exact
    ones; per_object: answer with each object's row, too. receive_s: for one whole request.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    token: str
    queue: int = 256
    body_bytes: int = 128 << 20
    unpacked_bytes: int = 512 << 20
    step: float = 0.01
    per_object: bool = False
    receive_s: float = 30.0

    @property
    def spool_bytes(self) -> int:
        """What may lie on disk of requests that are not answered yet."""
        return 16 * self.body_bytes


def access_token(file: Path | None) -> tuple[str, bool]:
    """The bearer token of a file, else of the environment, else a new one; whether it is new.

    UsageError for one that is too short.
    """
    try:
        token = file.read_text("utf-8").strip() if file else os.environ.get(TOKEN_VARIABLE, "")
    except (OSError, ValueError) as error:
        raise UsageError(f"the token file {file} cannot be read", found=cause(error)) from error
    if not token and file is None:
        return secrets.token_urlsafe(32), True
    if len(token) < _SHORTEST_TOKEN or not token.isascii() or not token.isprintable():
        raise UsageError(
            "the bearer token cannot be used",
            found=f"{len(token)} characters",
            expected=f"at least {_SHORTEST_TOKEN} printable ASCII characters",
            next_step="python -c 'import secrets; print(secrets.token_urlsafe(32))' makes one",
        )
    return token, False


def require_http(what: str) -> None:
    """InstallationError without the extra that an HTTP server needs. what: such as "view"."""
    extras.require_extra("serve", f"`{what}`", ("starlette", "uvicorn"))
