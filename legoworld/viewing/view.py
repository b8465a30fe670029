"""`view`: serve what is below a folder to a browser on this machine, or to a notebook."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Final

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.bench.admission import require_http
from legoworld.errors import UsageError
from legoworld.workers.scratch import scratch_folder

_CONNECTIONS: Final = 64
_HEIGHT_PX: Final = 720


@dataclass(frozen=True, kw_only=True)
class ViewServer:
    """A server at an address that has its token. run: until `end`, or Ctrl-C."""

    url: str
    run: Callable[[], None]
    end: Callable[[], None]


@dataclass(frozen=True, kw_only=True)
class View:
    """A server that runs until `close()`, or until the process ends. In a notebook it is a frame.

    url: its address, with the token that it answers to.
    """

    url: str
    close: Callable[[], None]

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{escape(self.url)}" width="100%" height="{_HEIGHT_PX}" '
            'style="border: 0" title="legoworld view"></iframe>'
        )


@check_arguments
def view(
    folder: str | Path,
    *,
    photos: str | Path | None = None,
    scene_folders: Sequence[str | Path] = (),
    port: int = 0,
) -> View:
    """Serve the runs, trials, evaluations and comparisons below a folder, also unfinished ones.

    The server listens on 127.0.0.1 alone, answers only addresses with its token, and writes nothing
    below the folder. photos, scene_folders: as `write_report` has them; port: 0 takes a free one.
    InstallationError without the extra `serve`; PortTakenError; UsageError without the folder.
    """
    stack = ExitStack()
    places = [Path(one) for one in scene_folders]
    served = stack.enter_context(serving(Path(folder), optional_path(photos), places, port))
    thread = threading.Thread(target=served.run, daemon=True)
    thread.start()
    stack.callback(thread.join)
    stack.callback(served.end)
    return View(url=served.url, close=stack.close)


@contextmanager
def serving(
    folder: Path, photos: Path | None, scene_folders: Sequence[Path], port: int
) -> Iterator[ViewServer]:
    """A server of a folder that listens and is not run yet; see `view`. UsageError."""
    require_http("view")
    from legoworld.bench.http_server import http_server, listening
    from legoworld.viewing.app import ViewApp
    from legoworld.viewing.pages import Pages
    from legoworld.viewing.watched import Watch

    if not folder.is_dir():
        raise UsageError(
            f"{folder} cannot be watched",
            found="no folder of this name",
            expected="a folder that runs, trials or evaluations are written below",
        )
    token = secrets.token_urlsafe(16)
    with listening("127.0.0.1", port) as listener, scratch_folder("legoworld-view-") as scratch:
        watch = Watch(folder)
        pages = Pages(top=watch.top, scratch=scratch, photos=photos, scene_folders=scene_folders)
        server = http_server(ViewApp(watch, pages, token).asgi(), connections=_CONNECTIONS)
        yield ViewServer(
            url=f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/",
            run=partial(server.run, sockets=[listener]),
            end=partial(setattr, server, "should_exit", True),
        )
