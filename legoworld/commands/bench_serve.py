"""`legoworld bench serve`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from legoworld.commands import options
from legoworld.commands.options import flag, option, refuse_given
from legoworld.commands.param_types import COUNT, EXISTING_FILE, EXISTING_FOLDER

if TYPE_CHECKING:
    from legoworld.bench.admission import HttpOptions

_OF_HTTP: Final = (
    "host", "port", "token_file", "queue", "body_limit", "unpacked_limit", "step", "per_object",
)  # fmt: skip


def _http_options(
    http: bool, token_file: Path | None, body_limit: int, unpacked_limit: int, **given: Any
) -> HttpOptions | None:
    if not http:
        refuse_given(_OF_HTTP, "needs --http")
        return None
    from legoworld.bench.admission import HttpOptions, access_token

    token, new = access_token(token_file)
    if new:
        click.echo(f"bearer token of this server: {token}", err=True)
    return HttpOptions(
        token=token, body_bytes=body_limit << 20, unpacked_bytes=unpacked_limit << 20, **given
    )


@click.command("serve")
@click.argument("dataset", type=EXISTING_FOLDER)
@option(
    "--root",
    "Folder that every submission lies below [default: the working folder; with --http: none, so "
    "that only what is sent is scored].",
    EXISTING_FOLDER,
)
@option("--no-render", "R alone: no Cycles render, no integrity facts.")
@flag(
    "--second-card",
    'Answer LEGO-Bench-X, too, where a request\'s "parts" is RX or RAX: whoever may ask often can '
    "search for its private offset.",
)
@flag("--diagnostics", "Compute the diagnostics beside R, too.")
@option("--workers")
@options.cache
@options.limits
@options.together(
    "http",
    _http_options,
    flag("--http", "Serve over HTTP instead; needs the extra `serve`."),
    option("--host", "Address to listen on.", default="127.0.0.1"),
    option("--port", "Port to listen on; 0: any free one.", click.IntRange(0, 65535), default=8000),
    option(
        "--token-file",
        "File of the bearer token [default: LEGOWORLD_SERVE_TOKEN, else a new one is printed].",
        EXISTING_FILE,
    ),
    option("--queue", "Requests taken at once; further ones get 429.", COUNT, default=256),
    option("--body-limit", "Largest body, in MiB.", COUNT, default=128),
    option("--unpacked-limit", "What an archive may unpack to, in MiB.", COUNT, default=512),
    option(
        "--step",
        "Scores are rounded to multiples of this; 0: exact, which shows how each edit changed "
        "the hidden comparison.",
        click.FloatRange(0, 1),
        default=0.01,
    ),
    flag(
        "--per-object",
        "Also answer with each object's exact row, the checks, flags and warnings: reveals names, "
        "categories, sizes and, over many answers, places of the hidden objects.",
    ),
)
def serve_command(dataset: Path, http: HttpOptions | None, **given: Any) -> int:
    """Score submissions as they come: JSON lines on standard input, scores on standard output.

    A request is {"scene": folder, "image_id": number} with an optional "id", which its answer has,
    too; the folder is below --root. An answer has V, R, A, S, the objects' rows and the checks. A
    missing or invalid submission scores zero, with a reason. Every line gets one answer: an invalid
    request gets `refused`, a scoring that failed twice `evaluator_error`, both without numbers.
    Answers come in order of completion. DATASET holds public and private: run this
    where no agent can read it.

    With --http, POST /score takes a .tar, a .zip or a .blend (with ?image_id=N), or a request as
    above where --root is given; POST /rewards takes OpenRLHF's batches; /healthz and /metrics. Each
    request but /healthz has the bearer token. SIGTERM ends the server once all it took is answered.

    \b
    Examples:
      legoworld bench serve bench < requests.jsonl > scores.jsonl
      legoworld bench serve bench --root submissions --no-render --workers 2 < requests.jsonl
      legoworld bench serve bench --http --port 8000 --token-file token --no-render
    """
    from legoworld.api.bench import bench_serve, serve_bench_http
    from legoworld.records.base import canonical

    if http is not None:
        serve_bench_http(dataset, http, lambda text: click.echo(text, err=True), **given)
        return 0
    bench_serve(dataset, sys.stdin.buffer, lambda answer: click.echo(canonical(answer)), **given)
    return 0
