"""Empty places that are reached by a URL: in memory, and in an S3 server on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

#: For a fixture's `params`; S3 needs a server, and is tested where clusters are.
KINDS = ["memory", pytest.param("s3", marks=pytest.mark.cluster)]


@contextmanager
def empty_bucket(kind: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The URL of an empty place of this kind."""
    fsspec = pytest.importorskip("fsspec")
    if kind == "memory":
        fsspec.filesystem("memory").rm("/", recursive=True)
        yield "memory://bucket"
        return
    s3fs = pytest.importorskip("s3fs")
    s3fs.S3FileSystem.clear_instance_cache()  # of another server
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in (
        ("AWS_ACCESS_KEY_ID", "key"),
        ("AWS_SECRET_ACCESS_KEY", "secret"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
        ("AWS_ENDPOINT_URL", f"http://{host}:{port}"),
    ):
        monkeypatch.setenv(name, value)
    system = fsspec.filesystem("s3")
    if system.exists("bucket"):
        system.rm("bucket", recursive=True)
    system.mkdir("bucket")
    try:
        yield "s3://bucket"
    finally:
        server.stop()
