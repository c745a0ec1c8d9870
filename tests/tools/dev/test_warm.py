"""What `make setup` compiles ahead is compiled again once any source of it has changed."""

import re
from pathlib import Path

from compilation import PACKAGES

MAKEFILE = Path(__file__).parents[3] / "Makefile"


def test_the_makefile_looks_at_all_sources_that_are_compiled() -> None:
    (looked_at,) = re.findall(
        r"^WARM := .*\$\$\(find ([\w ]+) -name '\*\.py'", MAKEFILE.read_text(), re.MULTILINE
    )
    assert set(looked_at.split()) == set(PACKAGES) - {"tools"}
