"""Error codes are in results and in the answers of programs: none changes unnoticed."""

from __future__ import annotations

import importlib
import pkgutil
import re

import pytest

import legoworld
from legoworld.errors import LegoWorldError

#: Codes that are not their class's name in words.
OTHER_NAMES = {
    "AnswerInvalidError": "baseline_answer",
    "ConfigurationMismatchError": "configuration",
    "EnvironmentFailedError": "baseline_environment",
    "FileNotSharedError": "run_folder_not_shared",
    "ImageCrashedError": "baseline_crashed",
    "ImageFailedError": "baseline_image",
    "ImageTimeoutError": "baseline_timeout",
    "JointInvalidError": "invalid_joint",
    "LabelsInvalidError": "invalid_labels",
    "MapInvalidError": "label_map",
    "MapTruthError": "label_map_truth",
    "MapUnseenError": "label_map_unseen",
    "NotShownError": "endpoint_file",
    "OutputFullError": "disk_full",
    "PhotoMissingError": "missing_photo",
    "PlaceError": "url_unreachable",
    "RefusedFileError": "file_refused",
    "ResultMissingError": "missing_result",
    "SceneChangedError": "changed",
    "SceneInvalidError": "invalid_scene",
    "SceneMissingError": "missing_scene",
    "SideFileInvalidError": "invalid_side_file",
    "TrialStoppedError": "stopped",
    "UrdfInvalidError": "invalid_urdf",
}
#: How a row records the error, and the exit code of a command it ends, where not failed and 2.
STATUS_AND_EXIT = {
    ("invalid", 2): """CaseRefused DepthFile DepthPrediction IrregularFile LabelsInvalid MapInvalid
        MissingLibrary NoCamera NoMesh NonFiniteGeometry NormalsPrediction NotFrozen PictureTooLarge
        SceneInvalid SideFileInvalid TiersNotNested UnreadableBlend UnreadableGltf UnsupportedCamera
        UnsupportedGltf UnwritableRecord UrdfInvalid""",
    ("missing", 2): "DepthMissing NormalsMissing PhotoMissing ResultMissing SceneMissing",
    ("timeout", 2): "ImageTimeout ProgramTimeout WorkerTimeout",
    ("changed", 2): "SceneChanged",
    ("no_photo", 2): "NoPhoto",
    ("failed", 4): """BaselineFailed BenchUnseen BlenderNotStarted CacheFolder ClusterUnreachable
        DepthUnseen EngineMissing EnvironmentFailed EvaluatorDisagrees Installation KernelBuild
        LvisMissing MapUnseen NoLocks NormalsUnseen OutputFull Place PortTaken ProcessLost
        SandboxUnavailable""",
    ("failed", 5): "NotAssessed",
}
#: They run in Blender, or are programs.
_NOT_IMPORTED = ("legoworld.scene.blender.", "legoworld.scene.programs.")


def errors(kind: type[LegoWorldError]) -> set[type[LegoWorldError]]:
    return {kind}.union(*(errors(below) for below in kind.__subclasses__()))


@pytest.fixture(scope="module")
def every_error() -> set[type[LegoWorldError]]:
    for module in pkgutil.walk_packages(legoworld.__path__, "legoworld."):
        if not module.name.startswith(_NOT_IMPORTED) and not module.name.endswith(
            ("__main__", "_kernel")
        ):
            importlib.import_module(module.name)
    return {kind for kind in errors(LegoWorldError) if kind.__module__.startswith("legoworld.")}


def test_a_code_is_its_class_in_words(every_error):
    """A class without one of its own is told as the error that it is a case of."""
    own = [kind for kind in every_error - {LegoWorldError} if "code" in vars(kind)]
    words = {
        kind.__name__: re.sub("(?<=.)(?=[A-Z])", "_", kind.__name__.removesuffix("Error")).lower()
        for kind in own
    }
    found = {kind.__name__: kind.code for kind in own}
    assert found == words | OTHER_NAMES


def test_a_status_and_an_exit_code_are_the_class_s_own(every_error):
    expected = {
        f"{name}Error": both for both, names in STATUS_AND_EXIT.items() for name in names.split()
    }
    for kind in every_error:
        assert (kind.status, kind.exit_code) == expected.pop(kind.__name__, ("failed", 2)), kind
    assert not expected


def test_no_two_errors_have_one_code(every_error):
    codes = [kind.code for kind in every_error if "code" in vars(kind)]
    assert len(set(codes)) == len(codes)
