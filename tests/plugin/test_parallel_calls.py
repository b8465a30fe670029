"""Calls that a client sends at once, or cancels: each is answered, one after the other."""

from __future__ import annotations

import threading
import time

import anyio
import pytest
from waiting import until

from legoworld.plugin.case import Case
from legoworld.plugin.ledger import read_ledger
from legoworld.plugin.server import plugin_server
from legoworld.records.plugin_ledger import TransactionLimits

BURST = 17


class Counted:
    """A `diff` that notices another call within it, and writes to the ledger as every tool does."""

    def __init__(self) -> None:
        self.running = self.most = 0
        self.begun, self.free = threading.Event(), threading.Event()

    def __call__(self, case: Case) -> tuple[()]:
        self.running += 1
        self.most = max(self.most, self.running)
        self.begun.set()
        assert self.free.wait(300)
        time.sleep(0)  # another thread may run here
        try:
            case.record("diff", {}, lambda: ())
        finally:
            self.running -= 1
        return ()


@pytest.fixture
def diff(monkeypatch) -> Counted:
    counted = Counted()
    monkeypatch.setattr(Case, "diff", lambda case: counted(case))
    return counted


@pytest.fixture
def case(tmp_path):
    return Case(tmp_path, None, None, TransactionLimits())


@pytest.fixture
def server(case, diff):
    return plugin_server(case, None)


def test_a_burst_of_calls_is_answered_one_by_one(server, diff, tmp_path):
    from mcp import Client

    answers = []

    async def talk() -> None:
        async with Client(server) as client, anyio.create_task_group() as group:

            async def ask() -> None:
                answers.append(await client.call_tool("diff", {}))

            for _ in range(BURST):
                group.start_soon(ask)
            await anyio.to_thread.run_sync(diff.begun.wait)
            diff.free.set()

    anyio.run(talk)
    assert [a.is_error for a in answers] == [False] * BURST
    assert diff.most == 1
    assert [e.seq for e in read_ledger(tmp_path)] == [*range(1, BURST + 1)]


def test_the_call_after_a_cancelled_one_waits_for_its_end(server, case, diff, tmp_path):
    """The cancelled one succeeds in that moment: its client has no answer, so nothing counts."""
    from mcp import Client

    answers = []

    async def talk() -> None:
        async with Client(server) as client, anyio.create_task_group() as group:
            with anyio.CancelScope() as cancelled:

                async def stop() -> None:
                    await anyio.to_thread.run_sync(diff.begun.wait)
                    cancelled.cancel()
                    await anyio.to_thread.run_sync(until, lambda: case.interruption.is_requested)
                    diff.free.set()

                group.start_soon(stop)
                await client.call_tool("diff", {})

            async def ask() -> None:
                answers.append(await client.call_tool("diff", {}))

            group.start_soon(ask)

    anyio.run(talk)
    assert [a.is_error for a in answers] == [False]
    assert diff.most == 1
    first, second = read_ledger(tmp_path)
    assert "the client cancelled the call" in first.error
    assert second.error is None


def test_what_the_system_refuses_is_an_answer_in_words(server, monkeypatch):
    from mcp import Client

    def refused(_case: Case) -> None:
        raise OSError(28, "No space left on device", "ledger.jsonl")

    monkeypatch.setattr(Case, "diff", refused)

    async def talk() -> str:
        async with Client(server) as client:
            result = await client.call_tool("diff", {})
            assert result.is_error
            return result.content[0].text

    said = anyio.run(talk)
    assert "ledger.jsonl; found: No space left on device" in said
