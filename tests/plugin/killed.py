"""A program that makes calls over a ledger and kills itself at one point: killed.py POINT PORT DIR.

Points name the tool and the moment: before its line is written, half-way through it, or after.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

from legoworld.plugin.case import STATES, Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.ledger import LEDGER, Ledger
from legoworld.plugin.live import LiveBlender
from legoworld.records.plugin_ledger import Declaration, TransactionLimits
from legoworld.scene.blender_process import BlenderProcess, Limits

MOVE = Declaration(editable=("Cup",), kinds=("transform",))


def main() -> None:
    """begin, an edit, commit or rollback; never to the end."""
    point, port, folder = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    tool, moment = point.split(":")
    append = Ledger.append

    def dying(self: Ledger, **named: Any) -> Any:
        if named["tool"] != tool:
            return append(self, **named)
        if moment == "half":
            with (folder / LEDGER).open("ab") as stream:
                stream.write(b'{"seq":' + str(len(self.entries) + 1).encode())
        elif moment == "after":
            append(self, **named)
        os.kill(os.getpid(), signal.SIGKILL)
        return None

    Ledger.append = dying  # type: ignore[method-assign]
    (folder / STATES).mkdir(parents=True, exist_ok=True)
    connection = BlenderConnection(Address(port=port))
    with BlenderProcess(Limits()) as reader:
        live = LiveBlender(connection, reader, folder / STATES)
        case = Case(folder, live, None, TransactionLimits())
        case.begin(MOVE)
        connection.run("import bpy; bpy.data.objects['Cup'].location.x += 0.3")
        getattr(case, tool)()


if __name__ == "__main__":
    main()
