"""One JSON file an image: category id to number of visible instances."""

from collections import Counter

from msgspec.structs import replace

from legoworld.files import canonical_json, sha256_of_file, write_text
from legoworld.readouts.exports import select_exported
from legoworld.readouts.family import ReadoutFamily, answer_file
from legoworld.records.submission import WrittenFile


def write_counts(run, name, counts):
    """Write an image's file below a run; what its row says of it."""
    file = answer_file(name, ".json")
    (run / file).parent.mkdir(parents=True, exist_ok=True)
    write_text(run / file, canonical_json({str(k): n for k, n in sorted(counts.items())}) + "\n")
    return WrittenFile(
        file=file, sha256=sha256_of_file(run / file), bytes=(run / file).stat().st_size
    )


def _write(row, image):
    counts = Counter(i.category.id for i in select_exported(image.instances, image.view))
    return replace(row, answer=write_counts(image.run, image.name, counts))


READOUT = ReadoutFamily(write=_write, sum_up=lambda summary, _rows, _ok: summary)
