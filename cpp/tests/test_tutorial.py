"""The part of the tutorial that builds the C++ client, installs it and builds a project against it."""

import os
import re
from pathlib import Path

from test_documents import ROOT, follow, page  # noqa: F401


def test_a_reader_who_follows_the_tutorial_has_the_client_and_a_project_of_their_own(page):  # noqa: F811
    """What cpp/check has built stands in for the folder `build`, so that nothing is built twice."""
    run, built = page.run, Path(os.environ["COVIS_CPP_BUILD"]).resolve()
    # By its own path, and the sources by theirs: CMake keeps both.
    page.run = lambda commands, more=None: run(
        re.sub(r"(?<![\w/-])build\b", str(built), commands).replace("covis/cpp", str(ROOT / "cpp")), more
    )
    page.environment |= {"CMAKE_BUILD_TYPE": "Debug", "CXXFLAGS": "-O0"}
    assert follow(page, "tutorial", with_cpp=True) >= 8
