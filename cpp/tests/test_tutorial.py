"""The part of the tutorial that builds the C++ client, installs it and builds a project against it."""

import os
from pathlib import Path

from test_documents import follow, page  # noqa: F401


def test_a_reader_who_follows_the_tutorial_has_the_client_and_a_project_of_their_own(page):  # noqa: F811
    """What cpp/check has built stands in for the folder `build`, so that nothing is built twice."""
    (page.folder / "build").symlink_to(Path(os.environ["COVIS_CPP_BUILD"]).absolute())
    page.environment |= {"CMAKE_BUILD_TYPE": "Debug", "CXXFLAGS": "-O0"}
    assert follow(page, "tutorial", with_cpp=True) >= 8
